"""Rotation of a rigid body that departs from what is believed of it, and its derivatives.

A departure is a kind and an amount x. INERTIA + r: the moments along the second (r = 0) or third
body axis grow by exp(x), I becoming ``S I S`` with exp(x / 2) in the diagonal of S. TORQUE + c: a
torque constant in the body frame accelerates the rotation by x along axis c.

Derivatives are columns of small turns e and changes w of the angular velocity (body frame)::

    de/dt = -omega x e + w,    I dw/dt = (I w) x omega + (I omega) x w + I d,

with d, the drive of the column, zero for the three by the initial angular velocity, the unit vector
of its axis for a torque, and ``I^-1 ((I' omega) x omega - I' a)`` for a moment of inertia, a being
the torque-free acceleration and I' the derivative of I. All eight columns are carried together,
whichever are wanted. Steps are of `TURN_PER_STEP`, and what lies between their ends is interpolated
(cubic, by Hermite), since many rows of a light curve fall within one. Compiled; inertia in any
unit, times in any.
"""

import numpy as np
from numba import njit

from cislunar.attitude.inertia import INERTIA, TORQUE
from cislunar.attitude.quaternion import rotate_components
from cislunar.attitude.rigid_body import angular_acceleration, matrix_times
from cislunar.attitude.short_steps import rigid_step, slope
from cislunar.elementary import exponential

COLUMNS = 8
"""Derivatives by the three components of the initial rate, then by departures in their order."""

FIRST_DEPARTURE = 3

TURN_PER_STEP = 0.15
"""Turn of a step, rad. A step of fourth order errs by 0.15^5 / 120 = 6e-7 rad, so that a day of 20
rad has 1e-4 rad or less; the interpolation errs by 0.15^4 / 384 = 1e-6 rad."""

_LARGEST = 3.0
"""Amounts of a change of inertia beyond are taken as this: twenty times the moment."""

_FINEST = 1e-4
"""Least step as a share of the time to be covered, whatever the rate."""

# Rows of a track: the two ends of a step, each with attitude and rate, the columns' errors, and the
# time derivatives of both; then the work of a step.
_END, _SLOPES = 14, 7
_TRIAL, _SLOPE, _TOTAL, _DRIVE = 28, 34, 40, 46
_ROWS = 49


@njit(cache=True, error_model="numpy")
def departed_rotation(kinds, amounts, inertia, inverse_inertia, out):
    """Inertia, its inverse and the forced acceleration after departures, into `out`.

    `kinds` and `amounts` have an entry for each; `out` holds arrays (3, 3), (3, 3) and (3,).
    """
    new, new_inverse, forced = out
    new[:, :], new_inverse[:, :] = inertia, inverse_inertia
    forced[:] = 0.0
    for i in range(kinds.shape[0]):
        kind = kinds[i]
        if kind >= TORQUE:
            forced[kind - TORQUE] += amounts[i]
            continue
        axis = 1 + kind - INERTIA
        root = exponential(0.5 * min(max(amounts[i], -_LARGEST), _LARGEST))
        for c in range(3):
            new[axis, c] *= root
            new[c, axis] *= root
            new_inverse[axis, c] /= root
            new_inverse[c, axis] /= root


@njit(cache=True, error_model="numpy", inline="always")
def _inertia_slope(axis, inertia, x, y, z):
    """Product of dI/dx and a vector, of the departure along an axis: (E I + I E) / 2."""
    along = inertia[axis, 0] * x + inertia[axis, 1] * y + inertia[axis, 2] * z
    entry = x if axis == 0 else (y if axis == 1 else z)
    return (
        0.5 * (inertia[0, axis] * entry + (along if axis == 0 else 0.0)),
        0.5 * (inertia[1, axis] * entry + (along if axis == 1 else 0.0)),
        0.5 * (inertia[2, axis] * entry + (along if axis == 2 else 0.0)),
    )


