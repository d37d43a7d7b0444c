"""Metrics of estimates, and the Cramer-Rao bound."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "characterization": ["CHARACTERIZED_FIELDS", "CharacterizedTargets", "INTERVAL_PARTS",
        "characterized_targets", "spin_axis_error_deg", "within_intervals"],
    "cramer_rao": ["CramerRaoBound"],
    "custody": ["Custody", "attitude_angle_deg", "rotation_vectors_deg"],
    "gospa": ["CatalogQuality", "FALSE_ALARM", "Gospa", "catalog_quality"],
    "intervals": ["CONFIDENCE", "GEOMETRIC_MEANS", "Interval", "SPANS_DECADES", "contrast_interval",
        "count_interval", "group_means", "interval_of", "log_interval", "prediction_interval",
        "share_interval", "t_interval"],
    "metrics": ["BOUND_SIGMAS", "Evaluation", "FINAL_HOURS", "INCONSISTENT", "NEVER_OBSERVED",
        "NOMINAL_COVERAGE", "PARTS", "TARGET_STATUS_NAMES", "TRACKED", "TrackingMetrics"],
})
# fmt: on
