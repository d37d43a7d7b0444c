"""Update of an orbit that is a Gaussian mixture by the measured angles, compiled; see
`cislunar.estimation.kalman.gaussian_mixture`."""

from typing import NamedTuple

import numpy as np

from cislunar.compiled import copy_into, njit_alloc, njit_noalloc
from cislunar.estimation.estimator import HEALTHY
from cislunar.estimation.expected import expected_directions
from cislunar.estimation.kalman.gaussian_mixture import (
    MAX_COMPONENTS,
    carry_points,
    definite_root,
    keep_single,
    merge,
    moments,
    open_single,
    point_moments,
    split,
    split_weights,
    updated,
)
from cislunar.estimation.kalman.translation_filter import (
    ACCEPTED,
    CURVED,
    FAILED_UPDATE,
    OUTSIDE_FIELD,
    SIZE,
    is_curved,
    update_translation,
)
from cislunar.estimation.kalman.workspace import Workspace, in_field, make_workspace
from cislunar.estimation.unscented import innovation_moments, sigma_points
from cislunar.observation.sightline import wrap_angle
from cislunar.runtime import Array

_LEAST_SCORE = 10.0
"""Difference of log-likelihood to the whole mixture below which a component is dropped."""

_OVERLAP = 0.1
"""Variance between components, summed over the axes, below which they are merged."""

NO_LIMITS = (np.inf, np.inf)


class _SplitWork(NamedTuple):
    """Scratch of one target's mixture: that of its filter, and components yet to be processed."""

    filter: Workspace
    weight: Array
    score: Array
    mean: Array
    root: Array
    points: Array
    noise: Array


@njit_alloc
def make_split_work(most):
    """Scratch for mixtures of this many components, none for a filter that does not split."""
    size = 2 * most
    return _SplitWork(
        make_workspace(SIZE, 2),
        np.empty(size),
        np.empty(size),
        np.empty((size, SIZE)),
        np.empty((size, SIZE, SIZE)),
        np.empty((size, SIZE, 2 * SIZE + 1)),
        np.empty((size, SIZE, SIZE)),
    )


@njit_noalloc
def _log_likelihood(work):
    """Log-likelihood of the innovation, from the moments in the work."""
    a, b, c = work.even[0, 0], work.even[0, 1], work.even[1, 1]
    for i in range(SIZE):
        a += work.cross[i, 0] * work.cross[i, 0]
        b += work.cross[i, 0] * work.cross[i, 1]
        c += work.cross[i, 1] * work.cross[i, 1]
    determinant = a * c - b * b
    x, y = work.innovation[0], work.innovation[1]
    distance = (c * x * x - 2.0 * b * x * y + a * y * y) / determinant
    return -0.5 * (distance + np.log(determinant))


@njit_noalloc
def _observe(points, observation, constants, work):
    """Moments of the angles expected at sigma points, into the work; returns the log-likelihood. An
    observation is right ascension and declination, their variances (2,), and the position (3,) and
    axes (3, 3) of the observer."""
    right_ascension, declination, variance, observer, axes = observation
    ra0, dec0 = expected_directions(points, observer, axes, work.expected)
    out = work.expected_shift, work.cross, work.even
    innovation_moments(work.expected, variance, constants.weights, *out)
    work.innovation[0] = wrap_angle(right_ascension - ra0) - work.expected_shift[0]
    work.innovation[1] = declination - dec0 - work.expected_shift[1]
    return _log_likelihood(work)


@njit_alloc
def _with_noise(observation, points, noise):
    """An observation whose variances include the effect of the process noise (6, 6) of a component
    on the angles, at the center of its points."""
    right_ascension, declination, variance, observer, axes = observation
    seen, slope = np.zeros(3), np.zeros((2, 3))
    for a in range(3):
        for b in range(3):
            seen[a] += axes[a, b] * (points[b, 0] - observer[b])
    x, y, z = seen
    across2 = x * x + y * y
    distance2, across = across2 + z * z, np.sqrt(across2)
    for b in range(3):
        slope[0, b] = (x * axes[1, b] - y * axes[0, b]) / across2
        along = x * axes[0, b] + y * axes[1, b]
        slope[1, b] = (across2 * axes[2, b] - z * along) / (distance2 * across)
    wider = variance.copy()
    for angle in range(2):
        for b in range(3):
            for c in range(3):
                wider[angle] += slope[angle, b] * noise[b, c] * slope[angle, c]
    return right_ascension, declination, wider, observer, axes


