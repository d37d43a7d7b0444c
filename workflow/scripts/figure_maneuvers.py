"""Makes figures/maneuvers: detection and custody of targets that maneuver."""

from cislunar.runtime.worker_client import in_worker

in_worker()

import pandas as pd

from cislunar.figures.maneuvers import maneuver_figure
from cislunar.figures.style import save_figure
from cislunar.runtime.job import job

with job(snakemake.log):
    figure = maneuver_figure(pd.read_csv(snakemake.input[0]))
    save_figure(figure, snakemake.output.png, snakemake.output.pdf)
