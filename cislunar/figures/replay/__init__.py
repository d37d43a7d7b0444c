"""Replay of tracking: a page of observers, exposures, detections and tracks in time."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "page": ["Replay", "ReplayDetections", "ReplayFact", "ReplayManeuver", "replay_page"],
    "tracking_cell": ["cell_page", "cell_replay"],
})
# fmt: on
