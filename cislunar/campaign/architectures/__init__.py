"""Data sets and tables of observer architectures."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "designs": ["design_dataset", "objective_front_dataset"],
    "exact": ["exact_dataset", "front_dataset"],
    "generalization": ["generalization_rows"],
    "given": ["own_dataset", "published_dataset"],
    "moving": ["MovingTargets"],
    "objectives": ["ArchitectureInputs", "check_orbit_slots"],
    "objectives_table": ["front_architectures", "objective_row", "single_architecture"],
    "search_runs": ["best_run_dataset", "label_rows", "search_run_dataset"],
    "table2": ["architecture_rows", "near_optimal_rows"],
    "variables": ["phases_of"],
    "visibility": ["architecture_coverage", "cost_function", "visibility_dataset"],
})
# fmt: on
