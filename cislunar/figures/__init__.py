"""Figures, each drawn from data sets of the campaign."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "benchmark": ["score_figure"],
    "maneuvers": ["maneuver_figure"],
    "style": ["estimator_style", "house_style", "new_figure", "save_figure"],
    "survey": ["catalog_figure"],
})
# fmt: on
