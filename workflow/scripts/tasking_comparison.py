"""Makes task2/tasking_comparison.nc: the tasking methods on all compared cells."""

from cislunar.campaign.data.netcdf import read_dataset, write_dataset
from cislunar.campaign.data.progress import job
from cislunar.campaign.tracking.tasking_comparison import gather

with job(snakemake.log[0]):
    write_dataset(gather([read_dataset(path) for path in snakemake.input]), snakemake.output[0])
