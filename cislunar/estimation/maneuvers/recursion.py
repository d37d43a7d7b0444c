"""Compiled recursion of the likelihood ratio test for an impulse at an unknown time; see
`cislunar.estimation.maneuvers.likelihood_ratio`."""

import numpy as np

from cislunar.compiled import copy_into, njit, njit_noalloc
from cislunar.dynamics.forces import (
    acceleration,
    acceleration_change,
    at,
    is_calm,
    of_state,
    partials,
)
from cislunar.estimation.linearization import (
    SIZE,
    carry_along,
    carry_filter,
    follow,
    make_scratch,
    measured_at,
    restart,
    transition,
)
from cislunar.estimation.maneuvers.bank_kernels import STRIDE_S

_LONGER = 4
"""Factor of the longest integration step where forces change little."""


@njit_noalloc
def _slopes(field, state, phi, before, h, out):
    """Derivatives by time of a state (6,) and of the derivatives `phi` (6, 6) of the state, all
    displaced by h times `before`, into `out` (6, 7 or more): of `phi`, then of the state."""
    x, y, z, vx, vy, vz = state[0], state[1], state[2], state[3], state[4], state[5]
    x, y, z = x + h * before[0, 6], y + h * before[1, 6], z + h * before[2, 6]
    vx, vy, vz = vx + h * before[3, 6], vy + h * before[4, 6], vz + h * before[5, 6]
    out[0, 6], out[1, 6], out[2, 6] = vx, vy, vz
    out[3, 6], out[4, 6], out[5, 6] = acceleration(field, x, y, z, vx, vy, vz)
    derivatives = partials(field, x, y, z, vx, vy, vz)
    for i in range(SIZE):
        dx, dy, dz = (
            phi[0, i] + h * before[0, i],
            phi[1, i] + h * before[1, i],
            phi[2, i] + h * before[2, i],
        )
        ux, uy, uz = (
            phi[3, i] + h * before[3, i],
            phi[4, i] + h * before[4, i],
            phi[5, i] + h * before[5, i],
        )
        out[0, i], out[1, i], out[2, i] = ux, uy, uz
        out[3, i], out[4, i], out[5, i] = acceleration_change(derivatives, dx, dy, dz, ux, uy, uz)


@njit_noalloc
def _calm_transition(forces, k, n_steps, scene, state, work):
    """Propagate a state (6,) over some steps from time k where forces change little, in place, with
    its transition matrix into `work.phi`, by the classical Runge-Kutta method. Returns whether
    forces change little."""
    start, dt = k * scene.step, n_steps * scene.step
    field, slopes, phi = at(forces, start), work.slopes, work.phi
    if not is_calm(field, state[0], state[1], state[2], dt):
        return False
    restart(phi)
    slopes[3, :, :] = 0.0
    _slopes(field, state, phi, slopes[3], 0.0, slopes[0])
    field = at(forces, start + 0.5 * dt)
    _slopes(field, state, phi, slopes[0], 0.5 * dt, slopes[1])
    _slopes(field, state, phi, slopes[1], 0.5 * dt, slopes[2])
    _slopes(at(forces, start + dt), state, phi, slopes[2], dt, slopes[3])
    for c in range(SIZE):
        for i in range(SIZE + 1):
            inner = slopes[1, c, i] + slopes[2, c, i]
            change = dt / 6.0 * (slopes[0, c, i] + 2.0 * inner + slopes[3, c, i])
            if i < SIZE:
                phi[c, i] += change
            else:
                state[c] += change
    return True


@njit_noalloc
def _carry(path, sensitivity, product):
    """Apply the matrix `path` to the sensitivities (hypothesis, 6, 3), and reset it."""
    for h in range(sensitivity.shape[0]):
        carry_along(path, sensitivity[h], product)
    restart(path)


@njit_noalloc
def _accumulate(root, known, path, own, whitened, work):
    """Add two angles to the information on the impulses, and their update to `path`, the derivative
    of the error of the estimate by that at the time of the sensitivities. Without a known
    innovation (`known` = 0) it counts as zero. The whitened derivatives of the innovation go into
    `whitened` (hypothesis, 2, 3). Returns the normalized innovation squared."""
    l11, l21, l22 = root
    rows, gain, seen = work.rows, work.gain, work.own
    sensitivity, gradient, information = own
    e0 = known * work.angles[0] / l11
    e1 = (known * work.angles[1] - l21 * e0) / l22
    for c in range(SIZE):
        g0 = rows[1, 3] * path[0, c] + rows[1, 4] * path[1, c] + rows[1, 5] * path[2, c]
        g1 = rows[2, 3] * path[0, c] + rows[2, 4] * path[1, c] + rows[2, 5] * path[2, c]
        seen[0, c] = g0 / l11
        seen[1, c] = (g1 - l21 * seen[0, c]) / l22
        for i in range(SIZE):
            path[i, c] -= gain[i, 0] * g0 + gain[i, 1] * g1
    for h in range(sensitivity.shape[0]):
        d, c, w = sensitivity[h], information[h], whitened[h]
        for a in range(3):
            w0, w1 = 0.0, 0.0
            for i in range(SIZE):
                w0 += seen[0, i] * d[i, a]
                w1 += seen[1, i] * d[i, a]
            w[0, a], w[1, a] = w0, w1
            gradient[h, a] += w0 * e0 + w1 * e1
            for b in range(a + 1):
                c[a, b] += w0 * w[0, b] + w1 * w[1, b]
                c[b, a] = c[a, b]
    return e0 * e0 + e1 * e1


