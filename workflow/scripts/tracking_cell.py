"""Makes task2/{scenario}/{architecture}/{estimator}/nt{n}_dt{minutes}.nc: a cell, all seeds.

With a realization among the wildcards that one alone, kept beside the file for its maker.
"""

from cislunar.campaign.kernels import tracking_kernels
from cislunar.runtime.worker_client import in_worker

in_worker(tracking_kernels(snakemake.params.settings, snakemake.params.cell[2]))

from cislunar.campaign.settings.cells import Cell
from cislunar.campaign.tracking import read_inputs, write_cell
from cislunar.runtime import progress_log
from cislunar.runtime.job import job

with job(snakemake.log, snakemake.threads):
    params, realization = snakemake.params, snakemake.wildcards.get("realization")
    write_cell(
        Cell(*params.cell),
        read_inputs(snakemake.input),
        params.settings,
        params.path,
        propagator=params.propagator,
        seed=params.seed,
        progress=progress_log("tasking epochs of all seeds"),
        realization=None if realization is None else int(realization),
    )
