"""Orbit estimates as Gaussian mixtures where a single Gaussian is not adequate, compiled;
docs/dynamics.md derives the method. An estimate that never became a mixture equals that of the
filter without splitting, bit for bit.

Each component has the covariance of the process noise since the time of its Gaussian. It is carried
by the transition matrix of the component: that of the central differences of its sigma points over
a stride, in which noise is added as in free motion. The noise is thus linearized, about each
component and over its width; it has to remain small compared with the curvature of the flow."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.compiled import copy_into, njit_alloc, njit_noalloc
from cislunar.dynamics.bundle import step_bundle
from cislunar.dynamics.forces import of_state
from cislunar.estimation.estimator import HEALTHY, NOT_FINITE
from cislunar.estimation.kalman.translation_filter import SIZE, predict_translation
from cislunar.estimation.kalman.workspace import add_orbit_noise, covariance_of, has_orbit_noise
from cislunar.estimation.triangular import cholesky, solve_lower
from cislunar.estimation.unscented import difference_moments, sigma_points
from cislunar.runtime import Array

MAX_COMPONENTS = 40
"""Largest number of components; a split that would exceed it is not made."""

_NONLINEARITY_LIMIT = 0.02
"""Shift of the mean by curvature, in standard deviations, from which an estimate becomes a mixture.
"""

_STRIDE_S = 240.0
"""Longest integration step of a component over a gap, s."""

_SPLIT_NODE = np.sqrt(3.0)
_SPLIT_WEIGHT = 1.0 / 6.0
_SPLIT_VARIANCE = 0.42
"""A standard normal is split into three: means 0 and +- the node times sqrt(1 - variance), with
weights 2/3 and 1/6 (Gauss-Hermite, so that all moments up to the fifth are kept)."""


class GaussianMixture(NamedTuple):
    """Mixtures of all targets, which the kernels change in place; arrays by target.

    `steps_since_update`; `since`, the time index of the Gaussians (-1 for none); `nonlinearity`,
    the upper bound of the shift of a single mean by curvature since then, standard deviations;
    `count` of components, 0 for a single Gaussian; their `weight` (target, MAX_COMPONENTS), `mean`
    (..., 6) and `root` (..., 6, 6) at the time `since`, nondimensional, propagation frame; `points`
    (..., 6, 13), their sigma points propagated to the present; `noise` (..., 6, 6), the covariance
    of their process noise since then.
    """

    steps_since_update: NDArray[np.int64]
    since: NDArray[np.int64]
    nonlinearity: Array
    count: NDArray[np.int64]
    weight: Array
    mean: Array
    root: Array
    points: Array
    noise: Array


def no_mixture(n_targets: int, splitting: bool) -> GaussianMixture:
    """Mixtures before the first step; without memory for components if nothing is ever split."""
    most = MAX_COMPONENTS if splitting else 0
    return GaussianMixture(
        np.ones(n_targets, dtype=np.int64),  # a gap may begin at the epoch
        np.full(n_targets, -1, dtype=np.int64),
        np.zeros(n_targets),
        np.zeros(n_targets, dtype=np.int64),
        np.zeros((n_targets, most)),
        np.zeros((n_targets, most, SIZE)),
        np.zeros((n_targets, most, SIZE, SIZE)),
        np.zeros((n_targets, most, SIZE, 2 * SIZE + 1)),
        np.zeros((n_targets, most, SIZE, SIZE)),
    )


def restart_mixtures(mixture: GaussianMixture, targets: ArrayLike) -> None:
    """Make the estimates of some targets single Gaussians, as after an update."""
    mixture.steps_since_update[targets], mixture.since[targets] = 0, -1
    mixture.nonlinearity[targets], mixture.count[targets] = 0.0, 0


@njit_alloc
def split_weights():
    """Weights of the three components that `split` makes."""
    return np.array([1.0 - 2.0 * _SPLIT_WEIGHT, _SPLIT_WEIGHT, _SPLIT_WEIGHT])


@njit_noalloc
def split(mean, root, axis, means, narrow):
    """Split a Gaussian along a column of its root: three means (3, 6) and their root (6, 6)."""
    length = _SPLIT_NODE * np.sqrt(1.0 - _SPLIT_VARIANCE)
    copy_into(narrow, root)
    for c in range(SIZE):
        means[0, c] = mean[c]
        means[1, c] = mean[c] + length * root[c, axis]
        means[2, c] = mean[c] - length * root[c, axis]
        narrow[c, axis] = np.sqrt(_SPLIT_VARIANCE) * root[c, axis]


@njit_noalloc
def point_moments(points, weights, work):
    """Mean and covariance of sigma points (6, 13), into `work.shift` and `work.covariance`."""
    for c in range(SIZE):
        for i in range(2 * SIZE):
            work.differences[i, c] = points[c, 1 + i] - points[c, 0]
    difference_moments(
        work.differences, weights.outer, weights.mean_shift, work.shift, work.covariance
    )
    for c in range(SIZE):
        work.shift[c] += points[c, 0]


@njit_noalloc
def definite_root(covariance):
    """Replace a covariance by its Cholesky factor; False if rounding has made it indefinite."""
    for c in range(SIZE):
        covariance[c, c] *= 1.0 + 1e-12
    return cholesky(covariance)


@njit_noalloc
def _half_differences(points, out):
    """Half the differences of opposite sigma points (6, 13), in rows of `out` (6, 6)."""
    for i in range(SIZE):
        for c in range(SIZE):
            out[i, c] = 0.5 * (points[c, 1 + i] - points[c, 1 + SIZE + i])


@njit_noalloc
def _solve(matrix, right):
    """Solve ``matrix x = right`` for six columns, by elimination with partial pivoting; both are
    overwritten, `right` by x. False if the matrix is singular."""
    for i in range(SIZE):
        pivot = i
        for r in range(i + 1, SIZE):
            if abs(matrix[r, i]) > abs(matrix[pivot, i]):
                pivot = r
        if not abs(matrix[pivot, i]) > 0.0:
            return False
        for c in range(SIZE):
            matrix[i, c], matrix[pivot, c] = matrix[pivot, c], matrix[i, c]
            right[i, c], right[pivot, c] = right[pivot, c], right[i, c]
        for r in range(SIZE):
            if r != i:
                factor = matrix[r, i] / matrix[i, i]
                for c in range(SIZE):
                    matrix[r, c] -= factor * matrix[i, c]
                    right[r, c] -= factor * right[i, c]
    for i in range(SIZE):
        for c in range(SIZE):
            right[i, c] /= matrix[i, i]
    return True


@njit_noalloc
def _carry_noise(noise, transposed, scratch):
    """Carry a covariance (6, 6) by a transition matrix, given its transpose (6, 6)."""
    for a in range(SIZE):
        for b in range(SIZE):
            total = 0.0
            for i in range(SIZE):
                total += noise[a, i] * transposed[i, b]
            scratch[a, b] = total
    for a in range(SIZE):
        for b in range(a + 1):
            total = 0.0
            for i in range(SIZE):
                total += transposed[i, a] * scratch[i, b]
            noise[a, b] = total
            noise[b, a] = total


@njit_noalloc
def carry_points(points, noise, j, first, last, scene, constants, work):
    """Propagate sigma points (6, 13) of target j, and the covariance (6, 6) of their process noise,
    from one time to another."""
    stride = max(1, int(_STRIDE_S / scene.step_s))
    forces = of_state(constants.forces, j)
    noisy = has_orbit_noise(constants)
    before, after = work.differences[:SIZE, :SIZE], work.differences[SIZE : 2 * SIZE, :SIZE]
    for k in range(first, last, stride):
        n_steps = min(k + stride, last) - k
        dt = n_steps * scene.step
        if noisy:
            _half_differences(points, before)
        step_bundle(forces, k * scene.step, points, dt, work.slopes, work.stage)
        if noisy:
            _half_differences(points, after)
            # without a transition matrix the noise of the points is not finite either
            if _solve(before, after):
                _carry_noise(noise, after, work.covariance)
            add_orbit_noise(noise, n_steps, scene.step, constants)


@njit_alloc
def merge(mixture, j, translation, root, constants, work):
    """Mean and root of a mixture's present moments; returns the variance between the components.
    The variance is summed over the axes in units of the root; -1 if the moments are not finite or
    not definite."""
    weights = constants.weights
    count = mixture.count[j]
    mean, covariance = np.zeros(SIZE), np.zeros((SIZE, SIZE))
    each = np.empty((count, SIZE))
    for m in range(count):
        point_moments(mixture.points[j, m], weights, work)
        weight = mixture.weight[j, m]
        for c in range(SIZE):
            each[m, c] = work.shift[c]
            mean[c] += weight * work.shift[c]
            for d in range(c + 1):
                own = work.covariance[c, d] + mixture.noise[j, m, c, d]
                covariance[c, d] += weight * own
    for m in range(count):
        for c in range(SIZE):
            each[m, c] -= mean[c]
        for c in range(SIZE):
            for d in range(c + 1):
                covariance[c, d] += mixture.weight[j, m] * each[m, c] * each[m, d]
    if not np.isfinite(np.sum(mean)) or not definite_root(covariance):
        return -1.0
    translation[:], root[:, :] = mean, covariance
    between = 0.0
    for m in range(count):
        solve_lower(covariance, each[m])
        for c in range(SIZE):
            between += mixture.weight[j, m] * each[m, c] ** 2
    return between


@njit_noalloc
def moments(mixture, j, translation, rows, constants, work):
    """Present moments of a mixture, into mean (6,) and rows (6, n) of a root; its health. The
    correlation of the other n - 6 states with the orbit is neglected."""
    others = rows.shape[1] - SIZE
    rows[:, :others] = 0.0
    between = merge(mixture, j, translation, rows[:, others:], constants, work)
    return HEALTHY if between >= 0.0 else NOT_FINITE


@njit_noalloc
def keep_single(mixture, j, translation, rows, k, work):
    """Store the Gaussian of target j at time k, given by rows of a root, for a later split."""
    covariance_of(rows, work.covariance)
    if not definite_root(work.covariance):
        return False
    copy_into(mixture.mean[j, 0], translation)
    copy_into(mixture.root[j, 0], work.covariance)
    mixture.weight[j, 0] = 1.0
    mixture.since[j] = k
    mixture.nonlinearity[j] = 0.0
    return True


@njit_noalloc
def before_step(mixture, j, translation, rows, k, work):
    """Store a single Gaussian before its step from time k if a gap begins; `rows` (6, n) of its
    root."""
    if mixture.weight.shape[1] == 0:
        return
    if mixture.steps_since_update[j] == 1:
        keep_single(mixture, j, translation, rows, k, work)
    mixture.steps_since_update[j] += 1


@njit_noalloc
def after_step(mixture, j, translation, rows, shift, health, k, scene, constants, work):
    """Convert a single Gaussian into a mixture after its step to time k if it is nonlinear; its
    health. `shift` (6,) is the shift of its mean by the curvature of the step. Its length in
    standard deviations is invariant under linear flow, so that the sum of the lengths bounds the
    total shift."""
    if mixture.since[j] < 0:
        return health
    if health == HEALTHY:
        for c in range(SIZE):
            work.correction[c] = shift[c]
        solve_lower(rows[:, rows.shape[1] - SIZE :], work.correction)
        squared = 0.0
        for c in range(SIZE):
            squared += work.correction[c] ** 2
        mixture.nonlinearity[j] += np.sqrt(squared)
        if mixture.nonlinearity[j] <= _NONLINEARITY_LIMIT:
            return health
    open_single(mixture, j, k, scene, constants, work)
    return moments(mixture, j, translation, rows, constants, work)


@njit_noalloc
def open_single(mixture, j, k, scene, constants, work):
    """Propagate the sigma points of the stored Gaussian to time k, as the only component."""
    spread = constants.weights.spread
    sigma_points(mixture.mean[j, 0], mixture.root[j, 0], spread, mixture.points[j, 0])
    points, noise = mixture.points[j, 0], mixture.noise[j, 0]
    noise[:, :] = 0.0
    carry_points(points, noise, j, mixture.since[j], k, scene, constants, work)
    mixture.count[j] = 1


@njit_noalloc
def step_mixture(mixture, j, translation, rows, k, scene, constants, work):
    """Propagate a mixture over the step from time k; its moments go into mean and rows of a
    root."""
    for m in range(mixture.count[j]):
        points, noise = mixture.points[j, m], mixture.noise[j, m]
        carry_points(points, noise, j, k, k + 1, scene, constants, work)
    return moments(mixture, j, translation, rows, constants, work)


@njit_noalloc
def step_orbit(mixture, j, translation, root, k, scene, constants, work):
    """Propagate the orbit of target j over the step from time k; its health."""
    if mixture.count[j] > 0:
        return step_mixture(mixture, j, translation, root, k, scene, constants, work)
    before_step(mixture, j, translation, root, k, work)
    health = predict_translation(translation, root, j, k, scene, constants, work)
    return after_step(
        mixture, j, translation, root, work.shift, health, k + 1, scene, constants, work
    )


@njit_noalloc
def updated(mixture, j):
    """Reset the record of a gap after the update of a single Gaussian."""
    mixture.steps_since_update[j], mixture.since[j], mixture.nonlinearity[j] = 0, -1, 0.0