@njit_noalloc
def _steepest(work, variance):
    """Axis along which the predicted angles have the largest second difference."""
    axis, largest = 0, -1.0
    for i in range(SIZE):
        size = 0.0
        for a in range(2):
            second = work.expected[i, a] + work.expected[SIZE + i, a]
            size += second * second / variance[a]
        if size > largest:
            axis, largest = i, size
    return axis


@njit_alloc
def _wait(stack, at, weight, mean, root, observation, constants):
    """Put a component, whose points and noise are there, onto the stack, with its score by a
    direction."""
    stack.weight[at] = weight
    copy_into(stack.mean[at], mean)
    copy_into(stack.root[at], root)
    points = stack.points[at]
    noisy = _with_noise(observation, points, stack.noise[at])
    stack.score[at] = weight + _observe(points, noisy, constants, stack.filter)


@njit_noalloc
def _leave(stack, at, last):
    """Remove a component from the stack: the last one moves to its index."""
    stack.weight[at], stack.score[at] = stack.weight[last], stack.score[last]
    copy_into(stack.mean[at], stack.mean[last])
    copy_into(stack.root[at], stack.root[last])
    copy_into(stack.points[at], stack.points[last])
    copy_into(stack.noise[at], stack.noise[last])


@njit_noalloc
def _take(mixture, j, count, points, noise, observation, constants, work):
    """Update the Gaussian of sigma points and process noise as component number `count` of target
    j; whether this was possible."""
    weights = constants.weights
    point_moments(points, weights, work)
    for c in range(SIZE):
        for d in range(c + 1):
            work.covariance[c, d] += noise[c, d]
    if not definite_root(work.covariance):
        return False
    mean, root = mixture.mean[j, count], mixture.root[j, count]
    copy_into(mean, work.shift)
    copy_into(root, work.covariance)
    return update_translation(mean, root, observation, NO_LIMITS, 0.0, weights, work) == ACCEPTED


@njit_alloc
def update_mixture(
    mixture, j, translation, root, observation, half_field, k, scene, constants, stack
):
    """Update a mixture by one direction at time k: ACCEPTED, OUTSIDE_FIELD or FAILED_UPDATE.
    `half_field` is half the observer's field of view; `translation` and `root` are the mixture's
    moments, before and after. The most likely component is processed first, so that unlikely
    components stay whole if the number of components is exhausted."""
    work, weights = stack.filter, constants.weights
    right_ascension, declination, _, observer, axes = observation
    sigma_points(translation, root, weights.spread, work.bundle)
    ra0, dec0 = expected_directions(work.bundle, observer, axes, work.expected)
    off_ra, off_dec = wrap_angle(right_ascension - ra0), declination - dec0
    if not in_field(off_ra, off_dec, dec0, half_field):
        return OUTSIDE_FIELD
    waiting, since = mixture.count[j], mixture.since[j]
    for m in range(waiting):
        stack.points[m], stack.noise[m] = mixture.points[j, m], mixture.noise[j, m]
        log_weight = np.log(mixture.weight[j, m])
        _wait(stack, m, log_weight, mixture.mean[j, m], mixture.root[j, m], observation, constants)
    best = np.max(stack.score[:waiting])
    least = best + np.log(np.sum(np.exp(stack.score[:waiting] - best))) - _LEAST_SCORE
    count, scores = 0, np.empty(MAX_COMPONENTS)
    means, narrow = np.empty((3, SIZE)), np.empty((SIZE, SIZE))
    log_weights = np.log(split_weights())
    while waiting > 0:
        at = np.argmax(stack.score[:waiting])
        score = stack.score[at]
        if not score > least:
            break
        points, noise = stack.points[at], stack.noise[at]
        noisy = _with_noise(observation, points, noise)
        _observe(points, noisy, constants, work)
        room = count + waiting + 2 <= MAX_COMPONENTS
        if room and is_curved(work.even, work.cross, noisy[2], 0.0, constants.curvature):
            split(stack.mean[at], stack.root[at], _steepest(work, noisy[2]), means, narrow)
            log_weight = stack.weight[at]
            for i in range(3):
                new = at if i == 0 else waiting + i - 1
                sigma_points(means[i], narrow, weights.spread, stack.points[new])
                stack.noise[new] = 0.0
                carried = stack.points[new], stack.noise[new]
                carry_points(*carried, j, since, k, scene, constants, work)
                weight = log_weight + log_weights[i]
                _wait(stack, new, weight, means[i], narrow, observation, constants)
            waiting += 2
            continue
        if _take(mixture, j, count, points, noise, observation, constants, work):
            scores[count] = score
            count += 1
        waiting -= 1
        _leave(stack, at, waiting)
    if count == 0:
        return FAILED_UPDATE
    _weigh(mixture, j, scores[:count], weights.spread)
    mixture.since[j], mixture.steps_since_update[j] = k, 0
    between = merge(mixture, j, translation, root, constants, work)
    if between < 0.0:
        return FAILED_UPDATE
    if between < _OVERLAP:
        mixture.count[j], mixture.since[j] = 0, -1
    return ACCEPTED


