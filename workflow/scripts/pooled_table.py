"""Makes tables/pooled.csv: the statistics of every cell over the days and targets of its runs."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.campaign.tracking.tables import pooled_rows
from cislunar.runtime.job import job
from cislunar.runtime.netcdf import read_dataset, write_text

with job(snakemake.log):
    rows = pooled_rows(read_dataset(snakemake.input[0]), snakemake.params.pooled)
    write_text(rows.to_csv(index=False), snakemake.output[0])
