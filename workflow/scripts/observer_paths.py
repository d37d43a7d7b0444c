"""Makes orbits/paths.nc: positions of observers in ephemeris dynamics."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.campaign.data.refined_orbits import paths_dataset
from cislunar.runtime.job import job
from cislunar.runtime.netcdf import read_dataset, write_dataset
from cislunar.runtime.progress import progress_log

with job(snakemake.log):
    paths = paths_dataset(
        read_dataset(snakemake.input.orbits),
        read_dataset(snakemake.input.bodies),
        snakemake.params.settings,
        snakemake.params.max_satellites,
        progress_log("orbits"),
    )
    write_dataset(paths, snakemake.output[0])
