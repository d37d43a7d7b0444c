"""Makes architecture/{scenario}/fronts/{front}.nc: the best by number of satellites, bounds."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.campaign.architectures import ArchitectureInputs, objective_front_dataset
from cislunar.runtime import progress_log, read_dataset, write_dataset
from cislunar.runtime.job import job

with job(snakemake.log):
    found = objective_front_dataset(
        snakemake.params.front,
        ArchitectureInputs(
            *(read_dataset(snakemake.input[name]) for name in ArchitectureInputs._fields)
        ),
        snakemake.params.settings,
        scenario=snakemake.wildcards.scenario,
        name=snakemake.wildcards.front,
        seed=snakemake.params.seed,
        progress=progress_log("orbits"),
    )
    write_dataset(found, snakemake.output[0])
