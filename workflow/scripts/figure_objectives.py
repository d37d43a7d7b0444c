"""Makes figures/objectives: fronts of every objective with bounds, and all architectures."""

from cislunar.campaign.operation.handing_over import in_worker

in_worker()

import pandas as pd

from cislunar.campaign.data.job import job
from cislunar.figures.search.objectives import objectives_figure
from cislunar.figures.style import save_figure

with job(snakemake.log):
    tables = map(pd.read_csv, snakemake.input)
    figure = objectives_figure(dict(zip(snakemake.params.scenarios, tables, strict=True)))
    save_figure(figure, snakemake.output.png, snakemake.output.pdf)
