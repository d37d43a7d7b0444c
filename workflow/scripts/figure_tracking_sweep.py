"""Makes figures/fig13, fig14 (both sweeps), fig16 and fig17 (both sweeps by both estimators)."""

from cislunar.campaign.data.netcdf import read_dataset
from cislunar.campaign.data.progress import job
from cislunar.figures.style import save_figure
from cislunar.figures.tracking.estimators import (
    estimators_against_interval_figure,
    estimators_against_targets_figure,
)
from cislunar.figures.tracking.sweeps import against_interval_figure, against_targets_figure

with job(snakemake.log[0]):
    draw = {
        "targets": against_targets_figure,
        "interval": against_interval_figure,
        "targets, estimators": estimators_against_targets_figure,
        "interval, estimators": estimators_against_interval_figure,
    }
    figure = draw[snakemake.params.along](read_dataset(snakemake.input[0]))
    save_figure(figure, snakemake.output.png, snakemake.output.pdf)
