"""Schmidt-Kalman filter of a target whose observers have errors (compiled); see
`cislunar.estimation.navigation.navigated_estimator`. The recursion accompanies a filter that
assumes observers without errors, and is linear about the corrected estimate."""

import numpy as np

from cislunar.compiled import njit, njit_alloc, njit_noalloc
from cislunar.dynamics.forces import of_state
from cislunar.estimation.linearization import (
    SIZE,
    carry_along,
    carry_estimates,
    carry_filter,
    follow,
    innovation_root,
    linearize,
    make_scratch,
    measured_at,
    restart,
)


@njit_noalloc
def _consider(state, covariance, cross, parameter_variance, variance, o, observers, work, gain):
    """Schmidt-Kalman update (Schmidt 1966) of a state by two angles with the rows in `work`.
    `cross` (6, n) is the covariance with the parameters, whose own variances (n,) do not change."""
    rows, own, m = work.rows, work.own, observers.per_observer
    s11, s12, s22 = variance[0], 0.0, variance[1]
    for c in range(SIZE):
        for a in range(2):
            total = 0.0
            for d in range(3):
                total += covariance[c, d] * rows[1 + a, 3 + d]
            for d in range(m):
                total += cross[c, m * o + d] * own[a, d]
            gain[c, a] = total  # P H^T + C J^T
    for d in range(3):
        s11 += rows[1, 3 + d] * gain[d, 0]
        s12 += rows[1, 3 + d] * gain[d, 1]
        s22 += rows[2, 3 + d] * gain[d, 1]
    for d in range(m):
        b0 = parameter_variance[m * o + d] * own[0, d]
        b1 = parameter_variance[m * o + d] * own[1, d]
        for c in range(3):
            b0 += cross[c, m * o + d] * rows[1, 3 + c]
            b1 += cross[c, m * o + d] * rows[2, 3 + c]
        s11 += own[0, d] * b0
        s12 += own[0, d] * b1
        s22 += own[1, d] * b1
    l11, l21, l22 = innovation_root(s11, s12, s22)
    for c in range(SIZE):
        gain[c, 0] /= l11
        gain[c, 1] = (gain[c, 1] - l21 * gain[c, 0]) / l22
    e0 = work.angles[0] / l11
    e1 = (work.angles[1] - l21 * e0) / l22
    for c in range(SIZE):
        state[c] += gain[c, 0] * e0 + gain[c, 1] * e1
        for d in range(SIZE):
            covariance[c, d] -= gain[c, 0] * gain[d, 0] + gain[c, 1] * gain[d, 1]
    for d in range(cross.shape[1]):
        b0 = b1 = 0.0
        for c in range(3):
            b0 += cross[c, d] * rows[1, 3 + c]
            b1 += cross[c, d] * rows[2, 3 + c]
        if m * o <= d < m * o + m:
            b0 += parameter_variance[d] * own[0, d - m * o]
            b1 += parameter_variance[d] * own[1, d - m * o]
        b0 /= l11
        b1 = (b1 - l21 * b0) / l22
        for c in range(SIZE):
            cross[c, d] -= gain[c, 0] * b0 + gain[c, 1] * b1


@njit_alloc
def _consider_target(j, first, model, records, orbit, own, parameter_variance, out, work):
    """See `consider`; the arrays are those of target j."""
    scene, forces, observers = model
    used, start, spread_start, mean, covariance = orbit
    shift, excess, cross = own
    translation, total = out
    forced = of_state(forces, j)
    offset = records.offset[j]
    path, carried = np.eye(SIZE), np.empty(cross.shape)
    gain, whole = np.empty((SIZE, 2)), np.empty((SIZE, SIZE))
    # estimate of the filter, then the one with considered errors
    state, before, place = start.copy(), spread_start.copy(), start + shift
    for i in range(offset.shape[0] - 1):
        k = first + i
        if not np.isfinite(mean[i, 0]):
            translation[i:], total[i:] = np.nan, np.nan
            return
        measured = measured_at(used, offset[i], offset[i + 1])
        carry_estimates(forced, k - 1, scene, place, state, measured, path, excess, work)
        if measured:
            carry_filter(before, observers.process, work)
            carry_along(path, cross, carried)
            restart(path)
            for c in range(SIZE):
                for d in range(SIZE):
                    whole[c, d] = before[c, d] + excess[c, d]
        for row in range(offset[i], offset[i + 1]):
            if not used[row]:
                continue
            o, value = records.observer[row], records.value[row]
            variance = records.variance[row, 1:]
            linearize(place, value, o, k, scene, observers, work)
            _consider(place, whole, cross, parameter_variance, variance, o, observers, work, gain)
            follow(state, before, value, variance, o, k, scene, work)
        for a in range(SIZE):
            shift[a] = place[a] - state[a]
            for b in range(SIZE):
                if measured:
                    excess[a, b] = whole[a, b] - before[a, b]
        # the next step begins with the mean and covariance of the filter itself
        for a in range(SIZE):
            state[a] = mean[i, a]
            place[a] = translation[i, a] = mean[i, a] + shift[a]
            for b in range(SIZE):
                before[a, b] = covariance[i, a, b]
                total[i, a, b] = covariance[i, a, b] + excess[a, b]
    carry_along(path, cross, carried)


@njit(cache=True, error_model="numpy", nogil=True)
def consider(targets, first, model, records, orbits, own, parameter_variance, out):
    """Run the Schmidt-Kalman filter over an interval that begins at time `first`, for a range of
    targets.

    `model` and `orbits` are as in `calibrate`, without the numbers of rows. `own`, changed in
    place: the state minus the mean of the filter (target, 6), the covariance minus that of the
    filter (target, 6, 6), and the covariance with the parameters (target, 6, n), whose variances
    are `parameter_variance` (n,). Outputs `out`: states (target, step, 6) and covariances.
    """
    work = make_scratch()
    used, start, spread, mean, covariance = orbits
    shift, excess, cross = own
    translation, total = out
    for j in range(targets[0], targets[1]):
        orbit = used, start[j], spread[j], mean[j], covariance[j]
        each = shift[j], excess[j], cross[j]
        given = parameter_variance, (translation[j], total[j]), work
        _consider_target(j, first, model, records, orbit, each, *given)
