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

Array = NDArray[np.float64]

REQUIRED = ("stn", "obsTime", "ra", "dec")
"""Columns of every table of observations."""

OBJECT_NAMES = ("permID", "provID", "artSat")
"""Columns that name the object; the first that is not empty is used."""

POSITION_COLUMNS = ("pos1", "pos2", "pos3")

RANGES = {
    **dict.fromkeys(("ra", "mag", *POSITION_COLUMNS), (-np.inf, np.inf, "be a finite number")),
    **dict.fromkeys(("rmsRA", "rmsDec", "rmsMag"), (0.0, np.inf, "be a positive number")),
    "dec": (-90.0, 90.0, "be a number between -90 and 90"),
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
    """Refuse a table in which a value breaks a rule.

    Parameters
    ----------
    table : DataFrame
    name : str
        Column of the values.
    right : array_like of bool, shape (row,)
        Whether the value of each row obeys the rule.
    rule : str
        The rule after the word "must", for the message.
    fault : type
        Class of the error.
    place : str
        Name of the table, for the message.

    Raises
    ------
    fault
        For the first row in which `right` is false.
    """
    for row in np.flatnonzero(~np.asarray(right, dtype=bool))[:1].tolist():
        value = table[name].iloc[row]
        raise fault(f"{place}, row {row + 1}: {name} = {value} must {rule}")


def numbers_within(
    table: pd.DataFrame,
    name: str,
    fault: type[CislunarError] = ConfigurationError,
    place: str = "observations",
    *,
    optional: bool = False,
) -> Array:
    """Numbers of a column, which must lie within its interval in `RANGES`.

    Parameters
    ----------
    table : DataFrame
    name : str
        Column, a key of `RANGES`.
    fault, place
        See `require`.
    optional : bool
        Whether values may be missing.

    Returns
    -------
    ndarray, shape (row,)
        NaN where a value is missing.

    Raises
    ------
    fault
        If a value is no number or not within the interval.
    """
    values = pd.to_numeric(table[name], errors="coerce").to_numpy(dtype=float)
    least, most, rule = RANGES[name]
    absent = _text(table, name) == "" if optional else np.zeros(len(table), dtype=bool)
    require(table, name, absent | ((values > least) & (values < most)), rule, fault, place)
    return values


def observation_times(
    table: pd.DataFrame,
    fault: type[CislunarError] = ConfigurationError,
    place: str = "observations",
) -> Array:
    """Times of the column ``obsTime``.

    Parameters
    ----------
    table : DataFrame
    fault, place
        See `require`.

    Returns
    -------
    ndarray, shape (row,)
        TDB seconds past J2000.

    Raises
    ------
    fault
        If a value is no date.
    """
    seconds: dict[str, float] = {}
    given = table["obsTime"].astype(str).tolist()
    for row, date in enumerate(given):
        try:
            seconds[date] = seconds[date] if date in seconds else tdb_seconds(date)
        except ConfigurationError as error:
            raise fault(f"{place}, row {row + 1}: obsTime: {error}") from error
    return np.array([seconds[date] for date in given])


def observation_dates(tdb_s: ArrayLike) -> list[str]:
    """Dates for the column ``obsTime``.

    Parameters
    ----------
    tdb_s : array_like, shape (row,)
        TDB seconds past J2000.

    Returns
    -------
    list of str
        ISO 8601, UTC, to the microsecond, with the letter Z at the end.
    """
    return [f"{date}Z" for date in dates(tdb_s, DATE_SYSTEM)]


def checked(table: pd.DataFrame, optional: Iterable[str]) -> pd.DataFrame:
    """The columns of a table that a format has, with numbers as floats and names as text.

    Parameters
    ----------
    table : DataFrame
        See the module.
    optional : iterable of str
        Columns of the format besides `REQUIRED`; those that the table lacks are added empty.

    Raises
    ------
    ConfigurationError
        If a required column is missing or has an empty value, or a number is invalid or outside of
        its range.
    """
    missing = [name for name in REQUIRED if name not in table]
    if missing:
        raise ConfigurationError(
            f"observations: columns {', '.join(missing)} are missing; the table needs "
            f"{', '.join(REQUIRED)}"
        )
    columns = {}
    for name in dict.fromkeys((*REQUIRED, *optional)):
        if name not in table:
            columns[name] = np.full(len(table), np.nan if name in RANGES else "", dtype=object)
        elif name in RANGES:
            columns[name] = numbers_within(table, name, optional=name not in REQUIRED)
        else:
            columns[name] = _text(table, name)
            if name in REQUIRED:
                require(table, name, columns[name] != "", "be given")
    found = pd.DataFrame(columns)
    return found.astype({name: float for name in found if name in RANGES})


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