@njit(cache=True, error_model="numpy")
def _drive(track, y, inertia, inverse_inertia):
    """Fill in what drives the columns at a stage of the motion; only inertia's changes."""
    x, v, z = y[4], y[5], y[6]
    a = angular_acceleration(x, v, z, inertia, inverse_inertia)
    for r in range(TORQUE - INERTIA):
        gx, gy, gz = _inertia_slope(1 + r, inertia, x, v, z)
        bx, by, bz = _inertia_slope(1 + r, inertia, a[0], a[1], a[2])
        d = matrix_times(
            inverse_inertia, gy * z - gz * v - bx, gz * x - gx * z - by, gx * v - gy * x - bz
        )
        for i in range(3):
            track[_DRIVE + i, FIRST_DEPARTURE + INERTIA + r] = d[i]


@njit(cache=True, error_model="numpy")
def _slopes(track, of, into, y, inertia, inverse_inertia):
    """Time derivatives of the errors in six rows from `of` on, into those from `into` on."""
    _drive(track, y, inertia, inverse_inertia)
    t = track.reshape((_ROWS, COLUMNS))  # with its shape known to the compiler
    x, v, z = y[4], y[5], y[6]
    hx, hy, hz = matrix_times(inertia, x, v, z)
    for c in range(COLUMNS):
        e1, e2, e3 = t[of, c], t[of + 1, c], t[of + 2, c]
        w1, w2, w3 = t[of + 3, c], t[of + 4, c], t[of + 5, c]
        gx, gy, gz = matrix_times(inertia, w1, w2, w3)
        ax, ay, az = matrix_times(
            inverse_inertia,
            gy * z - gz * v + (hy * w3 - hz * w2),
            gz * x - gx * z + (hz * w1 - hx * w3),
            gx * v - gy * x + (hx * w2 - hy * w1),
        )
        t[into, c] = e2 * z - e3 * v + w1
        t[into + 1, c] = e3 * x - e1 * z + w2
        t[into + 2, c] = e1 * v - e2 * x + w3
        t[into + 3, c] = ax + t[_DRIVE, c]
        t[into + 4, c] = ay + t[_DRIVE + 1, c]
        t[into + 5, c] = az + t[_DRIVE + 2, c]


@njit(cache=True, error_model="numpy")
def _put(row, values):
    """Write seven numbers into a row."""
    row[0], row[1], row[2], row[3], row[4], row[5], row[6] = values


@njit(cache=True, error_model="numpy")
def _carry_columns(track, h, stages, inertia, inverse_inertia):
    """Carry the columns from the first end of a step to the second."""
    t = track.reshape((_ROWS, COLUMNS))
    old, first, new = 1, _SLOPES + 1, _END + 1
    for i in range(6):
        for c in range(COLUMNS):
            t[_TOTAL + i, c] = t[first + i, c]
            t[_TRIAL + i, c] = t[old + i, c] + 0.5 * h * t[first + i, c]
    for stage in range(1, 4):
        _slopes(track, _TRIAL, _SLOPE, stages[stage], inertia, inverse_inertia)
        ahead, weight = (0.5 * h if stage == 1 else h), (1.0 if stage == 3 else 2.0)
        for i in range(6):
            for c in range(COLUMNS):
                t[_TOTAL + i, c] += weight * t[_SLOPE + i, c]
                t[_TRIAL + i, c] = t[old + i, c] + ahead * t[_SLOPE + i, c]
    for i in range(6):
        for c in range(COLUMNS):
            t[new + i, c] = t[old + i, c] + h / 6.0 * t[_TOTAL + i, c]


@njit(cache=True, error_model="numpy")
def _slopes_at_end(track, body, with_columns):
    """Fill in the time derivatives at the second end of a step."""
    inertia, inverse, forced = body[0], body[1], (body[2][0], body[2][1], body[2][2])
    last = track[_END]
    y = (last[0], last[1], last[2], last[3], last[4], last[5], last[6])
    _put(track[_END + _SLOPES], slope(y, inertia, inverse, forced))
    if with_columns:
        _slopes(track, _END + 1, _END + _SLOPES + 1, y, inertia, inverse)
    return y


@njit(cache=True, error_model="numpy")
def start_track(quaternion, omega, body, with_columns):
    """A track (`_ROWS`, COLUMNS) that begins with an attitude and a rate, and its ends' times.

    `body` is inertia, its inverse and the forced acceleration (3,).
    """
    track, times = np.zeros((_ROWS, COLUMNS)), np.zeros(2)
    track[_END, :4] = quaternion
    track[_END, 4:7] = omega
    for i in range(3):
        track[_END + 4 + i, i] = 1.0  # d omega(0) / d omega(0)
        track[_DRIVE + i, FIRST_DEPARTURE + TORQUE + i] = 1.0
    _slopes_at_end(track, body, with_columns)
    return track, times


