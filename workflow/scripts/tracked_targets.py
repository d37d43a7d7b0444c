"""Makes orbits/tracked.nc: the moving targets of sensor tasking."""

from cislunar.campaign.operation.handing_over import in_worker

in_worker()

from cislunar.campaign.data.job import job
from cislunar.campaign.data.netcdf import write_dataset
from cislunar.campaign.data.progress import progress_log
from cislunar.campaign.tracking.dataset import tracked_dataset

with job(snakemake.log):
    write_dataset(tracked_dataset(progress_log("targets")), snakemake.output[0])
