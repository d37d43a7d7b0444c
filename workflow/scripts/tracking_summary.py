"""Makes task2/summary.nc: statistics over the targets of every cell, seed by seed."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.campaign.settings.cells import campaign_cells
from cislunar.campaign.tracking.summary import read_cell_metrics, summary_dataset
from cislunar.runtime.job import job
from cislunar.runtime.netcdf import write_dataset
from cislunar.runtime.progress import each

with job(snakemake.log):
    settings = snakemake.params.settings
    cells = zip(campaign_cells(settings["task2"]), each(snakemake.input, "cells"), strict=True)
    summary = summary_dataset(
        [(cell, read_cell_metrics(path)) for cell, path in cells],
        settings,
        snakemake.params.seed,
    )
    write_dataset(summary, snakemake.output[0])
