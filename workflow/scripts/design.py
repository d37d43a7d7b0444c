"""Makes architecture/{scenario}/{design}.nc: the best architecture by an objective of its own."""

from cislunar.campaign.operation.handing_over import in_worker

in_worker()

from cislunar.campaign.architectures.designs import design_dataset
from cislunar.campaign.architectures.goals import World
from cislunar.campaign.data.job import job
from cislunar.campaign.data.netcdf import read_dataset, write_dataset
from cislunar.campaign.data.progress import progress_log

with job(snakemake.log):
    found = design_dataset(
        snakemake.params.design,
        World(*(read_dataset(snakemake.input[name]) for name in World._fields)),
        snakemake.params.settings,
        scenario=snakemake.wildcards.scenario,
        name=snakemake.wildcards.design,
        seed=snakemake.params.seed,
        progress=progress_log("orbits"),
    )
    write_dataset(found, snakemake.output[0])
