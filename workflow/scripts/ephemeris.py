"""Makes ephemeris/sun.nc: the Sun and the rotating frame over the horizon, from SPICE."""

from cislunar.campaign.inputs import sun_dataset
from cislunar.campaign.netcdf import write_dataset
from cislunar.campaign.progress import job

with job(snakemake.log[0]):
    write_dataset(sun_dataset(snakemake.params.settings), snakemake.output[0])
