"""Makes tables/pooled.csv: the statistics of every cell over the days and targets of its runs."""

from cislunar.campaign.operation.handing_over import in_worker

in_worker()

from cislunar.campaign.data.job import job
from cislunar.campaign.data.netcdf import read_dataset, write_text
from cislunar.campaign.tracking.tables import pooled_rows

with job(snakemake.log):
    rows = pooled_rows(read_dataset(snakemake.input[0]), snakemake.params.pooled)
    write_text(rows.to_csv(index=False), snakemake.output[0])
