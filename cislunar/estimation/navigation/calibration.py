"""Calibration of the errors of the observers by the angles of a target (compiled); see
`cislunar.estimation.navigation.navigated_estimator`. The recursion accompanies a filter that
assumes observers without errors, and is linear about the corrected estimate."""

import numpy as np

from cislunar.compiled import copy_into, njit, njit_alloc, njit_noalloc
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
    use_exactly,
)


@njit_noalloc
def _spread_of(sensitivity, joint, spread):
    """Covariance V P V^T (6, 6) of an orbit due to the parameters, from V (6, n) and V P (6, n)."""
    n = sensitivity.shape[1]
    for a in range(SIZE):
        for b in range(a + 1):
            total = 0.0
            for c in range(n):
                total += joint[a, c] * sensitivity[b, c]
            spread[a, b] = total
            spread[b, a] = total


@njit_noalloc
def _predicted(o, m, rows, own, sensitivity, joint, covariance, gained, n_gained, partial, moved):
    """Derivatives G = H V + J of two angles (2, n) by the parameters, into `partial`, and G P, into
    `moved` (2, n). The covariance of the parameters is P = P_c - U U^T with P_c = `covariance` and
    the first `n_gained` rows of `gained` (r, n) as U^T."""
    n = sensitivity.shape[1]
    for a in range(2):
        h0, h1, h2 = rows[1 + a, 3], rows[1 + a, 4], rows[1 + a, 5]
        for c in range(n):
            partial[a, c] = h0 * sensitivity[0, c] + h1 * sensitivity[1, c] + h2 * sensitivity[2, c]
            moved[a, c] = h0 * joint[0, c] + h1 * joint[1, c] + h2 * joint[2, c]
        for d in range(m):
            factor = own[a, d]
            if factor == 0.0:
                continue
            partial[a, m * o + d] += factor
            for c in range(n):
                moved[a, c] += factor * covariance[m * o + d, c]
        for r in range(n_gained):
            factor = 0.0
            for d in range(m):
                factor += own[a, d] * gained[r, m * o + d]
            if factor == 0.0:
                continue
            for c in range(n):
                moved[a, c] -= factor * gained[r, c]


@njit_noalloc
def _displaced(state, o, mean, observers, out):
    """State (6,) less the estimated position error of an observer, into `out`."""
    copy_into(out, state)
    for c in range(3):
        column = observers.column[c]
        if column >= 0:
            out[c] -= observers.unit[c] * mean[observers.per_observer * o + column]


@njit_noalloc
def _learn(white, moved, residual, mean, gained, change):
    """Update the mean (n,) of the parameters by a whitened residual (2,) with the derivatives
    `white` (2, n). `moved` has their product with the covariance P, whose change by the update is
    -U U^T, with U^T (2, n) into `gained` and the change of the mean into `change` (n,)."""
    n = mean.shape[0]
    t11 = t22 = 1.0
    t12 = 0.0
    for c in range(n):
        t11 += white[0, c] * moved[0, c]
        t12 += white[0, c] * moved[1, c]
        t22 += white[1, c] * moved[1, c]
    l11, l21, l22 = innovation_root(t11, t12, t22)
    e0 = residual[0] / l11
    e1 = (residual[1] - l21 * e0) / l22
    for c in range(n):
        gained[0, c] = moved[0, c] / l11
        gained[1, c] = (moved[1, c] - l21 * gained[0, c]) / l22
        change[c] = gained[0, c] * e0 + gained[1, c] * e1
        mean[c] += change[c]


@njit_noalloc
def _whiten(l11, l21, l22, values, out):
    """Product of the inverse of a lower triangular matrix and `values` (2, n), into `out`."""
    for c in range(values.shape[1]):
        out[0, c] = values[0, c] / l11
        out[1, c] = (values[1, c] - l21 * out[0, c]) / l22


