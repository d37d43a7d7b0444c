"""Makes figures/fig05_target_counts, fig07_intervals, fig08_intervals_high_load: every target."""

from cislunar.campaign.operation.handing_over import in_worker

in_worker()

from cislunar.campaign.data.job import job
from cislunar.campaign.data.progress import each
from cislunar.campaign.settings.cells import Cell
from cislunar.campaign.tracking.summary import read_cell_metrics
from cislunar.figures.style import save_figure
from cislunar.figures.tracking.heatmaps import (
    high_load_figure,
    intervals_figure,
    target_counts_figure,
)

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
