"""Information about moving targets: tables, objectives, greedy and local search, certified
bound."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "brightness": ["squared_detection_ranges"],
    "certificate": ["certify_information"],
    "objective": ["InformationObjective"],
    "tables": ["InformationTables", "ObservationSettings", "attitude_information", "moving_targets",
        "orbit_information", "windows_of"],
})
# fmt: on
