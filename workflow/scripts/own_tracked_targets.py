"""Makes orbits/tracked_{scenario}.nc: moving targets from a table, a catalog or an OEM."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.campaign.data.own_targets import own_tracked_dataset
from cislunar.runtime.job import job
from cislunar.runtime.netcdf import write_dataset

with job(snakemake.log):
    write_dataset(
        own_tracked_dataset(snakemake.input[0], snakemake.params.epoch), snakemake.output[0]
    )
