"""Makes targets/static_{scenario}.nc: static targets from a table."""

from cislunar.campaign.data.netcdf import write_dataset
from cislunar.campaign.data.own_targets import own_static_dataset
from cislunar.campaign.data.progress import job

with job(snakemake.log[0]):
    scenario = snakemake.wildcards.scenario
    write_dataset(own_static_dataset(snakemake.input[0], scenario), snakemake.output[0])
