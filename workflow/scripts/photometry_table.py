"""Makes tables/photometry.csv: what the readings of the photometric equations do."""

from cislunar.campaign.operation.handing_over import in_worker

in_worker()

from cislunar.campaign.data.job import job
from cislunar.campaign.data.netcdf import write_text
from cislunar.campaign.readings.photometry import photometry_table

with job(snakemake.log):
    params = snakemake.params
    table = photometry_table(params.material, params.limiting_magnitude, params.seed)
    write_text(table.to_csv(index=False), snakemake.output[0])
