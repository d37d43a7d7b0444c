"""Makes tables/refined_orbits.csv: departure and cost of holding of refined orbits by family."""

from cislunar.campaign.operation.handing_over import in_worker

in_worker()

from cislunar.campaign.data.job import job
from cislunar.campaign.data.netcdf import read_dataset, write_text
from cislunar.campaign.data.refined_orbits import refined_rows

with job(snakemake.log):
    read = zip(snakemake.params.uses, map(read_dataset, snakemake.input), strict=True)
    write_text(refined_rows(dict(read)).to_csv(index=False), snakemake.output[0])
