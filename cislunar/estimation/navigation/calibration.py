"""Calibration of the errors of the observers by the angles of a target (compiled); see
`cislunar.estimation.navigation.navigated_estimator`. The recursion accompanies a filter that
assumes observers without errors, and is linear about the corrected estimate."""

import numpy as np
from numba import njit

from cislunar.compiled import copy_into, njit_alloc, njit_noalloc
from cislunar.dynamics.forces import of_state
from cislunar.estimation.linearization import (
    SIZE,
    carry_covariance,
    follow,
    innovation_root,
    linearize,
    make_scratch,
    multiply,
    transition,
    use_exactly,
)


@njit_noalloc
def _spread_of(sensitivity, covariance, product, spread):
    """Covariance (6, 6) of an orbit due to parameters with a covariance (n, n)."""
    n = covariance.shape[0]
    for a in range(SIZE):
        for c in range(n):
            product[c] = 0.0
        for d in range(n):
            factor = sensitivity[a, d]
            for c in range(n):
                product[c] += factor * covariance[d, c]
        for b in range(a + 1):
            total = 0.0
            for c in range(n):
                total += product[c] * sensitivity[b, c]
            spread[a, b] = total
            spread[b, a] = total


@njit_noalloc
def _learn(row, residual, mean, covariance, product, change):
    """Update parameters, mean (n,) and covariance (n, n), by a whitened residual (2,) of their mean
    with the derivatives `row` (2, n); the change of the mean goes into `change` (n,)."""
    n = mean.shape[0]
    t11 = t22 = 1.0
    t12 = 0.0
    e0, e1 = residual[0], residual[1]
    for c in range(n):
        p0 = p1 = 0.0
        for d in range(n):
            p0 += covariance[c, d] * row[0, d]
            p1 += covariance[c, d] * row[1, d]
        product[0, c], product[1, c] = p0, p1
    for c in range(n):
        t11 += row[0, c] * product[0, c]
        t12 += row[0, c] * product[1, c]
        t22 += row[1, c] * product[1, c]
    l11, l21, l22 = innovation_root(t11, t12, t22)
    e0 /= l11
    e1 = (e1 - l21 * e0) / l22
    for c in range(n):
        product[0, c] /= l11
        product[1, c] = (product[1, c] - l21 * product[0, c]) / l22
        change[c] = product[0, c] * e0 + product[1, c] * e1
        mean[c] += change[c]
    for c in range(n):
        for d in range(n):
            covariance[c, d] -= product[0, c] * product[0, d] + product[1, c] * product[1, d]


@njit_alloc
def _calibrate_target(j, first, model, records, orbit, own, parameters, out, work):
    """See `calibrate`; the arrays are those of target j."""
    scene, forces, observers = model
    used, row_of, start, spread_start, mean, covariance = orbit
    shift, sensitivity = own
    translation, total, whitened, residual = out
    forced = of_state(forces, j)
    offset, n = records.offset[j], parameters[0].shape[0]
    m = observers.per_observer
    own_mean, own_covariance = parameters[0].copy(), parameters[1].copy()
    spread, change = np.empty((SIZE, SIZE)), np.empty(n)
    product, carried, partial = np.empty((2, n)), np.empty((SIZE, n)), np.empty((2, n))
    path, moved, error = np.eye(SIZE), np.empty((SIZE, SIZE)), np.empty(2)
    beside = np.empty((SIZE, SIZE))
    # estimate of the filter, then the calibrated estimate
    state, before, place = start.copy(), spread_start.copy(), start + shift
    _spread_of(sensitivity, own_covariance, product[0], spread)
    for i in range(offset.shape[0] - 1):
        k = first + i
        if not np.isfinite(mean[i, 0]):
            translation[i:], total[i:] = np.nan, np.nan
            return
        transition(forced, k - 1, 1, scene, place, state, work)
        phi = work.phi
        multiply(phi, path, moved)
        copy_into(path, moved)
        copy_into(place, work.mean)
        copy_into(state, work.beside)
        carry_covariance(phi, spread, work.square)
        any_used = False
        for row in range(offset[i], offset[i + 1]):
            if not used[row]:
                continue
            if not any_used:
                any_used = True
                carry_covariance(phi, before, work.square)
                before += observers.process
                copy_into(beside, before)
                multiply(path, sensitivity, carried)
                copy_into(sensitivity, carried)
                path[:, :] = 0.0
                for c in range(SIZE):
                    path[c, c] = 1.0
            o, value = records.observer[row], records.value[row]
            linearize(place, value, o, k, scene, observers, work)
            rows, of_observer, gain = work.rows, work.own, work.gain
            for a in range(2):
                for c in range(n):
                    partial[a, c] = (
                        rows[1 + a, 3] * sensitivity[0, c]
                        + rows[1 + a, 4] * sensitivity[1, c]
                        + rows[1 + a, 5] * sensitivity[2, c]
                    )
                for c in range(m):
                    partial[a, m * o + c] += of_observer[a, c]
                    work.angles[a] -= of_observer[a, c] * own_mean[m * o + c]
            l11, l21, l22 = use_exactly(before, records.variance[row, 1:], work)
            white, absolute = whitened[row_of[row]], residual[row_of[row]]
            for c in range(n):
                white[0, c] = partial[0, c] / l11
                white[1, c] = (partial[1, c] - l21 * white[0, c]) / l22
            error[0] = work.angles[0] / l11
            error[1] = (work.angles[1] - l21 * error[0]) / l22
            absolute[0], absolute[1] = error[0], error[1]
            for c in range(n):
                absolute[0] += white[0, c] * own_mean[c]
                absolute[1] += white[1, c] * own_mean[c]
            _learn(white, error, own_mean, own_covariance, product, change)
            for c in range(SIZE):
                place[c] += gain[c, 0] * work.angles[0] + gain[c, 1] * work.angles[1]
                for d in range(n):
                    sensitivity[c, d] -= gain[c, 0] * partial[0, d] + gain[c, 1] * partial[1, d]
                    place[c] += sensitivity[c, d] * change[d]
            follow(state, beside, value, records.variance[row, 1:], o, k, scene, work)
        if any_used:
            _spread_of(sensitivity, own_covariance, product[0], spread)
        # the next step begins with the mean and covariance of the filter itself
        for a in range(SIZE):
            shift[a] = place[a] - state[a]
            state[a] = mean[i, a]
            place[a] = translation[i, a] = mean[i, a] + shift[a]
            for b in range(SIZE):
                before[a, b] = covariance[i, a, b]
                total[i, a, b] = covariance[i, a, b] + spread[a, b]
    multiply(path, sensitivity, carried)
    copy_into(sensitivity, carried)
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
    own : tuple of ndarray, shapes (target, 6) and (target, 6, n)
        Estimate minus that of the filter, and its derivative by the parameters; changed in place.
        In the end the difference is that for parameters of zero.
    parameters : tuple of ndarray, shapes (n,) and (n, n)
        Mean and covariance of the parameters before the interval.
    out : tuple of ndarray
        Outputs: states (target, step, 6) and covariances (target, step, 6, 6), and the whitened
        derivatives (used row, 2, n) and residuals (used row, 2) of the parameters.
    """
    work = make_scratch()
    used, row_of, start, spread, mean, covariance = orbits
    shift, sensitivity = own
    translation, total, whitened, residual = out
    for j in range(targets[0], targets[1]):
        orbit = used, row_of, start[j], spread[j], mean[j], covariance[j]
        found = translation[j], total[j], whitened, residual
        each = shift[j], sensitivity[j]
        _calibrate_target(j, first, model, records, orbit, each, parameters, found, work)
