"""Rows of a light curve in blocks: attitudes, and sums of derivatives (compiled).

Rows are processed `LANES` at a time, with each quantity in a row of the arrays. Sums over all rows
are kept lane by lane and added at the end in one fixed order. Derivatives are summed with respect
to a small rotation of the initial attitude in the inertial frame and to the initial angular
velocity; the map from there to the estimated parameters is applied to the sums. Further parameters
follow these six, already in their units.
"""

from typing import NamedTuple

import numpy as np

from cislunar.attitude.grp import pull_back_to_grp
from cislunar.attitude.parameter_deviations import (
    FIRST_DEVIATION,
    ends_of,
    extend_track,
    make_track,
    weigh_ends,
)
from cislunar.attitude.quaternion import multiply_components, rotate_components
from cislunar.compiled import njit, njit_alloc, njit_inline, njit_noalloc
from cislunar.elementary import sine_and_cosine
from cislunar.photometry import facet_blocks
from cislunar.photometry.facet_blocks import BLOCK_ROWS, LANES, QUATERNION, TURN
from cislunar.runtime import Array

ROTATION = 6
"""Number of parameters of the rotation: attitude error (GRP) and angular velocity at the epoch, in
prior standard deviations. They come first and are often all."""

# Columns of a light curve.
TIME, MAGNITUDE, SUN, VIEW, RANGE, SEEN, WEIGHT = 0, 1, slice(2, 5), slice(5, 8), 8, 9, 10
ROW_COLUMNS = 11
_GEOMETRY = 2
"""First of the seven columns of directions and range."""

# Rows of a block's work besides the magnitudes.
MISFIT_SLOPE, CURVATURE = 0, 1
"""Of a row: derivative of its cost by the magnitude, and the second."""
_ELAPSED, _LAG, _REST, _TURNS, _DERIVATIVE = 2, 3, 4, 5, 29
"""There are rows for the rotations by the rate and by five rotation deviations."""
_WEIGHTS = _DERIVATIVE
"""Of the ends of a track's step, before there are derivatives."""
_MOTION_ROWS = _DERIVATIVE + ROTATION
_ROTATION_SUMS = ROTATION * (ROTATION + 1) // 2 + ROTATION


class _CostWork(NamedTuple):
    """Scratch of the cost, reused from call to call.
    `start` (4,), `omega` (3,): attitude and angular velocity at the epoch. `body`: inertia, its
    inverse and the forced acceleration. `amounts` (n,): rotation deviations. `track`, `times`: see
    `cislunar.attitude.parameter_deviations.begin_track`. `block`, `rows`, `products`: magnitudes of
    a block, its other rows, and sums of products of derivatives."""

    start: Array
    omega: Array
    body: tuple[Array, Array, Array]
    amounts: Array
    track: Array
    times: Array
    block: Array
    rows: Array
    products: Array


