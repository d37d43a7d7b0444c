"""Makes tables/model_error.csv: what a truth unlike the estimators' belief costs."""

from cislunar.campaign.operation.handing_over import in_worker

in_worker()

from cislunar.campaign.data.job import job
from cislunar.campaign.data.netcdf import read_dataset, write_text
from cislunar.campaign.tracking.model_errors import model_errors
from cislunar.campaign.tracking.tables import model_error_rows

with job(snakemake.log):
    errors = model_errors(snakemake.params.settings["task2"])
    rows = model_error_rows(read_dataset(snakemake.input[0]), errors)
    write_text(rows.to_csv(index=False), snakemake.output[0])
