"""Figures of tasking and tracking."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "association": ["association_figure"],
    "choice": ["characterized_cells", "figure_architectures", "high_load_cells", "interval_cells",
        "learned_cell", "selected_cell", "target_count_cells", "tasking_variants"],
    "errors": ["components_figure", "error_norms_figure", "selected_targets_figure"],
    "heatmaps": ["intervals_figure", "target_counts_figure"],
    "learned": ["characterization_figure", "learned_figure"],
    "model_error": ["model_error_figure"],
    "pooled": ["pooled_figure"],
    "representative": ["representative_target_figure"],
    "single_run": ["light_curve_figure", "residuals_figure", "run_errors_figure",
        "schedule_figure"],
    "tasking": ["tasking_figure"],
    "trends": ["against_interval_figure", "against_targets_figure"],
})
# fmt: on
