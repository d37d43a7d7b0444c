"""Rows of JPL's catalogue of three-body periodic orbits, as its web page exports them.

Columns ``Id, x0 (LU), y0 (LU), z0 (LU), vx0 (LU/TU), vy0 (LU/TU), vz0 (LU/TU), Jacobi constant
(LU2/TU2), Period (TU), Stability index, Mass ratio``; others are ignored. The numbers are
nondimensional and are taken over as such: a length in km or a period in days is another here,
where l* = 384 400 km (JPL: 389 703 km). JPL's mass ratio is larger than this library's by 6e-7, so
that a row is periodic at its own mass ratio and nearly so at this library's.
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

MASS_RATIO_SLACK = 1e-5
"""Rows with a mass ratio further off than this belong to other bodies."""


class CatalogueRows(NamedTuple):
    """Periodic orbits of the catalogue.

    Attributes
    ----------
    name : list of str
        ``Id`` of each row.
    state : ndarray, shape (row, 6)
        Initial states, nondimensional, rotating frame.
    jacobi, period, stability_index, mu : ndarray, shape (row,)
        As stated in the row.
    """

    name: list[str]
    state: Array
    jacobi: Array
    period: Array
    stability_index: Array
    mu: Array


def is_catalogue(header: list[str]) -> bool:
    """Whether the header of a table is meant to be that of the catalogue."""
    return any(name.strip().startswith("x0 (") for name in header)


def read_catalogue(path: str | Path) -> CatalogueRows:
    """Read rows of the catalogue.

    Parameters
    ----------
    path : str or Path
        Comma-separated, with the catalogue's header.

    Returns
    -------
    CatalogueRows
        In the order of the file.

    Raises
    ------
    InputFileError
        If the file cannot be read, a column is missing or in another unit, a field is no number, a
        period is not positive, an Id occurs twice or the mass ratio is not the Moon's.
    """
    lines = [
        (number, [each.strip() for each in fields])
        for number, fields in read_lines(path, "catalogue")
    ]
    rows = [(number, fields) for number, fields in lines[1:] if any(fields)]
    header = lines[0][1] if lines else []
    lacking = [name for name in ("Id", *COLUMNS) if name not in header]
    if lacking:
        raise InputFileError(
            f"{path}, row 1: no column {lacking[0]!r}; export the rows in the catalogue's units "
            f"LU and TU, with their header; it has {listed(header)}"
        )
    if not rows:
        raise InputFileError(f"{path}: holds no orbit; add a row per orbit")
    places = [header.index(name) for name in COLUMNS]
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
        values.append([_number(place, COLUMNS[k], fields[at]) for k, at in enumerate(places)])
        period, mu = values[-1][7], values[-1][9]
        if not period > 0.0:
            raise InputFileError(f"{place}: Period (TU) = {period:g} must be positive")
        if abs(mu - MU) > MASS_RATIO_SLACK:
            raise InputFileError(
                f"{place}: Mass ratio = {mu:g} is not that of Earth and Moon, {MU}; take rows of "
                "the Earth-Moon system"
            )
    table = np.array(values)
    return CatalogueRows(list(names), table[:, :6], *table[:, 6:].T)


def _number(place: str, column: str, field: str) -> float:
    try:
        value = float(field)
    except ValueError:
        value = float("nan")
    if not isfinite(value):
        raise InputFileError(f"{place}: {column} = {field!r} must be a finite number")
    return value
