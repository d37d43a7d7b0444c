"""Parts of the recursions for observer errors (compiled): transition matrices, and the derivatives
of measured angles by the state of a target and by the errors of an observer. Errors are parameters
in units of their prior standard deviations."""

from typing import NamedTuple

import numpy as np

from cislunar.compiled import copy_into, njit, njit_alloc, njit_noalloc
from cislunar.dynamics.bundle import step_cloud
from cislunar.dynamics.forces import (
    acceleration,
    acceleration_change,
    at,
    is_calm,
    of_state,
    partials,
)
from cislunar.dynamics.tableau import STAGES8
from cislunar.observation.measurement_derivatives import angle_rows
from cislunar.observation.sightline import direction_angles, wrap_angle
from cislunar.runtime import Array, Indices

SIZE = 6

_OFFSET = 1e-7
"""Difference of states, nondimensional, from which transition matrices are computed."""


class ObserverModel(NamedTuple):
    """Errors of the observers, in the layout of the recursions.

    Attributes
    ----------
    column : ndarray of int, shape (6,)
        Index of each component among the parameters of an observer, -1 without a parameter.
    per_observer : int
        Number of parameters of an observer.
    unit : ndarray, shape (6,)
        Standard deviation of each component; nondimensional, rad and s.
    velocity : ndarray, shape (observer, time, 3)
        Velocities of the observers, nondimensional, propagation frame.
    turning : ndarray, shape (3,)
        Angular velocity of the propagation frame, nondimensional.
    time_unit_s : float
        Nondimensional unit of time, s.
    process : ndarray, shape (6, 6)
        Process noise of the orbits in a step.
    """

    column: Indices
    per_observer: int
    unit: Array
    velocity: Array
    turning: Array
    time_unit_s: float
    process: Array


class RecursionScratch(NamedTuple):
    """Scratch arrays of one target."""

    pair: Array
    pair_slopes: Array
    pair_stage: Array
    bundle: Array
    slopes: Array
    stage: Array
    mean: Array
    beside: Array
    phi: Array
    square: Array
    rows: Array
    own: Array
    gain: Array
    angles: Array


@njit_alloc
def make_scratch():
    """Scratch arrays of a recursion."""
    return RecursionScratch(
        np.empty((SIZE, 2)),
        np.empty((STAGES8, SIZE, 2)),
        np.empty((SIZE, 2)),
        np.empty((SIZE, SIZE + 2)),
        np.empty((STAGES8, SIZE, SIZE + 2)),
        np.empty((SIZE, SIZE + 2)),
        np.empty(SIZE),
        np.empty(SIZE),
        np.empty((SIZE, SIZE)),
        np.empty((SIZE, SIZE)),
        np.zeros((3, SIZE)),
        np.empty((2, SIZE)),
        np.empty((SIZE, 2)),
        np.empty(2),
    )


@njit_noalloc
def transition(forces, k, n_steps, scene, state, other, work):
    """Propagate a state (6,) and another one nearby from time k over some steps at once, into
    `work.mean` and `work.beside`, with the transition matrix of the first into `work.phi`."""
    bundle = work.bundle
    for c in range(SIZE):
        for i in range(SIZE + 1):
            bundle[c, i] = state[c]
        bundle[c, 1 + c] += _OFFSET
        bundle[c, SIZE + 1] = other[c]
    step_cloud(forces, k * scene.step, bundle, n_steps * scene.step, work.slopes, work.stage)
    for c in range(SIZE):
        work.mean[c] = bundle[c, 0]
        work.beside[c] = bundle[c, SIZE + 1]
        for i in range(SIZE):
            work.phi[c, i] = (bundle[c, 1 + i] - bundle[c, 0]) / _OFFSET


