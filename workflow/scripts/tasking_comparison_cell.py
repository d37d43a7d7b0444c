"""Makes task2/tasking/{scenario}_{architecture}_nt{n}.nc: tasking methods on one cell."""

from cislunar.campaign.kernels import tracking_kernels
from cislunar.runtime.worker_client import in_worker

in_worker(tracking_kernels(snakemake.params.settings, snakemake.params.estimator))

from cislunar.campaign.settings.cells import Cell
from cislunar.campaign.tracking import compared_dataset, read_inputs
from cislunar.runtime import progress_log, write_dataset
from cislunar.runtime.job import job

with job(snakemake.log):
    wildcards, params = snakemake.wildcards, snakemake.params
    compared = compared_dataset(
        Cell(
            wildcards.scenario,
            wildcards.architecture,
            params.estimator,
            int(wildcards.n),
            int(params.interval_minutes),
        ),
        read_inputs(snakemake.input),
        params.settings,
        params.comparison,
        propagator=params.propagator,
        seed=params.seed,
        progress=progress_log("searches"),
    )
    write_dataset(compared, snakemake.output[0])
