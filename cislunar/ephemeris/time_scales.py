"""Time scales UTC, TAI, TT and TDB.

UTC is converted with the published leap seconds (IERS Bulletin C), of which the last is that of
2017-01-01; later ones are unknown to this version. The periodic part of TDB - TT is its leading
term; the neglected terms are below 0.05 ms.
"""

import datetime
import re
from numbers import Real

import numpy as np
from numpy.typing import ArrayLike

from cislunar.constants import SECONDS_PER_DAY
from cislunar.errors import ConfigurationError
from cislunar.quantities import date_of
from cislunar.runtime.arguments import Array, require_choice

J2000_JD = 2_451_545.0
_TT_MINUS_TAI_S = 32.184

# Dates on which TAI - UTC changed (IERS Bulletin C): 10 s from the first date, one second more from
# each later date.
# fmt: off
_LEAP_STEPS = [
    "1972-01-01", "1972-07-01", "1973-01-01", "1974-01-01", "1975-01-01", "1976-01-01",
    "1977-01-01", "1978-01-01", "1979-01-01", "1980-01-01", "1981-07-01", "1982-07-01",
    "1983-07-01", "1985-07-01", "1988-01-01", "1990-01-01", "1991-01-01", "1992-07-01",
    "1993-07-01", "1994-07-01", "1996-01-01", "1997-07-01", "1999-01-01", "2006-01-01",
    "2009-01-01", "2012-07-01", "2015-07-01", "2017-01-01",
]
# fmt: on
_LEAP_JD = (
    J2000_JD
    - 0.5
    + (np.array(_LEAP_STEPS, dtype="datetime64[D]") - np.datetime64("2000-01-01")).astype(float)
)
_FIRST_TAI_MINUS_UTC_S = 10.0


def _utc_dates(name: str, jd: ArrayLike) -> Array:
    """Julian dates in UTC as an array; a `ConfigurationError` names the argument at fault."""
    dates = np.asarray(jd, dtype=float)
    if not np.all(np.isfinite(dates)) or np.any(dates < _LEAP_JD[0]):
        raise ConfigurationError(
            f"{name} = {np.min(dates)}: Julian dates must be finite and not before 1972-01-01 "
            f"({_LEAP_JD[0]}), where UTC with leap seconds begins"
        )
    return dates


def tai_minus_utc(time_utc_jd: ArrayLike) -> Array:
    """TAI - UTC, s, at Julian dates in UTC from 1972 on, when whole leap seconds began."""
    jd = _utc_dates("time_utc_jd", time_utc_jd)
    return _FIRST_TAI_MINUS_UTC_S - 1.0 + np.searchsorted(_LEAP_JD, jd, side="right")


def utc_to_tdb(time_utc_jd: ArrayLike, name: str = "time_utc_jd") -> Array:
    """TDB seconds past J2000 (SPICE's ET) of Julian dates in UTC, from 1972 on. TDB - TT is
    ``1.657 ms sin(E)`` with the Earth's eccentric anomaly E, the formula of SPICE.

    A Julian date has a resolution of 40 microseconds. It stands for the nearest date with four
    decimals of a second, so that a calendar date with no more decimals is recovered exactly.

    Raises
    ------
    ConfigurationError
        If a date is not finite or lies before 1972; the message names the argument by `name`.
    """
    elapsed = (_utc_dates(name, time_utc_jd) - J2000_JD) * SECONDS_PER_DAY
    return clock_to_tdb(np.round(elapsed, 4), "UTC")


def _leaps(clock: Array) -> Array:
    """TAI - UTC at dates in UTC. Their days decide, because the Julian date of a time shortly
    before midnight is rounded to the next day."""
    return tai_minus_utc(J2000_JD - 0.5 + np.floor(clock / SECONDS_PER_DAY + 0.5))


def _tdb_minus_tt(tt: Array) -> Array:
    mean_anomaly = 6.239996 + 1.99096871e-7 * tt
    return 1.657e-3 * np.sin(mean_anomaly + 1.671e-2 * np.sin(mean_anomaly))


TIME_SYSTEMS = ("UTC", "TAI", "TT", "TDB")
"""Time scales of dates."""

_DATE = re.compile(
    r"(\d{4})-(?:(\d\d)-(\d\d)|(\d{3}))(?:[T ](\d\d):(\d\d)(?::(\d\d(?:\.\d*)?))?)?(?:Z|\+00:00)?",
    re.ASCII,
)
_NOON = datetime.datetime(2000, 1, 1, 12)


def clock_seconds(date: str) -> float:
    """Seconds from 2000-01-01T12:00 to a date in the same time scale, without leap seconds.

    Parameters
    ----------
    date : str
        ISO 8601: ``2024-10-01``, ``2024-10-01T06:30:00.5`` or, with the day of the year,
        ``2024-275T06:30:00``; a blank may stand for the T, and a Z or +00:00 may follow. Other time
        zones and leap seconds are not supported.

    Returns
    -------
    float

    Raises
    ------
    ConfigurationError
        If the text is not such a date.
    """
    try:
        found = _DATE.fullmatch(date.strip())
        year, month, day, of_year, hour, minute, second = found.groups()
        start = datetime.datetime(int(year), int(month or 1), int(day or 1))
        start += datetime.timedelta(int(of_year or 1) - 1)
        clock = datetime.timedelta(hours=int(hour or 0), minutes=int(minute or 0))
        seconds = float(second or 0.0)
        if start.year != int(year) or int(hour or 0) > 23 or max(int(minute or 0), seconds) >= 60:
            raise ValueError
    except (AttributeError, ValueError, OverflowError):
        raise ConfigurationError(
            f"{date!r} is not a date: write it like 2024-10-01T00:00:00 (ISO 8601, no time zone)"
        ) from None
    return (start + clock - _NOON).total_seconds() + seconds


