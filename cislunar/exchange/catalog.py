"""Rows of JPL's catalog of three-body periodic orbits, as exported by its web page.

The columns are ``Id, x0 (LU), y0 (LU), z0 (LU), vx0 (LU/TU), vy0 (LU/TU), vz0 (LU/TU), Jacobi
constant (LU2/TU2), Period (TU), Stability index, Mass ratio``; others are ignored. The
nondimensional numbers are used unchanged. A length in km or a period in days therefore differs from
JPL's, because l* = 384,400 km here and 389,703 km at JPL. JPL's mass ratio exceeds this library's
by 6e-7, so that a row is periodic at its own mass ratio and nearly periodic at this library's.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from cislunar.constants import MU
from cislunar.errors import InputFileError
from cislunar.exchange.table_rows import named_rows, row_names, row_numbers
from cislunar.runtime.arguments import Array

CATALOG_COLUMNS = (
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
    ConfigurationError
        If `path` is not a path.
    InputFileError
        If a column is missing or in another unit, a row is unusable, an Id occurs twice, or the
        mass ratio is not the Moon's.
    """
    remedy = "; export the rows in the catalog's units LU and TU, with their header"
    _, rows = named_rows(path, "orbit", "Id", CATALOG_COLUMNS, remedy=remedy)
    names = row_names(rows, "orbit", "Id")
    table = np.array([row_numbers(place, row, (CATALOG_COLUMNS, 1.0)) for place, row in rows])
    for (place, _), period, mu in zip(rows, table[:, 7], table[:, 9], strict=True):
        if not period > 0.0:
            raise InputFileError(f"{place}: Period (TU) = {period:g} must be positive")
        if abs(mu - MU) > _MASS_RATIO_SLACK:
            raise InputFileError(
                f"{place}: Mass ratio = {mu:g} is not that of Earth and Moon, {MU}; take rows of "
                "the Earth-Moon system"
            )
    return _CatalogRows(names, table[:, :6], *table[:, 6:].T)
