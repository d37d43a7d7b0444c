"""Makes orbits/tracked.nc: the moving targets of sensor tasking."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.campaign.tracking.dataset import tracked_dataset
from cislunar.runtime.job import job
from cislunar.runtime.netcdf import write_dataset
from cislunar.runtime.progress import progress_log

with job(snakemake.log):
    write_dataset(tracked_dataset(progress_log("targets")), snakemake.output[0])
