"""Makes orbits/refined_{orbits}.nc: ephemeris-refined orbits."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.campaign.data.refined_orbits import refined_dataset
from cislunar.runtime.job import job
from cislunar.runtime.netcdf import read_dataset, write_dataset
from cislunar.runtime.progress import progress_log

with job(snakemake.log):
    refined = refined_dataset(
        read_dataset(snakemake.input.orbits),
        read_dataset(snakemake.input.bodies),
        snakemake.params.settings,
        progress_log("orbits"),
    )
    write_dataset(refined, snakemake.output[0])
