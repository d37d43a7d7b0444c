"""Association of detections with tracks: candidates, gates, likelihoods, and interchangeable
methods."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "candidates": ["Expectation", "find_candidates"],
    "likelihood": ["gate_threshold", "gaussian_log_likelihood"],
    "maneuvered": ["associate_maneuvered", "reachable"],
    "methods": ["associate"],
    "model": ["ASSOCIATORS", "AssociationModel", "MULTIPLE_FRAMES", "KNOWN"],
    "multiple_frames": ["associate_frames", "set_packing"],
    "nearest_neighbor": ["best_pairs", "nearest_neighbor"],
    "probabilistic": ["equivalent_direction", "joint_probabilities", "marginals"],
    "tracks": ["CONFIRMED", "DELETED", "LOST", "TRACK_STATUS_NAMES", "TENTATIVE", "TrackStatus",
        "known_tracks"],
    "window": ["Association", "Window", "clusters"],
})
# fmt: on
