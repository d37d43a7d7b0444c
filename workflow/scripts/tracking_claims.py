"""Makes tables/claims_tracking.csv: the paper's claims on tracking with this library's result."""

from cislunar.runtime.worker_client import in_worker

in_worker()

import sys
from pathlib import Path

from cislunar.runtime import read_dataset, write_text
from cislunar.runtime.job import job

sys.path.append(str(Path(snakemake.scriptdir).parents[1]))
from workflow.documents.claims.judges import claims_table
from workflow.documents.claims.tracking import tasking_claims, tracking_claims

with job(snakemake.log):
    summary = read_dataset(snakemake.input.summary)
    claims = tracking_claims(summary)
    comparison = snakemake.input.get("comparison")
    claims += tasking_claims(read_dataset(comparison) if comparison else None, summary)
    write_text(claims_table(claims).to_csv(index=False), snakemake.output[0])
