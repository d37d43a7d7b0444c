"""Figures of searches and sweeps."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "objectives": ["objectives_figure", "tracking_errors"],
    "optimizers": ["convergence_figure", "satellite_front_figure"],
    "sweep": ["sweep_figure"],
})
# fmt: on
