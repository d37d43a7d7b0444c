"""Makes figures/fig15_tasking_comparison: TPE, random search, greedy and exact tasking."""

from cislunar.campaign.operation.handing_over import in_worker

in_worker()

from cislunar.campaign.data.job import job
from cislunar.campaign.data.netcdf import read_dataset
from cislunar.figures.style import save_figure
from cislunar.figures.tracking.tasking import tasking_figure

with job(snakemake.log):
    figure = tasking_figure(
        read_dataset(snakemake.input.compared),
        read_dataset(snakemake.input.summary),
        snakemake.params.variants,
    )
    save_figure(figure, snakemake.output.png, snakemake.output.pdf)
