"""Makes tables/paper_vs_ours.csv: each number and claim of the paper beside ours."""

import pandas as pd

from cislunar.campaign.data.netcdf import write_text
from cislunar.campaign.data.progress import job

with job(snakemake.log[0]):
    claims = pd.concat([pd.read_csv(path, dtype=str) for path in snakemake.input])
    write_text(claims.to_csv(index=False), snakemake.output[0])
