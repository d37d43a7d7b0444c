"""Makes figures/fig02_orbit_library: the candidate observer orbits with the static targets."""

from cislunar.campaign.data.netcdf import read_dataset
from cislunar.campaign.data.progress import job
from cislunar.figures.space.library import orbit_library_figure
from cislunar.figures.style import save_figure

with job(snakemake.log[0]):
    figure = orbit_library_figure(
        read_dataset(snakemake.input.orbits), read_dataset(snakemake.input.targets)
    )
    save_figure(figure, snakemake.output.png, snakemake.output.pdf)
