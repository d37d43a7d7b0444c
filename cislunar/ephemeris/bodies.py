"""Table of Earth, Moon and Sun that is read without SPICE, and the orientation of the Moon.

Positions are tabulated relative to the Earth-Moon barycenter, in J2000 (ICRF) axes. Between nodes,
10 minutes apart, a cubic Hermite polynomial interpolates position and velocity; it is within 0.1 mm
of the kernel (`docs/dynamics.md`).

The kernel DE421 has no orientations. That of the Moon is the series of the IAU working group on
cartographic coordinates (Archinal et al. 2011, Celest. Mech. Dyn. Astron. 109, 101, table 2; the
constants of the text kernel pck00010.tpc), accurate to some 150 m on the surface. Its axes are mean
Earth axes, which lie 0.03 deg from the principal axes of the gravity field.

Assumptions and limitations
---------------------------
- Masses and radii are those of DE421, with other kernels too (DE440 differs in the ninth digit).
- Positions are geometric.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cislunar.compiled import njit_inline
from cislunar.constants import SECONDS_PER_DAY
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
from cislunar.ephemeris.time_scales import calendar_date
from cislunar.errors import ConfigurationError
from cislunar.runtime import Array

# Folkner, Williams & Boggs 2009, "The planetary and lunar ephemeris DE 421", IPN Progress Report
# 42-178, km^3/s^2; TDB-compatible, unlike the WGS 84 value in `cislunar.constants`.
GM_EARTH, GM_MOON, GM_SUN = 398_600.436233, 4_902.800076, 132_712_440_040.944

NODE_SPACING_S = 600.0
BODY_COLUMNS = {"earth": slice(0, 3), "moon": slice(3, 6), "sun": slice(6, 9)}


class BodyTable(NamedTuple):
    """Polynomials of the bodies' coordinates in time.

    Attributes
    ----------
    start : float
        First node, TDB seconds past J2000, a whole number.
    spacing : float
        Spacing of the nodes, s.
    coefficients : ndarray, shape (intervals, 4, 9)
        Coefficients of the powers 0 to 3 of the fraction of the interval, km, for the coordinates
        of Earth, Moon and Sun relative to the Earth-Moon barycenter, J2000 axes.
    """

    start: float
    spacing: float
    coefficients: Array

    @property
    def stop(self) -> float:
        """Last node, TDB seconds past J2000."""
        return self.start + self.spacing * len(self.coefficients)


def tabulate_bodies(start: float, stop: float, kernel: str | Path = DEFAULT_KERNEL) -> BodyTable:
    """Sample Earth, Moon and Sun from SPICE over a span.

    Parameters
    ----------
    start, stop : float
        Span, TDB seconds past J2000, in either order; extended to the next node.
    kernel : str or Path
        ``"de421"``, ``"de440"``, or the path of an SPK file.

    Returns
    -------
    BodyTable

    Raises
    ------
    ConfigurationError
        If the span is not finite.
    InputFileError
        If the kernel is missing, lacks a body, or does not cover the span.
    """
    if not np.isfinite(start + stop):
        raise ConfigurationError(f"a span of times must be finite, got {start} to {stop}")
    path = kernel_path(kernel)

    import spiceypy

    with loaded(path):
        # Nodes at whole seconds are exact; rounding would move the Sun by 2 mm.
        first = np.floor(min(start, stop))
        count = max(1, int(np.ceil((max(start, stop) - first) / NODE_SPACING_S)))
        nodes = first + NODE_SPACING_S * np.arange(count + 1)
        require_coverage(path, float(nodes[0]), float(nodes[-1]))
        states = np.array(
            [
                [
                    spiceypy.spkgeo(body, et, "J2000", EARTH_MOON_BARYCENTER)[0]
                    for body in (EARTH, MOON, SUN)
                ]
                for et in nodes
            ]
        )
    position, velocity = states[..., :3].reshape(-1, 9), states[..., 3:].reshape(-1, 9)
    coefficients = hermite(position, velocity * NODE_SPACING_S)
    return BodyTable(float(first), NODE_SPACING_S, coefficients)


def hermite(value: Array, slope: Array) -> Array:
    """Coefficients of the cubics through values and slopes at nodes.

    Parameters
    ----------
    value, slope : ndarray, shape (n + 1, c)
        Values at the nodes, and derivatives with respect to the fraction of an interval.

    Returns
    -------
    ndarray, shape (n, 4, c)
        Coefficients of the powers 0 to 3 of the fraction of the interval.
    """
    step = np.diff(value, axis=0)
    first, last = slope[:-1], slope[1:]
    return np.stack(
        [value[:-1], first, 3.0 * step - 2.0 * first - last, first + last - 2.0 * step], 1
    )


@njit_inline
def cubic(coefficients, k, column, w):
    """Value of a tabulated column at the fraction w of interval k."""
    return (
        (coefficients[k, 3, column] * w + coefficients[k, 2, column]) * w
        + coefficients[k, 1, column]
    ) * w + coefficients[k, 0, column]


def read_table(table: BodyTable, time: ArrayLike) -> tuple[Array, Array, Array]:
    """Positions, velocities and accelerations of the bodies.

    Parameters
    ----------
    table : BodyTable
        From `tabulate_bodies`.
    time : array_like, shape (...)
        TDB seconds past J2000.

    Returns
    -------
    position, velocity, acceleration : ndarray, shape (..., 9)
        Earth, Moon and Sun (`BODY_COLUMNS`) relative to the Earth-Moon barycenter, J2000 axes, km,
        km/s and km/s^2. The acceleration is that of the cubic, with a relative accuracy of 1e-6.

    Raises
    ------
    ConfigurationError
        If a time lies outside of the table.
    """
    t = np.asarray(time, dtype=float)
    require_within(table, float(np.min(t)), float(np.max(t)))
    u = (t - table.start) / table.spacing
    k = np.clip(u.astype(int), 0, len(table.coefficients) - 1)
    w = (u - k)[..., None]
    a, b, c, d = np.moveaxis(table.coefficients[k], -2, 0)
    h = table.spacing
    return (
        ((d * w + c) * w + b) * w + a,
        ((3.0 * d * w + 2.0 * c) * w + b) / h,
        (6.0 * d * w + 2.0 * c) / h**2,
    )


def require_within(table: BodyTable, start: float, stop: float) -> None:
    """Raise a `ConfigurationError` for a span, TDB seconds past J2000, beyond a table."""
    slack = 1e-3  # rounding of a converted time
    low, high = min(start, stop), max(start, stop)
    if not (table.start - slack <= low and high <= table.stop + slack):
        requested = (
            f"{calendar_date(low)} to {calendar_date(high)}"
            if np.isfinite(low + high)
            else f"{start} to {stop}"
        )
        raise ConfigurationError(
            f"table of Earth, Moon and Sun: covers {calendar_date(table.start)} to "
            f"{calendar_date(table.stop)} (TDB), not the requested dates, {requested}; "
            "tabulate the bodies over the whole span"
        )


# fmt: off
# Degrees; angles E1 to E13 and their rates per day, then amplitudes in right ascension and
# declination of the pole and in the prime meridian.
_ANGLE = np.array([
    125.045, 250.089, 260.008, 176.625, 357.529, 311.589, 134.963, 276.617, 34.226, 15.134,
    119.743, 239.961, 25.053,
])
_RATE = np.array([
    -0.0529921, -0.1059842, 13.0120009, 13.3407154, 0.9856003, 26.4057084, 13.0649930, 0.3287146,
    1.7484877, -0.1589763, 0.0036096, 0.1643573, 12.9590088,
])
_ASCENSION = np.array([
    -3.8787, -0.1204, 0.0700, -0.0172, 0.0, 0.0072, 0.0, 0.0, 0.0, -0.0052, 0.0, 0.0, 0.0043,
])
_DECLINATION = np.array([
    1.5419, 0.0239, -0.0278, 0.0068, 0.0, -0.0029, 0.0009, 0.0, 0.0, 0.0008, 0.0, 0.0, -0.0009,
])
_MERIDIAN = np.array([
    3.5610, 0.1208, -0.0642, 0.0158, 0.0252, -0.0066, -0.0047, -0.0046, 0.0028, 0.0052, 0.0040,
    0.0019, -0.0044,
])
# fmt: on


def moon_axes(time: ArrayLike) -> Array:
    """Rotation from J2000 to Moon-fixed axes (Archinal et al. 2011, table 2).

    Parameters
    ----------
    time : array_like, shape (...)
        TDB seconds past J2000.

    Returns
    -------
    ndarray, shape (..., 3, 3)
        Rows are the axes: x at the prime meridian, towards the Earth, z the pole.
    """
    day = np.asarray(time, dtype=float) / SECONDS_PER_DAY
    century = day / 36_525.0
    angle = np.radians(_ANGLE + _RATE * day[..., None])
    ascension = np.radians(269.9949 + 0.0031 * century + np.sin(angle) @ _ASCENSION)
    declination = np.radians(66.5392 + 0.0130 * century + np.cos(angle) @ _DECLINATION)
    meridian = np.radians(
        38.3213 + 13.17635815 * day - 1.4e-12 * day**2 + np.sin(angle) @ _MERIDIAN
    )
    zero = np.zeros_like(ascension)
    sin, cos = np.sin(ascension), np.cos(ascension)
    node = np.stack([-sin, cos, zero], axis=-1)
    pole = np.stack(
        [np.cos(declination) * cos, np.cos(declination) * sin, np.sin(declination)], axis=-1
    )
    across = np.cross(pole, node)
    w = meridian[..., None]
    x = np.cos(w) * node + np.sin(w) * across
    return np.stack([x, np.cross(pole, x), pole], axis=-2)
