"""Data sets of the campaign's inputs: ephemeris, orbits and targets."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "inputs": ["COMPONENTS", "bodies_dataset", "body_table", "families_dataset", "horizon",
        "orbit_set_dataset", "static_targets_dataset", "sun_at", "sun_dataset", "variables",
        "zvs_points_dataset"],
    "own_targets": ["objects_dataset", "own_observers_dataset", "own_static_dataset",
        "own_tracked_dataset"],
    "refined_orbits": ["forces_of", "forces_on_observers", "horizon_days", "observer_states",
        "paths_dataset", "refined_dataset", "refined_rows"],
})
# fmt: on