@njit_alloc
def make_cost_work(size):
    """Scratch for this number of estimated parameters."""
    track, times = make_track()
    return _CostWork(
        np.empty(4),
        np.empty(3),
        (np.empty((3, 3)), np.empty((3, 3)), np.empty(3)),
        np.empty(size),
        track,
        times,
        np.empty((BLOCK_ROWS, LANES)),
        np.empty((_DERIVATIVE + size, LANES)),
        np.empty((size * (size + 1) // 2 + size, LANES)),
    )


@njit(cache=True, error_model="numpy", inline="always")
def _motion_rows(work):
    """The first rows of the work, with their shape as constants (see `facet_blocks`)."""
    return work[:_MOTION_ROWS].reshape((_MOTION_ROWS, LANES))


@njit(cache=True, error_model="numpy", inline="always")
def parameter_rows(work, first):
    """Rows of the derivatives by the parameters from number `first` on."""
    return work[_DERIVATIVE + first :]


@njit_inline
def _axis(omega):
    """Angular velocity as its length, the inverse of the length and a unit vector; zeros for
    none."""
    rate = np.sqrt(omega[0] * omega[0] + omega[1] * omega[1] + omega[2] * omega[2])
    inverse = 1.0 / rate if rate > 0.0 else 0.0
    return rate, inverse, omega[0] * inverse, omega[1] * inverse, omega[2] * inverse


@njit_noalloc
def fill_block(block, work, data, first, count):
    """Directions, ranges and times of the rows from `first` on."""
    b = block.reshape((BLOCK_ROWS, LANES))
    w = _motion_rows(work)
    for k in range(count):
        w[_ELAPSED, k] = data[first + k, TIME]
        for c in range(7):
            b[facet_blocks.SUN + c, k] = data[first + k, _GEOMETRY + c]


@njit_noalloc
def turn_evenly(block, work, count, start, omega):
    """Attitudes of a body of constant angular velocity, and the factors of `pull_back`."""
    b = block.reshape((BLOCK_ROWS, LANES))
    w = _motion_rows(work)
    rate, inverse, nx, ny, nz = _axis(omega)
    s1, s2, s3, s4 = start[0], start[1], start[2], start[3]
    for k in range(count):
        t = w[_ELAPSED, k]
        sine, cosine = sine_and_cosine(0.5 * rate * t)
        q1, q2, q3, q4 = multiply_components(
            nx * sine, ny * sine, nz * sine, cosine, s1, s2, s3, s4
        )
        b[QUATERNION, k], b[QUATERNION + 1, k] = q1, q2
        b[QUATERNION + 2, k], b[QUATERNION + 3, k] = q3, q4
        w[_LAG, k] = 2.0 * sine * sine * inverse
        w[_REST, k] = t - 2.0 * sine * cosine * inverse


@njit_inline
def _interpolate(rows, row, w, first, end, ends):
    """A quantity of the rows from `first` to `end` that fall within one step of a track."""
    before, after, leaving, arriving = ends
    for k in range(first, end):
        rows[row, k] = (before * w[_WEIGHTS, k] + after * w[_WEIGHTS + 1, k]) + (
            leaving * w[_WEIGHTS + 2, k] + arriving * w[_WEIGHTS + 3, k]
        )


@njit_noalloc
def read_attitude(block, work, count, track, times, columns, body, turn):
    """Attitudes of a body whose angular velocity changes, from a track that is extended. The first
    `columns` of its rotation derivatives are kept for `pull_back`; its steps rotate by `turn`. See
    `cislunar.attitude.parameter_deviations`."""
    b = block.reshape((BLOCK_ROWS, LANES))
    w = _motion_rows(work)
    first = 0
    while first < count:
        if w[_ELAPSED, first] > times[1]:
            extend_track(track, times, w[_ELAPSED, first], body, columns > 0, turn)
        end = first
        while end < count and not w[_ELAPSED, end] > times[1]:
            weights = weigh_ends(times, w[_ELAPSED, end])
            w[_WEIGHTS, end], w[_WEIGHTS + 1, end] = weights[0], weights[1]
            w[_WEIGHTS + 2, end], w[_WEIGHTS + 3, end] = weights[2], weights[3]
            end += 1
        for c in range(4):
            _interpolate(b, QUATERNION + c, w, first, end, ends_of(track, 0, c))
        for c in range(columns):
            for i in range(3):
                _interpolate(w, _TURNS + 3 * c + i, w, first, end, ends_of(track, 1 + i, c))
        first = end
    for k in range(count):
        q1, q2, q3 = b[QUATERNION, k], b[QUATERNION + 1, k], b[QUATERNION + 2, k]
        q4 = b[QUATERNION + 3, k]
        scale = 1.0 / np.sqrt(q1 * q1 + q2 * q2 + q3 * q3 + q4 * q4)
        b[QUATERNION, k], b[QUATERNION + 1, k] = scale * q1, scale * q2
        b[QUATERNION + 2, k], b[QUATERNION + 3, k] = scale * q3, scale * q4


@njit_noalloc
def pull_back(block, work, count, omega, even, kinds, sigma):
    """Carry the magnitudes' derivatives by attitude back to the epoch. With phi = omega t, its
    direction n and the derivative g at t, that by omega is ``t g + (1 - cos|phi|)/|omega| n x g +
    (t - sin|phi|/|omega|) n x (n x g)`` for a spherical body, and that by the attitude ``A(q)^T
    g``. Derivatives by rotation deviations of the `kinds` are in units of `sigma`."""
    b = block.reshape((BLOCK_ROWS, LANES))
    w = _motion_rows(work)
    _, _, nx, ny, nz = _axis(omega)
    for k in range(count):
        gx, gy, gz = b[TURN, k], b[TURN + 1, k], b[TURN + 2, k]
        q1, q2, q3, q4 = b[QUATERNION, k], b[QUATERNION + 1, k], b[QUATERNION + 2, k], b[3, k]
        ex, ey, ez = rotate_components(-q1, -q2, -q3, q4, gx, gy, gz)
        w[_DERIVATIVE, k], w[_DERIVATIVE + 1, k], w[_DERIVATIVE + 2, k] = ex, ey, ez
    if even:
        for k in range(count):
            gx, gy, gz = b[TURN, k], b[TURN + 1, k], b[TURN + 2, k]
            t, lag, rest = w[_ELAPSED, k], w[_LAG, k], w[_REST, k]
            cx, cy, cz = ny * gz - nz * gy, nz * gx - nx * gz, nx * gy - ny * gx
            w[_DERIVATIVE + 3, k] = t * gx + lag * cx + rest * (ny * cz - nz * cy)
            w[_DERIVATIVE + 4, k] = t * gy + lag * cy + rest * (nz * cx - nx * cz)
            w[_DERIVATIVE + 5, k] = t * gz + lag * cz + rest * (nx * cy - ny * cx)
        return
    whole = work.reshape((work.shape[0], LANES))
    for c in range(3 + kinds.shape[0]):
        scale, column = 1.0, c
        if c >= 3:
            scale, column = sigma[c - 3], FIRST_DEVIATION + kinds[c - 3]
        for k in range(count):
            whole[_DERIVATIVE + 3 + c, k] = scale * (
                whole[_TURNS + 3 * column, k] * w[_DERIVATIVE, k]
                + whole[_TURNS + 3 * column + 1, k] * w[_DERIVATIVE + 1, k]
                + whole[_TURNS + 3 * column + 2, k] * w[_DERIVATIVE + 2, k]
            )


@njit(cache=True, error_model="numpy", inline="always")
def _add_products(w, s, count, size):
    """`add_products` for this number of parameters."""
    by_slope = size * (size + 1) // 2
    pair = 0
    for i in range(size):
        for j in range(i + 1):
            for k in range(count):
                s[pair, k] += w[CURVATURE, k] * w[_DERIVATIVE + i, k] * w[_DERIVATIVE + j, k]
            pair += 1
        for k in range(count):
            s[by_slope + i, k] += w[MISFIT_SLOPE, k] * w[_DERIVATIVE + i, k]


@njit_noalloc
def add_products(work, count, sums):
    """Add a block's products of derivatives to the sums (n (n + 3) / 2, LANES), lane by lane."""
    size = work.shape[0] - _DERIVATIVE
    if size == ROTATION:  # the common case, with all shapes known to the compiler
        s = sums.reshape((_ROTATION_SUMS, LANES))
        _add_products(_motion_rows(work), s, count, ROTATION)
    else:
        _add_products(work, sums, count, size)


@njit_alloc
def pull_back_matrix(u, start, sigma):
    """Matrix (6, 6) from derivatives by attitude (inertial) and rate at the epoch to the
    parameters'."""
    matrix, turn = np.zeros((ROTATION, ROTATION)), np.empty(3)
    p = sigma[:3] * u[:3]
    for i in range(3):
        turn[0], turn[1], turn[2] = rotate_components(
            start[0], start[1], start[2], start[3], 1.0 * (i == 0), 1.0 * (i == 1), 1.0 * (i == 2)
        )
        by_grp = pull_back_to_grp(p, turn)
        for c in range(3):
            matrix[c, i] = sigma[c] * by_grp[c]
        matrix[3 + i, 3 + i] = sigma[3 + i]
    return matrix


@njit_alloc
def fold(sums, matrix, size):
    """Sums over all lanes for the parameters: products (n, n) and by slope (n,). `matrix`, shape
    (6, 6), applies to the parameters of the rotation; the others stay."""
    width = LANES // 2
    while width > 0:
        for row in range(sums.shape[0]):
            for k in range(width):
                sums[row, k] += sums[row, width + k]
        width //= 2
    first = size * (size + 1) // 2
    whole, half = np.empty((size, size)), np.zeros((size, size))
    products = np.zeros((size, size))
    by_slope = np.zeros(size)
    for i in range(size):
        for j in range(i + 1):
            whole[i, j] = whole[j, i] = sums[i * (i + 1) // 2 + j, 0]
    for i in range(size):
        if i >= ROTATION:
            by_slope[i] = sums[first + i, 0]
            half[i] = whole[i]
            continue
        for k in range(ROTATION):
            by_slope[i] += matrix[i, k] * sums[first + k, 0]
            for j in range(size):
                half[i, j] += matrix[i, k] * whole[k, j]
    for i in range(size):
        for j in range(i + 1):
            if j >= ROTATION:
                products[i, j] = half[i, j]
            else:
                for k in range(ROTATION):
                    products[i, j] += half[i, k] * matrix[j, k]
            products[j, i] = products[i, j]
    return products, by_slope
