"""Makes architecture/{scenario}/runs/{method}_{labels}_{run}.nc: one Hyperopt search."""

from cislunar.campaign.architectures.search_runs import search_run_dataset
from cislunar.campaign.architectures.visibility import cost_function
from cislunar.campaign.data.netcdf import read_dataset, write_dataset
from cislunar.campaign.data.progress import job

with job(snakemake.log[0]):
    visibility = read_dataset(snakemake.input.visibility)
    run = search_run_dataset(
        cost_function(visibility, read_dataset(snakemake.input.orbits)),
        visibility,
        scenario=snakemake.wildcards.scenario,
        method=snakemake.wildcards.method,
        labels=snakemake.wildcards.labels,
        run=int(snakemake.wildcards.run),
        seed=snakemake.params.seed,
        slots=snakemake.params.slots,
        max_evaluations=snakemake.params.max_evaluations,
        early_stop=snakemake.params.early_stop,
        sampler=snakemake.params.sampler,
    )
    write_dataset(run, snakemake.output[0])
