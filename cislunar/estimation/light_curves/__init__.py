"""Batch estimation of attitude from whole light curves."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "batch_settings": ["BatchSettings"],
    "light_curve": ["cost", "cost_and_derivatives"],
    "row_blocks": ["MAGNITUDE", "RANGE", "SUN", "TIME", "VIEW", "WEIGHT"],
})
# fmt: on
