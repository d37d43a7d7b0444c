"""Makes figures/fig11_convergence: best J against evaluations, for every optimizer."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from collections import defaultdict
from pathlib import Path

from cislunar.figures.search.optimizers import convergence_figure
from cislunar.figures.style import save_figure
from cislunar.runtime import read_dataset
from cislunar.runtime.job import job

with job(snakemake.log):
    runs = defaultdict(lambda: defaultdict(list))
    for path in map(Path, snakemake.input.runs):
        method, _ = path.stem.split("_", 1)
        runs[path.parent.parent.name][method].append(read_dataset(path))
    architectures = defaultdict(dict)
    for path in map(Path, snakemake.input.architectures):
        architectures[path.parent.name][path.stem] = read_dataset(path)
    figure = convergence_figure(runs, architectures)
    save_figure(figure, snakemake.output.png, snakemake.output.pdf)
