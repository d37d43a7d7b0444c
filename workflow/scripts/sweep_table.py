"""Makes tables/sweep_{sweep}.csv: what every value of a sweep gives."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.campaign.settings import Cell, SweepPoint
from cislunar.campaign.tracking.summary import read_cell_metrics, summary_dataset
from cislunar.campaign.tracking.sweep_table import architecture_values, sweep_rows
from cislunar.runtime import read_dataset, write_text
from cislunar.runtime.job import job

with job(snakemake.log, snakemake.threads):
    read, params = snakemake.input, snakemake.params
    orbits = read_dataset(read.orbits)
    places = zip(read.architectures, read.targets, read.suns, params.settings, strict=True)
    reached = [
        architecture_values(read_dataset(a), orbits, read_dataset(t), read_dataset(s), settings)
        for a, t, s, settings in places
    ]
    cells = zip(params.cells, read.cells, strict=True)
    tracked = [(Cell(*cell), read_cell_metrics(path)) for cell, path in cells]
    summary = summary_dataset(tracked, {"sweep": params.sweep}, params.seed) if tracked else None
    points = [SweepPoint(*point) for point in params.points]
    rows = sweep_rows(snakemake.wildcards.sweep, params.sweep, points, reached, summary)
    write_text(rows.to_csv(index=False), snakemake.output[0])
