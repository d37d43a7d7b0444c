"""Makes tables/paper_vs_ours.csv: each number and claim of the paper beside ours."""

from cislunar.campaign.operation.handing_over import in_worker

in_worker()

import pandas as pd

from cislunar.campaign.data.job import job
from cislunar.campaign.data.netcdf import write_text

with job(snakemake.log):
    claims = pd.concat([pd.read_csv(path, dtype=str) for path in snakemake.input])
    write_text(claims.to_csv(index=False), snakemake.output[0])
