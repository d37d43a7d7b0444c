"""Makes figures/fig11_convergence: best J so far by evaluations, for every optimizer."""

from cislunar.campaign.operation.handing_over import in_worker

in_worker()

from collections import defaultdict
from pathlib import Path

from cislunar.campaign.data.job import job
from cislunar.campaign.data.netcdf import read_dataset
from cislunar.figures.search.optimizers import convergence_figure
from cislunar.figures.style import save_figure

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
