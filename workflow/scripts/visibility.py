"""Makes visibility/{scenario}.nc: observations for every orbit, satellite count and target."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.campaign.architectures.visibility import visibility_dataset
from cislunar.runtime.job import job
from cislunar.runtime.netcdf import read_dataset, write_dataset
from cislunar.runtime.progress import progress_log

with job(snakemake.log, snakemake.threads):
    counts = visibility_dataset(
        read_dataset(snakemake.input.orbits),
        read_dataset(snakemake.input.targets),
        read_dataset(snakemake.input.sun),
        snakemake.params.settings,
        snakemake.params.max_satellites,
        progress_log("orbits"),
    )
    write_dataset(counts, snakemake.output[0])
