"""Makes architecture/{scenario}/{design}.nc: the best architecture by an objective of its own."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.campaign.architectures import ArchitectureInputs, design_dataset
from cislunar.runtime import progress_log, read_dataset, write_dataset
from cislunar.runtime.job import job

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
