"""Makes tables/model_error.csv: effect of model errors on tracking."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.campaign.tracking.model_errors import model_errors
from cislunar.campaign.tracking.tables import model_error_rows
from cislunar.runtime import read_dataset, write_text
from cislunar.runtime.job import job

with job(snakemake.log):
    errors = model_errors(snakemake.params.settings["task2"])
    rows = model_error_rows(read_dataset(snakemake.input[0]), errors)
    write_text(rows.to_csv(index=False), snakemake.output[0])
