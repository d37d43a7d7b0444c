"""Makes architecture/{scenario}/exact.nc: the best architecture found, and its certificate."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.campaign.architectures.exact import exact_dataset
from cislunar.campaign.architectures.visibility import cost_function
from cislunar.runtime.job import job
from cislunar.runtime.netcdf import read_dataset, write_dataset

with job(snakemake.log, snakemake.threads):
    visibility = read_dataset(snakemake.input.visibility)
    exact = exact_dataset(
        cost_function(visibility, read_dataset(snakemake.input.orbits)),
        visibility,
        scenario=snakemake.wildcards.scenario,
        seed=snakemake.params.seed,
        slots=snakemake.params.slots,
        restarts=snakemake.params.restarts,
        certificate=snakemake.params.certificate,
        threads=snakemake.threads,
    )
    write_dataset(exact, snakemake.output[0])
