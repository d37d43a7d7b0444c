"""Makes architecture/{scenario}/runs/{method}_{labels}_{run}.nc: one Hyperopt search."""

from cislunar.campaign.kernels import kernel_set
from cislunar.runtime.worker_client import in_worker

in_worker(kernel_set("search"))

from cislunar.campaign.architectures.search_runs import search_run_dataset
from cislunar.campaign.architectures.visibility import cost_function
from cislunar.runtime.job import job
from cislunar.runtime.netcdf import read_dataset, write_dataset

with job(snakemake.log):
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
