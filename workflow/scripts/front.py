"""Makes architecture/{scenario}/front.nc: best J and its coverage by number of satellites."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.campaign.architectures.exact import front_dataset
from cislunar.campaign.architectures.visibility import cost_function
from cislunar.runtime.job import job
from cislunar.runtime.netcdf import read_dataset, write_dataset
from cislunar.runtime.progress import progress_log

with job(snakemake.log):
    visibility = read_dataset(snakemake.input.visibility)
    orbits = read_dataset(snakemake.input.orbits)
    front = front_dataset(
        cost_function(visibility, orbits),
        visibility,
        orbits,
        read_dataset(snakemake.input.targets),
        read_dataset(snakemake.input.sun),
        scenario=snakemake.wildcards.scenario,
        seed=snakemake.params.seed,
        slots=snakemake.params.slots,
        front=snakemake.params.front,
        settings=snakemake.params.settings,
        progress=progress_log("numbers of satellites"),
    )
    write_dataset(front, snakemake.output[0])
