"""Makes architecture/{scenario}/{method}.nc: the best of several searches, and their spread."""

from cislunar.campaign.architectures.search_runs import best_run_dataset
from cislunar.campaign.architectures.visibility import cost_function
from cislunar.campaign.data.netcdf import read_dataset, write_dataset
from cislunar.campaign.data.progress import job

with job(snakemake.log[0]):
    cost = cost_function(
        read_dataset(snakemake.input.visibility), read_dataset(snakemake.input.orbits)
    )
    best = best_run_dataset(
        [read_dataset(path) for path in snakemake.input.runs],
        snakemake.params.early_stop,
        cost,
    )
    write_dataset(best, snakemake.output[0])
