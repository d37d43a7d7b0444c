"""Rotation of a rigid body with body-parameter deviations, and its derivatives (compiled).

A body-parameter deviation is a kind and an amount x relative to the assumed body. For kind
INERTIA + r the moments along the second (r = 0) or third body axis are scaled by exp(x): I becomes
``S I S`` with exp(x / 2) in the diagonal of S. For kind TORQUE + c a torque that is constant in the
body frame adds an angular acceleration x along axis c.

Derivatives are columns of small rotations s, in the inertial frame, and of changes w of the angular
velocity, in the body frame::

    ds/dt = A^T w,    dw/dt = M w + d,    M w = I^-1 [(I w) x omega + (I omega) x w],

where A is the attitude matrix and d the forcing of the column: zero for the three components of the
initial angular velocity, the unit vector of its axis for a torque, and ``I^-1 ((I' omega) x omega -
I' a)`` for a moment of inertia, where a is the torque-free acceleration and I' the derivative of I.
All eight columns are integrated together, regardless of which are needed: w by the classical
fourth-order Runge-Kutta method and s by Simpson's rule. The step is a rotation by a given angle.
Values within a step come from cubic Hermite interpolation, because many rows of a light curve fall
within one step. Any consistent units may be used.
"""

import numpy as np

from cislunar.attitude.attitude_integrator import acceleration, rate_after, turned
from cislunar.attitude.inertia import INERTIA, TORQUE
from cislunar.attitude.quaternion import rotate_components
from cislunar.attitude.rigid_body import angular_acceleration, matrix_times
from cislunar.compiled import copy_into, njit_alloc, njit_inline, njit_noalloc
from cislunar.elementary import exponential

TRACK_COLUMNS = 8
"""Derivatives with respect to the three components of the initial angular velocity, then with
respect to the deviations in the order of their kinds."""

FIRST_DEVIATION = 3

TURN_PER_STEP = 0.3
"""Rotation angle of a step if inertia or torque are estimated, rad. After 20 rad in a day,
attitudes err by 1e-7 rad for moments that differ by 5 %, and by 1e-5 rad for moments that differ by
20 % and deviate by as much; derivatives err by 1e-4 of the elapsed time."""

TURN_IF_KNOWN = 0.1
"""Rotation angle of a step if inertia and torque are known, rad: eighty times as accurate."""

_TURN_OF_TRANSITION = 0.15
"""Rotation angle of a step of `parameter_transition`, whose results are multiplied over a run, rad.
"""

_LARGEST = 3.0
"""Largest amount of an inertia deviation (a factor of twenty); larger amounts are clipped."""

_FINEST = 1e-4
"""Least step as a fraction of the interval, whatever the angular velocity."""

# Rows of a track: the two ends of a step, each with attitude and rate, the columns' rotations and
# changes, and the time derivatives of all; then the columns' forcing midway and after the step.
_END, _SLOPES = 14, 7
_TURNS, _CHANGES = 1, 4
_DRIVE_MIDWAY, _DRIVE_AFTER = 28, 31
_ROWS = 34


@njit_noalloc
def perturbed_rotation(kinds, amounts, inertia, inverse_inertia, out):
    """Write inertia, its inverse and the angular acceleration of a perturbed body into `out`.
    `kinds` and `amounts` have one entry per deviation; `out` holds arrays (3, 3), (3, 3) and (3,).
    """
    new, new_inverse, forced = out
    copy_into(new, inertia)
    copy_into(new_inverse, inverse_inertia)
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


@njit_inline
def _inertia_slope(axis, inertia, x, y, z):
    """Product of dI/dx and a vector for the deviation along an axis: (E I + I E) / 2."""
    along = inertia[axis, 0] * x + inertia[axis, 1] * y + inertia[axis, 2] * z
    entry = x if axis == 0 else (y if axis == 1 else z)
    return (
        0.5 * (inertia[0, axis] * entry + (along if axis == 0 else 0.0)),
        0.5 * (inertia[1, axis] * entry + (along if axis == 1 else 0.0)),
        0.5 * (inertia[2, axis] * entry + (along if axis == 2 else 0.0)),
    )