def julian_date(date: str) -> float:
    """Julian date of an ISO 8601 date (see `clock_seconds`) in the same time scale.

    Raises
    ------
    ConfigurationError
        If the text is not such a date.
    """
    return J2000_JD + clock_seconds(date) / SECONDS_PER_DAY


def clock_to_tdb(seconds: ArrayLike, system: str) -> Array:
    """TDB seconds past J2000 of dates in a time scale.

    Parameters
    ----------
    seconds : array_like
        Dates, as from `clock_seconds`.
    system : {"UTC", "TAI", "TT", "TDB"}
        Time scale of the dates.

    Returns
    -------
    ndarray
        With the rounding of a double, 0.1 microseconds in this century.

    Raises
    ------
    ConfigurationError
        If the time scale is unknown, or a UTC date lies before 1972.
    """
    clock = np.asarray(seconds, dtype=float)
    require_choice("system", system, TIME_SYSTEMS)
    if system == "TDB":
        return clock.copy()
    leaps = _leaps(clock) if system == "UTC" else 0.0
    tt = clock + leaps + (0.0 if system == "TT" else _TT_MINUS_TAI_S)
    return tt + _tdb_minus_tt(tt)


def tdb_seconds(instant: str | float) -> float:
    """TDB seconds past J2000 of a date in UTC.

    Parameters
    ----------
    instant : str, float, datetime, numpy.datetime64 or astropy.time.Time
        ISO 8601 date (see `clock_seconds`), Julian date (see `utc_to_tdb`), or see
        `cislunar.quantities.date_of`.

    Returns
    -------
    float
        TDB, s.

    Raises
    ------
    ConfigurationError
        If the text is not such a date, or the date lies before 1972.
    """
    instant = date_of(instant)
    if isinstance(instant, str):
        return float(clock_to_tdb(clock_seconds(instant), "UTC"))
    if isinstance(instant, bool) or not isinstance(instant, Real):
        raise ConfigurationError(
            f"{instant!r} is not a date: give a text like '2024-10-01T00:00:00', or a Julian date"
        )
    return float(utc_to_tdb(instant))


def tdb_to_clock(tdb_s: ArrayLike, system: str) -> Array:
    """Dates in a time scale, as from `clock_seconds`; the inverse of `clock_to_tdb`.

    Parameters
    ----------
    tdb_s : array_like
        TDB seconds past J2000.
    system : {"UTC", "TAI", "TT", "TDB"}
        Time scale of the dates.

    Returns
    -------
    ndarray
        Seconds.

    Raises
    ------
    ConfigurationError
        If the time scale is unknown, or a UTC date lies before 1972.
    """
    tdb = np.asarray(tdb_s, dtype=float)
    require_choice("system", system, TIME_SYSTEMS)
    if system == "TDB":
        return tdb.copy()
    clock = tdb - _tdb_minus_tt(tdb)
    if system == "TT":
        return clock
    clock = clock - _TT_MINUS_TAI_S
    if system == "UTC":
        clock = clock - _leaps(clock - _leaps(clock))
    return clock


def tdb_after(epoch_tdb_s: ArrayLike, elapsed_s: ArrayLike) -> Array:
    """TDB seconds past J2000 at times after an epoch.

    Parameters
    ----------
    epoch_tdb_s : array_like
        Epoch, TDB seconds past J2000.
    elapsed_s : array_like
        Times since the epoch, in seconds of TT, TAI and UTC, so that equal steps are equal steps of
        dates in UTC. Seconds of TDB differ from them by up to 30 microseconds a day.

    Returns
    -------
    ndarray, shape (...)
        TDB, s, of the broadcast epochs and times.
    """
    return clock_to_tdb(tdb_to_clock(epoch_tdb_s, "TT") + np.asarray(elapsed_s, dtype=float), "TT")


def tdb_since(epoch_tdb_s: ArrayLike, tdb_s: ArrayLike) -> Array:
    """Seconds of TT, TAI and UTC since an epoch; the inverse of `tdb_after`."""
    return tdb_to_clock(tdb_s, "TT") - tdb_to_clock(epoch_tdb_s, "TT")


def clock_text(seconds: float) -> str:
    """ISO 8601 date of a number of `clock_seconds`, to the microsecond."""
    micro = np.timedelta64(round(seconds * 1e6), "us")
    return str(np.datetime64("2000-01-01T12:00:00.000000") + micro)


def calendar_date(tdb_s: float) -> str:
    """Calendar date of TDB seconds past J2000, to the minute."""
    return str(np.datetime64("2000-01-01T12:00") + np.timedelta64(round(tdb_s / 60.0), "m"))
