"""Rotation of a rigid body that does not turn evenly, and its derivatives.

A body may depart from what is believed of it; a departure is a kind and an amount x. INERTIA + r:
the moments along the second (r = 0) or third body axis grow by exp(x), I becoming ``S I S`` with
exp(x / 2) in the diagonal of S. TORQUE + c: a torque constant in the body frame accelerates the
rotation by x along axis c.

Derivatives are columns of small turns s, in the inertial frame, and of changes w of the angular
velocity, in the body frame::

    ds/dt = A^T w,    dw/dt = M w + d,    M w = I^-1 [(I w) x omega + (I omega) x w],

A the attitude, and d, the drive of the column, zero for the three by the initial angular velocity,
the unit vector of its axis for a torque, and ``I^-1 ((I' omega) x omega - I' a)`` for a moment of
inertia, a being the torque-free acceleration and I' the derivative of I. All eight columns are
carried together, whichever are wanted: w by Runge and Kutta's fourth order, s by Simpson's rule.
Steps are of `TURN_PER_STEP`, and what lies between their ends is interpolated (cubic, by Hermite),
since many rows of a light curve fall within one. Compiled; inertia in any unit, times in any.
"""

import numpy as np
from numba import njit

from cislunar.attitude.inertia import INERTIA, TORQUE
from cislunar.attitude.quaternion import rotate_components
from cislunar.attitude.rigid_body import angular_acceleration, matrix_times
from cislunar.attitude.short_steps import acceleration, rate_after, turned
from cislunar.compiled import allocating, borrowing, put
from cislunar.elementary import exponential

COLUMNS = 8
"""Derivatives by the three components of the initial rate, then by departures in their order."""

FIRST_DEPARTURE = 3

TURN_PER_STEP = 0.3
"""Turn of a step of a body whose inertia or torque is estimated, rad. After a day of 20 rad
attitudes err by 1e-7 rad for moments 5 % apart and by 1e-5 rad for moments 20 % apart that change
by as much, derivatives by 1e-4 of the time."""

TURN_IF_KNOWN = 0.1
"""The same of a body that is known, rad: eighty times as accurate."""

TURN_OF_TRANSITION = 0.15
"""Turn of a step of `departing_transition`, which is multiplied up over a run, rad."""

_LARGEST = 3.0
"""Amounts of a change of inertia beyond are taken as this: twenty times the moment."""

_FINEST = 1e-4
"""Least step as a share of the time to be covered, whatever the rate."""

# Rows of a track: the two ends of a step, each with attitude and rate, the columns' turns and
# changes, and the time derivatives of all; then what drives the columns within and after the step.
_END, _SLOPES = 14, 7
_TURNS, _CHANGES = 1, 4
_DRIVE_MIDWAY, _DRIVE_AFTER = 28, 31
_ROWS = 34


@borrowing
def departed_rotation(kinds, amounts, inertia, inverse_inertia, out):
    """Inertia, its inverse and the forced acceleration after departures, into `out`.

    `kinds` and `amounts` have an entry for each; `out` holds arrays (3, 3), (3, 3) and (3,).
    """
    new, new_inverse, forced = out
    put(new, inertia)
    put(new_inverse, inverse_inertia)
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


@njit(cache=True, error_model="numpy", inline="always")
def _put_drive(track, row, omega, body):
    """Fill in what drives the columns at an angular velocity; only inertia's changes."""
    inertia, inverse = body[0], body[1]
    x, v, z = omega
    a = angular_acceleration(x, v, z, inertia, inverse)
    for r in range(TORQUE - INERTIA):
        gx, gy, gz = _inertia_slope(1 + r, inertia, x, v, z)
        bx, by, bz = _inertia_slope(1 + r, inertia, a[0], a[1], a[2])
        d = matrix_times(inverse, gy * z - gz * v - bx, gz * x - gx * z - by, gx * v - gy * x - bz)
        for i in range(3):
            track[row + i, FIRST_DEPARTURE + INERTIA + r] = d[i]


@njit(cache=True, error_model="numpy", inline="always")
def _growth(omega, body):
    """Matrix M of the change of a change of the angular velocity, row by row."""
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


@njit(cache=True, error_model="numpy", inline="always")
def _to_inertial(q):
    """Transpose of the attitude matrix, row by row."""
    one = rotate_components(q[0], q[1], q[2], q[3], 1.0, 0.0, 0.0)
    two = rotate_components(q[0], q[1], q[2], q[3], 0.0, 1.0, 0.0)
    three = rotate_components(q[0], q[1], q[2], q[3], 0.0, 0.0, 1.0)
    return one, two, three


@njit(cache=True, error_model="numpy", inline="always")
def _times(m, x, y, z, a, b, c):
    """Product of a matrix, row by row, and a vector, and another vector added."""
    return (
        m[0][0] * x + m[0][1] * y + m[0][2] * z + a,
        m[1][0] * x + m[1][1] * y + m[1][2] * z + b,
        m[2][0] * x + m[2][1] * y + m[2][2] * z + c,
    )


@borrowing
def _carry_columns(track, h, midway, after, body):
    """Carry the columns over a step, given attitude and rate midway and after it."""
    _put_drive(track, _DRIVE_MIDWAY, midway[1], body)
    _put_drive(track, _DRIVE_AFTER, after[1], body)
    m, n = _growth(midway[1], body), _growth(after[1], body)
    a, b = _to_inertial(midway[0]), _to_inertial(after[0])
    half, eighth, sixth = 0.5 * h, 0.125 * h, h / 6.0
    t = track.reshape((_ROWS, COLUMNS))  # with its shape known to the compiler
    for c in range(COLUMNS):
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


