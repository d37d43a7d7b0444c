"""Makes figures/catalog: completeness, wrong orbits and consistency of catalogs by survey."""

from cislunar.runtime.worker_client import in_worker

in_worker()

import pandas as pd

from cislunar.figures.style import save_figure
from cislunar.figures.survey import catalog_figure
from cislunar.runtime.job import job

with job(snakemake.log):
    figure = catalog_figure(pd.read_csv(snakemake.input[0]))
    save_figure(figure, snakemake.output.png, snakemake.output.pdf)
