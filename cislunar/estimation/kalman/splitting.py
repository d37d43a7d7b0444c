"""Update of an orbit that is a mixture of Gaussians by the direction of a look, compiled.

See `cislunar.estimation.kalman.parts`.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.compiled import allocating, borrowing, put
from cislunar.estimation.estimator import HEALTHY
from cislunar.estimation.expected import expected_directions
from cislunar.estimation.kalman.parts import (
    MOST_PARTS,
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
from cislunar.estimation.kalman.workspace import (
    Workspace,
    add_orbit_noise,
    in_field,
    make_workspace,
    noise_of_gap,
)
from cislunar.estimation.unscented import innovation_moments, sigma_points
from cislunar.observation.sightline import direction_angles, wrap_angle

Array = NDArray[np.float64]

_LEAST_SCORE = 10.0
"""A part this much less likely than the whole, by its logarithm, is given up."""

_OVERLAP = 0.1
"""Share of the spread between parts, summed over the axes, below which they are merged."""

NO_LIMITS = (np.inf, np.inf)


class SplitWork(NamedTuple):
    """Scratch of one target's mixture: that of its filter, and parts still to be looked at."""

    filter: Workspace
    weight: Array
    score: Array
    mean: Array
    root: Array
    points: Array


@allocating
def make_split_work(most):
    """Scratch for mixtures of so many parts, none for a filter that does not split."""
    size = 2 * most
    return SplitWork(
        make_workspace(SIZE, 2),
        np.empty(size),
        np.empty(size),
        np.empty((size, SIZE)),
        np.empty((size, SIZE, SIZE)),
        np.empty((size, SIZE, 2 * SIZE + 1)),
    )


@borrowing
def _log_likelihood(work):
    """Of the innovation, from the moments in the work."""
    a, b, c = work.even[0, 0], work.even[0, 1], work.even[1, 1]
    for i in range(SIZE):
        a += work.cross[i, 0] * work.cross[i, 0]
        b += work.cross[i, 0] * work.cross[i, 1]
        c += work.cross[i, 1] * work.cross[i, 1]
    determinant = a * c - b * b
    x, y = work.innovation[0], work.innovation[1]
    distance = (c * x * x - 2.0 * b * x * y + a * y * y) / determinant
    return -0.5 * (distance + np.log(determinant))


@borrowing
def _look(points, look, constants, work):
    """Moments of the angles expected at sigma points, into the work; the log likelihood.

    A look is right ascension and declination, their variances (2,), and the place (3,) and axes
    (3, 3) of the observer, of whose field of view `half_field` is half.
    """
    right_ascension, declination, variance, observer, axes = look
    ra0, dec0 = expected_directions(points, observer, axes, work.expected)
    innovation_moments(
        work.expected,
        variance,
        constants.orbit_weights,
        work.expected_shift,
        work.cross,
        work.even,
    )
    work.innovation[0] = wrap_angle(right_ascension - ra0) - work.expected_shift[0]
    work.innovation[1] = declination - dec0 - work.expected_shift[1]
    return _log_likelihood(work)


@allocating
def _with_noise(look, place, n_steps, scene, constants):
    """A look whose variances hold what process noise of a gap does to the angles of a place."""
    right_ascension, declination, variance, observer, axes = look
    dx, dy, dz = place[0] - observer[0], place[1] - observer[1], place[2] - observer[2]
    distance2 = dx * dx + dy * dy + dz * dz
    across2 = distance2 * np.cos(direction_angles(dx, dy, dz, axes)[1]) ** 2
    position = noise_of_gap(n_steps, scene.step, constants)[0]
    wider = variance.copy()
    wider[0] += position / across2
    wider[1] += position / distance2
    return right_ascension, declination, wider, observer, axes


@borrowing
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


@borrowing
def _wait(stack, at, weight, mean, root, look, constants):
    """Let a part wait at a place of the stack, its points there, with its score by a direction."""
    stack.weight[at] = weight
    put(stack.mean[at], mean)
    put(stack.root[at], root)
    stack.score[at] = weight + _look(stack.points[at], look, constants, stack.filter)


@borrowing
def _leave(stack, at, last):
    """Take a part off the stack: the last one moves to its place."""
    stack.weight[at], stack.score[at] = stack.weight[last], stack.score[last]
    put(stack.mean[at], stack.mean[last])
    put(stack.root[at], stack.root[last])
    put(stack.points[at], stack.points[last])


@borrowing
def _take(parts, j, count, points, look, n_steps, scene, constants, work):
    """Update the Gaussian of sigma points as part number `count` of target j; whether it could.

    They are those of a Gaussian so many steps before, whose noise is added.
    """
    weights = constants.orbit_weights
    point_moments(points, weights, work)
    add_orbit_noise(work.covariance, n_steps, scene.step, constants)
    if not definite_root(work.covariance):
        return False
    mean, root = parts.mean[j, count], parts.root[j, count]
    put(mean, work.shift)
    put(root, work.covariance)
    return update_translation(mean, root, *look, NO_LIMITS, 0.0, weights, work) == ACCEPTED


