"""Makes tables/maneuvers.csv: detection and recovery of targets that maneuver."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.campaign.settings.cells import Cell
from cislunar.campaign.tracking.maneuvers.table import maneuver_rows
from cislunar.runtime import read_dataset, write_text
from cislunar.runtime.job import job

with job(snakemake.log, snakemake.threads):
    cells = zip(snakemake.params.cells, snakemake.input.cells, strict=True)
    read = [(Cell(*cell), read_dataset(path)) for cell, path in cells]
    rows = maneuver_rows(read, snakemake.params.custody_km)
    write_text(rows.to_csv(index=False), snakemake.output[0])
