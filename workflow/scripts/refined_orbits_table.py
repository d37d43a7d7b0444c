"""Makes tables/refined_orbits.csv: refined orbits against reference tracking, by family."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.campaign.data.refined_orbits import refined_rows
from cislunar.runtime.job import job
from cislunar.runtime.netcdf import read_dataset, write_text

with job(snakemake.log):
    read = zip(snakemake.params.uses, map(read_dataset, snakemake.input), strict=True)
    write_text(refined_rows(dict(read)).to_csv(index=False), snakemake.output[0])
