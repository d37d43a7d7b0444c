"""Figures of sensor tasking and tracking: those of the paper, and both sweeps."""

from cislunar.campaign.tracking.model_errors import plotted_errors
from cislunar.figures.tracking.choice import (
    characterized_cells,
    figure_architectures,
    high_load_cells,
    interval_cells,
    learned_cell,
    selected_cell,
    tasking_variants,
    target_count_cells,
)

# The paper's figures are drawn for every architecture of the sweeps: the first one under the usual
# file name, the others with the name of the architecture appended.
SHOWN = {
    f"_{name}" if number else "": name for number, name in enumerate(figure_architectures(TASK2))
}
COUNT_CELLS = {of: target_count_cells(TASK2, name) for of, name in SHOWN.items()}
INTERVAL_CELLS = {of: interval_cells(TASK2, name) for of, name in SHOWN.items()}
SELECTED_CELL = {of: selected_cell(TASK2, name) for of, name in SHOWN.items()}
LEARNED = learned_cell(TASK2)
CHARACTERIZED = characterized_cells(TASK2)
HIGH_LOAD = {of: high_load_cells(TASK2, name) for of, name in SHOWN.items()}

# Cells may omit the errors over time; figures of single targets are then omitted.
ERRORS_KEPT = "errors" in TASK2["histories"]
# Variables of cells that figures of parameters and bodies do not need.
HISTORIES = ["error", "sigma", "bound", "valid", "outcome"]
# Cells with the shortest and the longest interval, for the errors of one of many targets.
HIGH_LOAD_ENDS = {of: [cells[0], cells[-1]] if cells else [] for of, cells in HIGH_LOAD.items()}


wildcard_constraints:
    of=f"(?:{'|'.join(SHOWN)})",


use rule result as target_counts_figure with:
    input:
        cells=lambda wildcards: [results(cell.path) for cell in COUNT_CELLS[wildcards.of]],
    output:
        **figure_files("fig05_target_counts{of}", "target_counts"),
    log:
        log_of("figures/target_counts{of}"),
        times=benchmark_of("target_counts_figure/figure{of}"),
    params:
        function="figures.tracking.target_counts_figure",
        metrics=True,
        cells=lambda wildcards: list(map(tuple, COUNT_CELLS[wildcards.of])),
    message:
        "Drawing every target by number of targets"


use rule result as selected_targets_figure with:
    input:
        data=lambda wildcards: results(SELECTED_CELL[wildcards.of][0].path),
    output:
        **figure_files("fig06_selected_targets{of}", "selected_targets"),
    log:
        log_of("figures/selected_targets{of}"),
        times=benchmark_of("selected_targets_figure/figure{of}"),
    params:
        function="figures.tracking.selected_targets_figure",
        cell=lambda wildcards: tuple(SELECTED_CELL[wildcards.of][0]),
    message:
        "Drawing the error norms of a few targets"


use rule selected_targets_figure as components_figure with:
    output:
        **figure_files("fig06_components{of}", "components"),
    log:
        log_of("figures/components{of}"),
        times=benchmark_of("components_figure/figure{of}"),
    params:
        function="figures.tracking.components_figure",
    message:
        "Drawing the errors of a few targets by component"


use rule result as intervals_figure with:
    input:
        cells=lambda wildcards: [results(cell.path) for cell in INTERVAL_CELLS[wildcards.of]],
    output:
        **figure_files("fig07_intervals{of}", "intervals"),
    log:
        log_of("figures/intervals{of}"),
        times=benchmark_of("intervals_figure/figure{of}"),
    params:
        function="figures.tracking.intervals_figure",
        metrics=True,
        cells=lambda wildcards: list(map(tuple, INTERVAL_CELLS[wildcards.of])),
    message:
        "Drawing every target by tasking interval"


use rule result as high_load_figure with:
    input:
        cells=lambda wildcards: [results(cell.path) for cell in HIGH_LOAD[wildcards.of]],
    output:
        **figure_files("fig08_intervals_high_load{of}", "intervals_high_load"),
    log:
        log_of("figures/intervals_high_load{of}"),
        times=benchmark_of("high_load_figure/figure{of}"),
    params:
        function="figures.tracking.intervals_figure",
        measures=["anees", "rmse"],
        metrics=True,
        cells=lambda wildcards: list(map(tuple, HIGH_LOAD[wildcards.of])),
    message:
        "Drawing every target by tasking interval, more targets than observers"


use rule result as representative_target_figure with:
    input:
        cells=lambda wildcards: [results(cell.path) for cell in HIGH_LOAD_ENDS[wildcards.of]],
    output:
        **figure_files("fig08_representative_target{of}", "representative_target"),
    log:
        log_of("figures/representative_target{of}"),
        times=benchmark_of("representative_target_figure/figure{of}"),
    params:
        function="figures.tracking.representative_target_figure",
        cells=lambda wildcards: list(map(tuple, HIGH_LOAD_ENDS[wildcards.of])),
    message:
        "Drawing the errors of one target for two tasking intervals"


use rule result as against_targets_figure with:
    input:
        SUMMARY,
    output:
        **figure_files("fig13_tracking_against_targets", "tracking_against_targets"),
    log:
        log_of("figures/tracking_against_targets"),
        times=benchmark_of("against_targets_figure"),
    params:
        function="figures.tracking.against_targets_figure",
    message:
        "Drawing tracking against the number of targets"


