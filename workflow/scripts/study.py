"""Makes studies/{study}/: a study of user-defined observers and targets."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from pathlib import Path

from cislunar.runtime.job import job
from cislunar.study.study_file import run_study_file

with job(snakemake.log, snakemake.threads):
    run_study_file(snakemake.input[0], Path(snakemake.output.cell).parent)
