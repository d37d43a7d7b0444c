"""Detection of maneuvers from the innovations of a filter, beside any estimator."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "bank": ["AngleRows", "BankSolution", "EstimatedManeuver", "ManeuverBank"],
    "baselines": ["control_distance", "control_gramian", "cusum"],
    "detection_settings": ["ManeuverDetection"],
    "likelihood_ratio": ["ManeuverEstimates", "ManeuverTest", "planned_information"],
    "factory": ["monitored"],
    "monitored_estimator": ["MonitoredEstimator"],
    "power": ["detectable_impulse", "impulse_bound", "impulse_detection_probability",
        "planned_bound"],
    "recovering_estimator": ["RecoveredManeuvers", "RecoveringEstimator"],
    "search": ["ReachableSearch", "SEARCHING"],
    "thresholds": ["exceedance_probability", "false_alarm_threshold", "threshold_of_schedule",
        "whitened_tests"],
})
# fmt: on