use rule against_targets_figure as against_interval_figure with:
    output:
        **figure_files("fig14_tracking_against_interval", "tracking_against_interval"),
    log:
        log_of("figures/tracking_against_interval"),
        times=benchmark_of("against_interval_figure"),
    params:
        function="figures.tracking.against_interval_figure",
    message:
        "Drawing tracking against the tasking interval"


use rule against_targets_figure as estimators_against_targets_figure with:
    output:
        **figure_files("fig16_estimators_against_targets", "estimators_against_targets"),
    log:
        log_of("figures/estimators_against_targets"),
        times=benchmark_of("estimators_against_targets_figure"),
    params:
        by="estimator",
    message:
        "Drawing both estimators against the number of targets"


use rule against_targets_figure as estimators_against_interval_figure with:
    output:
        **figure_files("fig17_estimators_against_interval", "estimators_against_interval"),
    log:
        log_of("figures/estimators_against_interval"),
        times=benchmark_of("estimators_against_interval_figure"),
    params:
        function="figures.tracking.against_interval_figure",
        by="estimator",
    message:
        "Drawing both estimators against the tasking interval"


use rule against_targets_figure as tasking_figure with:
    input:
        compared=rules.tasking_comparison.output[0],
        summary=SUMMARY,
    output:
        **figure_files("fig15_tasking_comparison", "tasking_comparison"),
    log:
        log_of("figures/tasking_comparison"),
        times=benchmark_of("tasking_figure"),
    params:
        function="figures.tracking.tasking_figure",
        variants=tasking_variants(TASK2),
    message:
        "Drawing the comparison of tasking methods"


use rule result as model_error_figure with:
    input:
        rules.model_error_table.output[0],
    output:
        **figure_files("fig18_model_error", "model_error"),
    log:
        log_of("figures/model_error"),
        times=benchmark_of("model_error_figure"),
    params:
        function="figures.tracking.model_error_figure",
    message:
        "Drawing tracking by kind and size of the model error"


use rule model_error_figure as pooled_figure with:
    input:
        rules.pooled_table.output[0],
    output:
        **figure_files("pooled", "pooled"),
    log:
        log_of("figures/pooled"),
        times=benchmark_of("pooled_figure"),
    params:
        function="figures.tracking.pooled_figure",
    message:
        "Drawing the tracking of all targets by number of satellites"


use rule result as characterization_figure with:
    input:
        cells=lambda wildcards: [
            results(cell.path) for cell in CHARACTERIZED[wildcards.characterized]
        ],
    output:
        **figure_files("characterization/{characterized}", "characterization"),
    log:
        log_of("figures/characterization/{characterized}"),
        times=benchmark_of("characterization_figure/{characterized}"),
    params:
        function="figures.tracking.characterization_figure",
        without=HISTORIES,
    message:
        "Drawing the characterization of targets from their light curves"


rule pooled:
    input:
        rules.pooled_table.output,
        rules.pooled_figure.output,
        expand(rules.characterization_figure.output, characterized=CHARACTERIZED),


use rule result as learned_figure with:
    input:
        [results(cell.path) for cell in LEARNED],
    output:
        **figure_files("fig19_learned", "learned"),
    log:
        log_of("figures/learned"),
        times=benchmark_of("learned_figure"),
    params:
        function="figures.tracking.learned_figure",
        without=HISTORIES,
    message:
        "Drawing the body parameters learned from light curves"


use rule result as replay_page with:
    input:
        cell=results(f"replay/{REPLAYED.name}.nc") if REPLAYED else [],
        orbits=orbits_file(REPLAYED.architecture) if REPLAYED else [],
        sun=shared("ephemeris/sun", REPLAYED.scenario) if REPLAYED else [],
    output:
        report(
            results("figures/replay.html"),
            caption="../report/figure_replay.rst",
            category="Figures",
        ),
    log:
        log_of("figures/replay_page"),
        times=benchmark_of("replay_page"),
    params:
        function="figures.replay.cell_page",
    message:
        "Writing the replay of a cell"


rule paper_tracking_figures:
    input:
        expand(rules.target_counts_figure.output, of=[of for of in SHOWN if COUNT_CELLS[of]]),
        expand(
            rules.selected_targets_figure.output + rules.components_figure.output,
            of=[of for of in SHOWN if ERRORS_KEPT and SELECTED_CELL[of]],
        ),
        expand(rules.intervals_figure.output, of=[of for of in SHOWN if INTERVAL_CELLS[of]]),
        expand(rules.high_load_figure.output, of=[of for of in SHOWN if HIGH_LOAD[of]]),
        expand(
            rules.representative_target_figure.output,
            of=[of for of in SHOWN if ERRORS_KEPT and len(HIGH_LOAD[of]) > 1],
        ),


rule tracking_figures:
    input:
        rules.paper_tracking_figures.input,
        rules.against_targets_figure.output if CELLS else [],
        rules.against_interval_figure.output if any(INTERVAL_CELLS.values()) else [],
        rules.estimators_against_targets_figure.output if CELLS else [],
        (rules.estimators_against_interval_figure.output if any(INTERVAL_CELLS.values()) else []),
        rules.tasking_figure.output if COMPARED["scenario"] else [],
        rules.model_error_figure.output if plotted_errors(TASK2) else [],
        rules.learned_figure.output if LEARNED else [],
        rules.replay_page.output if REPLAYED else [],
        expand(rules.characterization_figure.output, characterized=CHARACTERIZED),
        rules.pooled_figure.output if config["task2"]["variants"]["pooled"] else [],
