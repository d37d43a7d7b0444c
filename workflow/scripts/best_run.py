"""Makes architecture/{scenario}/{method}.nc: the best of several searches, and all results."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.campaign.architectures.search_runs import best_run_dataset
from cislunar.campaign.architectures.visibility import cost_function
from cislunar.runtime.job import job
from cislunar.runtime.netcdf import read_dataset, write_dataset

with job(snakemake.log):
    cost = cost_function(
        read_dataset(snakemake.input.visibility), read_dataset(snakemake.input.orbits)
    )
    best = best_run_dataset(
        [read_dataset(path) for path in snakemake.input.runs],
        snakemake.params.early_stop,
        cost,
    )
    write_dataset(best, snakemake.output[0])
