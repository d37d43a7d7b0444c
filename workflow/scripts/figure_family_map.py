"""Makes figures/fig12_family_map: family members by Jacobi constant, period and stability."""

from cislunar.campaign.data.netcdf import read_dataset
from cislunar.campaign.data.progress import job
from cislunar.figures.space.library import family_map_figure
from cislunar.figures.style import save_figure

with job(snakemake.log[0]):
    figure = family_map_figure(read_dataset(snakemake.input.orbits))
    save_figure(figure, snakemake.output.png, snakemake.output.pdf)
