"""Makes figures/objectives: fronts of every objective with bounds, and all architectures."""

from cislunar.runtime.worker_client import in_worker

in_worker()

import pandas as pd

from cislunar.figures.search.objectives import objectives_figure, tracking_errors
from cislunar.figures.style import save_figure
from cislunar.runtime.job import job

with job(snakemake.log):
    tables = map(pd.read_csv, snakemake.input.tables)
    tracked = [tracking_errors(pd.read_csv(path)) for path in snakemake.input.tracking]
    figure = objectives_figure(dict(zip(snakemake.params.scenarios, tables, strict=True)), *tracked)
    save_figure(figure, snakemake.output.png, snakemake.output.pdf)