@allocating
def update_parts(parts, j, translation, root, look, half_field, k, scene, constants, stack):
    """Use one direction of a mixture at time k: ACCEPTED, OUTSIDE_FIELD or FAILED_UPDATE.

    `half_field` is half the observer's field of view, `translation` and `root` are those of the
    mixture's moments, before and after. The most likely part comes first, so that it is the
    unlikely ones that stay whole where there is no more room.
    """
    work, weights = stack.filter, constants.orbit_weights
    right_ascension, declination, _, observer, axes = look
    sigma_points(translation, root, weights.spread, work.bundle)
    ra0, dec0 = expected_directions(work.bundle, observer, axes, work.expected)
    off_ra, off_dec = wrap_angle(right_ascension - ra0), declination - dec0
    if not in_field(off_ra, off_dec, dec0, half_field):
        return OUTSIDE_FIELD
    waiting, since = parts.count[j], parts.since[j]
    noisy = _with_noise(look, translation, k - since, scene, constants)
    for m in range(waiting):
        stack.points[m] = parts.points[j, m]
        log_weight = np.log(parts.weight[j, m])
        _wait(stack, m, log_weight, parts.mean[j, m], parts.root[j, m], noisy, constants)
    best = np.max(stack.score[:waiting])
    least = best + np.log(np.sum(np.exp(stack.score[:waiting] - best))) - _LEAST_SCORE
    count, scores = 0, np.empty(MOST_PARTS)
    means, narrow, log_weights = (
        np.empty((3, SIZE)),
        np.empty((SIZE, SIZE)),
        np.log(split_weights()),
    )
    while waiting > 0:
        at = np.argmax(stack.score[:waiting])
        score = stack.score[at]
        if not score > least:
            break
        points = stack.points[at]
        _look(points, noisy, constants, work)
        room = count + waiting + 2 <= MOST_PARTS
        if room and is_curved(work.even, work.cross, noisy[2], 0.0, constants.curvature):
            split(stack.mean[at], stack.root[at], _steepest(work, noisy[2]), means, narrow)
            log_weight = stack.weight[at]
            for i in range(3):
                new = at if i == 0 else waiting + i - 1
                sigma_points(means[i], narrow, weights.spread, stack.points[new])
                carry_points(stack.points[new], j, since, k, scene, constants, work)
                weight = log_weight + log_weights[i]
                _wait(stack, new, weight, means[i], narrow, noisy, constants)
            waiting += 2
            continue
        if _take(parts, j, count, points, look, k - since, scene, constants, work):
            scores[count] = score
            count += 1
        waiting -= 1
        _leave(stack, at, waiting)
    if count == 0:
        return FAILED_UPDATE
    _weigh(parts, j, scores[:count], weights.spread)
    parts.since[j], parts.idle[j] = k, 0
    between = merge(parts, j, k, translation, root, scene, constants, work)
    if between < 0.0:
        return FAILED_UPDATE
    if between < _OVERLAP:
        parts.count[j], parts.since[j] = 0, -1
    return ACCEPTED


@borrowing
def _weigh(parts, j, score, spread):
    """Weights of updated parts from the logarithms; those that count for nothing are left out."""
    best, count = np.max(score), 0
    for m in range(score.shape[0]):
        if score[m] < best - _LEAST_SCORE:
            continue
        parts.weight[j, count] = np.exp(score[m] - best)
        put(parts.mean[j, count], parts.mean[j, m])
        put(parts.root[j, count], parts.root[j, m])
        sigma_points(parts.mean[j, count], parts.root[j, count], spread, parts.points[j, count])
        count += 1
    total = np.sum(parts.weight[j, :count])
    for m in range(count):
        parts.weight[j, m] /= total
    parts.count[j] = count


@allocating
def open_if_curved(parts, j, translation, rows, look, k, scene, constants, work):
    """Open a single Gaussian at time k, if its own sigma points say that it has to be split."""
    if parts.since[j] < 0 and not keep_single(parts, j, translation, rows, k, work):
        return False
    noisy = _with_noise(look, translation, k - parts.since[j], scene, constants)
    open_single(parts, j, k, scene, constants, work)
    _look(parts.points[j, 0], noisy, constants, work)
    curved = is_curved(work.even, work.cross, noisy[2], 0.0, constants.curvature)
    given = k, scene, constants, work
    if curved and moments(parts, j, translation, rows, *given) == HEALTHY:
        return True
    parts.count[j] = 0
    return False


@borrowing
def use_direction(parts, j, translation, root, look, half_field, k, scene, constants, stack):
    """Use one direction of target j at time k; its outcome, as of `update_translation`.

    A look is right ascension and declination, their variances (2,), and the place (3,) and axes
    (3, 3) of the observer, of whose field of view `half_field` is half.
    """
    work, weights = stack.filter, constants.orbit_weights
    if parts.count[j] == 0:
        limits, strain = (half_field, constants.curvature), parts.strain[j]
        outcome = update_translation(translation, root, *look, limits, strain, weights, work)
        given = look, k, scene, constants, work
        if outcome == CURVED and not open_if_curved(parts, j, translation, root, *given):
            outcome = update_translation(translation, root, *look, NO_LIMITS, 0.0, weights, work)
        if outcome == ACCEPTED:
            updated(parts, j)
        if outcome != CURVED:
            return outcome
    return update_parts(parts, j, translation, root, look, half_field, k, scene, constants, stack)
