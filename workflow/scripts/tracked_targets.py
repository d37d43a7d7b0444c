"""Makes orbits/tracked.nc: the moving targets of sensor tasking."""

from cislunar.campaign.netcdf import write_dataset
from cislunar.campaign.progress import job, progress_log
from cislunar.campaign.tracking_dataset import tracked_dataset

with job(snakemake.log[0]):
    write_dataset(tracked_dataset(progress_log("targets")), snakemake.output[0])
