"""Makes task2/tasking/{scenario}_{architecture}_nt{n}.nc: tasking methods on one cell."""

from cislunar.campaign.operation.handing_over import in_worker, tracking_kernels

in_worker(tracking_kernels(snakemake.params.settings))

from cislunar.campaign.data.job import job
from cislunar.campaign.data.netcdf import write_dataset
from cislunar.campaign.data.progress import progress_log
from cislunar.campaign.settings.cells import Cell
from cislunar.campaign.tracking.cell import read_inputs
from cislunar.campaign.tracking.tasking_comparison import compared_dataset

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
