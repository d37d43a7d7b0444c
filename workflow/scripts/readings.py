"""Makes tables/readings.csv: J under each reading of the paper."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.campaign.readings.architecture import readings_table
from cislunar.runtime import progress_log, read_dataset, write_text
from cislunar.runtime.job import job

with job(snakemake.log, snakemake.threads):
    table = readings_table(
        snakemake.params.config,
        snakemake.params.scenario,
        read_dataset(snakemake.input.orbits),
        read_dataset(snakemake.input.sun),
        progress_log("readings"),
    )
    write_text(table.to_csv(index=False), snakemake.output[0])
