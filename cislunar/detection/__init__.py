"""Detections without identity: exposures of telescopes, false alarms, tables of detections."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "exposures": ["Detections", "Exposures", "FALSE_ALARM", "boresight_vectors", "expose",
        "point_at", "tangent_offset"],
    "process": ["DetectionProcess"],
    "tables": ["DETECTION_COLUMNS", "EXPOSURE_COLUMNS", "detection_table",
        "direction_errors", "exposure_table", "icrf_directions", "read_detections"],
})
# fmt: on
