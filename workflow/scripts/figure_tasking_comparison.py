"""Makes figures/fig15_tasking_comparison: TPE, random search, greedy and exact tasking."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.figures.style import save_figure
from cislunar.figures.tracking.tasking import tasking_figure
from cislunar.runtime.job import job
from cislunar.runtime.netcdf import read_dataset

with job(snakemake.log):
    figure = tasking_figure(
        read_dataset(snakemake.input.compared),
        read_dataset(snakemake.input.summary),
        snakemake.params.variants,
    )
    save_figure(figure, snakemake.output.png, snakemake.output.pdf)
