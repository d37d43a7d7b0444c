"""Makes ephemeris/bodies.nc: Earth, Moon and Sun over the horizon, from SPICE."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.campaign.data.inputs import bodies_dataset
from cislunar.runtime.job import job
from cislunar.runtime.netcdf import write_dataset

with job(snakemake.log):
    write_dataset(bodies_dataset(snakemake.params.settings), snakemake.output[0])
