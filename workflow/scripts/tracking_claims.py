"""Makes tables/claims_tracking.csv: the paper's claims on tasking and tracking beside ours."""

from cislunar.campaign.operation.handing_over import in_worker

in_worker()

from cislunar.campaign.claims.judges import claims_table
from cislunar.campaign.claims.tracking import tasking_claims, tracking_claims
from cislunar.campaign.data.job import job
from cislunar.campaign.data.netcdf import read_dataset, write_text

with job(snakemake.log):
    summary = read_dataset(snakemake.input.summary)
    claims = tracking_claims(summary)
    comparison = snakemake.input.get("comparison")
    claims += tasking_claims(read_dataset(comparison) if comparison else None, summary)
    write_text(claims_table(claims).to_csv(index=False), snakemake.output[0])
