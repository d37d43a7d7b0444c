"""Figures of targets that maneuver."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "recovery": ["maneuver_figure"],
})
# fmt: on
