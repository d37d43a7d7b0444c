"""Makes figures/fig12_family_map: family members by Jacobi constant, period and stability."""

from cislunar.campaign.operation.handing_over import in_worker

in_worker()

from cislunar.campaign.data.job import job
from cislunar.campaign.data.netcdf import read_dataset
from cislunar.figures.space.library import family_map_figure
from cislunar.figures.style import save_figure

with job(snakemake.log):
    figure = family_map_figure(read_dataset(snakemake.input.orbits))
    save_figure(figure, snakemake.output.png, snakemake.output.pdf)
