"""Static targets: missions, zero-velocity surfaces, clustering; tables of user-defined targets;
objects outside of families of periodic orbits; maneuvers of targets."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "clustering": ["DEFAULT_SEEDING", "SEEDINGS", "cluster", "distinct_points"],
    "maneuver_model": ["DrawnManeuvers", "ManeuverModel"],
    "maneuvers": ["MANEUVER_AXES", "ManeuverTable", "Maneuvers", "NO_MANEUVERS", "draw_maneuvers",
        "joined_maneuvers", "load_maneuvers"],
    "missions": ["load_missions"],
    "outside_families": ["objects_outside_families"],
    "sampling": ["SamplingSettings", "sample_zero_velocity"],
    "tables": ["TargetStates", "check_closed_targets", "is_message", "load_target_positions",
        "load_target_states", "replace_targets", "target_states_csv"],
})
# fmt: on
