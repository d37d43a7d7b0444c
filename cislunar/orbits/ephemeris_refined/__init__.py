"""CR3BP orbits in ephemeris dynamics: reference tracking by thrust, or ephemeris-refined orbits."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "reference_tracking": ["tracking_cost", "reference_states"],
    "refinement": ["RefinedPath", "path_states", "refined_path"],
})
# fmt: on
