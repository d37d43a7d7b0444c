"""Makes figures/fig10_satellite_front: J and coverage by number of satellites."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from collections import defaultdict
from pathlib import Path

import pandas as pd

from cislunar.figures.search.optimizers import satellite_front_figure
from cislunar.figures.style import save_figure
from cislunar.runtime import read_dataset
from cislunar.runtime.job import job

with job(snakemake.log):
    fronts = {Path(path).parent.name: read_dataset(path) for path in snakemake.input.fronts}
    architectures = defaultdict(dict)
    for path in map(Path, snakemake.input.architectures):
        architectures[path.parent.name][path.stem] = read_dataset(path)
    figure = satellite_front_figure(fronts, architectures, pd.read_csv(snakemake.input.coverage))
    save_figure(figure, snakemake.output.png, snakemake.output.pdf)
