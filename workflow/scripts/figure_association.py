"""Makes figures/association: association against the number of false alarms."""

from cislunar.runtime.worker_client import in_worker

in_worker()

import pandas as pd

from cislunar.figures.style import save_figure
from cislunar.figures.tracking.association import association_figure
from cislunar.runtime.job import job

with job(snakemake.log):
    figure = association_figure(pd.read_csv(snakemake.input[0]))
    save_figure(figure, snakemake.output.png, snakemake.output.pdf)
