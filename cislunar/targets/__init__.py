"""Static targets: missions, zero-velocity surfaces, clustering; tables of user-defined targets;
objects outside of families of periodic orbits."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "audit": ["audit_centers"],
    "clustering": ["DEFAULT_SEEDING", "SEEDINGS", "cluster", "distinct_points"],
    "missions": ["load_missions"],
    "outside_families": ["objects_outside_families"],
    "sampling": ["SamplingSettings", "sample_zero_velocity"],
    "tables": ["TargetStates", "check_closed_targets", "is_message", "load_target_positions",
        "load_target_states", "replace_targets", "target_states_csv"],
})
# fmt: on