@njit(cache=True, error_model="numpy")
def _take_step(track, times, h, body, with_columns):
    """Go a step on from where a track ends."""
    inertia, inverse, forced = body[0], body[1], (body[2][0], body[2][1], body[2][2])
    last = track[_END]
    y = (last[0], last[1], last[2], last[3], last[4], last[5], last[6])
    track[:_END] = track[_END : 2 * _END]
    y, stages = rigid_step(y, h, inertia, inverse, forced)
    _put(last, y)
    if with_columns:
        _carry_columns(track, h, stages, inertia, inverse)
    _slopes_at_end(track, body, with_columns)
    times[0], times[1] = times[1], times[1] + h


@njit(cache=True, error_model="numpy")
def _rate_of_turning(track):
    """Rate at the end of a track, the square root of its change included."""
    w, a = track[_END, 4:7], track[_END + _SLOPES, 4:7]
    faster = np.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])
    return np.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2] + faster)


@njit(cache=True, error_model="numpy")
def extend_track(track, times, until, body, with_columns):
    """Take steps until the last one ends at a time or later; `body` as of `start_track`."""
    finest = _FINEST * (until - times[1])
    while until > times[1]:
        rate = _rate_of_turning(track)
        h = max(TURN_PER_STEP / rate, finest) if rate > 0.0 else until - times[1]
        _take_step(track, times, h, body, with_columns)


@njit(cache=True, error_model="numpy", inline="always")
def read_track(track, times, when, out):
    """Attitude, and the turns of all columns, at a time within the last step.

    Into `out` (4, COLUMNS): the quaternion in the first row, then the components of the turns; or
    into `out` (1, COLUMNS) the quaternion alone.
    """
    h = times[1] - times[0]
    s = (when - times[0]) / h if h > 0.0 else 1.0
    r = 1.0 - s
    first, last = r * r * (1.0 + 2.0 * s), s * s * (1.0 + 2.0 * r)
    leaving, arriving = h * s * r * r, -h * s * s * r
    for i in range(out.shape[0]):
        for c in range(COLUMNS if i > 0 else 4):
            out[i, c] = (first * track[i, c] + last * track[_END + i, c]) + (
                leaving * track[_SLOPES + i, c] + arriving * track[_END + _SLOPES + i, c]
            )
    q1, q2, q3, q4 = out[0, 0], out[0, 1], out[0, 2], out[0, 3]
    scale = 1.0 / np.sqrt(q1 * q1 + q2 * q2 + q3 * q3 + q4 * q4)
    out[0, 0], out[0, 1], out[0, 2], out[0, 3] = scale * q1, scale * q2, scale * q3, scale * q4


@njit(cache=True, error_model="numpy")
def departing_transition(omega, dt, inertia, inverse_inertia, kinds, out):
    """Transition matrix of (small turn, angular velocity) over a step, and derivatives (compiled).

    Into `out`, shape (6, 6 + n): ``[[A, B], [0, C]]`` with A the turn of the body over the step,
    then columns by the amounts of departures of these `kinds`.
    """
    body = inertia, inverse_inertia, np.zeros(3)
    track, times = start_track(np.array([0.0, 0.0, 0.0, 1.0]), omega, body, True)
    count = max(1, int(np.ceil(_rate_of_turning(track) * dt / TURN_PER_STEP)))
    for _ in range(count):
        _take_step(track, times, dt / count, body, True)
    q, errors = track[_END], track[_END + 1 :]
    out[:, :] = 0.0
    for i in range(3):
        turned = rotate_components(
            q[0], q[1], q[2], q[3], 1.0 * (i == 0), 1.0 * (i == 1), 1.0 * (i == 2)
        )
        for c in range(3):
            out[c, i] = turned[c]
    for i in range(6):
        for c in range(3):
            out[i, 3 + c] = errors[i, c]
        for c in range(kinds.shape[0]):
            out[i, 6 + c] = errors[i, FIRST_DEPARTURE + kinds[c]]
