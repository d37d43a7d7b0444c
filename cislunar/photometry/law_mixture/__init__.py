"""Reflection laws between Cook-Torrance, Lambert-Phong and Lommel-Seeliger."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "blocks": ["COOK_TORRANCE", "add_mixed_facet", "add_phase_terms", "clear_mixture",
               "phase_magnitude", "phase_terms"],
})
# fmt: on
