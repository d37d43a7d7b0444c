"""Makes figures/pooled: what is known of all targets against the number of satellites."""

from cislunar.campaign.operation.handing_over import in_worker

in_worker()

import pandas as pd

from cislunar.campaign.data.job import job
from cislunar.figures.style import save_figure
from cislunar.figures.tracking.pooled import pooled_figure

with job(snakemake.log):
    figure = pooled_figure(pd.read_csv(snakemake.input[0]))
    save_figure(figure, snakemake.output.png, snakemake.output.pdf)