@njit_inline
def _put_drive(track, row, omega, body):
    """Write the forcing of the columns at an angular velocity; only that of the inertia changes."""
    inertia, inverse = body[0], body[1]
    x, v, z = omega
    a = angular_acceleration(x, v, z, inertia, inverse)
    for r in range(TORQUE - INERTIA):
        gx, gy, gz = _inertia_slope(1 + r, inertia, x, v, z)
        bx, by, bz = _inertia_slope(1 + r, inertia, a[0], a[1], a[2])
        d = matrix_times(inverse, gy * z - gz * v - bx, gz * x - gx * z - by, gx * v - gy * x - bz)
        for i in range(3):
            track[row + i, FIRST_DEVIATION + INERTIA + r] = d[i]


@njit_inline
def _growth(omega, body):
    """Matrix M of the linearized Euler equations, row by row."""
    inertia, inverse = body[0], body[1]
    x, v, z = omega
    hx, hy, hz = matrix_times(inertia, x, v, z)
    first = matrix_times(
        inverse, z * inertia[1, 0] - v * inertia[2, 0],
        x * inertia[2, 0] - z * inertia[0, 0] + hz, v * inertia[0, 0] - x * inertia[1, 0] - hy,
    )  # fmt: skip
    second = matrix_times(
        inverse, z * inertia[1, 1] - v * inertia[2, 1] - hz,
        x * inertia[2, 1] - z * inertia[0, 1], v * inertia[0, 1] - x * inertia[1, 1] + hx,
    )  # fmt: skip
    third = matrix_times(
        inverse, z * inertia[1, 2] - v * inertia[2, 2] + hy,
        x * inertia[2, 2] - z * inertia[0, 2] - hx, v * inertia[0, 2] - x * inertia[1, 2],
    )  # fmt: skip
    return (
        (first[0], second[0], third[0]),
        (first[1], second[1], third[1]),
        (first[2], second[2], third[2]),
    )


@njit_inline
def _to_inertial(q):
    """Transpose of the attitude matrix, row by row."""
    one = rotate_components(q[0], q[1], q[2], q[3], 1.0, 0.0, 0.0)
    two = rotate_components(q[0], q[1], q[2], q[3], 0.0, 1.0, 0.0)
    three = rotate_components(q[0], q[1], q[2], q[3], 0.0, 0.0, 1.0)
    return one, two, three


@njit_inline
def _times(m, x, y, z, a, b, c):
    """Product of a matrix, given row by row, and a vector, plus another vector."""
    return (
        m[0][0] * x + m[0][1] * y + m[0][2] * z + a,
        m[1][0] * x + m[1][1] * y + m[1][2] * z + b,
        m[2][0] * x + m[2][1] * y + m[2][2] * z + c,
    )


