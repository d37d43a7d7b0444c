"""Sun and Moon from SPICE, in the rotating frame of the three-body problem.

Paul & Fan (section 2.2) take the Sun from the JPL ephemerides through SPICE and carry it into the
rotating frame at every time step. Here the frame follows the *ephemeris* Moon: x from the Earth
to the Moon, z along r x v of the Moon about the Earth, y = z x x; the origin is the Earth-Moon
barycenter and lengths are divided by the constant l*. The result is sampled once, so that nothing
downstream needs SPICE; `interpolate_sun` reads between the samples.

Assumptions and limitations
---------------------------
- Positions are geometric: light time and aberration (20 arcsec for the Sun) are neglected.
- The true Earth-Moon distance varies by 6 per cent; l* does not. Only directions to the Sun, and
  its distance of some 390 units, matter to the photometry.
- UTC is carried to TDB with the published leap seconds (IERS Bulletin C), of which the last is
  that of 2017-01-01; later ones are unknown to this version. The periodic part of TDB - TT is kept
  to its leading term (the neglected ones stay below 0.05 ms).

`spiceypy` is imported inside the functions, and every kernel is unloaded again before they return.
"""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.constants import EPOCH_JD, LENGTH_UNIT_KM, SECONDS_PER_DAY, TIME_UNIT_S
from cislunar.errors import ConfigurationError, InputFileError

Array = NDArray[np.float64]

DEFAULT_KERNEL = "de421"
"""JPL DE421 (1899 to 2053), the file carried by the `skyfield-data` package."""

J2000_JD = 2_451_545.0
TT_MINUS_TAI_S = 32.184

# NAIF identifiers, and the names they go by in messages.
_SUN, _EARTH_MOON_BARYCENTER, _EARTH, _MOON = 10, 3, 399, 301
_BODIES = {
    _SUN: "the Sun",
    _EARTH_MOON_BARYCENTER: "the Earth-Moon barycenter",
    _EARTH: "the Earth",
    _MOON: "the Moon",
}

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


@dataclass(frozen=True)
class Ephemeris:
    """Sun and Moon sampled on a uniform grid of times.

    Attributes
    ----------
    time_utc_jd : ndarray, shape (time,)
        Julian date, UTC.
    et : ndarray, shape (time,)
        TDB seconds past J2000, uniformly spaced.
    sun_position : ndarray, shape (time, 3)
        Sun from the Earth-Moon barycenter, nondimensional, rotating frame.
    moon_rotation : ndarray, shape (time, 3, 3)
        Rotation from J2000 to the rotating frame: ``r_rotating = moon_rotation @ r_j2000``.
    """

    time_utc_jd: Array
    et: Array
    sun_position: Array
    moon_rotation: Array

    @property
    def time(self) -> Array:
        """Nondimensional time since the first sample, shape (time,)."""
        return (self.et - self.et[0]) / TIME_UNIT_S


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


def kernel_path(kernel: str | Path = DEFAULT_KERNEL) -> Path:
    """File of an ephemeris kernel.

    Parameters
    ----------
    kernel : str or Path
        ``"de421"``, or the path of an SPK file of one's own (DE440, ...).

    Returns
    -------
    Path
        An existing file.

    Raises
    ------
    InputFileError
        If there is no such file.
    """
    if str(kernel) != DEFAULT_KERNEL:
        path = Path(kernel)
        with suppress(RuntimeError):  # of a user who is not there
            path = path.expanduser()
        mend = f"set the kernel to {DEFAULT_KERNEL!r} or to the path of an SPK (.bsp) file"
    else:
        # The file is located directly: the package's own accessor warns of the age of an unrelated
        # table of Earth orientation.
        try:
            path = Path(str(files("skyfield_data").joinpath("data", "de421.bsp")))
        except ModuleNotFoundError:
            path = Path("skyfield_data/data/de421.bsp")
        mend = "install the package skyfield-data, or set the kernel to the path of an SPK file"
    if not path.is_file():
        raise InputFileError(f"ephemeris kernel {path}: no such file; {mend}")
    return path


