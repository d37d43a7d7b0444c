"""Upper bounds of the information of pairs, from the covariance and the line of sight alone.

`cislunar.tasking.planning.information` evaluates right ascension and declination at sigma points.
Here the two angles are expanded along each sigma point instead, which takes no trigonometry and
vectorizes. The remainders are bounded, so that the result is a bound whatever the covariance.

With w = (a_x + i a_y) / (x + i y) for a line of sight (x, y, z) in the observer's axes and a shift
a of the target, the right ascension is Im log(x + i y), and the declination Im log(r + i z) with
r^2 = x^2 + y^2. First and second differences of both at +a and -a follow to second order. Where |a|
<= |a_all| and q = |a_all| / (r - |a_all|), the derivatives of the logarithms bound the remainders
of the first differences, divided by 2, by sqrt(1/9 + 1.03^2) q^3 < 1.1 q^3, and of the second ones
by sqrt(1/4 + 2.4^2) q^4 < 2.5 q^4.

In the terms of `cislunar.estimation.unscented.innovation_moments` the information is (1/2) log
det(I + S^-1 U^T U), which decreases with S. Let U = U' + E with ||E|| <= e, S = R + T^T T with T =
T' + F and ||F|| <= f, and sigma^2 the least of the noise variances. For any n, |T n| >= |T' n| - f
|n|. Therefore S >= k S' with S' = R + T'^T T' and k = exp(-2 asinh(f / (2 sigma))), and the
singular values of U S'^-1/2 exceed those of U' S'^-1/2 by e / sigma at most. Likewise the standard
deviation of the direction is at least the largest singular value of U' diag(cos dec, 1) less e:
where that exceeds the pointing-uncertainty gate, the pair has no information.
"""

import numpy as np

from cislunar.attitude.rigid_body import matrix_times
from cislunar.compiled import njit, njit_inline, njit_noalloc
from cislunar.estimation.triangular import cholesky
from cislunar.observation.sightline import SUN, toward_primary

_ROUNDING = 1e-14
"""Upper bound of the rounding error of a difference of two computed angles, rad."""

_FIRST_REMAINDER, _SECOND_REMAINDER = 1.1, 2.5


@njit(cache=True, error_model="numpy")
def _shifts(translation, covariance, axes, place, root):
    """Positions (3, N) and position columns of covariances' roots (3, 3, N) in the observers' axes.
    Those of a target without an estimate are NaN."""
    work = np.empty((6, 6))
    for j in range(translation.shape[0]):
        work[:, :] = covariance[j]
        if not (np.isfinite(np.sum(translation[j])) and cholesky(work)):
            place[:, j] = np.nan
            root[:, :, j] = np.nan
            continue
        x, y, z = translation[j, 0], translation[j, 1], translation[j, 2]
        place[0, j], place[1, j], place[2, j] = matrix_times(axes, x, y, z)
        for i in range(3):
            x, y, z = matrix_times(axes, work[0, i], work[1, i], work[2, i])
            root[i, 0, j], root[i, 1, j], root[i, 2, j] = x, y, z


@njit_inline
def _differences(x, y, z, r, per_r2, per_d2, ax, ay, az):
    """First and second derivatives of both angles along a shift a."""
    along, across = (ax * x + ay * y) * per_r2, (ay * x - ax * y) * per_r2
    outward = along * r
    radial, rise = (outward * r + az * z) * per_d2, (az * r - outward * z) * per_d2
    bend = -(across * across * r * z * per_d2 + 2.0 * radial * rise)
    return across, rise, -2.0 * along * across, bend


@njit_noalloc
def _bound_row(observer, place, root, radius, variance, weights, gate, out):
    """Upper bound of det(I + S^-1 U^T U) for all targets of an observer; 1 beyond the gate."""
    square = weights.spread * weights.spread
    half, middle = 0.5 * weights.outer, weights.mean_shift * weights.outer * weights.outer
    per_sigma = 1.0 / np.sqrt(min(variance[0], variance[1]))
    growth = np.sqrt(half + 3.0 * middle)
    for j in range(out.size):
        x, y, z = place[0, j] - observer[0], place[1, j] - observer[1], place[2, j] - observer[2]
        r2 = x * x + y * y
        d2 = r2 + z * z
        r = np.sqrt(r2)
        per_r2, per_d2 = 1.0 / r2, 1.0 / d2
        a0, b0, c0, e0 = _differences(
            x, y, z, r, per_r2, per_d2, root[0, 0, j], root[0, 1, j], root[0, 2, j]
        )
        a1, b1, c1, e1 = _differences(
            x, y, z, r, per_r2, per_d2, root[1, 0, j], root[1, 1, j], root[1, 2, j]
        )
        a2, b2, c2, e2 = _differences(
            x, y, z, r, per_r2, per_d2, root[2, 0, j], root[2, 1, j], root[2, 2, j]
        )
        u00 = a0 * a0 + a1 * a1 + a2 * a2
        u01 = a0 * b0 + a1 * b1 + a2 * b2
        u11 = b0 * b0 + b1 * b1 + b2 * b2
        m0, m1 = c0 + c1 + c2, e0 + e1 + e2
        both = square * square
        s00 = both * (half * (c0 * c0 + c1 * c1 + c2 * c2) + middle * m0 * m0) + variance[0]
        s01 = both * (half * (c0 * e0 + c1 * e1 + c2 * e2) + middle * m0 * m1)
        s11 = both * (half * (e0 * e0 + e1 * e1 + e2 * e2) + middle * m1 * m1) + variance[1]
        q = radius[j] / (r - radius[j]) if r > radius[j] else np.inf
        cube = q * q * q
        first = _FIRST_REMAINDER / weights.spread * cube + _ROUNDING
        second = growth * _SECOND_REMAINDER * cube * q + _ROUNDING
        # k = (h - f) / (h + f) with h^2 = f^2 + 4 sigma^2, all in units of sigma.
        f = second * per_sigma
        ratio = 0.5 * (np.sqrt(f * f + 4.0) + f)
        per_k = ratio * ratio
        per_det = 1.0 / (s00 * s11 - s01 * s01)
        trace = (s11 * u00 - 2.0 * s01 * u01 + s00 * u11) * per_det
        product = np.sqrt(max(0.0, u00 * u11 - u01 * u01) * per_det)
        total = np.sqrt(trace + 2.0 * product)
        e = first * per_sigma
        sum_of_squares = trace + 2.0 * e * (total + e)
        product += e * (total + e)
        bound = 1.0 + per_k * (sum_of_squares + per_k * product * product)
        cos2 = r2 * per_d2
        mean, half_gap = 0.5 * (cos2 * u00 + u11), 0.5 * (cos2 * u00 - u11)
        widest = np.sqrt(mean + np.sqrt(half_gap * half_gap + cos2 * u01 * u01))
        out[j] = 1.0 if widest - first > gate else bound