@njit(cache=True, error_model="numpy", inline="always")
def _put_end(track, q, w, a):
    """Attitude, rate and their time derivatives at the second end of a step."""
    row, of_time = track[_END], track[_END + _SLOPES]
    row[0], row[1], row[2], row[3] = q
    row[4], row[5], row[6] = w
    of_time[0] = 0.5 * (w[0] * q[3] + w[2] * q[1] - w[1] * q[2])
    of_time[1] = 0.5 * (w[1] * q[3] + w[0] * q[2] - w[2] * q[0])
    of_time[2] = 0.5 * (w[2] * q[3] + w[1] * q[0] - w[0] * q[1])
    of_time[3] = -0.5 * (w[0] * q[0] + w[1] * q[1] + w[2] * q[2])
    of_time[4], of_time[5], of_time[6] = a


@allocating
def start_track(quaternion, omega, body, with_columns):
    """A track (`_ROWS`, COLUMNS) that begins with an attitude and a rate, and its ends' times.

    `body` is inertia, its inverse and the forced acceleration (3,).
    """
    track, times = make_track()
    begin_track(track, times, quaternion, omega, body, with_columns)
    return track, times


@allocating
def make_track():
    """Room for a track and its ends' times."""
    return np.empty((_ROWS, COLUMNS)), np.empty(2)


@borrowing
def begin_track(track, times, quaternion, omega, body, with_columns):
    """Begin a track; see `start_track`."""
    track[:, :] = 0.0
    times[:] = 0.0
    q = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    w = omega[0], omega[1], omega[2]
    _put_end(track, q, w, acceleration(w, body))
    if with_columns:
        for i in range(3):
            track[_DRIVE_MIDWAY + i, FIRST_DEPARTURE + TORQUE + i] = 1.0
            track[_DRIVE_AFTER + i, FIRST_DEPARTURE + TORQUE + i] = 1.0
        _put_drive(track, _DRIVE_AFTER, w, body)
        growth, to_inertial = _growth(w, body), _to_inertial(q)
        for i in range(3):
            track[_END + _CHANGES + i, i] = 1.0  # d omega(0) / d omega(0)
            for c in range(COLUMNS):
                row = _END + _SLOPES
                track[row + _CHANGES + i, c] = track[_DRIVE_AFTER + i, c]
                if c < 3:
                    track[row + _CHANGES + i, c] += growth[i][c]
                    track[row + _TURNS + i, c] = to_inertial[i][c]


@borrowing
def _take_step(track, times, h, body, with_columns):
    """Go a step on from where a track ends."""
    for row in range(_END):
        if with_columns or row % _SLOPES == 0:
            for c in range(COLUMNS):
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


@borrowing
def _rate_of_turning(track):
    """Rate at the end of a track, the square root of its change included."""
    w, a = track[_END, 4:7], track[_END + _SLOPES, 4:7]
    faster = np.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])
    return np.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2] + faster)


@borrowing
def extend_track(track, times, until, body, with_columns, turn_per_step):
    """Take steps until the last one ends at a time or later; `body` as of `start_track`."""
    finest = _FINEST * (until - times[1])
    while until > times[1]:
        rate = _rate_of_turning(track)
        h = max(turn_per_step / rate, finest) if rate > 0.0 else until - times[1]
        _take_step(track, times, h, body, with_columns)


@njit(cache=True, error_model="numpy", inline="always")
def weigh_ends(times, when):
    """Weights of the ends of the last step at a time within it.

    Of the values there, first those at the first end, then of their time derivatives.
    """
    h = times[1] - times[0]
    s = (when - times[0]) / h if h > 0.0 else 1.0
    r = 1.0 - s
    return r * r * (1.0 + 2.0 * s), s * s * (1.0 + 2.0 * r), h * s * r * r, -h * s * s * r


@njit(cache=True, error_model="numpy", inline="always")
def ends_of(track, row, column):
    """A number of a track at the ends of the last step, in the order of `weigh_ends`.

    Row 0 has the attitude (columns 0 .. 3), rows 1 .. 3 the turns of the columns, inertial frame.
    """
    return (
        track[row, column],
        track[_END + row, column],
        track[_SLOPES + row, column],
        track[_END + _SLOPES + row, column],
    )


@allocating
def departing_transition(omega, dt, inertia, inverse_inertia, kinds, out):
    """Transition matrix of (small turn, angular velocity) over a step, and derivatives (compiled).

    Into `out`, shape (6, 6 + n): ``[[A, B], [0, C]]`` with A the turn of the body over the step,
    then columns by the amounts of departures of these `kinds`.
    """
    body = inertia, inverse_inertia, np.zeros(3)
    track, times = start_track(np.array([0.0, 0.0, 0.0, 1.0]), omega, body, True)
    count = max(1, int(np.ceil(_rate_of_turning(track) * dt / TURN_OF_TRANSITION)))
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
        column = c if c < 3 else FIRST_DEPARTURE + kinds[c - 3]
        turn = rotate_components(
            q[0], q[1], q[2], q[3], turns[0, column], turns[1, column], turns[2, column]
        )
        for i in range(3):
            out[i, 3 + c], out[3 + i, 3 + c] = turn[i], changes[i, column]
