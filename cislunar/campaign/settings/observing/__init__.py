"""Settings of the observers: their telescopes, and the places of ground stations."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "sensor_tree": ["Exclusion", "GroupName", "Sensor", "SensorGroup", "Station"],
    "sensors": ["exclusion", "observer_sensors", "own_sensors", "sensor", "true_sensors"],
})
# fmt: on
