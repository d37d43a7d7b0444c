"""Makes ephemeris/sun.nc: the Sun and the rotating frame over the horizon, from SPICE."""

from cislunar.campaign.data.inputs import sun_dataset
from cislunar.campaign.data.netcdf import write_dataset
from cislunar.campaign.data.progress import job

with job(snakemake.log[0]):
    write_dataset(sun_dataset(snakemake.params.settings), snakemake.output[0])
