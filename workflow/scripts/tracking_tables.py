"""Makes tables/tracking.csv, readings_tracking.csv and estimators.csv: cells with intervals."""

from cislunar.campaign.data.netcdf import read_dataset, write_text
from cislunar.campaign.data.progress import job
from cislunar.campaign.tracking.tables import estimator_rows, reading_rows, tracking_rows

with job(snakemake.log[0]):
    summary = read_dataset(snakemake.input[0])
    write_text(tracking_rows(summary).to_csv(index=False), snakemake.output.tracking)
    write_text(reading_rows(summary).to_csv(index=False), snakemake.output.readings)
    write_text(estimator_rows(summary).to_csv(index=False), snakemake.output.estimators)
