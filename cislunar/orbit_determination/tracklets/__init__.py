"""Tracklets: their settings, their formation from detections, and their directions and rates."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "fits": ["Attributables", "attributables"],
    "formation": ["form_tracklets"],
    "settings": ["TrackletSettings"],
})
# fmt: on
