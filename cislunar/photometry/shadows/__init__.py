"""Shadows that the facets of a body cast on each other, tabulated over all directions."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "blocks": ["add_edges", "find_corners", "gather", "make_sight", "resolve_edges", "settle"],
    "table": ["STEPS", "Shadows", "joined_shadows", "no_shadows", "shadow_table"],
})
# fmt: on
