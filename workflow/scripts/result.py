"""Makes a result from its input files and parameters by one function of the library.

`params.function` names it within `cislunar`. Named input files, the other parameters, and the
wildcards and threads that it takes are the arguments of their names; unnamed input files are its
first arguments if no file has a name. Files are read, except those of arguments whose name ends
with ``path``. `params` may also have the `kernels` that are loaded first, variables `without` which
data sets are read, as `progress` what the function counts, as `inputs` the class of a named tuple
whose fields are named input files, and as `cells` the labels of the cells whose files the input
`cells` has: the function takes pairs of cells with their data sets, or with their metrics alone if
`metrics` is true.
"""

from cislunar.runtime.worker_client import in_worker

in_worker(snakemake.params.get("kernels", ""), f"cislunar.{snakemake.params.function}")

from inspect import signature
from pathlib import Path
from pkgutil import resolve_name

import pandas as pd

from cislunar.runtime import each, progress_log, read_dataset, write_dataset, write_text
from cislunar.runtime.job import job


def read(files):
    """The content of a file, or of each of several files."""
    if not isinstance(files, str):
        return [read(path) for path in files]
    if Path(files).suffix == ".csv":
        return pd.read_csv(files)
    return read_dataset(files, without=snakemake.params.get("without", ()))


def read_cells(labels, files):
    """Cells with their data sets or metrics."""
    from cislunar.campaign.settings import Cell
    from cislunar.campaign.tracking import read_cell_metrics

    reader = read_cell_metrics if snakemake.params.get("metrics") else read
    labeled = zip(labels, each(files, "cells"), strict=True)
    return [(Cell(*cell), reader(path)) for cell, path in labeled]


with job(snakemake.log, snakemake.threads):
    function = resolve_name(f"cislunar.{snakemake.params.function}")
    named, output = dict(snakemake.input.items()), snakemake.output
    known = {**dict(snakemake.wildcards.items()), "threads": snakemake.threads}
    given = {key: value for key, value in known.items() if key in signature(function).parameters}
    special = ("function", "kernels", "without", "metrics")
    given |= {key: value for key, value in snakemake.params.items() if key not in special}
    if "cells" in given:
        given["cells"] = read_cells(given["cells"], named.pop("cells"))
    given |= {key: path if key.endswith("path") else read(path) for key, path in named.items()}
    if "inputs" in given:
        kind = resolve_name(f"cislunar.{given['inputs']}")
        given["inputs"] = kind(*map(given.pop, kind._fields))
    if "progress" in given:
        given["progress"] = progress_log(given["progress"])
    result = function(*([] if snakemake.input.keys() else read(snakemake.input)), **given)
    if hasattr(output, "png"):
        from cislunar.figures.style import save_figure

        save_figure(result, output.png, output.pdf)
    elif isinstance(result, pd.DataFrame):
        write_text(result.to_csv(index=False), output[0])
    else:
        write_dataset(result, output[0])
