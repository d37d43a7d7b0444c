"""Proof of the largest value: branch and bound for any objective, bounds and relaxation of J."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "certificate": ["certify"],
    "knapsack": ["NO_CHOICE", "best_choice", "conditional_bests"],
    "prescribed": ["certify_total"],
})
# fmt: on
