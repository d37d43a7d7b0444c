"""Makes figures/fig02_orbit_library: the candidate observer orbits with the static targets."""

from cislunar.campaign.operation.handing_over import in_worker

in_worker()

from cislunar.campaign.data.job import job
from cislunar.campaign.data.netcdf import read_dataset
from cislunar.figures.space.library import orbit_library_figure
from cislunar.figures.style import save_figure

with job(snakemake.log):
    figure = orbit_library_figure(
        read_dataset(snakemake.input.orbits), read_dataset(snakemake.input.targets)
    )
    save_figure(figure, snakemake.output.png, snakemake.output.pdf)
