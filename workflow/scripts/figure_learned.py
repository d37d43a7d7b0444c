"""Makes figures/fig19_learned: what light curves tell of bodies nobody has measured."""

from cislunar.campaign.operation.handing_over import in_worker

in_worker()

from cislunar.campaign.data.job import job
from cislunar.campaign.data.netcdf import read_dataset
from cislunar.figures.style import save_figure
from cislunar.figures.tracking.learned import learned_figure

with job(snakemake.log):
    cell = read_dataset(snakemake.input[0], without=("error", "sigma", "bound", "valid", "fate"))
    save_figure(learned_figure(cell), snakemake.output.png, snakemake.output.pdf)
