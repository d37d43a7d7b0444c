"""Figures of orbits, architectures and targets in space."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "architectures": ["selected_orbits_figure"],
    "facet": ["facet_geometry_figure"],
    "geometry": ["geometry_figure"],
    "library": ["family_map_figure", "orbit_library_figure"],
    "orbits_page_layout": ["VIEWS", "scene_layout"],
    "page": ["body_traces", "page_html"],
})
# fmt: on
