"""Makes ephemeris/bodies.nc: Earth, Moon and Sun over the horizon, from SPICE."""

from cislunar.campaign.operation.handing_over import in_worker

in_worker()

from cislunar.campaign.data.inputs import bodies_dataset
from cislunar.campaign.data.job import job
from cislunar.campaign.data.netcdf import write_dataset

with job(snakemake.log):
    write_dataset(bodies_dataset(snakemake.params.settings), snakemake.output[0])