@njit_noalloc
def _weigh(mixture, j, score, spread):
    """Normalize the weights of updated components from their logarithms, and drop negligible
    ones."""
    best, count = np.max(score), 0
    for m in range(score.shape[0]):
        if score[m] < best - _LEAST_SCORE:
            continue
        mixture.weight[j, count] = np.exp(score[m] - best)
        copy_into(mixture.mean[j, count], mixture.mean[j, m])
        copy_into(mixture.root[j, count], mixture.root[j, m])
        sigma_points(
            mixture.mean[j, count], mixture.root[j, count], spread, mixture.points[j, count]
        )
        mixture.noise[j, count] = 0.0
        count += 1
    total = np.sum(mixture.weight[j, :count])
    for m in range(count):
        mixture.weight[j, m] /= total
    mixture.count[j] = count


@njit_alloc
def open_if_curved(mixture, j, translation, rows, observation, k, scene, constants, work):
    """Convert a single Gaussian into a mixture at time k if its own sigma points require a
    split."""
    if mixture.since[j] < 0 and not keep_single(mixture, j, translation, rows, k, work):
        return False
    open_single(mixture, j, k, scene, constants, work)
    points = mixture.points[j, 0]
    noisy = _with_noise(observation, points, mixture.noise[j, 0])
    _observe(points, noisy, constants, work)
    curved = is_curved(work.even, work.cross, noisy[2], 0.0, constants.curvature)
    if curved and moments(mixture, j, translation, rows, constants, work) == HEALTHY:
        return True
    mixture.count[j] = 0
    return False


@njit_noalloc
def use_direction(
    mixture, j, translation, root, observation, half_field, k, scene, constants, stack
):
    """Update target j by one direction at time k; see `update_translation` for `observation` and
    the outcomes. `half_field` is half the observer's field of view."""
    work, weights = stack.filter, constants.weights
    if mixture.count[j] == 0:
        limits, nonlinearity = (half_field, constants.curvature), mixture.nonlinearity[j]
        outcome = update_translation(
            translation, root, observation, limits, nonlinearity, weights, work
        )
        given = observation, k, scene, constants, work
        if outcome == CURVED and not open_if_curved(mixture, j, translation, root, *given):
            outcome = update_translation(
                translation, root, observation, NO_LIMITS, 0.0, weights, work
            )
        if outcome == ACCEPTED:
            updated(mixture, j)
        if outcome != CURVED:
            return outcome
    return update_mixture(
        mixture, j, translation, root, observation, half_field, k, scene, constants, stack
    )