@njit_noalloc
def _drop_row(observer, place, directions, sun, limits, out):
    """Put 1 for targets within a bright body's exclusion angle, or too faint, beyond any rounding.
    `directions` are unit vectors to Sun, Moon and Earth. The brightness of a sphere is a convex
    function of the cosine of the phase, below its chords from 0 over 1 to pi."""
    cosines, faintness = limits
    x0, y0, z0 = observer
    for j in range(out.size):
        dx, dy, dz = place[0, j] - x0, place[1, j] - y0, place[2, j] - z0
        squared = dx * dx + dy * dy + dz * dz
        distance = np.sqrt(squared) * (1.0 + _ROUNDING)
        hidden = False
        for body in range(3):
            b = directions[body]
            hidden |= b[0] * dx + b[1] * dy + b[2] * dz > (cosines[body] + _ROUNDING) * distance
        fx, fy, fz = place[0, j] - sun[0], place[1, j] - sun[1], place[2, j] - sun[2]
        cosine = (dx * fx + dy * fy + dz * fz) / np.sqrt(squared * (fx * fx + fy * fy + fz * fz))
        chord = 1.0 + cosine * (np.pi - 1.0 if cosine > 0.0 else 1.0)
        hidden |= chord + _ROUNDING < faintness * squared
        out[j] = 1.0 if hidden else out[j]


@njit_noalloc
def _beyond_gate(j, observer, points, gate):
    """Whether a single sigma point of a target puts its direction beyond the gate. The variance of
    the direction is at least the point's weight times the square of the greater of its two offsets,
    declination and cos(dec) times right ascension. The law of haversines gives sin(theta / 2) <=
    the greater offset, with theta the angle between the directions."""
    place, root, radius, weights = points
    least = gate * gate / weights.outer * (1.0 + _ROUNDING)
    x, y, z = place[0, j] - observer[0], place[1, j] - observer[1], place[2, j] - observer[2]
    squared = x * x + y * y + z * z
    if radius[j] * radius[j] < least * squared:
        return False
    for i in range(3):
        for shift in (weights.spread, -weights.spread):
            ax, ay, az = shift * root[i, 0, j], shift * root[i, 1, j], shift * root[i, 2, j]
            along = squared + ax * x + ay * y + az * z
            other = (x + ax) ** 2 + (y + ay) ** 2 + (z + az) ** 2
            if 0.5 * (1.0 - along / np.sqrt(squared * other)) > least:
                return True
    return False


@njit(cache=True, error_model="numpy")
def bound_all(prediction, scene, constants, weights, gate, out):
    """Upper bound of the information of all pairs, nats, into `out` (observer, target).
    `prediction` is index, translation (target, 6) and covariance (target, 6, 6). `constants` are,
    by observer, the least variances of right ascension and declination, cosines of the exclusion
    angles, and faintness. `gate` has the largest standard deviations of the direction (rad) or
    infinity."""
    index, translation, covariance = prediction
    variance, cosines, faintness = constants
    axes, count = scene.observer_axes[index], translation.shape[0]
    place, root, radius = np.empty((3, count)), np.empty((3, 3, count)), np.empty(count)
    _shifts(translation, covariance, axes, place, root)
    for j in range(count):
        radius[j] = weights.spread * np.sqrt(np.sum(root[:, :, j] ** 2))
    points = place, root, radius, weights
    sun, directions = scene.sun_position[index], np.empty((3, 3))
    for o in range(out.shape[0]):
        x, y, z = scene.observer_position[o, index]
        for body in range(3):
            bx, by, bz = sun[0] - x, sun[1] - y, sun[2] - z
            if body != SUN:
                bx, by, bz = toward_primary(body, x, y, z, scene.primaries[index])
            distance = np.sqrt(bx * bx + by * by + bz * bz)
            bx, by, bz = matrix_times(axes, bx, by, bz)
            directions[body] = bx / distance, by / distance, bz / distance
        observer = matrix_times(axes, x, y, z)
        _bound_row(observer, place, root, radius, variance[o], weights, gate[o], out[o])
        there = matrix_times(axes, sun[0], sun[1], sun[2])
        _drop_row(observer, place, directions, there, (cosines[o], faintness[o]), out[o])
        for j in range(count):
            if (
                np.isnan(place[0, j])
                or out[o, j] == 1.0
                or _beyond_gate(j, observer, points, gate[o])
            ):
                out[o, j] = 0.0
            elif out[o, j] < np.inf:
                out[o, j] = 0.5 * np.log(out[o, j]) + 1e-9
            else:
                out[o, j] = np.inf
