"""Makes task2/{scenario}/{architecture}/{estimator}/nt{n}_dt{minutes}.nc: a cell, all seeds."""

from cislunar.campaign.operation.handing_over import in_worker

in_worker("tracking")

from cislunar.campaign.data.job import job
from cislunar.campaign.data.progress import progress_log
from cislunar.campaign.settings.cells import Cell
from cislunar.campaign.tracking.cell import read_inputs
from cislunar.campaign.tracking.dataset import write_cell

with job(snakemake.log):
    wildcards = snakemake.wildcards
    cell = Cell(
        wildcards.scenario,
        wildcards.architecture,
        wildcards.estimator,
        int(wildcards.n),
        int(wildcards.minutes),
        wildcards.get("variant", ""),
    )
    write_cell(
        cell,
        read_inputs(snakemake.input),
        snakemake.params.settings,
        snakemake.output[0],
        propagator=snakemake.params.propagator,
        seed=snakemake.params.seed,
        progress=progress_log("tasking epochs of all seeds"),
    )
