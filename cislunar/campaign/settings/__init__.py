"""The configuration of a campaign: settings, scenarios, variants, sweeps, and their checks."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "cell_settings": ["cell_files", "cell_settings", "observer_sensors", "own_sensors",
        "sensor_change", "true_sensors", "true_settings"],
    "cell_tree": ["CellSettings", "Dynamics", "GroupName", "SensorGroup", "Station", "Tasking"],
    "cells": ["Cell", "FEWEST_RANKED", "PAPER_ARCHITECTURES", "PAPER_FILTER", "campaign_cells",
        "check_cell", "estimator_names", "grid_cells", "most_alike", "paper_cells",
        "unpooled_variant", "variant_cells"],
    "checks": ["check_campaign"],
    "families": ["SweepPoint", "nested", "sweep_points", "swept_cells", "with_families"],
    "library": ["estimator_factory", "family_extent", "loop_settings",
        "nominal_surfaces", "observation_settings", "target_names", "truth_model"],
    "preflight": ["check_inputs", "check_orbits", "check_request", "crowded_objectives"],
    "reading": ["merged", "read_yaml", "typed", "with_types"],
    "scenarios": ["in_study", "information_of", "longest_horizon", "orbits_of", "scenario_settings",
        "shared_dataset", "tracked_count", "tracked_epoch"],
    "schema": ["SCHEMA_FILE", "schema_text", "stated_keys"],
    "tracking_checks": ["require_consistent"],
    "tree": ["Campaign", "Date", "EphemerisSettings", "Orbits", "StatedSurvey", "Targets",
        "Visibility", "survey_label"],
})
# fmt: on
