"""Makes tables/photometry.csv: what the readings of the photometric equations do."""

from cislunar.campaign.data.netcdf import write_text
from cislunar.campaign.data.progress import job
from cislunar.campaign.readings.photometry import photometry_table

with job(snakemake.log[0]):
    params = snakemake.params
    table = photometry_table(params.material, params.limiting_magnitude, params.seed)
    write_text(table.to_csv(index=False), snakemake.output[0])