@njit_noalloc
def _last_step(i, stop, first, spacing, used, offset):
    """Last of the steps from i on, before `stop`, that a transition without observations covers: up
    to a hypothesized time or the step before an observation."""
    while i + 1 < stop and (first + i) % spacing != 0:
        if measured_at(used, offset[i + 1], offset[i + 2]):
            break
        i += 1
    return i


@njit_noalloc
def _statistic(gradient, information, prior, root, whitened):
    """Statistic d^T (C + prior I)^-1 d of an impulse, with the Cholesky factor of the matrix into
    `root` (3, 3), and the impulse times its transpose into `whitened` (3,)."""
    found = 0.0
    for a in range(3):
        total = gradient[a]
        for b in range(a):
            product = information[a, b]
            for c in range(b):
                product -= root[a, c] * root[b, c]
            root[a, b] = product / root[b, b]
            total -= root[a, b] * whitened[b]
        square = information[a, a] + prior
        for c in range(a):
            square -= root[a, c] * root[a, c]
        root[a, a] = np.sqrt(square)
        whitened[a] = total / root[a, a]
        found += whitened[a] * whitened[a]
    return found


@njit_noalloc
def _test(k, number, settings, gradient, information, root, whitened, best):
    """Keep the largest statistic of the hypotheses after observation `number` at time k."""
    spacing, prior = settings
    value, at, impulse, matrix = best
    count, base = gradient.shape[0], (k - 1) // spacing
    for h in range(count):
        found = _statistic(gradient[h], information[h], prior, root, whitened)
        if found > value[0]:
            value[0] = found
            at[0], at[1], at[2] = (base - (base - h) % count) * spacing, k, number
            for a in range(2, -1, -1):
                total = whitened[a]
                for c in range(a + 1, 3):
                    total -= root[c, a] * impulse[c]
                impulse[a] = total / root[a, a]
            copy_into(matrix, information[h])


@njit_noalloc
def _scan_target(j, first, model, records, orbit, own, settings, planned, out, work, scratch):
    """See `scan`; the arrays are those of target j."""
    scene, forces, process = model
    used, start, spread, mean, covariance = orbit
    sensitivity, gradient, information = own
    squared, whitened, best = out
    path, product, root, white, state, before = scratch
    forced, offset = of_state(forces, j), records.offset[j]
    spacing, usual = settings[0], max(1, int(STRIDE_S / scene.step_s))
    n_steps, i, longer = offset.shape[0] - 1, 0, _LONGER * usual
    copy_into(state, start)
    copy_into(before, spread)
    restart(path)
    while i < n_steps:
        begin, stride = i, usual
        needed = planned or measured_at(used, offset[i], offset[i + 1])
        if not needed:
            begun = at(forced, (first + i - 1) * scene.step)
            if is_calm(begun, state[0], state[1], state[2], longer * scene.step):
                stride = longer
            i = _last_step(i, min(i + stride, n_steps), first, spacing, used, offset)
        if not planned and not np.isfinite(mean[i, 0]):
            return
        k, span = first + i, i + 1 - begin
        if not _calm_transition(forced, k - span, span, scene, state, work):
            transition(forced, k - span, span, scene, state, state, work)
            copy_into(state, work.mean)
        carry_along(work.phi, path, work.square)
        if needed:
            carry_filter(before, process, work)
        for row in range(offset[i], offset[i + 1]):
            if not used[row]:
                continue
            o, value = records.observer[row], records.value[row]
            variance = records.variance[row, 1:]
            if planned:
                # the covariance alone: there is no measurement yet
                copy_into(mean[i], state)
                found = follow(state, before, value, variance, o, k, scene, work)
                copy_into(state, mean[i])
                _accumulate(found, 0.0, path, own, whitened[row], work)
            else:
                found = follow(state, before, value, variance, o, k, scene, work)
                squared[row] = _accumulate(found, 1.0, path, own, whitened[0], work)
                _test(k, row, settings, gradient, information, root, white, best)
        if k % spacing == 0:
            _carry(path, sensitivity, product)
            h = (k // spacing) % gradient.shape[0]
            sensitivity[h, :, :] = 0.0
            gradient[h, :] = 0.0
            information[h, :, :] = 0.0
            for c in range(3):
                sensitivity[h, 3 + c, c] = 1.0
        if planned:
            copy_into(mean[i], state)
            copy_into(covariance[i], before)
        else:
            # the filter itself decides on mean and covariance, from which the next step begins
            copy_into(state, mean[i])
            copy_into(before, covariance[i])
        i += 1
    _carry(path, sensitivity, product)


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
    none = np.empty_like(whitened[:1])
    square, three = np.empty((2, SIZE, SIZE)), np.empty((2, 3, 3))
    scratch = square[0], np.empty((SIZE, 3)), three[0], three[1, 0], np.empty(SIZE), square[1]
    for j in range(targets[0], targets[1]):
        orbit = used, start[j], spread[j], mean[j], covariance[j]
        each = sensitivity[j], gradient[j], information[j]
        largest = best[0][j], best[1][j], best[2][j], best[3][j]
        found = squared, whitened if planned else none, largest
        _scan_target(j, first, model, records, orbit, each, settings, planned, found, work, scratch)
