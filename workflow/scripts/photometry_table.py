"""Makes tables/photometry.csv: what the readings of the photometric equations do."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.campaign.readings.photometry import photometry_table
from cislunar.runtime.job import job
from cislunar.runtime.netcdf import write_text

with job(snakemake.log):
    params = snakemake.params
    table = photometry_table(params.material, params.limiting_magnitude, params.seed)
    write_text(table.to_csv(index=False), snakemake.output[0])