@njit_noalloc
def _carry_columns(track, h, midway, after, body):
    """Integrate the columns over a step, given attitude and rate midway and at its end."""
    _put_drive(track, _DRIVE_MIDWAY, midway[1], body)
    _put_drive(track, _DRIVE_AFTER, after[1], body)
    m, n = _growth(midway[1], body), _growth(after[1], body)
    a, b = _to_inertial(midway[0]), _to_inertial(after[0])
    half, eighth, sixth = 0.5 * h, 0.125 * h, h / 6.0
    t = track.reshape((_ROWS, TRACK_COLUMNS))  # a constant shape, for the compiler
    for c in range(TRACK_COLUMNS):
        s1, s2, s3 = t[_TURNS, c], t[_TURNS + 1, c], t[_TURNS + 2, c]
        p1, p2, p3 = t[_SLOPES + _TURNS, c], t[_SLOPES + _TURNS + 1, c], t[_SLOPES + _TURNS + 2, c]
        x, y, z = t[_CHANGES, c], t[_CHANGES + 1, c], t[_CHANGES + 2, c]
        x1, y1 = t[_SLOPES + _CHANGES, c], t[_SLOPES + _CHANGES + 1, c]
        z1 = t[_SLOPES + _CHANGES + 2, c]
        d1, d2, d3 = t[_DRIVE_MIDWAY, c], t[_DRIVE_MIDWAY + 1, c], t[_DRIVE_MIDWAY + 2, c]
        e1, e2, e3 = t[_DRIVE_AFTER, c], t[_DRIVE_AFTER + 1, c], t[_DRIVE_AFTER + 2, c]
        x2, y2, z2 = _times(m, x + half * x1, y + half * y1, z + half * z1, d1, d2, d3)
        x3, y3, z3 = _times(m, x + half * x2, y + half * y2, z + half * z2, d1, d2, d3)
        x4, y4, z4 = _times(n, x + h * x3, y + h * y3, z + h * z3, e1, e2, e3)
        u = x + sixth * (x1 + 2.0 * (x2 + x3) + x4)
        v = y + sixth * (y1 + 2.0 * (y2 + y3) + y4)
        w = z + sixth * (z1 + 2.0 * (z2 + z3) + z4)
        x5, y5, z5 = _times(n, u, v, w, e1, e2, e3)
        x6, y6 = 0.5 * (x + u) + eighth * (x1 - x5), 0.5 * (y + v) + eighth * (y1 - y5)
        z6 = 0.5 * (z + w) + eighth * (z1 - z5)
        q1, q2, q3 = _times(a, x6, y6, z6, 0.0, 0.0, 0.0)
        r1, r2, r3 = _times(b, u, v, w, 0.0, 0.0, 0.0)
        row = _END + _TURNS
        t[row, c] = s1 + sixth * (p1 + 4.0 * q1 + r1)
        t[row + 1, c] = s2 + sixth * (p2 + 4.0 * q2 + r2)
        t[row + 2, c] = s3 + sixth * (p3 + 4.0 * q3 + r3)
        t[_END + _CHANGES, c], t[_END + _CHANGES + 1, c], t[_END + _CHANGES + 2, c] = u, v, w
        row = _END + _SLOPES + _TURNS
        t[row, c], t[row + 1, c], t[row + 2, c] = r1, r2, r3
        row = _END + _SLOPES + _CHANGES
        t[row, c], t[row + 1, c], t[row + 2, c] = x5, y5, z5


@njit_inline
def _put_end(track, q, w, a):
    """Write attitude, angular velocity and their time derivatives at the second end of a step."""
    row, of_time = track[_END], track[_END + _SLOPES]
    row[0], row[1], row[2], row[3] = q
    row[4], row[5], row[6] = w
    of_time[0] = 0.5 * (w[0] * q[3] + w[2] * q[1] - w[1] * q[2])
    of_time[1] = 0.5 * (w[1] * q[3] + w[0] * q[2] - w[2] * q[0])
    of_time[2] = 0.5 * (w[2] * q[3] + w[1] * q[0] - w[0] * q[1])
    of_time[3] = -0.5 * (w[0] * q[0] + w[1] * q[1] + w[2] * q[2])
    of_time[4], of_time[5], of_time[6] = a


@njit_alloc
def make_track():
    """Uninitialized arrays of a track (34, TRACK_COLUMNS) and of the times of its step's ends."""
    return np.empty((_ROWS, TRACK_COLUMNS)), np.empty(2)


@njit_noalloc
def begin_track(track, times, quaternion, omega, body, with_columns):
    """Begin a track at an attitude and rate. `body` is the inertia, its inverse and the angular
    acceleration (3,) due to the torque."""
    track[:, :] = 0.0
    times[:] = 0.0
    q = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    w = omega[0], omega[1], omega[2]
    _put_end(track, q, w, acceleration(w, body))
    if with_columns:
        for i in range(3):
            track[_DRIVE_MIDWAY + i, FIRST_DEVIATION + TORQUE + i] = 1.0
            track[_DRIVE_AFTER + i, FIRST_DEVIATION + TORQUE + i] = 1.0
        _put_drive(track, _DRIVE_AFTER, w, body)
        growth, to_inertial = _growth(w, body), _to_inertial(q)
        for i in range(3):
            track[_END + _CHANGES + i, i] = 1.0  # d omega(0) / d omega(0)
            for c in range(TRACK_COLUMNS):
                row = _END + _SLOPES
                track[row + _CHANGES + i, c] = track[_DRIVE_AFTER + i, c]
                if c < 3:
                    track[row + _CHANGES + i, c] += growth[i][c]
                    track[row + _TURNS + i, c] = to_inertial[i][c]


