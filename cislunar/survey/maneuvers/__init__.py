"""Maneuvers and deployments in a catalog of a survey: orbits of one object before and after, lost
orbits, several orbits of one object, and objects next to each other."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "division": ["divided", "overlapping_pairs", "replaced"],
    "duplicates": ["duplicate_orbits"],
    "lineage": ["Lineage", "OrbitPaths", "find_lineage", "orbit_paths"],
    "misses": ["FieldHistory", "Watch", "log_missed"],
    "neighbors": ["NeighborFits", "divided_neighbors"],
    "status": ["CURRENT", "LOST", "ManeuveredOrbits", "SUPERSEDED", "maneuvered_orbits"],
    "within": ["OrbitsWithManeuvers", "maneuvers_within"],
})
# fmt: on
