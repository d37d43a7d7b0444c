"""Makes figures/fig08_representative_target: one target's errors with two tasking intervals."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.campaign.settings.cells import Cell
from cislunar.figures.style import save_figure
from cislunar.figures.tracking.representative import representative_target_figure
from cislunar.runtime import each, read_dataset
from cislunar.runtime.job import job

with job(snakemake.log):
    found = zip(snakemake.params.cells, each(snakemake.input, "cells"), strict=True)
    figure = representative_target_figure({Cell(*cell): read_dataset(path) for cell, path in found})
    save_figure(figure, snakemake.output.png, snakemake.output.pdf)
