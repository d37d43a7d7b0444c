"""Compiled calibration: what the angles of a target tell of the errors of its observers; see
`cislunar.estimation.navigation.navigated`. The recursion runs beside a filter that takes its
observers for exact, and is linear about its estimates."""

import numpy as np
from numba import njit

from cislunar.compiled import copy_into, njit_alloc, njit_noalloc
from cislunar.dynamics.forces import of_state
from cislunar.estimation.navigation.linearization import (
    SIZE,
    carry_covariance,
    carry_vector,
    innovation_root,
    linearize,
    make_scratch,
    multiply,
    transition,
    use_exactly,
)


@njit_noalloc
def _moments_of(sensitivity, mean, covariance, product, shift, spread):
    """Shift (6,) and covariance (6, 6) of an orbit due to parameters with this mean (n,) and
    covariance (n, n); the last column of the sensitivity belongs to a constant one."""
    n = mean.shape[0]
    for a in range(SIZE):
        total = sensitivity[a, n]
        for c in range(n):
            total += sensitivity[a, c] * mean[c]
        shift[a] = total
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
def _learn(row, residual, mean, covariance, product, work):
    """Update parameters, mean (n,) and covariance (n, n), by a whitened residual (2,) with the
    derivatives `row` (2, n)."""
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
        e0 -= row[0, c] * mean[c]
        e1 -= row[1, c] * mean[c]
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
        mean[c] += product[0, c] * e0 + product[1, c] * e1
    for c in range(n):
        for d in range(n):
            covariance[c, d] -= product[0, c] * product[0, d] + product[1, c] * product[1, d]


@njit_alloc
def _calibrate_target(j, first, model, records, orbit, sensitivity, parameters, out, work):
    """See `calibrate`; the arrays are those of target j."""
    scene, forces, observers = model
    used, row_of, start, spread_start, mean, covariance = orbit
    translation, total, whitened, residual = out
    forced = of_state(forces, j)
    offset, n = records.offset[j], parameters[0].shape[0]
    n_steps, m = offset.shape[0] - 1, observers.per_observer
    own_mean, own_covariance = parameters[0].copy(), parameters[1].copy()
    shift, spread = np.empty(SIZE), np.empty((SIZE, SIZE))
    product, carried = np.empty((2, n)), np.empty((SIZE, n + 1))
    path, moved = np.eye(SIZE), np.empty((SIZE, SIZE))
    state, before = start.copy(), spread_start.copy()
    partial = np.empty((2, n + 1))
    _moments_of(sensitivity, own_mean, own_covariance, product[0], shift, spread)
    for i in range(n_steps):
        k = first + i
        if not np.isfinite(mean[i, 0]):
            translation[i:], total[i:] = np.nan, np.nan
            return
        transition(forced, k - 1, scene, state, work)
        phi = work.phi
        multiply(phi, path, moved)
        copy_into(path, moved)
        carry_vector(phi, shift)
        carry_covariance(phi, spread, work.square)
        any_used = False
        for row in range(offset[i], offset[i + 1]):
            if not used[row]:
                continue
            if not any_used:
                any_used = True
                carry_covariance(phi, before, work.square)
                before += observers.process
                copy_into(state, work.mean)
                multiply(path, sensitivity, carried)
                copy_into(sensitivity, carried)
                path[:, :] = 0.0
                for c in range(SIZE):
                    path[c, c] = 1.0
            o = records.observer[row]
            linearize(state, records.value[row], o, k, scene, observers, work)
            rows, own, gain = work.rows, work.own, work.gain
            for a in range(2):
                for c in range(n + 1):
                    partial[a, c] = (
                        rows[1 + a, 3] * sensitivity[0, c]
                        + rows[1 + a, 4] * sensitivity[1, c]
                        + rows[1 + a, 5] * sensitivity[2, c]
                    )
                for c in range(m):
                    partial[a, m * o + c] += own[a, c]
            l11, l21, l22 = use_exactly(before, records.variance[row, 1:], work)
            for c in range(SIZE):
                state[c] += gain[c, 0] * work.angles[0] + gain[c, 1] * work.angles[1]
                for d in range(n + 1):
                    sensitivity[c, d] -= gain[c, 0] * partial[0, d] + gain[c, 1] * partial[1, d]
            white, error = whitened[row_of[row]], residual[row_of[row]]
            for c in range(n):
                white[0, c] = partial[0, c] / l11
                white[1, c] = (partial[1, c] - l21 * white[0, c]) / l22
            error[0] = (work.angles[0] - partial[0, n]) / l11
            error[1] = (work.angles[1] - partial[1, n] - l21 * error[0]) / l22
            _learn(white, error, own_mean, own_covariance, product, work)
        if any_used:
            _moments_of(sensitivity, own_mean, own_covariance, product[0], shift, spread)
        # the filter itself decides on mean and covariance, from which the next step begins
        copy_into(state, mean[i])
        copy_into(before, covariance[i])
        for a in range(SIZE):
            translation[i, a] = mean[i, a] + shift[a]
            for b in range(SIZE):
                total[i, a, b] = covariance[i, a, b] + spread[a, b]
    multiply(path, sensitivity, carried)
    copy_into(sensitivity, carried)


@njit(cache=True, error_model="numpy", nogil=True)
def calibrate(targets, first, model, records, orbits, sensitivity, parameters, out):
    """Run the calibration over an interval that begins at time `first`, for a range of targets.

    `model` are scene, force model and `ObserverModel`; `orbits` the rows that the filter has used
    (row,), their numbers, and the filter's mean and covariance at the time before the interval and
    at its steps. `sensitivity` (target, 6, n + 1) is the derivative of the true state by the
    parameters, given the filter's, whose last column belongs to a constant; it is changed in place.
    `parameters` are their mean (n,) and covariance (n, n) before the interval. Outputs `out`:
    states (target, step, 6) and covariances, and the whitened derivatives (used row, 2, n) and
    residuals (used row, 2) of the parameters.
    """
    work = make_scratch()
    used, row_of, start, spread, mean, covariance = orbits
    translation, total, whitened, residual = out
    for j in range(targets[0], targets[1]):
        orbit = used, row_of, start[j], spread[j], mean[j], covariance[j]
        own = translation[j], total[j], whitened, residual
        _calibrate_target(j, first, model, records, orbit, sensitivity[j], parameters, own, work)
