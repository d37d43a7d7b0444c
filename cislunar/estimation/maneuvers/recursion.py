"""Compiled recursion of the likelihood ratio test for an impulse at an unknown time; see
`cislunar.estimation.maneuvers.likelihood_ratio`."""

import numpy as np

from cislunar.compiled import copy_into, njit, njit_alloc, njit_noalloc
from cislunar.dynamics.forces import of_state
from cislunar.estimation.linearization import (
    SIZE,
    calm_transition,
    carry_covariance,
    follow,
    make_scratch,
    measured_at,
    multiply,
    transition,
)


@njit_noalloc
def _carry(path, moved, sensitivity, product):
    """Apply the transition matrix `path` to the sensitivities (hypothesis, 6, 3), and reset it."""
    for h in range(sensitivity.shape[0]):
        multiply(path, sensitivity[h], product)
        copy_into(sensitivity[h], product)
    path[:, :] = 0.0
    for c in range(SIZE):
        path[c, c] = 1.0


@njit_noalloc
def _accumulate(root, known, own, whitened, work):
    """Add two angles to the information on the impulses, and update the sensitivities. Without a
    known innovation (`known` = 0) it counts as zero. The whitened derivatives of the innovation go
    into `whitened` (hypothesis, 2, 3). Returns the normalized innovation squared."""
    l11, l21, l22 = root
    rows, gain = work.rows, work.gain
    sensitivity, gradient, information = own
    e0 = known * work.angles[0] / l11
    e1 = (known * work.angles[1] - l21 * e0) / l22
    for h in range(sensitivity.shape[0]):
        d, c, w = sensitivity[h], information[h], whitened[h]
        for a in range(3):
            g0 = rows[1, 3] * d[0, a] + rows[1, 4] * d[1, a] + rows[1, 5] * d[2, a]
            g1 = rows[2, 3] * d[0, a] + rows[2, 4] * d[1, a] + rows[2, 5] * d[2, a]
            w[0, a] = g0 / l11
            w[1, a] = (g1 - l21 * w[0, a]) / l22
            gradient[h, a] += w[0, a] * e0 + w[1, a] * e1
            for i in range(SIZE):
                d[i, a] -= gain[i, 0] * g0 + gain[i, 1] * g1
        for a in range(3):
            for b in range(3):
                c[a, b] += w[0, a] * w[0, b] + w[1, a] * w[1, b]
    return e0 * e0 + e1 * e1


@njit_noalloc
def statistic(gradient, information, prior, root, impulse):
    """Statistic d^T (C + prior I)^-1 d of an impulse, whose estimate goes into `impulse` (3,), and
    the Cholesky factor of the matrix into `root` (3, 3)."""
    for a in range(3):
        for b in range(a + 1):
            total = information[a, b]
            if a == b:
                total += prior
            for c in range(b):
                total -= root[a, c] * root[b, c]
            if a == b:
                root[a, a] = np.sqrt(total)
            else:
                root[a, b] = total / root[b, b]
    found = 0.0
    for a in range(3):
        total = gradient[a]
        for c in range(a):
            total -= root[a, c] * impulse[c]
        impulse[a] = total / root[a, a]
        found += impulse[a] * impulse[a]
    for a in range(2, -1, -1):
        total = impulse[a]
        for c in range(a + 1, 3):
            total -= root[c, a] * impulse[c]
        impulse[a] = total / root[a, a]
    return found


@njit_noalloc
def _test(k, number, settings, gradient, information, root, impulse, best):
    """Keep the largest statistic of the hypotheses after observation `number` at time k."""
    spacing, prior = settings
    value, at, change, matrix = best
    count, base = gradient.shape[0], (k - 1) // spacing
    for h in range(count):
        found = statistic(gradient[h], information[h], prior, root, impulse)
        if found > value[0]:
            value[0] = found
            at[0], at[1], at[2] = (base - (base - h) % count) * spacing, k, number
            copy_into(change, impulse)
            copy_into(matrix, information[h])


