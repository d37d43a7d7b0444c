"""Makes task2/{scenario}/{architecture}/{estimator}/nt{n}_dt{minutes}.nc: a cell, all seeds."""

from cislunar.campaign.data.netcdf import write_dataset
from cislunar.campaign.data.progress import job, progress_log
from cislunar.campaign.settings.cells import Cell
from cislunar.campaign.tracking.cell import read_inputs
from cislunar.campaign.tracking.dataset import cell_dataset

with job(snakemake.log[0]):
    wildcards = snakemake.wildcards
    cell = Cell(
        wildcards.scenario,
        wildcards.architecture,
        wildcards.estimator,
        int(wildcards.n),
        int(wildcards.minutes),
        wildcards.get("variant", ""),
    )
    tracking = cell_dataset(
        cell,
        read_inputs(snakemake.input),
        snakemake.params.settings,
        propagator=snakemake.params.propagator,
        seed=snakemake.params.seed,
        progress=progress_log("tasking epochs of all seeds"),
    )
    write_dataset(tracking, snakemake.output[0])
