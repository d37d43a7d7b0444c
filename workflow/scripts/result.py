"""Makes a result from its input files and parameters by one function of the library.

`params.function` names it within `cislunar`. Its arguments are the named input files, which are
read unless the name ends with ``path``, the other parameters, and the wildcards and threads that it
takes; unnamed input files come first. Special parameters are `kernels`, loaded first; `without`,
variables that are not read; `progress`, what the function counts; `inputs`, a class of named tuples
of input files; `cell`, labels of a cell; `cells`, those of the cells whose files the input `cells`
has, for pairs of cells and data sets, or their metrics alone if `metrics` is true; and `labeled`,
the labels of the files of some inputs, for mappings; a label of two parts makes nested mappings.
"""

from cislunar.runtime.worker_client import in_worker

in_worker(snakemake.params.get("kernels", ""), f"cislunar.{snakemake.params.function}")

from inspect import signature
from pathlib import Path
from pkgutil import resolve_name

import pandas as pd

from cislunar.runtime import progress_log, read_dataset, write_dataset, write_text
from cislunar.runtime.job import job


def by_label(labels, contents):
    """Contents by their labels; those whose labels are pairs by the first part and the second."""
    found = {}
    for label, content in zip(labels, contents, strict=True):
        if isinstance(label, str):
            found[label] = content
        else:
            found.setdefault(label[0], {})[label[1]] = content
    return found


def read(files):
    """The content of a file, or of each of several files."""
    if not isinstance(files, str):
        return [read(path) for path in files]
    if Path(files).suffix == ".csv":
        return pd.read_csv(files)
    return read_dataset(files, without=snakemake.params.get("without", ()))


with job(snakemake.log, snakemake.threads):
    function = resolve_name(f"cislunar.{snakemake.params.function}")
    named, output = dict(snakemake.input.items()), snakemake.output
    known = {**dict(snakemake.wildcards.items()), "threads": snakemake.threads}
    given = {key: value for key, value in known.items() if key in signature(function).parameters}
    special = ("function", "kernels", "without", "metrics", "labeled")
    given |= {key: value for key, value in snakemake.params.items() if key not in special}
    if "cell" in given:
        from cislunar.campaign.settings.cells import Cell

        given["cell"] = Cell(*given["cell"])
    if "cells" in given:
        from cislunar.campaign.tracking import read_cells

        metrics = snakemake.params.get("metrics", False)
        given["cells"] = read_cells(given["cells"], named.pop("cells"), metrics=metrics)
    given |= {key: path if key.endswith("path") else read(path) for key, path in named.items()}
    for name, labels in snakemake.params.get("labeled", {}).items():
        given[name] = by_label(labels, given[name])
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
    elif isinstance(result, str):
        write_text(result, output[0])
    else:
        write_dataset(result, output[0])
