"""Makes figures/orbits_3d.html: the interactive page of orbits, architectures and targets."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from collections import defaultdict
from pathlib import Path

from cislunar.figures.space.orbits_page import orbits_page
from cislunar.runtime import read_dataset, write_text
from cislunar.runtime.job import job

with job(snakemake.log):
    architectures = defaultdict(dict)
    for path in map(Path, snakemake.input.architectures):
        architectures[path.parent.name][path.stem] = read_dataset(path)
    targets = map(read_dataset, snakemake.input.targets)
    page = orbits_page(
        read_dataset(snakemake.input.orbits),
        read_dataset(snakemake.input.tracked),
        dict(zip(snakemake.params.scenarios, targets, strict=True)),
        architectures,
    )
    write_text(page, snakemake.output[0])
