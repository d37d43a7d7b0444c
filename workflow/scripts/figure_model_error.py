"""Makes figures/fig18_model_error: tracking by kind and size of the model error."""

from cislunar.runtime.worker_client import in_worker

in_worker()

import pandas as pd

from cislunar.figures.style import save_figure
from cislunar.figures.tracking.model_error import model_error_figure
from cislunar.runtime.job import job

with job(snakemake.log):
    figure = model_error_figure(pd.read_csv(snakemake.input[0]))
    save_figure(figure, snakemake.output.png, snakemake.output.pdf)