@njit_noalloc
def calm_transition(forces, k, scene, state, phi):
    """Transition matrix over the step from time k where forces change little, into `phi`: the
    exponential of the derivatives at the middle of the step (second-order Magnus expansion; Iserles
    & Norsett 1999) to third order. Returns whether they change little."""
    dt = scene.step
    x, y, z, vx, vy, vz = state[0], state[1], state[2], state[3], state[4], state[5]
    half = 0.5 * dt
    field = at(forces, k * dt)
    if not is_calm(field, x, y, z, dt):
        return False
    ax, ay, az = acceleration(field, x, y, z, vx, vy, vz)
    field = at(forces, k * dt + half)
    x, y, z = (
        x + half * (vx + 0.5 * half * ax),
        y + half * (vy + 0.5 * half * ay),
        z + half * (vz + 0.5 * half * az),
    )
    middle = partials(field, x, y, z, vx + half * ax, vy + half * ay, vz + half * az)
    for c in range(SIZE):
        for a in range(SIZE):
            phi[a, c] = 0.0
        phi[c, c] = 1.0
        dx, dy, dz = phi[0, c], phi[1, c], phi[2, c]
        ux, uy, uz = phi[3, c], phi[4, c], phi[5, c]
        factor = 1.0
        for order in range(1, 4):
            factor *= dt / order
            gx, gy, gz = acceleration_change(middle, dx, dy, dz, ux, uy, uz)
            dx, dy, dz, ux, uy, uz = ux, uy, uz, gx, gy, gz
            phi[0, c] += factor * dx
            phi[1, c] += factor * dy
            phi[2, c] += factor * dz
            phi[3, c] += factor * ux
            phi[4, c] += factor * uy
            phi[5, c] += factor * uz
    return True


@njit_noalloc
def carry_estimates(forces, k, scene, place, state, measured, path, spread, work):
    """Propagate two estimates (6,) of a target over the step from time k, in place, with the
    transition matrices `path` since the last measurement and the excess of the covariance of the
    first, `spread`. Where forces change little and nothing is measured at the end of the step, the
    difference of the estimates alone is propagated. The matrix of the step goes into `work.phi`."""
    phi, pair = work.phi, work.pair
    if not calm_transition(forces, k, scene, place, phi):
        transition(forces, k, 1, scene, place, state, work)
        copy_into(place, work.mean)
        copy_into(state, work.beside)
    elif measured:
        for c in range(SIZE):
            pair[c, 0], pair[c, 1] = place[c], state[c]
        step_cloud(forces, k * scene.step, pair, scene.step, work.pair_slopes, work.pair_stage)
        for c in range(SIZE):
            place[c], state[c] = pair[c, 0], pair[c, 1]
    else:
        for c in range(SIZE):
            work.mean[c] = place[c] - state[c]
        for a in range(SIZE):
            place[a] = state[a]
            for c in range(SIZE):
                place[a] += phi[a, c] * work.mean[c]
    multiply(phi, path, work.square)
    copy_into(path, work.square)
    carry_covariance(phi, spread, work.square)


@njit_noalloc
def measured_at(used, first, stop):
    """Whether any of the rows from `first` to the one before `stop` is used."""
    count = 0
    for row in range(first, stop):
        count += used[row]
    return count > 0


@njit_noalloc
def carry_filter(covariance, process, work):
    """Propagate the covariance (6, 6) of a filter by the transition matrix in `work`."""
    carry_covariance(work.phi, covariance, work.square)
    for a in range(SIZE):
        for b in range(SIZE):
            covariance[a, b] += process[a, b]


@njit_noalloc
def carry_along(path, matrix, carried):
    """Propagate a matrix (6, n) by `path`, with `carried` (6, n) as scratch array."""
    multiply(path, matrix, carried)
    copy_into(matrix, carried)


@njit_noalloc
def restart(path):
    """Make the transition matrix `path` (6, 6) that of no time."""
    for a in range(SIZE):
        for b in range(SIZE):
            path[a, b] = 1.0 if a == b else 0.0


@njit_noalloc
def multiply(phi, matrix, out):
    """phi (6, 6) times a matrix (6, n), into `out`."""
    for a in range(SIZE):
        for b in range(matrix.shape[1]):
            total = 0.0
            for c in range(SIZE):
                total += phi[a, c] * matrix[c, b]
            out[a, b] = total


@njit_noalloc
def carry_covariance(phi, covariance, work):
    """Replace a covariance (6, 6) by phi P phi^T."""
    multiply(phi, covariance, work)
    for a in range(SIZE):
        for b in range(SIZE):
            total = 0.0
            for c in range(SIZE):
                total += work[a, c] * phi[b, c]
            covariance[a, b] = total


@njit_noalloc
def angles_by_state(state, value, o, k, scene, work):
    """Measured less expected right ascension and declination, into `work.angles`, and the
    derivatives of the expected ones by the state's position, into `work.rows`."""
    place, axes = scene.observer_position[o, k], scene.observer_axes[k]
    dx, dy, dz = state[0] - place[0], state[1] - place[1], state[2] - place[2]
    ra, dec = direction_angles(dx, dy, dz, axes)
    work.angles[0], work.angles[1] = wrap_angle(value[1] - ra), value[2] - dec
    angle_rows(dx, dy, dz, axes, work.rows)
    return dx, dy, dz


