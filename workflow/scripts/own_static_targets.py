"""Makes targets/static_{scenario}.nc: static targets from a table."""

from cislunar.campaign.operation.handing_over import in_worker

in_worker()

from cislunar.campaign.data.job import job
from cislunar.campaign.data.netcdf import write_dataset
from cislunar.campaign.data.own_targets import own_static_dataset

with job(snakemake.log):
    scenario = snakemake.wildcards.scenario
    write_dataset(own_static_dataset(snakemake.input[0], scenario), snakemake.output[0])
