"""Cells of tasking and tracking: their data sets, statistics and tables."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "cell": ["CellInputs", "Placement", "Problem", "cell_ephemeris", "cell_loop", "read_inputs",
        "realization_seeds", "scene_times", "target_labels", "cell_problem"],
    "checkpoint": ["Checkpoint"],
    "comparisons": ["certain", "non_inferiority", "paired", "pairs_interval", "slopes"],
    "dataset": ["SETTING_KEYS", "cell_dataset", "tracked_dataset", "write_cell"],
    "ephemeris_inputs": ["CellEphemeris", "assumed_forces", "ephemeris_scene", "flown_dataset",
        "observer_tracks"],
    "maneuvers": ["cell_maneuvers"],
    "model_errors": ["NONE", "plotted_errors"],
    "realizations": ["CELL", "PRACTICAL_UNITS", "cells_of", "read_cells", "select",
        "usual_interval", "values_of"],
    "records": ["EPHEMERIS_FRAME", "FrameOfCell", "RECORD_COORDINATES", "ROTATING",
        "cell_arcs", "cell_attitudes", "cell_observations", "cell_observer_arcs", "frame_epoch",
        "frame_of", "is_ephemeris", "measured_directions", "observer_names",
        "observer_variables", "recorded_names",
        "require_records"],
    "summary": ["BRIGHT_ROWS", "characterized_in", "read_cell_metrics", "summary_dataset"],
    "sweep_table": ["architecture_values", "plotted_values", "sweep_rows"],
    "tables": ["estimator_rows", "model_error_rows", "pooled_rows", "rank_rows", "reading_rows",
        "tracking_rows"],
    "tasking_comparison": ["compared_dataset", "concatenate_comparisons"],
})
# fmt: on