@njit_alloc
def _scan_target(j, first, model, records, orbit, own, settings, planned, out, work):
    """See `scan`; the arrays are those of target j."""
    scene, forces, process = model
    used, start, spread, mean, covariance = orbit
    sensitivity, gradient, information = own
    squared, whitened, best = out
    forced, offset = of_state(forces, j), records.offset[j]
    spacing = settings[0]
    path, moved, product = np.eye(SIZE), np.empty((SIZE, SIZE)), np.empty((SIZE, 3))
    root, impulse = np.zeros((3, 3)), np.empty(3)
    state, before = start.copy(), spread.copy()
    for i in range(offset.shape[0] - 1):
        k = first + i
        if not planned and not np.isfinite(mean[i, 0]):
            return
        # without an observation the mean at the end of the step is that of the filter
        needed = planned or measured_at(used, offset[i], offset[i + 1])
        if needed or not calm_transition(forced, k - 1, scene, state, work.phi):
            transition(forced, k - 1, 1, scene, state, state, work)
            copy_into(state, work.mean)
        multiply(work.phi, path, moved)
        copy_into(path, moved)
        any_used = False
        if planned:
            carry_covariance(work.phi, before, work.square)
            before += process
        for row in range(offset[i], offset[i + 1]):
            if not used[row]:
                continue
            if not any_used:
                any_used = True
                _carry(path, moved, sensitivity, product)
                if not planned:
                    carry_covariance(work.phi, before, work.square)
                    before += process
            o, value, variance = (
                records.observer[row],
                records.value[row],
                records.variance[row, 1:],
            )
            if planned:
                # the covariance alone: there is no measurement yet
                copy_into(mean[i], state)
                found = follow(state, before, value, variance, o, k, scene, work)
                copy_into(state, mean[i])
                _accumulate(found, 0.0, own, whitened[row], work)
            else:
                found = follow(state, before, value, variance, o, k, scene, work)
                squared[row] = _accumulate(found, 1.0, own, whitened[0], work)
                _test(k, row, settings, gradient, information, root, impulse, best)
        if k % spacing == 0:
            _carry(path, moved, sensitivity, product)
            h = (k // spacing) % gradient.shape[0]
            sensitivity[h], gradient[h], information[h] = 0.0, 0.0, 0.0
            for c in range(3):
                sensitivity[h, 3 + c, c] = 1.0
        if planned:
            copy_into(mean[i], state)
            copy_into(covariance[i], before)
        else:
            # the filter itself decides on mean and covariance, from which the next step begins
            copy_into(state, mean[i])
            copy_into(before, covariance[i])
    _carry(path, moved, sensitivity, product)


@njit(cache=True, error_model="numpy", nogil=True)
def scan(targets, first, model, records, orbits, own, settings, planned, out):
    """Run the tests over an interval that begins at time `first`, for a range of targets.

    `model` are scene, force model and process noise (6, 6) of a step; `orbits` the rows that the
    filter has used (row,), and the filter's mean and covariance at the time before the interval and
    at its steps. `own`, changed in place: the derivatives of the error of the estimate by the
    impulses (target, hypothesis, 6, 3), d (target, hypothesis, 3) and C (target, hypothesis, 3, 3).
    `settings`: steps between the hypothesized times, and prior information on an impulse.

    Outputs `out`: normalized innovations squared (row,); whitened derivatives, see `_accumulate`,
    (row, hypothesis, 2, 3) with `planned`, otherwise scratch (1, hypothesis, 2, 3); and of the
    largest statistic of each target its value (target, 1), the hypothesized time, the time and the
    row of the test (target, 3), the impulse (target, 3) and its C (target, 3, 3). With `planned`
    there is no filter: mean and covariance at the steps are outputs, those of an observed target
    that follows its expected orbit.
    """
    work = make_scratch()
    used, start, spread, mean, covariance = orbits
    sensitivity, gradient, information = own
    squared, whitened, best = out
    scratch = np.empty_like(whitened[:1])
    for j in range(targets[0], targets[1]):
        orbit = used, start[j], spread[j], mean[j], covariance[j]
        each = sensitivity[j], gradient[j], information[j]
        largest = best[0][j], best[1][j], best[2][j], best[3][j]
        found = squared, whitened if planned else scratch, largest
        _scan_target(j, first, model, records, orbit, each, settings, planned, found, work)
