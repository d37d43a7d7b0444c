"""Makes architecture/{scenario}/{observers}.nc: observers of one's own as an architecture."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.campaign.architectures.own import own_dataset
from cislunar.campaign.architectures.visibility import cost_function
from cislunar.runtime.job import job
from cislunar.runtime.netcdf import read_dataset, write_dataset

with job(snakemake.log):
    visibility = read_dataset(snakemake.input.visibility)
    own = own_dataset(
        cost_function(visibility, read_dataset(snakemake.input.orbits)),
        visibility,
        scenario=snakemake.wildcards.scenario,
        name=snakemake.wildcards.observers,
    )
    write_dataset(own, snakemake.output[0])
