"""Makes figures/fig19_learned: what light curves tell about body parameters."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.figures.style import save_figure
from cislunar.figures.tracking.learned import learned_figure
from cislunar.runtime.job import job
from cislunar.runtime.netcdf import read_dataset

with job(snakemake.log):
    cell = read_dataset(snakemake.input[0], without=("error", "sigma", "bound", "valid", "outcome"))
    save_figure(learned_figure(cell), snakemake.output.png, snakemake.output.pdf)
