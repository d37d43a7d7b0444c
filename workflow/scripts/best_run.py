"""Makes architecture/{scenario}/{method}.nc: the best of several searches, and their spread."""

from cislunar.architecture.cost import CostFunction
from cislunar.campaign.architectures.observability import architecture_tables
from cislunar.campaign.architectures.optimization import best_run_dataset
from cislunar.campaign.data.netcdf import read_dataset, write_dataset
from cislunar.campaign.data.progress import job

with job(snakemake.log[0]):
    tables = architecture_tables(
        read_dataset(snakemake.input.visibility), read_dataset(snakemake.input.orbits)
    )
    best = best_run_dataset(
        [read_dataset(path) for path in snakemake.input.runs],
        snakemake.params.early_stop,
        CostFunction(tables),
    )
    write_dataset(best, snakemake.output[0])
