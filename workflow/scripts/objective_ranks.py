"""Makes tables/objective_ranks.csv: rank correlation of objectives with tracking performance."""

from cislunar.runtime.worker_client import in_worker

in_worker()

import pandas as pd

from cislunar.campaign.tracking.tables import rank_rows
from cislunar.runtime import write_text
from cislunar.runtime.job import job

with job(snakemake.log):
    read = snakemake.input
    objectives = pd.concat(map(pd.read_csv, read.objectives))
    rows = rank_rows(objectives, pd.read_csv(read.tracking))
    write_text(rows.to_csv(index=False), snakemake.output[0])