@njit_noalloc
def linearize(state, value, o, k, scene, observers, work):
    """As `angles_by_state`; the derivatives by the parameters of the observer, J, go into
    `work.own` (2, m)."""
    dx, dy, dz = angles_by_state(state, value, o, k, scene, work)
    rows, own = work.rows, work.own
    own[:, :] = 0.0
    for c in range(6):
        column = observers.column[c]
        if column < 0:
            continue
        unit = observers.unit[c]
        for a in range(2):
            if c < 3:  # as by the opposite displacement of the target
                own[a, column] = -rows[1 + a, 3 + c] * unit
            elif c < 5:
                own[a, column] = unit if c == 3 + a else 0.0
            else:
                total = 0.0
                turning, velocity = observers.turning, observers.velocity[o, k]
                rx = turning[1] * dz - turning[2] * dy + state[3] - velocity[0]
                ry = turning[2] * dx - turning[0] * dz + state[4] - velocity[1]
                rz = turning[0] * dy - turning[1] * dx + state[5] - velocity[2]
                total = rows[1 + a, 3] * rx + rows[1 + a, 4] * ry + rows[1 + a, 5] * rz
                own[a, column] = total * unit / observers.time_unit_s


@njit_noalloc
def innovation_root(s11, s12, s22):
    """Lower Cholesky factor of a symmetric 2 x 2 matrix."""
    l11 = np.sqrt(s11)
    l21 = s12 / l11
    return l11, l21, np.sqrt(s22 - l21 * l21)


@njit_noalloc
def use_exactly(covariance, variance, work):
    """Kalman update of a covariance (6, 6) by two angles with the rows in `work`; the gain goes
    into `work.gain`. Returns the root of the innovation's covariance."""
    rows, gain = work.rows, work.gain
    for c in range(SIZE):
        for a in range(2):
            total = 0.0
            for d in range(3):
                total += covariance[c, d] * rows[1 + a, 3 + d]
            gain[c, a] = total  # P H^T
    s11, s12, s22 = variance[0], 0.0, variance[1]
    for d in range(3):
        s11 += rows[1, 3 + d] * gain[d, 0]
        s12 += rows[1, 3 + d] * gain[d, 1]
        s22 += rows[2, 3 + d] * gain[d, 1]
    l11, l21, l22 = innovation_root(s11, s12, s22)
    for c in range(SIZE):
        gain[c, 0] /= l11
        gain[c, 1] = (gain[c, 1] - l21 * gain[c, 0]) / l22  # P H^T L^-T
    for c in range(SIZE):
        for d in range(SIZE):
            covariance[c, d] -= gain[c, 0] * gain[d, 0] + gain[c, 1] * gain[d, 1]
    for c in range(SIZE):
        gain[c, 1] /= l22
        gain[c, 0] = (gain[c, 0] - l21 * gain[c, 1]) / l11
    return l11, l21, l22


@njit_noalloc
def follow(state, covariance, value, variance, o, k, scene, work):
    """Update of the filter without errors, its state (6,) and covariance (6, 6), by two angles. The
    derivatives, gain and innovation go into `work`. Returns the root of the innovation's
    covariance."""
    angles_by_state(state, value, o, k, scene, work)
    root = use_exactly(covariance, variance, work)
    gain, angles = work.gain, work.angles
    for c in range(SIZE):
        state[c] += gain[c, 0] * angles[0] + gain[c, 1] * angles[1]
    return root


@njit(cache=True, error_model="numpy")
def carry_corrections(k, scene, forces, mean, shift, spread):
    """Propagate shifts (target, 6) and covariances (target, 6, 6) of estimates over the step from
    time k, in place; `mean` (target, 6) are the filter's estimates."""
    work, place = make_scratch(), np.empty(SIZE)
    for j in range(mean.shape[0]):
        if not np.isfinite(mean[j, 0]):
            continue
        for c in range(SIZE):
            place[c] = mean[j, c] + shift[j, c]
        transition(of_state(forces, j), k, 1, scene, place, mean[j], work)
        for c in range(SIZE):
            shift[j, c] = work.mean[c] - work.beside[c]
        carry_covariance(work.phi, spread[j], work.square)
