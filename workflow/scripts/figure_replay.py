"""Makes figures/replay.html: the page that replays a cell."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.figures.replay import cell_replay, replay_page
from cislunar.runtime import read_dataset, write_text
from cislunar.runtime.job import job

with job(snakemake.log):
    cell, orbits, sun = map(read_dataset, snakemake.input)
    write_text(replay_page(cell_replay(cell, sun, orbits=orbits)), snakemake.output[0])
