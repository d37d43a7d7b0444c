"""Orbit estimates that are mixtures of Gaussians where one Gaussian is not enough, compiled.

Through hours without a measurement the spread of an orbit bends, most of all about the Moon. A
filter that replaces it by a Gaussian at every step adds the bend to the covariance again and again.
Here such an estimate is opened: the sigma points of its last Gaussian are carried on as they are.
At the next measurement that Gaussian is split where the predicted angles are curved, its parts are
carried over the gap and split again, until none that matters is; each is updated by the angles and
weighed by how well it predicted them. When the parts lie within one another they are one Gaussian
again. An estimate that was never opened is that of the filter without splitting, bit for bit.
The process noise of a gap, as of free motion, is added to what the points say.
docs/dynamics.md derives the method.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.compiled import allocating, borrowing, put
from cislunar.dynamics.bundle import step_bundle
from cislunar.dynamics.forces import of_state
from cislunar.estimation.estimator import HEALTHY, NOT_FINITE
from cislunar.estimation.kalman.translation_filter import SIZE, predict_translation
from cislunar.estimation.kalman.workspace import add_orbit_noise, covariance_of
from cislunar.estimation.triangular import cholesky, solve_lower
from cislunar.estimation.unscented import difference_moments, sigma_points

Array = NDArray[np.float64]

MOST_PARTS = 40
"""Parts a mixture may have; those that would be beyond are not split."""

_STRAIN = 0.02
"""Shift of the mean by curvature, standard deviations, at which an estimate is opened."""

_STRIDE_S = 240.0
"""Longest step of a part that is carried over a gap, s."""

SPLIT_NODE = np.sqrt(3.0)
SPLIT_WEIGHT = 1.0 / 6.0
SPLIT_VARIANCE = 0.42
"""A standard normal is split into three: means 0 and +- the node times sqrt(1 - variance), with
weights 2/3 and 1/6 (Gauss-Hermite, so that all moments up to the fifth are kept)."""


class Parts(NamedTuple):
    """Mixtures of all targets, which the kernels change in place.

    Attributes
    ----------
    idle : ndarray of int, shape (target,)
        Steps since the last update.
    since : ndarray of int, shape (target,)
        Time index of the Gaussians below; -1 for none.
    strain : ndarray, shape (target,)
        Upper bound of the shift of a single mean by curvature since then, standard deviations.
    count : ndarray of int, shape (target,)
        Number of parts; 0 where the estimator carries a single Gaussian as ever.
    weight : ndarray, shape (target, MOST_PARTS)
    mean, root : ndarray, shapes (target, MOST_PARTS, 6) and (target, MOST_PARTS, 6, 6)
        The parts at the time `since`, nondimensional.
    points : ndarray, shape (target, MOST_PARTS, 6, 13)
        Their sigma points, carried to now.
    """

    idle: NDArray[np.int64]
    since: NDArray[np.int64]
    strain: Array
    count: NDArray[np.int64]
    weight: Array
    mean: Array
    root: Array
    points: Array


def no_parts(n_targets: int, splitting: bool) -> Parts:
    """Before the first step; without room for parts where nothing is ever split."""
    most = MOST_PARTS if splitting else 0
    return Parts(
        np.ones(n_targets, dtype=np.int64),  # the epoch is as good as a gap
        np.full(n_targets, -1, dtype=np.int64),
        np.zeros(n_targets),
        np.zeros(n_targets, dtype=np.int64),
        np.zeros((n_targets, most)),
        np.zeros((n_targets, most, SIZE)),
        np.zeros((n_targets, most, SIZE, SIZE)),
        np.zeros((n_targets, most, SIZE, 2 * SIZE + 1)),
    )


@allocating
def split_weights():
    """Weights of the parts `split` makes."""
    return np.array([1.0 - 2.0 * SPLIT_WEIGHT, SPLIT_WEIGHT, SPLIT_WEIGHT])


@borrowing
def split(mean, root, axis, means, narrow):
    """Split a Gaussian along a column of its root: three means (3, 6) and their root (6, 6)."""
    length = SPLIT_NODE * np.sqrt(1.0 - SPLIT_VARIANCE)
    put(narrow, root)
    for c in range(SIZE):
        means[0, c] = mean[c]
        means[1, c] = mean[c] + length * root[c, axis]
        means[2, c] = mean[c] - length * root[c, axis]
        narrow[c, axis] = np.sqrt(SPLIT_VARIANCE) * root[c, axis]


@borrowing
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


@borrowing
def definite_root(covariance):
    """Replace a covariance by its Cholesky factor; false if rounding has spoilt it."""
    for c in range(SIZE):
        covariance[c, c] *= 1.0 + 1e-12
    return cholesky(covariance)


@borrowing
def carry_points(points, j, first, last, scene, constants, work):
    """Carry sigma points (6, 13) of target j from one time to another."""
    stride = max(1, int(_STRIDE_S / scene.step_s))
    forces = of_state(constants.forces, j)
    for k in range(first, last, stride):
        dt = (min(k + stride, last) - k) * scene.step
        step_bundle(forces, k * scene.step, points, dt, work.slopes, work.stage)


@allocating
def merge(parts, j, k, translation, root, scene, constants, work):
    """Mean and root of a mixture's moments at time k; the share of its spread between the parts.

    -1 if they are not finite or not definite.
    """
    weights = constants.orbit_weights
    count = parts.count[j]
    mean, covariance = np.zeros(SIZE), np.zeros((SIZE, SIZE))
    each = np.empty((count, SIZE))
    for m in range(count):
        point_moments(parts.points[j, m], weights, work)
        weight = parts.weight[j, m]
        for c in range(SIZE):
            each[m, c] = work.shift[c]
            mean[c] += weight * work.shift[c]
            for d in range(c + 1):
                covariance[c, d] += weight * work.covariance[c, d]
    for m in range(count):
        for c in range(SIZE):
            each[m, c] -= mean[c]
        for c in range(SIZE):
            for d in range(c + 1):
                covariance[c, d] += parts.weight[j, m] * each[m, c] * each[m, d]
    add_orbit_noise(covariance, k - parts.since[j], scene.step, constants)
    if not np.isfinite(np.sum(mean)) or not definite_root(covariance):
        return -1.0
    translation[:], root[:, :] = mean, covariance
    between = 0.0
    for m in range(count):
        solve_lower(covariance, each[m])
        for c in range(SIZE):
            between += parts.weight[j, m] * each[m, c] ** 2
    return between


@borrowing
def moments(parts, j, translation, rows, k, scene, constants, work):
    """Moments of a mixture at time k, into mean (6,) and rows (6, n) of a root; its health.

    What the other n - 6 states have to do with the orbit is left out.
    """
    others = rows.shape[1] - SIZE
    rows[:, :others] = 0.0
    between = merge(parts, j, k, translation, rows[:, others:], scene, constants, work)
    return HEALTHY if between >= 0.0 else NOT_FINITE


@borrowing
def keep_single(parts, j, translation, rows, k, work):
    """Keep the Gaussian of target j at time k, given by rows of a root, as what may be split."""
    covariance_of(rows, work.covariance)
    if not definite_root(work.covariance):
        return False
    put(parts.mean[j, 0], translation)
    put(parts.root[j, 0], work.covariance)
    parts.weight[j, 0] = 1.0
    parts.since[j] = k
    parts.strain[j] = 0.0
    return True


@borrowing
def before_step(parts, j, translation, rows, k, work):
    """Before a single Gaussian's step from time k: keep it, if a gap has begun.

    `rows` (6, n) are those of its root.
    """
    if parts.weight.shape[1] == 0:
        return
    if parts.idle[j] == 1:
        keep_single(parts, j, translation, rows, k, work)
    parts.idle[j] += 1


@borrowing
def after_step(parts, j, translation, rows, shift, health, k, scene, constants, work):
    """After a single Gaussian's step to time k, open it if it has bent; its health.

    `shift` (6,) is that of its mean by the step's curvature. Its length in standard deviations
    stays as it is as far as the flow is linear, so that the sum of the lengths bounds that of all.
    """
    if parts.since[j] < 0:
        return health
    if health == HEALTHY:
        for c in range(SIZE):
            work.correction[c] = shift[c]
        solve_lower(rows[:, rows.shape[1] - SIZE :], work.correction)
        squared = 0.0
        for c in range(SIZE):
            squared += work.correction[c] ** 2
        parts.strain[j] += np.sqrt(squared)
        if parts.strain[j] <= _STRAIN:
            return health
    open_single(parts, j, k, scene, constants, work)
    return moments(parts, j, translation, rows, k, scene, constants, work)


@borrowing
def open_single(parts, j, k, scene, constants, work):
    """Carry the sigma points of the Gaussian that was kept to time k, as the only part."""
    spread = constants.orbit_weights.spread
    sigma_points(parts.mean[j, 0], parts.root[j, 0], spread, parts.points[j, 0])
    carry_points(parts.points[j, 0], j, parts.since[j], k, scene, constants, work)
    parts.count[j] = 1


@borrowing
def step_parts(parts, j, translation, rows, k, scene, constants, work):
    """Carry a mixture over the step from time k; its moments go into mean and rows of a root."""
    for m in range(parts.count[j]):
        carry_points(parts.points[j, m], j, k, k + 1, scene, constants, work)
    return moments(parts, j, translation, rows, k + 1, scene, constants, work)


@borrowing
def step_orbit(parts, j, translation, root, k, scene, constants, work):
    """Carry the orbit of target j over the step from time k; its health."""
    if parts.count[j] > 0:
        return step_parts(parts, j, translation, root, k, scene, constants, work)
    before_step(parts, j, translation, root, k, work)
    health = predict_translation(translation, root, j, k, scene, constants, work)
    return after_step(
        parts, j, translation, root, work.shift, health, k + 1, scene, constants, work
    )


@borrowing
def updated(parts, j):
    """Say that a single Gaussian has been updated."""
    parts.idle[j], parts.since[j], parts.strain[j] = 0, -1, 0.0
