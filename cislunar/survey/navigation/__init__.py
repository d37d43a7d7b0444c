"""Errors of the observers of a survey: their effect on linking, their calibration, and the paths of
orbits that both need."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "calibration": ["ObserverCalibration", "RemainingErrors", "calibrate", "considered",
        "corrected_angles", "uncalibrated"],
    "paths": ["ObservedPath", "observed_paths"],
})
# fmt: on
