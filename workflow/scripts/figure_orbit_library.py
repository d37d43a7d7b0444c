"""Makes figures/fig02_orbit_library: the candidate observer orbits with the static targets."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.figures.space.library import orbit_library_figure
from cislunar.figures.style import save_figure
from cislunar.runtime.job import job
from cislunar.runtime.netcdf import read_dataset

with job(snakemake.log):
    figure = orbit_library_figure(
        read_dataset(snakemake.input.orbits), read_dataset(snakemake.input.targets)
    )
    save_figure(figure, snakemake.output.png, snakemake.output.pdf)
