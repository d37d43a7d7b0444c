"""Rows of JPL's catalog of three-body periodic orbits, as exported by its web page.

The columns are ``Id, x0 (LU), y0 (LU), z0 (LU), vx0 (LU/TU), vy0 (LU/TU), vz0 (LU/TU), Jacobi
constant (LU2/TU2), Period (TU), Stability index, Mass ratio``; others are ignored. The
nondimensional numbers are used unchanged. A length in km or a period in days therefore differs from
JPL's, because l* = 384 400 km here and 389 703 km at JPL. JPL's mass ratio exceeds this library's
by 6e-7, so that a row is periodic at its own mass ratio and nearly periodic at this library's.
"""

from math import isfinite
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.constants import MU
from cislunar.errors import InputFileError
from cislunar.exchange.csv_lines import listed, read_lines

Array = NDArray[np.float64]

COLUMNS = (
    *("x0 (LU)", "y0 (LU)", "z0 (LU)", "vx0 (LU/TU)", "vy0 (LU/TU)", "vz0 (LU/TU)"),
    *("Jacobi constant (LU2/TU2)", "Period (TU)", "Stability index", "Mass ratio"),
)

_MASS_RATIO_SLACK = 1e-5
"""Rows whose mass ratio differs by more than this belong to other systems."""


class _CatalogRows(NamedTuple):
    """Periodic orbits of the catalog: ``Id`` of each row, initial states (row, 6), nondimensional,
    rotating frame, and the row's Jacobi constant, period, stability index and mass ratio (row,)."""

    name: list[str]
    state: Array
    jacobi: Array
    period: Array
    stability_index: Array
    mu: Array


def is_catalog(header: list[str]) -> bool:
    """Whether the column names of a table are those of the catalog."""
    return any(name.strip().startswith("x0 (") for name in header)


def read_catalog(path: str | Path) -> _CatalogRows:
    """Read rows of the catalog.

    Parameters
    ----------
    path : str or Path
        Comma-separated, with the catalog's header.

    Returns
    -------
    NamedTuple
        Orbits in the order of the file: ``name`` (their ``Id``), ``state``, shape (row, 6),
        nondimensional, rotating frame, and ``jacobi``, ``period``, ``stability_index`` and ``mu``
        (mass ratio), shape (row,).

    Raises
    ------
    InputFileError
        If a column is missing or in another unit, a row is unusable, an Id occurs twice, or the
        mass ratio is not the Moon's.
    """
    lines = [
        (number, [each.strip() for each in fields])
        for number, fields in read_lines(path, "catalog")
    ]
    rows = [(number, fields) for number, fields in lines[1:] if any(fields)]
    header = lines[0][1] if lines else []
    lacking = [name for name in ("Id", *COLUMNS) if name not in header]
    if lacking:
        raise InputFileError(
            f"{path}, row 1: no column {lacking[0]!r}; export the rows in the catalog's units "
            f"LU and TU, with their header; it has {listed(header)}"
        )
    if not rows:
        raise InputFileError(f"{path}: contains no orbit; add a row per orbit")
    columns = [header.index(name) for name in COLUMNS]
    names: dict[str, int] = {}
    values = []
    for number, fields in rows:
        place = f"{path}, row {number}"
        if len(fields) != len(header):
            raise InputFileError(
                f"{place}: {len(fields)} fields where the header has {len(header)}; complete it"
            )
        name = fields[header.index("Id")]
        if not name or name in names:
            raise InputFileError(f"{place}: Id {name!r} is empty or taken; give every row its own")
        names[name] = number
        values.append([_number(place, COLUMNS[k], fields[at]) for k, at in enumerate(columns)])
        period, mu = values[-1][7], values[-1][9]
        if not period > 0.0:
            raise InputFileError(f"{place}: Period (TU) = {period:g} must be positive")
        if abs(mu - MU) > _MASS_RATIO_SLACK:
            raise InputFileError(
                f"{place}: Mass ratio = {mu:g} is not that of Earth and Moon, {MU}; take rows of "
                "the Earth-Moon system"
            )
    table = np.array(values)
    return _CatalogRows(list(names), table[:, :6], *table[:, 6:].T)


def _number(place: str, column: str, field: str) -> float:
    try:
        value = float(field)
    except ValueError:
        value = float("nan")
    if not isfinite(value):
        raise InputFileError(f"{place}: {column} = {field!r} must be a finite number")
    return value
