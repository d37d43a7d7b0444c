"""Makes ephemeris/sun.nc: the Sun and the rotating frame over the horizon, from SPICE."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.campaign.data.inputs import sun_dataset
from cislunar.runtime.job import job
from cislunar.runtime.netcdf import write_dataset

with job(snakemake.log):
    write_dataset(sun_dataset(snakemake.params.settings), snakemake.output[0])