def sample_ephemeris(
    epoch_jd: float = EPOCH_JD,
    duration_days: float = 30.0,
    step_minutes: float = 60.0,
    kernel: str | Path = DEFAULT_KERNEL,
) -> Ephemeris:
    """Sun and rotating frame from SPICE, on a uniform grid.

    Parameters
    ----------
    epoch_jd : float
        First time, Julian date UTC (from 1972 on).
    duration_days : float
        Length of the grid, days; the last sample lies at its end, or up to a step after it if the
        step does not divide it.
    step_minutes : float
        Spacing, minutes.
    kernel : str or Path
        ``"de421"``, or the path of an SPK file.

    Returns
    -------
    Ephemeris

    Raises
    ------
    ConfigurationError
        If a time is impossible.
    InputFileError
        If the kernel is missing, is not an SPK file, lacks a body, or does not cover the dates.
    """
    elapsed = _grid(duration_days, step_minutes)
    et = float(utc_to_tdb(epoch_jd)) + elapsed
    path = kernel_path(kernel)

    import spiceypy

    with _loaded(path):
        _require_coverage(path, float(et[0]), float(et[-1]))
        moon = np.array([spiceypy.spkgeo(_MOON, t, "J2000", _EARTH)[0] for t in et])
        sun = np.array([spiceypy.spkgps(_SUN, t, "J2000", _EARTH_MOON_BARYCENTER)[0] for t in et])

    rotation = rotating_frame(moon[:, :3], moon[:, 3:])
    # A leap second within the span leaves the physical grid uniform and moves the clock.
    naive = epoch_jd + elapsed / SECONDS_PER_DAY
    leaps = tai_minus_utc(naive) - tai_minus_utc(epoch_jd)
    return Ephemeris(
        time_utc_jd=naive - leaps / SECONDS_PER_DAY,
        et=et,
        sun_position=np.einsum("tij,tj->ti", rotation, sun) / LENGTH_UNIT_KM,
        moon_rotation=rotation,
    )


def check_coverage(
    epoch_jd: float, duration_days: float, step_minutes: float, kernel: str | Path
) -> None:
    """Refuse a kernel that cannot be sampled over a span, without sampling it.

    Parameters
    ----------
    epoch_jd, duration_days, step_minutes, kernel
        As for `sample_ephemeris`.

    Raises
    ------
    ConfigurationError
        If a time is impossible.
    InputFileError
        If the kernel is missing, is not an SPK file, lacks a body, or does not cover the dates.
    """
    start, length = float(utc_to_tdb(epoch_jd)), _grid(duration_days, step_minutes)[-1]
    path = kernel_path(kernel)
    with _loaded(path):
        _require_coverage(path, start, start + float(length))


def rotating_frame(position: ArrayLike, velocity: ArrayLike) -> Array:
    """Rotation from the inertial axes to the rotating frame of an orbiting body.

    Parameters
    ----------
    position, velocity : array_like, shape (..., 3)
        Of the Moon relative to the Earth, inertial axes, any unit.

    Returns
    -------
    ndarray, shape (..., 3, 3)
        Rows are the unit vectors x = r, z = r x v, y = z x x (normalized), so that
        ``rotation @ inertial`` is the vector in the rotating frame.
    """
    r = np.asarray(position, dtype=float)
    x = r / np.linalg.norm(r, axis=-1, keepdims=True)
    z = np.cross(r, np.asarray(velocity, dtype=float))
    z /= np.linalg.norm(z, axis=-1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=-2)


