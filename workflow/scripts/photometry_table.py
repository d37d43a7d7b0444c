"""Makes tables/photometry.csv: what the readings of the photometric equations do."""

from cislunar.campaign.netcdf import write_text
from cislunar.campaign.photometry_readings import photometry_table
from cislunar.campaign.progress import job

with job(snakemake.log[0]):
    params = snakemake.params
    table = photometry_table(params.material, params.limiting_magnitude, params.seed)
    write_text(table.to_csv(index=False), snakemake.output[0])
