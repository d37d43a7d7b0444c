"""Makes figures/characterization: what light curves tell of targets, beside the truth."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.figures.style import save_figure
from cislunar.figures.tracking.learned import characterization_figure
from cislunar.runtime.job import job
from cislunar.runtime.netcdf import read_dataset

with job(snakemake.log):
    histories = ("error", "sigma", "bound", "valid", "outcome")
    cells = [read_dataset(path, without=histories) for path in snakemake.input]
    save_figure(characterization_figure(cells), snakemake.output.png, snakemake.output.pdf)
