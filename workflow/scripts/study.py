"""Makes studies/{study}/: a study of user-defined observers and targets."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from pathlib import Path

from cislunar.runtime.job import job
from cislunar.study.study_file import read_study, write_study

with job(snakemake.log, snakemake.threads):
    write_study(read_study(snakemake.input[0]).run(), Path(snakemake.output.cell).parent)
