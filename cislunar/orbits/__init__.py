"""Periodic orbits of the CR3BP: correction, continuation, families, stability."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "branches": ["halo_seed"],
    "catalog": ["CATALOG", "catalog_branch", "end_in_words", "family_named", "periodic_orbits"],
    "continuation": ["continue_branch"],
    "extent": ["CATALOG_EXTENT", "Extent", "KeepOut"],
    "families": ["FAMILIES", "OrbitSet", "concatenate", "observer_library", "spaced_members"],
    "observers": ["SENSOR_COLUMNS", "check_clear", "load_observers", "observer_orbits",
        "orbit_through"],
    "stability": ["stability_index"],
    "station_keeping": ["station_keeping_m_s"],
    "tracked": ["tracked_targets"],
})
# fmt: on
