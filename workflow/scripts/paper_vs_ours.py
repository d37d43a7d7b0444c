"""Makes tables/paper_vs_ours.csv: each claim of the paper and this library's result."""

from cislunar.runtime.worker_client import in_worker

in_worker()

import pandas as pd

from cislunar.runtime import write_text
from cislunar.runtime.job import job

with job(snakemake.log):
    claims = pd.concat([pd.read_csv(path, dtype=str) for path in snakemake.input])
    write_text(claims.to_csv(index=False), snakemake.output[0])
