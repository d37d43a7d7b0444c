"""Makes figures/fig13, fig14 (architectures compared), fig16 and fig17 (estimators compared)."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.figures.style import save_figure
from cislunar.figures.tracking.trends import against_interval_figure, against_targets_figure
from cislunar.runtime.job import job
from cislunar.runtime.netcdf import read_dataset

with job(snakemake.log):
    draw = {"targets": against_targets_figure, "interval": against_interval_figure}
    figure = draw[snakemake.params.along](read_dataset(snakemake.input[0]), snakemake.params.by)
    save_figure(figure, snakemake.output.png, snakemake.output.pdf)
