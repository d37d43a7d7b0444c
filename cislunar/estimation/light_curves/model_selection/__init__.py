"""Attitude and characterization of objects whose body may differ from the assumed body."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "characterization": ["AMBIGUOUS", "ATTITUDE_STATUS_NAMES", "Characterization",
        "EstimateInterval", "UNIQUE", "UNKNOWN_BODY", "amplitude_of", "area_albedo_of",
        "attitude_status", "characterize"],
    "correlated": ["ModelError"],
    "in_loop": ["Selection", "parameter_deviations", "report_points", "reported_points",
        "status_of", "updated_selection"],
    "selection": ["select_model"],
    "body_models": ["BODY_MODELS", "SelectedModel"],
    "settings": ["ModelSelectionSettings"],
    "unknown_rotation": ["SpinPeriod", "light_curve_rows", "measured_brightness", "spin_period",
        "unknown_rotation_model"],
})
# fmt: on