@njit_noalloc
def _take_step(track, times, h, body, with_columns):
    """Advance a track by one step."""
    for row in range(_END):
        if with_columns or row % _SLOPES == 0:
            for c in range(TRACK_COLUMNS):
                track[row, c] = track[_END + row, c]
    old, slope = track[0], track[_SLOPES]
    q, w = (old[0], old[1], old[2], old[3]), (old[4], old[5], old[6])
    a = slope[4], slope[5], slope[6]
    w_after = rate_after(w, a, h, body)
    a_after = acceleration(w_after, body)
    q_after = turned(q, h, (w, a), (w_after, a_after))
    _put_end(track, q_after, w_after, a_after)
    if with_columns:
        w_midway = (
            0.5 * (w[0] + w_after[0]) + 0.125 * h * (a[0] - a_after[0]),
            0.5 * (w[1] + w_after[1]) + 0.125 * h * (a[1] - a_after[1]),
            0.5 * (w[2] + w_after[2]) + 0.125 * h * (a[2] - a_after[2]),
        )
        ends = (w, a), (w_midway, acceleration(w_midway, body))
        midway = turned(q, 0.5 * h, *ends), w_midway
        _carry_columns(track, h, midway, (q_after, w_after), body)
    times[0], times[1] = times[1], times[1] + h


@njit_noalloc
def _rate_of_turning(track):
    """Angular rate at the end of a track, plus the square root of the angular acceleration."""
    w, a = track[_END, 4:7], track[_END + _SLOPES, 4:7]
    faster = np.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])
    return np.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2] + faster)


@njit_noalloc
def extend_track(track, times, until, body, with_columns, turn_per_step):
    """Take steps until the last one ends at or after a time; see `begin_track` for `body`."""
    finest = _FINEST * (until - times[1])
    while until > times[1]:
        rate = _rate_of_turning(track)
        h = max(turn_per_step / rate, finest) if rate > 0.0 else until - times[1]
        _take_step(track, times, h, body, with_columns)


@njit_inline
def weigh_ends(times, when):
    """Hermite weights of the ends of the last step at a time within it. The first two weigh the
    values at the ends, the last two their time derivatives."""
    h = times[1] - times[0]
    s = (when - times[0]) / h if h > 0.0 else 1.0
    r = 1.0 - s
    return r * r * (1.0 + 2.0 * s), s * s * (1.0 + 2.0 * r), h * s * r * r, -h * s * s * r


@njit_inline
def ends_of(track, row, column):
    """An entry of a track at the ends of the last step, in the order of `weigh_ends`. Row 0 has the
    attitude (columns 0 .. 3), rows 1 .. 3 the columns' rotations in the inertial frame."""
    return (
        track[row, column],
        track[_END + row, column],
        track[_SLOPES + row, column],
        track[_END + _SLOPES + row, column],
    )


@njit_alloc
def parameter_transition(omega, dt, inertia, inverse_inertia, kinds, out):
    """Transition matrix of (small rotation, angular velocity) over a step, with parameter
    derivatives. Written into `out`, shape (6, 6 + n): ``[[A, B], [0, C]]``, where A is the rotation
    over the step, then one column for each of the n deviations of these `kinds`."""
    body = inertia, inverse_inertia, np.zeros(3)
    track, times = make_track()
    begin_track(track, times, np.array([0.0, 0.0, 0.0, 1.0]), omega, body, True)
    count = max(1, int(np.ceil(_rate_of_turning(track) * dt / _TURN_OF_TRANSITION)))
    for _ in range(count):
        _take_step(track, times, dt / count, body, True)
    q, turns, changes = track[_END], track[_END + _TURNS :], track[_END + _CHANGES :]
    out[:, :] = 0.0
    for i in range(3):
        turned_axis = rotate_components(
            q[0], q[1], q[2], q[3], 1.0 * (i == 0), 1.0 * (i == 1), 1.0 * (i == 2)
        )
        for c in range(3):
            out[c, i] = turned_axis[c]
    for c in range(3 + kinds.shape[0]):
        column = c if c < 3 else FIRST_DEVIATION + kinds[c - 3]
        turn = rotate_components(
            q[0], q[1], q[2], q[3], turns[0, column], turns[1, column], turns[2, column]
        )
        for i in range(3):
            out[i, 3 + c], out[3 + i, 3 + c] = turn[i], changes[i, column]
