"""Makes tables/tracking.csv, and readings_tracking.csv and estimators.csv if cells compare."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.campaign.tracking.tables import estimator_rows, reading_rows, tracking_rows
from cislunar.runtime import read_dataset, write_text
from cislunar.runtime.job import job

with job(snakemake.log):
    summary = read_dataset(snakemake.input[0])
    tables = {"tracking": tracking_rows, "readings": reading_rows, "estimators": estimator_rows}
    for name, path in snakemake.output.items():
        write_text(tables[name](summary).to_csv(index=False), path)
