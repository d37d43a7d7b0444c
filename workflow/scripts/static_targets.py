"""Makes targets/static_{scenario}.nc: the sampled points clustered to static targets."""

from cislunar.campaign.operation.handing_over import in_worker

in_worker()

from cislunar.campaign.data.inputs import static_targets_dataset
from cislunar.campaign.data.job import job
from cislunar.campaign.data.netcdf import read_dataset, write_dataset

with job(snakemake.log):
    targets = static_targets_dataset(
        read_dataset(snakemake.input[0]),
        snakemake.wildcards.scenario,
        snakemake.params.targets,
        snakemake.params.seeding,
        snakemake.params.seed,
    )
    write_dataset(targets, snakemake.output[0])
