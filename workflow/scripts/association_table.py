"""Makes tables/association.csv: association against known identities."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.campaign.settings.cells import Cell
from cislunar.campaign.tracking.association_table import association_rows
from cislunar.campaign.tracking.summary import read_cell_metrics
from cislunar.runtime import write_text
from cislunar.runtime.job import job

with job(snakemake.log, snakemake.threads):
    cells = zip(snakemake.params.cells, snakemake.input.cells, strict=True)
    read = [(Cell(*cell), read_cell_metrics(path)) for cell, path in cells]
    rows = association_rows(read, snakemake.params.custody_km)
    write_text(rows.to_csv(index=False), snakemake.output[0])
