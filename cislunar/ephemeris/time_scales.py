"""UTC and TDB.

UTC is carried to TDB with the published leap seconds (IERS Bulletin C), of which the last is that
of 2017-01-01; later ones are unknown to this version. The periodic part of TDB - TT is kept to its
leading term (the neglected ones stay below 0.05 ms).
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.constants import SECONDS_PER_DAY
from cislunar.errors import ConfigurationError

Array = NDArray[np.float64]

J2000_JD = 2_451_545.0
TT_MINUS_TAI_S = 32.184

# TAI - UTC in seconds from the dates on which it stepped (IERS Bulletin C): ten at first, one more
# at each date that follows.
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


def tai_minus_utc(time_utc_jd: ArrayLike) -> Array:
    """Leap seconds in force.

    Parameters
    ----------
    time_utc_jd : array_like
        Julian date, UTC.

    Returns
    -------
    ndarray
        TAI - UTC, s.

    Raises
    ------
    ConfigurationError
        Before 1972, when UTC had no whole leap seconds.
    """
    jd = np.asarray(time_utc_jd, dtype=float)
    if not np.all(np.isfinite(jd)) or np.any(jd < _LEAP_JD[0]):
        raise ConfigurationError(
            f"epoch_jd: Julian dates must be finite and not before 1972-01-01 ({_LEAP_JD[0]}), "
            f"where UTC with leap seconds begins; got {np.min(jd)}"
        )
    return _FIRST_TAI_MINUS_UTC_S - 1.0 + np.searchsorted(_LEAP_JD, jd, side="right")


def utc_to_tdb(time_utc_jd: ArrayLike) -> Array:
    """TDB seconds past J2000 of Julian dates in UTC.

    TDB - TT is kept to ``1.657 ms sin(E)``, E the Earth's eccentric anomaly: the formula of the
    SPICE time subsystem.

    Parameters
    ----------
    time_utc_jd : array_like
        Julian date, UTC (from 1972 on).

    Returns
    -------
    ndarray
        TDB seconds past J2000 (SPICE's ET).
    """
    jd = np.asarray(time_utc_jd, dtype=float)
    tt = (jd - J2000_JD) * SECONDS_PER_DAY + tai_minus_utc(jd) + TT_MINUS_TAI_S
    mean_anomaly = 6.239996 + 1.99096871e-7 * tt
    return tt + 1.657e-3 * np.sin(mean_anomaly + 1.671e-2 * np.sin(mean_anomaly))


def calendar_date(tdb_s: float) -> str:
    """Calendar date of TDB seconds past J2000, to the minute."""
    return str(np.datetime64("2000-01-01T12:00") + np.timedelta64(round(tdb_s / 60.0), "m"))
