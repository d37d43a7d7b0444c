"""Orbits through two tracklets: ranges at which the motions of both agree.

For a range of the first tracklet, gravity is nearly known, and the motion between the tracklets is
ballistic in axes that do not rotate,

    r_2 = r_1 + v_1 dt + (2 g_1 + g_2) dt^2 / 6,    v_2 = v_1 + (g_1 + g_2) dt / 2.             (1)

With equation (1) of `cislunar.orbit_determination.tracklets` both sides are linear in the range
rate of the first and the range of the second tracklet, for which five equations hold: the position
at the second tracklet and the two components of its rate across the line of sight. Least squares
leave three residuals, which are measured in tolerances that allow for what equation (1) neglects.
They are minimized on the straight line between the ranges of a grid, since a tracklet of minutes
permits a narrower interval of ranges than a grid resolves.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.compiled import njit_inline, njit_noalloc
from cislunar.constants import TIME_UNIT_S
from cislunar.dynamics import EARTH_MOON, acceleration, at
from cislunar.errors import ConfigurationError
from cislunar.observation import ARCSECOND
from cislunar.orbit_determination.admissible_region import (
    AdmissibleRegion,
    range_grid,
    states_at_ranges,
)
from cislunar.orbit_determination.angles import frame_rate
from cislunar.orbit_determination.tracklets import Attributables
from cislunar.runtime import Array, Indices, indices_of
from cislunar.runtime.settings_fields import Count, Positive, Section, setting

_COARSE = 4
"""Ratio of the fine to the coarse grid of ranges."""

_EXCLUDED_ABOVE = 25.0
"""Squared residual, in tolerances, above which the coarse grid excludes a pair."""

_TINY = 1e-300
"""In place of a vanishing denominator."""


class PairSettings(Section):
    """Which pairs of tracklets may be of one object."""

    # fmt: off

    n_ranges: Count = setting("ranges, equally spaced in their logarithms", "1", default=40)
    angle_tolerance_deg: Positive = setting(
        "largest residual of the direction at the second tracklet", "deg", default=0.3)
    rate_tolerance_arcsec_s: Positive = setting(
        "largest residual of its rate", "arcsec/s", default=0.1)
    most_starts: Count = setting(
        "largest number of orbits through one tracklet and later ones; of more, those with the "
        "smallest residuals are kept. Objects that fly in a group have thousands",
        "1", default=100)

    # fmt: on


class PairStarts(NamedTuple):
    """Approximate orbits through two tracklets.

    Attributes
    ----------
    first, second : ndarray of int, shape (start,)
        Indices of the tracklets.
    cost : ndarray, shape (start,)
        Squared residuals in tolerances.
    time : ndarray, shape (start,)
        That of the first tracklet.
    state : ndarray, shape (start, 6)
        At that time, nondimensional, propagation frame.
    """

    first: Indices
    second: Indices
    cost: Array
    time: Array
    state: Array


@njit_noalloc
def gravity_at(forces, rate, t, x, y, z):
    """Acceleration in axes that do not rotate, of an object at rest in them."""
    ax, ay, az = acceleration(at(forces, t), x, y, z, rate * y, -rate * x, 0.0)
    return ax + rate * rate * x, ay + rate * rate * y, az


@njit_noalloc
def _turn(cosine, sine, vector, out):
    out[0] = cosine * vector[0] - sine * vector[1]
    out[1] = sine * vector[0] + cosine * vector[1]
    out[2] = vector[2]


@njit_noalloc
def _residuals(forces, rate, t, dt, turn, r, v, u, g, second, passes, units, work, out):
    """Residuals (5,) of both tracklets into `out`; range rate of the first, range of the second.
    `g` is the gravity at the first, at which the object is at r with the velocity v less that along
    u. Rows of `second`: position, velocity, direction, rate and basis of the second tracklet."""
    speed, distance, wa, wr = 0.0, 0.0, 0.0, 0.0
    later, gap, jump = work[0], work[1], work[2]
    for c in range(3):
        later[c] = g[c]
    for number in range(passes):
        span = 0.0
        for c in range(3):
            gap[c] = second[0, c] - r[c] - v[c] * dt - (2.0 * g[c] + later[c]) * dt * dt / 6.0
            jump[c] = v[c] + 0.5 * (g[c] + later[c]) * dt - second[1, c]
            span += gap[c] * gap[c]
        # unknown: range rate s and second range d; dt s u - d toward = gap, and the components of
        # (jump + s u) across the second line of sight are d motion
        scale = distance if distance > 1e-3 else max(np.sqrt(span), 1e-2)
        wa, wr = 1.0 / (units[0] * scale), 1.0 / (units[1] * scale)
        n11 = n12 = n22 = b1 = b2 = 0.0
        for c in range(3):
            a1, a2 = dt * u[c], -second[2, c]
            n11 += a1 * a1
            n12 += a1 * a2
            n22 += a2 * a2
            b1 += a1 * gap[c]
            b2 += a2 * gap[c]
        square = wa * wa
        n11, n12, n22, b1, b2 = n11 * square, n12 * square, n22 * square, b1 * square, b2 * square
        square = wr * wr
        for i in range(4, 6):
            a1 = a2 = b = 0.0
            for c in range(3):
                a1 += second[i, c] * u[c]
                a2 -= second[i, c] * second[3, c]
                b -= second[i, c] * jump[c]
            n11 += a1 * a1 * square
            n12 += a1 * a2 * square
            n22 += a2 * a2 * square
            b1 += a1 * b * square
            b2 += a2 * b * square
        determinant = n11 * n22 - n12 * n12
        speed = (n22 * b1 - n12 * b2) / determinant
        distance = (n11 * b2 - n12 * b1) / determinant
        if number + 1 < passes:
            far = distance if distance > 0.0 else scale
            x = second[0, 0] + far * second[2, 0]
            y = second[0, 1] + far * second[2, 1]
            z = second[0, 2] + far * second[2, 2]
            c, s = turn
            gx, gy, gz = gravity_at(forces, rate, t + dt, c * x + s * y, c * y - s * x, z)
            later[0], later[1], later[2] = c * gx - s * gy, s * gx + c * gy, gz
    for c in range(3):
        out[c] = (dt * u[c] * speed - distance * second[2, c] - gap[c]) * wa
    for i in range(4, 6):
        total = 0.0
        for c in range(3):
            total += second[i, c] * (jump[c] + speed * u[c] - distance * second[3, c])
        out[i - 1] = total * wr
    return speed, distance


@njit_noalloc
def _coarse_residuals(dt, u, points, second, units, out):
    """Residuals of `_residuals` with one pass for all points of a coarse grid into rows 0 to 4 of
    `out`, and ranges of the second tracklet into row 5. Rows of `points` (9, point): position,
    velocity less that along u, and gravity. The loop without branches becomes vector arithmetic."""
    p0, p1, p2 = second[0, 0], second[0, 1], second[0, 2]
    w0, w1, w2 = second[1, 0], second[1, 1], second[1, 2]
    d0, d1, d2 = second[2, 0], second[2, 1], second[2, 2]
    a0, a1, a2 = dt * u[0], dt * u[1], dt * u[2]
    # components of the rate across the second line of sight, by range rate and range
    e0 = e1 = f0 = f1 = 0.0
    for c in range(3):
        e0 += second[4, c] * u[c]
        e1 += second[5, c] * u[c]
        f0 -= second[4, c] * second[3, c]
        f1 -= second[5, c] * second[3, c]
    b0, b1, b2 = second[4, 0], second[4, 1], second[4, 2]
    c0, c1, c2 = second[5, 0], second[5, 1], second[5, 2]
    m11 = a0 * a0 + a1 * a1 + a2 * a2
    m12 = -(a0 * d0 + a1 * d1 + a2 * d2)
    m22 = d0 * d0 + d1 * d1 + d2 * d2
    s11, s12, s22 = e0 * e0 + e1 * e1, e0 * f0 + e1 * f1, f0 * f0 + f1 * f1
    third, angle2, rate2 = 0.5 * dt * dt, units[0] * units[0], units[1] * units[1]
    for k in range(points.shape[1]):
        g0, g1, g2 = points[6, k], points[7, k], points[8, k]
        q0 = p0 - points[0, k] - points[3, k] * dt - g0 * third
        q1 = p1 - points[1, k] - points[4, k] * dt - g1 * third
        q2 = p2 - points[2, k] - points[5, k] * dt - g2 * third
        j0 = points[3, k] + g0 * dt - w0
        j1 = points[4, k] + g1 * dt - w1
        j2 = points[5, k] + g2 * dt - w2
        h0 = b0 * j0 + b1 * j1 + b2 * j2
        h1 = c0 * j0 + c1 * j1 + c2 * j2
        # at least 0.01, as in `_residuals`
        scale2 = max(q0 * q0 + q1 * q1 + q2 * q2, 1e-4)
        wa2, wr2 = 1.0 / (angle2 * scale2), 1.0 / (rate2 * scale2)
        n11 = m11 * wa2 + s11 * wr2
        n12 = m12 * wa2 + s12 * wr2
        n22 = m22 * wa2 + s22 * wr2
        y1 = (a0 * q0 + a1 * q1 + a2 * q2) * wa2 - (e0 * h0 + e1 * h1) * wr2
        y2 = -(d0 * q0 + d1 * q1 + d2 * q2) * wa2 - (f0 * h0 + f1 * h1) * wr2
        inverse = 1.0 / (n11 * n22 - n12 * n12)
        speed = (n22 * y1 - n12 * y2) * inverse
        far = (n11 * y2 - n12 * y1) * inverse
        wa, wr = np.sqrt(wa2), np.sqrt(wr2)
        out[0, k] = (a0 * speed - far * d0 - q0) * wa
        out[1, k] = (a1 * speed - far * d1 - q1) * wa
        out[2, k] = (a2 * speed - far * d2 - q2) * wa
        out[3, k] = (h0 + speed * e0 + far * f0) * wr
        out[4, k] = (h1 + speed * e1 + far * f1) * wr
        out[5, k] = far


@njit_inline
def _nearest(a0, a1, a2, a3, a4, b0, b1, b2, b3, b4):
    """Least square of five residuals on the line from a to b, and where it is, from 0 to 1."""
    x0, x1, x2, x3, x4 = b0 - a0, b1 - a1, b2 - a2, b3 - a3, b4 - a4
    up = a0 * x0 + a1 * x1 + a2 * x2 + a3 * x3 + a4 * x4
    down = max(x0 * x0 + x1 * x1 + x2 * x2 + x3 * x3 + x4 * x4, _TINY)
    s = min(max(-up / down, 0.0), 1.0)
    a0, a1, a2, a3, a4 = a0 + s * x0, a1 + s * x1, a2 + s * x2, a3 + s * x3, a4 + s * x4
    return a0 * a0 + a1 * a1 + a2 * a2 + a3 * a3 + a4 * a4, s


@njit_noalloc
def _is_excluded(residuals, inside):
    """Whether residuals (7, point) between neighbors of a coarse grid exclude a pair; row 6 is for
    their squares. `inside` is 1 for points within the largest distance, and 0 for others."""
    e = residuals
    for k in range(residuals.shape[1] - 1):
        cost, _ = _nearest(
            e[0, k], e[1, k], e[2, k], e[3, k], e[4, k],
            e[0, k + 1], e[1, k + 1], e[2, k + 1], e[3, k + 1], e[4, k + 1],
        )  # fmt: skip
        far = max(e[5, k] * inside[k], e[5, k + 1] * inside[k + 1])
        e[6, k] = cost if far > 0.0 else np.inf
    possible = 0
    for k in range(residuals.shape[1] - 1):
        possible += e[6, k] <= _EXCLUDED_ABOVE
    return possible == 0


@njit_noalloc
def _scan(forces, rate, tracklets, pairs, ranges, units, largest, scratch, out):
    """Local minima of the residuals of all pairs; their number, or -1 if there are too many."""
    time, vectors = tracklets
    first, second, found_cost, found_range, found_rate = out
    start, gravity, speed, error, values, later, work, coarse, excluded, within = scratch
    rho_rate, far, inside, low_cost, low_range, low_rate = values
    count, n, last, least = 0, ranges.size, -1, ranges[0]
    for p in range(pairs.shape[0]):
        i, j = pairs[p, 0], pairs[p, 1]
        t, dt, u = time[i], time[j] - time[i], vectors[i, 2]
        if i != last:
            last = i
            for k in range(n):
                for c in range(3):
                    start[k, c] = vectors[i, 0, c] + ranges[k] * u[c]
                    speed[k, c] = vectors[i, 1, c] + ranges[k] * vectors[i, 3, c]
                inside[k] = start[k, 0] ** 2 + start[k, 1] ** 2 + start[k, 2] ** 2
                gravity[k, 0], gravity[k, 1], gravity[k, 2] = gravity_at(
                    forces, rate, t, start[k, 0], start[k, 1], start[k, 2]
                )
            for k in range(coarse.shape[1]):
                q = k * _COARSE
                for c in range(3):
                    coarse[c, k], coarse[3 + c, k] = start[q, c], speed[q, c]
                    coarse[6 + c, k] = gravity[q, c]
                within[k] = 1.0 if inside[q] <= largest * largest else 0.0
        c, s = np.cos(rate * dt), np.sin(rate * dt)
        for m in range(6):
            _turn(c, s, vectors[j, m], later[m])
        # a coarse grid with the gravity of the first tracklet alone excludes most pairs
        _coarse_residuals(dt, u, coarse, later, units, excluded)
        if _is_excluded(excluded, within):
            continue
        for k in range(n):
            far[k] = -1.0
            if inside[k] <= largest * largest:
                rho_rate[k], far[k] = _residuals(
                    forces, rate, t, dt, (c, s), start[k], speed[k], u, gravity[k], later, 2, units,
                    work, error[k],
                )  # fmt: skip
        minima = 0
        for k in range(n - 1):
            if far[k] > least and far[k + 1] > least:
                e, f = error[k], error[k + 1]
                low_cost[minima], s = _nearest(
                    e[0], e[1], e[2], e[3], e[4], f[0], f[1], f[2], f[3], f[4]
                )
                low_range[minima] = ranges[k] + s * (ranges[k + 1] - ranges[k])
                low_rate[minima] = rho_rate[k] + s * (rho_rate[k + 1] - rho_rate[k])
                minima += 1
        for m in range(minima):
            if not low_cost[m] <= 1.0:
                continue
            if m > 0 and low_cost[m - 1] < low_cost[m]:
                continue
            if m + 1 < minima and low_cost[m + 1] <= low_cost[m]:
                continue
            if count == first.size:
                return -1
            first[count], second[count] = i, j
            found_cost[count], found_range[count] = low_cost[m], low_range[m]
            found_rate[count] = low_rate[m]
            count += 1
    return count


def pair_starts(
    tracklets: Attributables,
    pairs: NDArray[np.int64],
    region: AdmissibleRegion,
    settings: PairSettings | None = None,
    *,
    forces: tuple = EARTH_MOON,
) -> PairStarts:
    """Approximate orbits through pairs of tracklets.

    Parameters
    ----------
    tracklets : Attributables
    pairs : ndarray of int, shape (pair, 2)
        Indices of tracklets at different times, the earlier one first.
    region : AdmissibleRegion
        Limits of the ranges.
    settings : PairSettings, optional
    forces : NamedTuple
        Force model.

    Returns
    -------
    PairStarts
        Local minima over the range within the tolerances, in the order of the pairs; none for a
        pair that no orbit joins, and at most `settings.most_starts` for a first tracklet.
        A pair of other tracklets, or not in order of time, raises a `ConfigurationError`.
    """
    settings = PairSettings() if settings is None else settings
    rate = frame_rate(forces)
    pairs = indices_of("pairs", pairs, tracklets.time.size).reshape(-1, 2)
    if not np.all(np.diff(tracklets.time[pairs], axis=1) > 0.0):
        raise ConfigurationError("pairs: give the earlier tracklet of each pair first")
    ranges = range_grid(region, settings.n_ranges)
    vectors = [
        tracklets.observer_position, tracklets.observer_velocity, tracklets.direction,
        tracklets.rate, tracklets.basis[:, 0], tracklets.basis[:, 1],
    ]  # fmt: skip
    data = tracklets.time, np.stack(vectors, axis=1)
    per_unit = ARCSECOND * TIME_UNIT_S
    units = np.deg2rad(settings.angle_tolerance_deg), settings.rate_tolerance_arcsec_s * per_unit
    n, capacity = ranges.size, 2 * len(pairs) + 64
    few = (n + _COARSE - 1) // _COARSE
    scratch = (
        *np.empty((3, n, 3)), np.zeros((n, 5)), tuple(np.empty((6, n))), np.empty((6, 3)),
        np.empty((3, 3)), np.empty((9, few)), np.empty((7, few)), np.empty(few),
    )  # fmt: skip
    while True:
        out = *np.empty((2, capacity), dtype=np.int64), *np.empty((3, capacity))
        count = _scan(forces, rate, data, pairs, ranges, units, region.radius, scratch, out)
        if count >= 0:
            break
        capacity *= 4
    kept = _smallest_of_each(out[0][:count], out[2][:count], settings.most_starts)
    first, second, cost, rho, speed = (each[kept] for each in out)
    state = states_at_ranges(tracklets, first, rho, speed, rate)
    return PairStarts(first, second, cost, tracklets.time[first], state)


def _smallest_of_each(group: Indices, cost: Array, most: int) -> Indices:
    """Indices of the `most` smallest costs of each group."""
    order = np.lexsort((cost, group))
    rank = np.arange(group.size) - np.searchsorted(group[order], group[order])
    return np.sort(order[rank < most])


def pairs_within(tracklets: Attributables, hours: float, least_hours: float, end: int) -> Indices:
    """Pairs (pair, 2) of tracklets whose times differ by `least_hours` to `hours`, the earlier one
    first and before index `end`; without pairs that share a detection."""
    unit = 3600.0 / TIME_UNIT_S
    t = tracklets.time
    after = np.maximum(
        np.searchsorted(t, t, side="right"), np.searchsorted(t, t + least_hours * unit)
    )
    until = np.searchsorted(t, t + hours * unit, side="right")
    until[end:] = 0
    count = np.maximum(until - after, 0)
    first = np.repeat(np.arange(t.size), count)
    second = after[first] + np.arange(first.size) - np.repeat(np.cumsum(count) - count, count)
    kept = np.ones(first.size, dtype=bool)
    # tracklets of one observer may share a detection if the later one begins before the other ends
    last = np.array([rows.max() for rows in tracklets.detections] or [0])
    start = np.array([rows.min() for rows in tracklets.detections] or [0])
    near = tracklets.observer[first] == tracklets.observer[second]
    for k in np.flatnonzero(near & (start[second] <= last[first])).tolist():
        shared = np.intersect1d(
            tracklets.detections[first[k]], tracklets.detections[second[k]], assume_unique=True
        )
        kept[k] = shared.size == 0
    return np.stack([first[kept], second[kept]], axis=1)
