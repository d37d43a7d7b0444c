"""Makes architecture/{scenario}/published.nc: the paper's architecture, members chosen by J."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.campaign.architectures.published import published_dataset
from cislunar.campaign.architectures.visibility import cost_function
from cislunar.runtime.job import job
from cislunar.runtime.netcdf import read_dataset, write_dataset

with job(snakemake.log):
    visibility = read_dataset(snakemake.input.visibility)
    published = published_dataset(
        cost_function(visibility, read_dataset(snakemake.input.orbits)),
        visibility,
        scenario=snakemake.wildcards.scenario,
        seed=snakemake.params.seed,
        restarts=snakemake.params.restarts,
    )
    write_dataset(published, snakemake.output[0])
