"""Makes task2/summary.nc: statistics over the targets of every cell, seed by seed."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.campaign.settings.cells import Cell
from cislunar.campaign.tracking.summary import read_cell_metrics, summary_dataset
from cislunar.runtime import each, write_dataset
from cislunar.runtime.job import job

with job(snakemake.log):
    cells = [Cell(*labels) for labels in snakemake.params.cells]
    read = each(snakemake.input, "cells")
    summary = summary_dataset(
        [(cell, read_cell_metrics(path)) for cell, path in zip(cells, read, strict=True)],
        snakemake.params.settings,
        snakemake.params.seed,
    )
    write_dataset(summary, snakemake.output[0])
