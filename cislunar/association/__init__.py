"""Association of detections with tracks: gates, likelihoods, and three interchangeable methods."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "likelihood": ["gate_threshold", "gaussian_log_likelihood", "log_ratio"],
    "multiple_frames": ["associate_frames"],
    "probabilistic": ["joint_probabilities"],
    "window": ["Association", "Window"],
})
# fmt: on
