"""Makes task2/tasking_comparison.nc: the tasking methods on all compared cells."""

from cislunar.campaign.operation.handing_over import in_worker

in_worker()

from cislunar.campaign.data.job import job
from cislunar.campaign.data.netcdf import read_dataset, write_dataset
from cislunar.campaign.tracking.tasking_comparison import gather

with job(snakemake.log):
    write_dataset(gather([read_dataset(path) for path in snakemake.input]), snakemake.output[0])
