"""Makes tables/objective_ranks.csv: whether objectives go with how well architectures track."""

from cislunar.campaign.operation.handing_over import in_worker

in_worker()

import pandas as pd

from cislunar.campaign.data.job import job
from cislunar.campaign.data.netcdf import write_text
from cislunar.campaign.tracking.objective_ranks import rank_rows

with job(snakemake.log):
    read = snakemake.input
    objectives = pd.concat(map(pd.read_csv, read.objectives))
    rows = rank_rows(objectives, pd.read_csv(read.tracking))
    write_text(rows.to_csv(index=False), snakemake.output[0])
