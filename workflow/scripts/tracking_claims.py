"""Makes tables/claims_tracking.csv: the paper's claims on tasking and tracking beside ours."""

from cislunar.campaign.claims import claims_table
from cislunar.campaign.netcdf import read_dataset, write_text
from cislunar.campaign.progress import job
from cislunar.campaign.tracking_claims import tasking_claims, tracking_claims

with job(snakemake.log[0]):
    claims = tracking_claims(read_dataset(snakemake.input.summary))
    claims += tasking_claims(read_dataset(snakemake.input.comparison))
    write_text(claims_table(claims).to_csv(index=False), snakemake.output[0])
