"""Makes figures/fig05_target_counts, fig07_intervals and fig08_intervals_high_load: heat maps."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.campaign.settings.cells import Cell
from cislunar.campaign.tracking.summary import read_cell_metrics
from cislunar.figures.style import save_figure
from cislunar.figures.tracking.heatmaps import (
    high_load_figure,
    intervals_figure,
    target_counts_figure,
)
from cislunar.runtime import each
from cislunar.runtime.job import job

with job(snakemake.log):
    files = each(snakemake.input, "cells")
    columns = [
        {Cell(*cell): read_cell_metrics(next(files)) for cell in column}
        for column in snakemake.params.columns
    ]
    draw = {
        "targets": target_counts_figure,
        "interval": intervals_figure,
        "high load": high_load_figure,
    }
    figure = draw[snakemake.params.along](columns)
    save_figure(figure, snakemake.output.png, snakemake.output.pdf)
