"""Results that one function of the library makes from files, settings and labels."""

from collections.abc import Iterable, Mapping, Sequence
from inspect import signature
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import pandas as pd

from cislunar.runtime import progress_log, read_dataset, write_dataset, write_text

Files = str | Iterable[str]
"""A file, or several."""

_SPECIAL = ("function", "kernels", "without", "metrics", "labeled")


def made_result(
    files: Mapping[str, Files] | Sequence[str],
    params: Mapping[str, Any],
    known: Mapping[str, Any],
) -> Any:
    """The result of a function.

    Parameters
    ----------
    files : mapping of str to str or sequence of str, or sequence of str
        Input files by the names of arguments. They are read unless the name ends with ``path``.
        Unnamed files are the first arguments.
    params : mapping of str
        `function` names the function within `cislunar`, and most others are arguments. Special are
        `kernels`, which are not used here; `without`, variables that are not read; `progress`, what
        the function counts; `inputs`, a class of named tuples of input files; `cell`, labels of a
        cell; `cells`, labels of the cells whose files are the input `cells`: the argument is then
        pairs of a cell and its data set, or its metrics if `metrics` is true; and `labeled`, for
        some inputs the labels of their files: the argument is then a mapping by label, nested if
        the labels are tuples.
    known : mapping of str
        Further arguments, of which those are used that the function has.

    Returns
    -------
    object
    """
    function = resolve_name(f"cislunar.{params['function']}")
    given = {key: value for key, value in known.items() if key in signature(function).parameters}
    given |= {key: value for key, value in params.items() if key not in _SPECIAL}
    named = dict(files) if isinstance(files, Mapping) else {}
    without = params.get("without", ())
    # few results are of cells, and their modules take longest to import
    if "cell" in given:
        from cislunar.campaign.settings.cells import Cell

        given["cell"] = Cell(*given["cell"])
    if "cells" in given:
        from cislunar.campaign.tracking import read_cells

        metrics = params.get("metrics", False)
        given["cells"] = read_cells(given["cells"], named.pop("cells"), metrics=metrics)
    given |= {key: path if key.endswith("path") else _read(path, without)
              for key, path in named.items()}  # fmt: skip
    for name, labels in params.get("labeled", {}).items():
        given[name] = _by_label(labels, given[name])
    if "inputs" in given:
        kind = resolve_name(f"cislunar.{given['inputs']}")
        given["inputs"] = kind(*map(given.pop, kind._fields))
    if "progress" in given:
        given["progress"] = progress_log(given["progress"])
    first = [] if isinstance(files, Mapping) else _read(files, without)
    return function(*first, **given)


def write_result(result: Any, paths: Sequence[str]) -> None:
    """Write a figure, a table, a text or a data set; `paths` is one path, or for a figure those of
    the PNG and of the PDF, in this order."""
    if Path(paths[0]).suffix == ".png":
        from cislunar.figures.style import save_figure

        save_figure(result, *paths)
    elif isinstance(result, pd.DataFrame):
        write_text(result.to_csv(index=False), paths[0])
    elif isinstance(result, str):
        write_text(result, paths[0])
    else:
        write_dataset(result, paths[0])


def _read(files: Files, without: Sequence[str]) -> Any:
    """The content of a file, or of each of several files."""
    if not isinstance(files, str):
        return [_read(path, without) for path in files]
    if Path(files).suffix == ".csv":
        return pd.read_csv(files)
    return read_dataset(files, without=without)


def _by_label(labels: Sequence[Any], contents: Sequence[Any]) -> dict[str, Any]:
    """Contents by their labels, nested if the labels are tuples."""
    found: dict[str, Any] = {}
    for label, content in zip(labels, contents, strict=True):
        *outer, last = [label] if isinstance(label, str) else label
        inner = found
        for key in outer:
            inner = inner.setdefault(key, {})
        inner[last] = content
    return found
