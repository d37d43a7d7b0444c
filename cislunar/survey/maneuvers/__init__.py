"""Maneuvers in a catalog of a survey: orbits of one object before and after, and lost orbits."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "division": ["divided", "overlapping_pairs", "replaced"],
    "lineage": ["Lineage", "OrbitPaths", "find_lineage", "orbit_paths"],
    "misses": ["FieldHistory", "Watch", "log_missed"],
    "status": ["CURRENT", "LOST", "ManeuveredOrbits", "SUPERSEDED", "maneuvered_orbits"],
    "within": ["maneuvers_within"],
})
# fmt: on
