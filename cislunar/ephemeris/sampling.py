"""Sun and Moon from SPICE, in the rotating frame of the three-body problem.

Paul & Fan (section 2.2) take the Sun from the JPL ephemerides through SPICE and transform it to the
rotating frame at every time step. Here the frame follows the *ephemeris* Moon: x from the Earth to
the Moon, z along r x v of the Moon relative to the Earth, y = z x x. The origin is the Earth-Moon
barycenter, and lengths are divided by the constant l*. The Sun is sampled once, so that no other
module needs SPICE; `interpolate_sun` interpolates between the samples.

Assumptions and limitations
---------------------------
- Positions are geometric: light time and aberration (20 arcsec for the Sun) are neglected.
- The true Earth-Moon distance varies by 6 percent; l* does not. The photometry depends only on the
  direction to the Sun and on its distance of some 390 units.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from cislunar.constants import EPOCH_JD, LENGTH_UNIT_KM, SECONDS_PER_DAY, TIME_UNIT_S
from cislunar.ephemeris.kernel import (
    DEFAULT_KERNEL,
    EARTH,
    EARTH_MOON_BARYCENTER,
    MOON,
    SUN,
    kernel_path,
    loaded,
    require_coverage,
)
from cislunar.ephemeris.time_scales import julian_date, tai_minus_utc, utc_to_tdb
from cislunar.errors import ConfigurationError
from cislunar.quantities import date_of, in_unit
from cislunar.runtime.arguments import Array, array_of, number_of, require_kind


@dataclass(frozen=True)
class SunMoonEphemeris:
    """Sun and rotating frame on a uniform grid of times.

    Attributes
    ----------
    time_utc_jd, et : ndarray, shape (time,)
        Julian dates, UTC, and TDB seconds past J2000.
    sun_position : ndarray, shape (time, 3)
        Sun relative to the Earth-Moon barycenter, nondimensional, rotating frame.
    moon_rotation : ndarray, shape (time, 3, 3)
        Rotation from J2000 axes to the rotating frame.
    """

    time_utc_jd: Array
    et: Array
    sun_position: Array
    moon_rotation: Array

    @property
    def time(self) -> Array:
        """Nondimensional time since the first sample, shape (time,)."""
        return (self.et - self.et[0]) / TIME_UNIT_S


def sample_ephemeris(
    epoch_jd: float | str = EPOCH_JD,
    duration_days: float = 30.0,
    step_minutes: float = 60.0,
    kernel: str | Path = DEFAULT_KERNEL,
) -> SunMoonEphemeris:
    """Sun and rotating frame from SPICE, on a uniform grid.

    Parameters
    ----------
    epoch_jd : float or str
        First time, UTC (from 1972 on): a Julian date, or ISO 8601 like ``2024-10-01T00:00:00``.
    duration_days : float
        Length of the grid, days. The last sample lies at its end, or up to a step after it if the
        step does not divide it.
    step_minutes : float
        Spacing, minutes.
    kernel : str or Path
        ``"de421"``, ``"de440"``, or the path of an SPK file.

    Returns
    -------
    SunMoonEphemeris

    Raises
    ------
    ConfigurationError
        If the epoch is no date or lies before 1972, or another argument is impossible.
    InputFileError
        If the kernel is missing, lacks a body, or does not cover the dates.
    """
    epoch_jd = date_of(epoch_jd)
    if isinstance(epoch_jd, str):
        epoch_jd = julian_date(epoch_jd)
    duration_days = in_unit("duration_days", duration_days, "d")
    step_minutes = in_unit("step_minutes", step_minutes, "min")
    intervals, step_s = _intervals(duration_days, step_minutes)
    first = float(utc_to_tdb(epoch_jd, "epoch_jd"))
    require_kind("kernel", kernel, (str, Path), "give 'de421', 'de440' or the path of an SPK file")
    path = kernel_path(kernel)

    import spiceypy

    with loaded(path):
        # before arrays are made, which may be too long for the memory
        require_coverage(path, first, first + intervals * step_s)
        elapsed = np.arange(intervals + 1) * step_s
        et = first + elapsed
        moon = np.array([spiceypy.spkgeo(MOON, t, "J2000", EARTH)[0] for t in et])
        sun = np.array([spiceypy.spkgps(SUN, t, "J2000", EARTH_MOON_BARYCENTER)[0] for t in et])

    rotation = rotating_frame(moon[:, :3], moon[:, 3:])
    # A leap second within the span shifts UTC; the physical grid stays uniform.
    naive = epoch_jd + elapsed / SECONDS_PER_DAY
    leaps = tai_minus_utc(naive) - tai_minus_utc(epoch_jd)
    return SunMoonEphemeris(
        time_utc_jd=naive - leaps / SECONDS_PER_DAY,
        et=et,
        sun_position=np.einsum("tij,tj->ti", rotation, sun) / LENGTH_UNIT_KM,
        moon_rotation=rotation,
    )


def check_coverage(
    epoch_jd: float, duration_days: float, step_minutes: float, kernel: str | Path
) -> None:
    """Raise the errors that `sample_ephemeris` would raise for these arguments."""
    start = float(utc_to_tdb(epoch_jd, "epoch_jd"))
    intervals, step_s = _intervals(duration_days, step_minutes)
    path = kernel_path(kernel)
    with loaded(path):
        require_coverage(path, start, start + intervals * step_s)


def rotating_frame(position: ArrayLike, velocity: ArrayLike) -> Array:
    """Rotation from inertial axes to the rotating frame of an orbiting body.

    Parameters
    ----------
    position, velocity : array_like, shape (..., 3)
        Moon relative to the Earth, inertial axes, any unit.

    Returns
    -------
    ndarray, shape (..., 3, 3)
        Rows are the unit vectors x = r, z = r x v, y = z x x (normalized), so that
        ``rotation @ inertial`` is the vector in the rotating frame. They are NaN where the position
        is zero or parallel to the velocity, which do not define the axes.
    """
    r = np.asarray(position, dtype=float)
    x = r / np.linalg.norm(r, axis=-1, keepdims=True)
    z = np.cross(r, np.asarray(velocity, dtype=float))
    z /= np.linalg.norm(z, axis=-1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=-2)


def interpolate_sun(time: ArrayLike, sample_time: ArrayLike, sun_position: ArrayLike) -> Array:
    """Sun between the samples, by linear interpolation.

    With hourly samples the result is within 2e-5 of the Sun's distance and 2e-6 rad (0.4 arcsec)
    of its direction: the Moon's rate varies by n^2 2e, e = 0.055, within an hour.

    Parameters
    ----------
    time : array_like, shape (...)
        Nondimensional times since the first sample's epoch.
    sample_time : array_like, shape (n,)
        Times of the samples, nondimensional, increasing (`SunMoonEphemeris.time`).
    sun_position : array_like, shape (n, 3)
        Nondimensional, rotating frame.

    Returns
    -------
    ndarray, shape (..., 3)
        Nondimensional, rotating frame.

    Raises
    ------
    ConfigurationError
        If a time lies outside of the sampled span, or the samples are not finite or of another
        shape.
    """
    t = array_of("time", time, finite=False)
    grid = array_of("sample_time", sample_time, ("sample",))
    sun = array_of("sun_position", sun_position, (grid.size, 3))
    slack = 1e-9  # rounding of a converted time (0.4 ms)
    if not np.all((t >= grid[0] - slack) & (t <= grid[-1] + slack)):
        days = TIME_UNIT_S / SECONDS_PER_DAY
        raise ConfigurationError(
            f"times from {np.min(t) * days:.4f} to {np.max(t) * days:.4f} days are not within the "
            f"sampled ephemeris, {grid[0] * days:.4f} to {grid[-1] * days:.4f} days after its "
            "epoch; sample it for longer (duration_days)"
        )
    return np.stack([np.interp(t, grid, sun[:, axis]) for axis in range(3)], axis=-1)


def _intervals(duration_days: float, step_minutes: float) -> tuple[int, float]:
    """Number of intervals of a uniform grid of times, and their length, s."""
    if number_of("duration_days", duration_days) < 0.0:
        raise ConfigurationError(f"duration_days = {duration_days} must be finite and >= 0")
    number_of("step_minutes", step_minutes, positive=True)
    intervals = int(np.ceil(duration_days * 1440.0 / step_minutes - 1e-9))
    return intervals, step_minutes * 60.0
