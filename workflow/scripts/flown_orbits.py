"""Makes orbits/flown_{scenario}_{architecture}.nc: ephemeris-refined orbits of its satellites."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.campaign.tracking.ephemeris_inputs import flown_dataset
from cislunar.runtime.job import job
from cislunar.runtime.netcdf import read_dataset, write_dataset
from cislunar.runtime.progress import progress_log

with job(snakemake.log):
    files = snakemake.input
    flown = flown_dataset(
        *(read_dataset(path) for path in (files.architecture, files.orbits, files.bodies)),
        snakemake.params.settings,
        progress_log("satellites"),
    )
    write_dataset(flown, snakemake.output[0])
