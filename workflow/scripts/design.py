"""Makes architecture/{scenario}/{design}.nc: the best architecture by an objective of its own."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.campaign.architectures.designs import design_dataset
from cislunar.campaign.architectures.objectives import ArchitectureInputs
from cislunar.runtime.job import job
from cislunar.runtime.netcdf import read_dataset, write_dataset
from cislunar.runtime.progress import progress_log

with job(snakemake.log):
    found = design_dataset(
        snakemake.params.design,
        ArchitectureInputs(
            *(read_dataset(snakemake.input[name]) for name in ArchitectureInputs._fields)
        ),
        snakemake.params.settings,
        scenario=snakemake.wildcards.scenario,
        name=snakemake.wildcards.design,
        seed=snakemake.params.seed,
        progress=progress_log("orbits"),
    )
    write_dataset(found, snakemake.output[0])
