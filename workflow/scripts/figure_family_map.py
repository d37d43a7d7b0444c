"""Makes figures/fig12_family_map: family members by Jacobi constant, period and stability."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.figures.space.library import family_map_figure
from cislunar.figures.style import save_figure
from cislunar.runtime.job import job
from cislunar.runtime.netcdf import read_dataset

with job(snakemake.log):
    figure = family_map_figure(read_dataset(snakemake.input.orbits))
    save_figure(figure, snakemake.output.png, snakemake.output.pdf)
