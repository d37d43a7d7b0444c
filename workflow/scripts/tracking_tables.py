"""Makes tables/tracking.csv and tables/readings_tracking.csv: cells with confidence intervals."""

from cislunar.campaign.netcdf import read_dataset, write_text
from cislunar.campaign.progress import job
from cislunar.campaign.tracking_tables import reading_rows, tracking_rows

with job(snakemake.log[0]):
    summary = read_dataset(snakemake.input[0])
    write_text(tracking_rows(summary).to_csv(index=False), snakemake.output.tracking)
    write_text(reading_rows(summary).to_csv(index=False), snakemake.output.readings)
