"""Observer architectures: objectives such as the paper's J, searches, and proofs of optimality."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "certified": ["Choice", "ObjectiveCertificate"],
    "coordinate_search": ["MultiStartResult", "random_start", "satellite_front"],
    "cost": ["CostFunction"],
    "cost_kernels": ["cost_factors"],
    "hyperopt_search": ["stopping_evaluation"],
    "objective": ["Objective", "first_best"],
    "orbit_slots": ["OrbitSlots", "free_orbit_slots", "orbit_slots_at", "satellite_orbit_slots",
        "steady_orbits"],
    "published": ["PUBLISHED", "PUBLISHED_COST", "choose_members", "random_member_values"],
    "tables": ["ArchitectureTables"],
})
# fmt: on
