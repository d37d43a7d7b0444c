"""Makes figures/fig01_facet_geometry: the reflection geometry of one facet."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.figures.space.facet import facet_geometry_figure
from cislunar.figures.style import save_figure
from cislunar.runtime.job import job

with job(snakemake.log):
    save_figure(facet_geometry_figure(), snakemake.output.png, snakemake.output.pdf)
