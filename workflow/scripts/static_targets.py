"""Makes targets/static_{scenario}.nc: the sampled points clustered to static targets."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.campaign.data.inputs import static_targets_dataset
from cislunar.runtime.job import job
from cislunar.runtime.netcdf import read_dataset, write_dataset

with job(snakemake.log):
    targets = static_targets_dataset(
        read_dataset(snakemake.input[0]),
        snakemake.wildcards.scenario,
        snakemake.params.targets,
        snakemake.params.seeding,
        snakemake.params.seed,
    )
    write_dataset(targets, snakemake.output[0])