def interpolate_sun(time: ArrayLike, sample_time: ArrayLike, sun_position: ArrayLike) -> Array:
    """Sun between the samples, linearly.

    With hourly samples the result is within 2e-5 of the Sun's distance and 2e-6 rad (0.4 arcsec)
    of its direction: the Moon's rate varies by n^2 2e, e = 0.055, within an hour.

    Parameters
    ----------
    time : array_like, shape (...)
        Nondimensional times since the first sample's epoch.
    sample_time : array_like, shape (n,)
        Times of the samples, nondimensional, increasing (`Ephemeris.time`).
    sun_position : array_like, shape (n, 3)
        Nondimensional, rotating frame.

    Returns
    -------
    ndarray, shape (..., 3)
        Nondimensional, rotating frame.

    Raises
    ------
    ConfigurationError
        If a time lies outside of the sampled span.
    """
    t = np.asarray(time, dtype=float)
    grid = np.asarray(sample_time, dtype=float)
    sun = np.asarray(sun_position, dtype=float)
    slack = 1e-9  # rounding of a time converted there and back (0.4 ms)
    if not np.all((t >= grid[0] - slack) & (t <= grid[-1] + slack)):
        days = TIME_UNIT_S / SECONDS_PER_DAY
        raise ConfigurationError(
            f"times from {np.min(t) * days:.4f} to {np.max(t) * days:.4f} days are not within the "
            f"sampled ephemeris, {grid[0] * days:.4f} to {grid[-1] * days:.4f} days after its "
            "epoch; sample it for longer (duration_days)"
        )
    return np.stack([np.interp(t, grid, sun[:, axis]) for axis in range(3)], axis=-1)


def _grid(duration_days: float, step_minutes: float) -> Array:
    """Uniform grid of times, s since the first; impossible ones are refused."""
    if not (np.isfinite(duration_days) and duration_days >= 0.0):
        raise ConfigurationError(f"duration_days = {duration_days} must be finite and >= 0")
    if not (np.isfinite(step_minutes) and step_minutes > 0.0):
        raise ConfigurationError(f"step_minutes = {step_minutes} must be finite and > 0")
    intervals = int(np.ceil(duration_days * 1440.0 / step_minutes - 1e-9))
    return np.arange(intervals + 1) * (step_minutes * 60.0)


@contextmanager
def _loaded(path: Path) -> Iterator[None]:
    """Hold a kernel loaded for the length of a block; a kernel the caller had loaded stays so."""
    import spiceypy
    from spiceypy.utils.exceptions import SpiceyError

    try:
        spiceypy.furnsh(str(path))
    except SpiceyError as error:
        raise InputFileError(
            f"ephemeris kernel {path}: not a SPICE kernel ({error.short})"
        ) from error
    try:
        yield
    finally:
        spiceypy.unload(str(path))


def _require_coverage(path: Path, start: float, stop: float) -> None:
    """Refuse a kernel that lacks a body or does not cover a span of TDB seconds."""
    import spiceypy
    from spiceypy.utils.exceptions import SpiceyError

    try:
        held = set(spiceypy.spkobj(str(path)))
    except SpiceyError as error:
        raise InputFileError(f"ephemeris kernel {path}: not an SPK file ({error.short})") from error
    missing = [name for body, name in _BODIES.items() if body not in held]
    if missing:
        raise InputFileError(
            f"ephemeris kernel {path}: holds nothing on {', '.join(missing)}; use a planetary "
            "ephemeris such as DE421 or DE440"
        )
    common = None
    for body in _BODIES:
        window = spiceypy.spkcov(str(path), body)
        common = window if common is None else spiceypy.wnintd(common, window)
    spans = [spiceypy.wnfetd(common, i) for i in range(spiceypy.wncard(common))]
    if not any(first <= start and stop <= last for first, last in spans):
        covered = ", ".join(f"{_calendar(a)} to {_calendar(b)}" for a, b in spans) or "no date"
        raise InputFileError(
            f"ephemeris kernel {path}: covers {covered} (TDB), not the dates wanted, "
            f"{_calendar(start)} to {_calendar(stop)}; change epoch_jd or duration_days, or give "
            "a kernel that covers them"
        )


def _calendar(et: float) -> str:
    """Calendar date of TDB seconds past J2000, to the minute."""
    return str(np.datetime64("2000-01-01T12:00") + np.timedelta64(round(et / 60.0), "m"))
