"""Makes tables/readings.csv: J under each reading of the paper."""

from cislunar.campaign.operation.handing_over import in_worker

in_worker()

from cislunar.campaign.data.job import job
from cislunar.campaign.data.netcdf import read_dataset, write_text
from cislunar.campaign.data.progress import progress_log
from cislunar.campaign.readings.architecture import readings_table

with job(snakemake.log, snakemake.threads):
    table = readings_table(
        snakemake.params.config,
        snakemake.params.scenario,
        read_dataset(snakemake.input.orbits),
        read_dataset(snakemake.input.sun),
        progress_log("readings"),
    )
    write_text(table.to_csv(index=False), snakemake.output[0])
