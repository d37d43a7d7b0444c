"""Makes figures/fig10_satellite_front: J and its coverage by prescribed number of satellites."""

from cislunar.campaign.operation.handing_over import in_worker

in_worker()

from collections import defaultdict
from pathlib import Path

import pandas as pd

from cislunar.campaign.data.job import job
from cislunar.campaign.data.netcdf import read_dataset
from cislunar.figures.search.optimizers import satellite_front_figure
from cislunar.figures.style import save_figure

with job(snakemake.log):
    fronts = {Path(path).parent.name: read_dataset(path) for path in snakemake.input.fronts}
    architectures = defaultdict(dict)
    for path in map(Path, snakemake.input.architectures):
        architectures[path.parent.name][path.stem] = read_dataset(path)
    figure = satellite_front_figure(fronts, architectures, pd.read_csv(snakemake.input.coverage))
    save_figure(figure, snakemake.output.png, snakemake.output.pdf)
