"""Tables of optical observations with the names of the Astrometry Data Exchange Standard (ADES).

A row is a direction and a magnitude: ``obsTime`` (UTC, ISO 8601), ``stn`` (station or observer),
``ra`` and ``dec`` (ICRF, deg), ``rmsRA`` (of right ascension times cos(declination)) and ``rmsDec``
(arcsec), ``rmsCorr``, ``mag`` and ``rmsMag``. The object is named by ``permID``, ``provID`` or
``artSat`` (an artificial satellite), a tracklet by ``trkSub``, the observation by ``obsID``; all
may be empty. ``sys``, ``ctr`` and ``pos1`` to ``pos3`` are the position of an observer in space.
Missing numbers are NaN, and missing text is empty.
"""

from collections.abc import Iterable

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from cislunar.constants import DATE_SYSTEM
from cislunar.ephemeris.time_scales import tdb_seconds
from cislunar.errors import CislunarError, ConfigurationError
from cislunar.exchange.key_values import dates
from cislunar.runtime.arguments import Array, require_kind

REQUIRED = ("stn", "obsTime", "ra", "dec")
"""Columns of every table of observations."""

OBJECT_NAMES = ("permID", "provID", "artSat")
"""Columns that name the object; the first that is not empty is used."""

POSITION_COLUMNS = ("pos1", "pos2", "pos3")

LINE = "line"
"""Name of an index of lines of a file, which messages then state in place of rows."""


def _closed(least: float, most: float) -> tuple[float, float]:
    """The open interval that contains the same numbers as the closed one."""
    return float(np.nextafter(least, -np.inf)), float(np.nextafter(most, np.inf))


RANGES = {
    **dict.fromkeys(POSITION_COLUMNS, (-np.inf, np.inf, "be a finite number")),
    **dict.fromkeys(("rmsRA", "rmsDec", "rmsMag"), (0.0, np.inf, "be a positive number")),
    "ra": (*_closed(-360.0, 360.0), "be a finite number, from -360 to 360"),
    "dec": (*_closed(-90.0, 90.0), "be a number between -90 and 90"),
    "mag": (*_closed(-40.0, 60.0), "be a finite number, from -40 to 60"),
    "rmsCorr": (-1.0, 1.0, "be a number between -1 and 1"),
}
"""Columns of numbers, and the open intervals in which they lie."""


def require(
    table: pd.DataFrame,
    name: str,
    right: ArrayLike,
    rule: str,
    fault: type[CislunarError] = ConfigurationError,
    place: str = "observations",
) -> None:
    """Raise a `fault` for the first row of the table `place` that breaks a rule: the value of
    column `name` "must ...", and `right`, shape (row,), is false."""
    for row in np.flatnonzero(~np.asarray(right, dtype=bool))[:1].tolist():
        value = table[name].iloc[row]
        raise fault(f"{place}, {_row(table, row)}: {name} = {value} must {rule}")


def _row(table: pd.DataFrame, row: int) -> str:
    """A row in words."""
    return f"line {table.index[row]}" if table.index.name == LINE else f"row {row + 1}"


def checked(
    table: pd.DataFrame,
    optional: Iterable[str],
    required: Iterable[str] = REQUIRED,
    fault: type[CislunarError] = ConfigurationError,
    place: str = "observations",
) -> pd.DataFrame:
    """The columns of a table that a format has, with numbers as floats and names as text.

    Parameters
    ----------
    table : DataFrame
        See the module.
    optional : iterable of str
        Columns of the format besides those that are required; those that the table lacks are added
        empty.
    required : iterable of str
        Columns without empty values, at least `REQUIRED`.
    fault : type
        Class of errors.
    place : str
        Name of the table, for messages.

    Returns
    -------
    DataFrame
        With ``tdb``, TDB seconds past J2000, besides the columns.

    Raises
    ------
    fault
        If a required column is missing or has an empty value, a number is invalid or outside of its
        range, or a date is none.
    ConfigurationError
        If `table` is not a DataFrame.
    """
    require_kind(place, table, pd.DataFrame, "give a table (DataFrame)")
    missing = ", ".join(name for name in required if name not in table)
    if missing:
        words = f"columns {missing} are missing; the table needs {', '.join(required)}"
        raise fault(f"{place}: {words}")
    columns = {}
    for name in dict.fromkeys((*required, *optional)):
        if name not in table:
            columns[name] = np.full(len(table), np.nan if name in RANGES else "", dtype=object)
            continue
        text = columns[name] = _text(table, name)
        right = (text != "") | (name not in required)
        if name in RANGES:
            values = columns[name] = pd.to_numeric(table[name], errors="coerce").to_numpy(float)
            least, most, rule = RANGES[name]
            right &= (text == "") | ((values > least) & (values < most))
        require(table, name, right, rule if name in RANGES else "be given", fault, place)
    found = pd.DataFrame(columns, table.index if table.index.name == LINE else None)
    found = found.astype({name: float for name in columns if name in RANGES})
    return found.assign(tdb=_times(found, fault, place))


def _times(table: pd.DataFrame, fault: type[CislunarError], place: str) -> Array:
    """TDB seconds past J2000 of dates."""
    seconds: dict[str, float] = {}
    given = table["obsTime"].tolist()
    for row, date in enumerate(given):
        try:
            seconds[date] = seconds[date] if date in seconds else tdb_seconds(date)
        except ConfigurationError as error:
            raise fault(f"{place}, {_row(table, row)}: obsTime: {error}") from error
    return np.array([seconds[date] for date in given])


def observation_dates(tdb_s: ArrayLike) -> list[str]:
    """Dates for the column ``obsTime``, ISO 8601, UTC, to the microsecond, with the letter Z at the
    end, at TDB seconds past J2000 (row,)."""
    return [f"{date}Z" for date in dates(tdb_s, DATE_SYSTEM)]


def object_of(table: pd.DataFrame) -> NDArray[np.object_]:
    """Names of the observed objects (row,), empty where none of `OBJECT_NAMES` is given."""
    found = np.full(len(table), "", dtype=object)
    for name in OBJECT_NAMES:
        if name in table:
            found = np.where(found == "", _text(table, name), found)
    return found


def _text(table: pd.DataFrame, name: str) -> NDArray[np.object_]:
    """A column as text without blanks at the ends; missing values are empty."""
    given = table[name]
    text = given.astype(str).str.strip().to_numpy(dtype=object)
    return np.where(given.isna().to_numpy(), "", text)
