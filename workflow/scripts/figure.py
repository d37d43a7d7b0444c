"""Makes a figure from its input files alone.

`params.figure` is the function of `cislunar.figures` that draws them, `params.arguments` what it
takes besides.
"""

from cislunar.runtime.worker_client import in_worker

in_worker()

from importlib import import_module
from pathlib import Path

import pandas as pd

from cislunar.figures.style import save_figure
from cislunar.runtime.job import job
from cislunar.runtime.netcdf import read_dataset

with job(snakemake.log):
    package, name = f"cislunar.figures.{snakemake.params.figure}".rsplit(".", 1)
    draw = getattr(import_module(package), name)
    read = {".csv": pd.read_csv, ".nc": read_dataset}
    files = [read[Path(path).suffix](path) for path in snakemake.input]
    figure = draw(*files, *snakemake.params.get("arguments", ()))
    save_figure(figure, snakemake.output.png, snakemake.output.pdf)
