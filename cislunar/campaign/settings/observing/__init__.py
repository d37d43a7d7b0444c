"""Settings of the observers: their telescopes, and the places of ground stations."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "sensor_tree": ["GroupName", "SensorGroup", "Station"],
    "sensors": ["observer_sensors", "own_sensors", "sensor_change", "true_sensors"],
})
# fmt: on
