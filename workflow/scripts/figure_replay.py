"""Makes figures/replay.html: the page that replays a cell."""

from cislunar.runtime import in_worker, read_dataset, write_text

in_worker()

from cislunar.figures.replay import cell_replay, replay_page
from cislunar.runtime.job import job

with job(snakemake.log):
    cell, orbits, sun = map(read_dataset, snakemake.input)
    write_text(replay_page(cell_replay(cell, sun, orbits=orbits)), snakemake.output[0])
