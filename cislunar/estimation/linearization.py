"""Parts of the recursions for observer errors (compiled): transition matrices, and the derivatives
of measured angles by the state of a target and by the errors of an observer. Errors are parameters
in units of their prior standard deviations."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cislunar.compiled import njit_alloc, njit_noalloc
from cislunar.dynamics.bundle import step_cloud
from cislunar.dynamics.forces import of_state
from cislunar.dynamics.tableau import STAGES8
from cislunar.observation.measurement_derivatives import angle_rows
from cislunar.observation.sightline import direction_angles, wrap_angle

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

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
