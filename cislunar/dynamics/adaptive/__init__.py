"""Adaptive integrators of a single trajectory and of many trajectories in parallel lanes."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "lanes": ["Jobs", "OfMatrices", "OfStates", "integrate_many"],
    "runge_kutta": ["DOP853", "DOPRI5", "MAX_STEPS", "OK", "STEP_UNDERFLOW", "integrate"],
})
# fmt: on
