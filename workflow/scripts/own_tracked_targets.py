"""Makes orbits/tracked_{scenario}.nc: moving targets from a table."""

from cislunar.campaign.netcdf import write_dataset
from cislunar.campaign.own_targets import own_tracked_dataset
from cislunar.campaign.progress import job

with job(snakemake.log[0]):
    write_dataset(own_tracked_dataset(snakemake.input[0]), snakemake.output[0])
