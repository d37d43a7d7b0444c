"""Tables of the constant errors of observers.

A table is comma-separated, in UTF-8, with one row for each observer. The column `observer` has its
number or name. The columns `position_x_m`, `position_y_m`, `position_z_m`,
`right_ascension_arcsec`, `declination_arcsec` and `clock_s` have its errors, true minus assumed
values. A missing column or an empty field is zero.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from cislunar.errors import ConfigurationError, InputFileError, did_you_mean
from cislunar.estimation.navigation.errors import (
    N_PARAMETERS,
    OBSERVER_PARAMETERS,
    PARAMETER_UNITS,
)
from cislunar.exchange.table_rows import listed, named_rows, row_names, row_numbers
from cislunar.runtime import Array

_COLUMNS = tuple(
    f"{name}_{unit}" for name, unit in zip(OBSERVER_PARAMETERS, PARAMETER_UNITS, strict=True)
)


def load_observer_errors(path: str | Path) -> dict[str, Array]:
    """Read a table of the constant errors of observers.

    Parameters
    ----------
    path : str or Path
        Comma-separated table, see the module.

    Returns
    -------
    dict of str to ndarray, shape (6,)
        Errors of each observer by its name or number, in the order of `OBSERVER_PARAMETERS`; m,
        arcsec and s.

    Raises
    ------
    InputFileError
        If the table is faulty; the message names the file and the line.
    """
    header, rows = named_rows(path, "observer", "observer")
    known = [column for column in _COLUMNS if column in header]
    unknown = [name for name in header if name not in _COLUMNS and name != "observer"]
    if unknown or not known:
        given = unknown[0] if unknown else None
        raise InputFileError(
            f"{path}, row 1: "
            + (f"column {given!r} is none of" if given else "no column of errors; give some of")
            + f" {', '.join(_COLUMNS)}; the header has {listed(header)}"
        )
    found = {}
    for name, (place, row) in zip(row_names(rows, "observer", "observer"), rows, strict=True):
        error = np.zeros(N_PARAMETERS)
        for column in known:
            if row[column]:
                (error[_COLUMNS.index(column)],) = row_numbers(place, row, ((column,), 1.0))
        found[name] = error
    return found


def errors_of_observers(
    path: str | Path, errors: Mapping[str, Array], names: Sequence[Sequence[str]]
) -> Array:
    """Constant errors of all observers from the rows of a table.

    Parameters
    ----------
    path : str or Path
        Path of the table, for messages.
    errors : mapping of str to ndarray, shape (6,)
        See `load_observer_errors`.
    names : sequence of sequence of str
        Names of each observer, any of which the table may use.

    Returns
    -------
    ndarray, shape (observer, 6)
        In the order of `OBSERVER_PARAMETERS`; m, arcsec and s. Zero without a row.

    Raises
    ------
    ConfigurationError
        If an observer of the table does not exist, or has two rows.
    """
    out, row_of = np.zeros((len(names), N_PARAMETERS)), {}
    known = {name: number for number, own in enumerate(names) for name in own}
    for name, error in errors.items():
        if name not in known:
            remedy = did_you_mean(name, known) or f"they are 0 .. {len(names) - 1}"
            raise ConfigurationError(f"{path}: there is no observer {name!r}: {remedy}")
        number = known[name]
        if number in row_of:
            raise ConfigurationError(
                f"{path}: {row_of[number]!r} and {name!r} are the same observer; remove a row"
            )
        row_of[number], out[number] = name, error
    return out