@njit_alloc
def _calibrate_target(j, first, model, records, orbit, own, parameters, out, work):
    """See `calibrate`; the arrays are those of target j."""
    scene, forces, observers = model
    used, row_of, start, spread_start, mean, covariance = orbit
    shift, sensitivity, joint = own
    translation, total, whitened, residual = out
    forced = of_state(forces, j)
    offset, n = records.offset[j], parameters[0].shape[0]
    m = observers.per_observer
    own_mean = parameters[0].copy()
    spread, change = np.empty((SIZE, SIZE)), np.empty(n)
    gained, n_gained = np.empty((2 * (offset[-1] - offset[0]), n)), 0
    partial, moved, white_moved = np.empty((2, n)), np.empty((2, n)), np.empty((2, n))
    path, carried, error = np.eye(SIZE), np.empty((SIZE, n)), np.empty(2)
    beside, apparent = np.empty((SIZE, SIZE)), np.empty(SIZE)
    # estimate of the filter, then the calibrated estimate
    state, before, place = start.copy(), spread_start.copy(), start + shift
    _spread_of(sensitivity, joint, spread)
    for i in range(offset.shape[0] - 1):
        k = first + i
        if not np.isfinite(mean[i, 0]):
            translation[i:], total[i:] = np.nan, np.nan
            return
        measured = measured_at(used, offset[i], offset[i + 1])
        carry_estimates(forced, k - 1, scene, place, state, measured, path, spread, work)
        if measured:
            carry_filter(before, observers.process, work)
            copy_into(beside, before)
            carry_along(path, sensitivity, carried)
            carry_along(path, joint, carried)
            restart(path)
        for row in range(offset[i], offset[i + 1]):
            if not used[row]:
                continue
            o, value = records.observer[row], records.value[row]
            _displaced(place, o, own_mean, observers, apparent)
            linearize(apparent, value, o, k, scene, observers, work)
            rows, of_observer, gain = work.rows, work.own, work.gain
            given = sensitivity, joint, parameters[1], gained, n_gained
            _predicted(o, m, rows, of_observer, *given, partial, moved)
            for c in range(3, SIZE):
                column = observers.column[c]
                if column >= 0:
                    for a in range(2):
                        work.angles[a] -= of_observer[a, column] * own_mean[m * o + column]
            l11, l21, l22 = use_exactly(before, records.variance[row, 1:], work)
            white, absolute = whitened[row_of[row]], residual[row_of[row]]
            _whiten(l11, l21, l22, partial, white)
            _whiten(l11, l21, l22, moved, white_moved)
            error[0] = work.angles[0] / l11
            error[1] = (work.angles[1] - l21 * error[0]) / l22
            absolute[0], absolute[1] = error[0], error[1]
            for c in range(n):
                absolute[0] += white[0, c] * own_mean[c]
                absolute[1] += white[1, c] * own_mean[c]
            new = gained[n_gained : n_gained + 2]
            _learn(white, white_moved, error, own_mean, new, change)
            n_gained += 2
            for c in range(SIZE):
                place[c] += gain[c, 0] * work.angles[0] + gain[c, 1] * work.angles[1]
                along0 = along1 = 0.0
                for d in range(n):
                    sensitivity[c, d] -= gain[c, 0] * partial[0, d] + gain[c, 1] * partial[1, d]
                    place[c] += sensitivity[c, d] * change[d]
                    along0 += sensitivity[c, d] * new[0, d]
                    along1 += sensitivity[c, d] * new[1, d]
                for d in range(n):
                    joint[c, d] -= gain[c, 0] * moved[0, d] + gain[c, 1] * moved[1, d]
                    joint[c, d] -= along0 * new[0, d] + along1 * new[1, d]
            follow(state, beside, value, records.variance[row, 1:], o, k, scene, work)
        if measured:
            _spread_of(sensitivity, joint, spread)
        # the next step begins with the mean and covariance of the filter itself
        for a in range(SIZE):
            shift[a] = place[a] - state[a]
            state[a] = mean[i, a]
            place[a] = translation[i, a] = mean[i, a] + shift[a]
            for b in range(SIZE):
                before[a, b] = covariance[i, a, b]
                total[i, a, b] = covariance[i, a, b] + spread[a, b]
    carry_along(path, sensitivity, carried)
    # without the contribution of the parameters, as estimated from this target
    for a in range(SIZE):
        for c in range(n):
            shift[a] -= sensitivity[a, c] * own_mean[c]


@njit(cache=True, error_model="numpy", nogil=True)
def calibrate(targets, first, model, records, orbits, own, parameters, out):
    """Run the calibration over an interval that begins at time `first`, for a range of targets.

    Parameters
    ----------
    targets : tuple of int
        First target, and the one after the last.
    first : int
        Index of the first time of the interval.
    model : tuple
        Scene, force model and `ObserverModel`.
    records : Measurements
    orbits : tuple
        Rows that the filter has used (row,), their numbers, and the filter's mean and covariance at
        the time before the interval and at its steps.
    own : tuple of ndarray, shapes (target, 6), (target, 6, n) and (target, 6, n)
        Estimate minus that of the filter, its derivative by the parameters, and the product of the
        derivative and the covariance of the parameters; changed in place. In the end the difference
        is that for parameters of zero, and the product is not used.
    parameters : tuple of ndarray, shapes (n,) and (n, n)
        Mean and covariance of the parameters before the interval.
    out : tuple of ndarray
        Outputs: states (target, step, 6) and covariances (target, step, 6, 6), and the whitened
        derivatives (used row, 2, n) and residuals (used row, 2) of the parameters.
    """
    work = make_scratch()
    used, row_of, start, spread, mean, covariance = orbits
    shift, sensitivity, joint = own
    translation, total, whitened, residual = out
    for j in range(targets[0], targets[1]):
        orbit = used, row_of, start[j], spread[j], mean[j], covariance[j]
        found = translation[j], total[j], whitened, residual
        each = shift[j], sensitivity[j], joint[j]
        _calibrate_target(j, first, model, records, orbit, each, parameters, found, work)
