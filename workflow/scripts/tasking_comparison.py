"""Makes task2/tasking_comparison.nc: all compared cells in one data set."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.campaign.tracking.tasking_comparison import concatenate_comparisons
from cislunar.runtime.job import job
from cislunar.runtime.netcdf import read_dataset, write_dataset

with job(snakemake.log):
    write_dataset(
        concatenate_comparisons([read_dataset(path) for path in snakemake.input]),
        snakemake.output[0],
    )
