"""Makes targets/static_{scenario}.nc: static targets from a table."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.campaign.data.own_targets import own_static_dataset
from cislunar.runtime.job import job
from cislunar.runtime.netcdf import write_dataset

with job(snakemake.log):
    scenario = snakemake.wildcards.scenario
    write_dataset(own_static_dataset(snakemake.input[0], scenario), snakemake.output[0])
