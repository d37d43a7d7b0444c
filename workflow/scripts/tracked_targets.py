"""Makes orbits/tracked.nc: the moving targets of sensor tasking."""

from cislunar.campaign.data.netcdf import write_dataset
from cislunar.campaign.data.progress import job, progress_log
from cislunar.campaign.tracking.dataset import tracked_dataset

with job(snakemake.log[0]):
    write_dataset(tracked_dataset(progress_log("targets")), snakemake.output[0])
