"""Adaptive integration of many trajectories in the lanes of vector arithmetic (compiled).

A single trajectory uses little of a processor, because each stage depends on the previous one and
its six components do not fill vector registers. A trajectory with its state transition matrix has
42 components. Here `LANES` trajectories are integrated together,
one per lane; when one ends, the next takes its lane. Each lane has its own time, step and error,
and nothing is summed across lanes. Every operation is that of
`cislunar.dynamics.adaptive.runge_kutta.integrate`, in the same order and without contraction.
Therefore the result is bit-identical, whatever the other trajectories, the number of lanes and the
width of the registers.

All numbers are in one table: component c of lane i is entry ``c * LANES + i`` of a row, whose
length is the number of components times `LANES`; rows with one number per lane use the first
entries. Rows are addressed by index rather than by views,
because only then does the compiler vectorize the loops.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.compiled import implements, njit
from cislunar.dynamics.adaptive.runge_kutta import (
    DOPRI5,
    MAX_STEPS,
    OK,
    SHORTEST_STEP,
    STEP_UNDERFLOW,
    TOO_MANY_STEPS,
    derivative,
    extended5,
    extended8,
    initial_step,
)
from cislunar.dynamics.forces import acceleration, acceleration_change, at, partials
from cislunar.dynamics.tableau import (
    DENSE5,
    DENSE8,
    ERROR5,
    ERROR8_3,
    ERROR8_5,
    PAIR5,
    PAIR8,
    STAGES5,
    STAGES8,
)

LANES = 16
_STATE, _NEW, _WORK, _STEP, _ERROR, _ERROR3 = range(6)
_TIME, _STAGE_TIME, _ELAPSED, _SIZE, _LEFT, _NORM = range(6, 12)
_SLOPES, _DENSE = 12, 28
_ROWS = 35
_JOB, _DONE, _TRIED, _REJECTED = range(4)


def _padded(rows: list, columns: int = 16) -> NDArray[np.float64]:
    """Rows of weights, padded with zeros."""
    out = np.zeros((len(rows), columns))
    for row, weights in zip(out, rows, strict=True):
        row[: len(weights)] = weights
    return out


# Indexed by method, so that the code of a stage is compiled once.
_A = np.stack([_padded([*pair[0], *np.zeros((16 - len(pair[0]), 1))]) for pair in (PAIR5, PAIR8)])
_NODES = _padded([pair[1] for pair in (PAIR5, PAIR8)])
_FIRST = _padded([pair[2] for pair in (PAIR5, PAIR8)]).astype(np.int64)
_STAGES = np.array([STAGES5, STAGES8])
_WEIGHTS = _padded([ERROR5, *DENSE5.T, ERROR8_5, ERROR8_3, *DENSE8])
_ERROR_ROW, _ERROR_ROWS, _ERROR_SLOPES = (0, 5), (1, 2), (STAGES5 + 1, STAGES8)
_DENSE_ROW, _DENSE_SLOPES, _DENSE_BEFORE = (1, 7), (STAGES5 + 1, 16), (0, 3)


class OfStates(NamedTuple):
    """Kind of trajectories: states alone."""


class OfMatrices(NamedTuple):
    """Kind of trajectories: states with their state transition matrices in row order."""


def n_components(kind):
    """Number of components of a kind of trajectories, which the compiler knows."""
    raise NotImplementedError


@implements(n_components, OfStates)
def _of_states(kind):
    return 6


@implements(n_components, OfMatrices)
def _of_matrices(kind):
    return 42


class Jobs(NamedTuple):
    """Trajectories to integrate, n of them, nondimensional.

    Attributes
    ----------
    state : ndarray, shape (n, components)
        Initial values of the components of the kind, propagation frame.
    start : ndarray, shape (n,)
        Initial times since the epoch.
    direction : ndarray, shape (n,)
        1 forward in time, -1 backward.
    first : ndarray of int, shape (n + 1,)
        Index in `times` of the first time of each trajectory.
    times : ndarray, shape (m,)
        Output times of all trajectories, elapsed since the start: nonnegative, and increasing for
        each trajectory.
    place : ndarray of int, shape (m,)
        Row of the result for each output time.
    """

    state: NDArray[np.float64]
    start: NDArray[np.float64]
    direction: NDArray[np.float64]
    first: NDArray[np.int64]
    times: NDArray[np.float64]
    place: NDArray[np.int64]


@njit(cache=True, error_model="numpy")
def _variations(forces, w, point, slope):
    """Slopes of the state transition matrices at the points of a row, into another row."""
    for k in range(6 * LANES, 24 * LANES):
        w[slope, k] = w[point, 18 * LANES + k]
    for i in range(LANES):
        x, y, z = w[point, i], w[point, LANES + i], w[point, 2 * LANES + i]
        vx, vy, vz = w[point, 3 * LANES + i], w[point, 4 * LANES + i], w[point, 5 * LANES + i]
        u = partials(at(forces, w[_STAGE_TIME, i]), x, y, z, vx, vy, vz)
        for column in range(6):
            k = (6 + column) * LANES + i
            ax, ay, az = acceleration_change(
                u,
                w[point, k],
                w[point, k + 6 * LANES],
                w[point, k + 12 * LANES],
                w[point, k + 18 * LANES],
                w[point, k + 24 * LANES],
                w[point, k + 30 * LANES],
            )
            w[slope, k + 18 * LANES] = ax
            w[slope, k + 24 * LANES] = ay
            w[slope, k + 30 * LANES] = az


@njit(cache=True, error_model="numpy")
def _stages(kind, method, forces, begin, end, w, out):
    """Slopes from stage `begin` to `end` - 1; the last stage's point remains in row `out`."""
    width = n_components(kind) * LANES
    for s in range(begin, end):
        c = _A[method, s, 0]
        for k in range(width):
            w[out, k] = w[_STATE, k] + w[_STEP, k] * c * w[_SLOPES, k]
        j = _FIRST[method, s]
        while j + 1 < s:  # two at a time, for fewer stores
            c, d = _A[method, s, j], _A[method, s, j + 1]
            row = _SLOPES + j
            for k in range(width):
                h = w[_STEP, k]
                w[out, k] = (w[out, k] + h * c * w[row, k]) + h * d * w[row + 1, k]
            j += 2
        if j < s:
            c = _A[method, s, j]
            for k in range(width):
                w[out, k] += w[_STEP, k] * c * w[_SLOPES + j, k]
        for i in range(LANES):
            w[_STAGE_TIME, i] = w[_TIME, i] + _NODES[method, s] * w[_STEP, i]
        slope = _SLOPES + s
        for i in range(LANES):
            ax, ay, az = acceleration(
                at(forces, w[_STAGE_TIME, i]),
                w[out, i],
                w[out, LANES + i],
                w[out, 2 * LANES + i],
                w[out, 3 * LANES + i],
                w[out, 4 * LANES + i],
                w[out, 5 * LANES + i],
            )
            w[slope, 3 * LANES + i] = ax
            w[slope, 4 * LANES + i] = ay
            w[slope, 5 * LANES + i] = az
        for k in range(3 * LANES):
            w[slope, k] = w[out, 3 * LANES + k]
        if width > 6 * LANES:
            _variations(forces, w, out, slope)


@njit(cache=True, error_model="numpy")
def _weigh(kind, row, rows, count, w, out):
    """Sums of the first slopes, weighted by `_WEIGHTS` from `row` on, into rows from `out` on."""
    for p in range(rows):
        for k in range(n_components(kind) * LANES):
            w[out + p, k] = 0.0
        for j in range(0, count - 1, 2):
            c, d = _WEIGHTS[row + p, j], _WEIGHTS[row + p, j + 1]
            for k in range(n_components(kind) * LANES):
                w[out + p, k] = (w[out + p, k] + c * w[_SLOPES + j, k]) + d * w[_SLOPES + j + 1, k]
        if count % 2:
            c = _WEIGHTS[row + p, count - 1]
            for k in range(n_components(kind) * LANES):
                w[out + p, k] += c * w[_SLOPES + count - 1, k]


@njit(cache=True, error_model="numpy")
def _step(kind, method, forces, rtol, atol, w):
    """All stages of a step, and the error norm of each lane."""
    _stages(kind, method, forces, 1, _STAGES[method] + 1, w, _NEW)
    _weigh(kind, _ERROR_ROW[method], _ERROR_ROWS[method], _ERROR_SLOPES[method], w, _ERROR)
    for k in range(n_components(kind) * LANES):
        scale = atol + rtol * max(abs(w[_STATE, k]), abs(w[_NEW, k]))
        # bit-identical to the integrator of one trajectory
        scale = w[_STEP, k] / scale if method == DOPRI5 else 1.0 / scale
        w[_ERROR, k] *= scale
        w[_ERROR3, k] *= scale
    size = n_components(kind)
    for i in range(LANES):
        total, total3 = 0.0, 0.0
        for c in range(size):
            total += w[_ERROR, c * LANES + i] * w[_ERROR, c * LANES + i]
            total3 += w[_ERROR3, c * LANES + i] * w[_ERROR3, c * LANES + i]
        if method == DOPRI5:
            w[_NORM, i] = np.sqrt(total / size)
        else:
            norm = abs(w[_STEP, i]) * total / np.sqrt((total + 0.01 * total3) * size)
            w[_NORM, i] = 0.0 if total == 0.0 else norm


@njit(cache=True, error_model="numpy")
def _prepare_dense(kind, method, forces, w):
    """Coefficients of the continuous extension of a step, for all lanes."""
    if method != DOPRI5:
        _stages(kind, method, forces, STAGES8 + 1, 16, w, _WORK)
        for k in range(n_components(kind) * LANES):
            h, slope, delta = w[_STEP, k], w[_SLOPES, k], w[_NEW, k] - w[_STATE, k]
            w[_DENSE, k] = delta
            w[_DENSE + 1, k] = h * slope - delta
            w[_DENSE + 2, k] = 2.0 * delta - h * (w[_SLOPES + STAGES8, k] + slope)
    first = _DENSE + _DENSE_BEFORE[method]
    _weigh(kind, _DENSE_ROW[method], 4, _DENSE_SLOPES[method], w, first)
    for p in range(4):
        for k in range(n_components(kind) * LANES):
            w[first + p, k] *= w[_STEP, k]


@njit(cache=True, error_model="numpy")
def _load(job, i, method, forces, jobs, rtol, atol, w, lanes, out):
    """Load a job into lane i, unless its only output time is its start."""
    first, last = jobs.first[job], jobs.first[job + 1]
    y = jobs.state[job]
    while first < last and jobs.times[first] == 0.0:
        out[jobs.place[first]] = y
        first += 1
    if first == last:
        return
    slope, work, work_slope = np.empty(y.size), np.empty(y.size), np.empty(y.size)
    start = jobs.start[job]
    derivative(forces, start, y, slope)
    span = jobs.times[last - 1] * jobs.direction[job]
    w[_SIZE, i] = initial_step(method, forces, start, y, slope, span, rtol, atol, work, work_slope)
    w[_ELAPSED, i] = 0.0
    for c in range(y.size):
        w[_STATE, c * LANES + i] = y[c]
        w[_SLOPES, c * LANES + i] = slope[c]
    lanes[_JOB, i] = job
    lanes[_DONE, i] = first
    lanes[_TRIED, i] = 0
    lanes[_REJECTED, i] = 0


@njit(cache=True, error_model="numpy")
def _propose(kind, jobs, w, lanes, status, reached):
    """Set the next step of each lane, zero if idle or failed; returns the number of busy lanes."""
    busy = 0
    for i in range(LANES):
        job = lanes[_JOB, i]
        step = 0.0
        if job >= 0:
            t, direction = w[_ELAPSED, i], jobs.direction[job]
            left = jobs.times[jobs.first[job + 1] - 1] - t
            h = min(w[_SIZE, i], left)
            w[_LEFT, i] = left
            w[_SIZE, i] = h
            w[_TIME, i] = jobs.start[job] + t * direction
            # Written so that a NaN (a step into the center of a primary) also counts as underflow.
            if not h > min(SHORTEST_STEP, 1e-3 * left) or lanes[_TRIED, i] == MAX_STEPS:
                status[job] = TOO_MANY_STEPS if lanes[_TRIED, i] == MAX_STEPS else STEP_UNDERFLOW
                reached[job] = t * direction
                lanes[_JOB, i] = -1
            else:
                lanes[_TRIED, i] += 1
                step = h * direction
                busy += 1
        for k in range(i, n_components(kind) * LANES, LANES):
            w[_STEP, k] = step
    return busy


@njit(cache=True, error_model="numpy")
def _has_outputs_within(jobs, w, lanes):
    """Whether a lane has an output time within the step just taken."""
    for i in range(LANES):
        if lanes[_JOB, i] >= 0 and w[_NORM, i] < 1.0:
            h = w[_SIZE, i]
            if h == w[_LEFT, i]:
                last = jobs.first[lanes[_JOB, i] + 1] - 1
                if lanes[_DONE, i] < last and jobs.times[lanes[_DONE, i]] < jobs.times[last]:
                    return True
            elif jobs.times[lanes[_DONE, i]] < w[_ELAPSED, i] + h:
                return True
    return False


@njit(cache=True, error_model="numpy")
def _evaluate(kind, method, fraction, i, w, row, out):
    """Continuous extension of lane i at a fraction of its step, into a row of `out`."""
    for k in range(i, n_components(kind) * LANES, LANES):
        y, a, b = w[_STATE, k], w[_DENSE, k], w[_DENSE + 1, k]
        c, d = w[_DENSE + 2, k], w[_DENSE + 3, k]
        if method == DOPRI5:
            out[row, k // LANES] = extended5(fraction, y, a, b, c, d)
        else:
            e, f, g = w[_DENSE + 4, k], w[_DENSE + 5, k], w[_DENSE + 6, k]
            out[row, k // LANES] = extended8(fraction, y, a, b, c, d, e, f, g)


@njit(cache=True, error_model="numpy")
def _settle(kind, method, jobs, w, lanes, out):
    """Accept steps and write their outputs, or reduce the next step."""
    exponent = -0.2 if method == DOPRI5 else -0.125
    end_slopes = _SLOPES + (STAGES5 if method == DOPRI5 else STAGES8)
    for i in range(LANES):
        job, h, error = lanes[_JOB, i], w[_SIZE, i], w[_NORM, i]
        if job < 0:
            continue
        if not error < 1.0:
            w[_SIZE, i] = h * (max(0.2, 0.9 * error**exponent) if np.isfinite(error) else 0.2)
            lanes[_REJECTED, i] = 1
            continue
        done, last = lanes[_DONE, i], jobs.first[job + 1]
        t, end = w[_ELAPSED, i], jobs.times[last - 1]
        t_new = end if h == w[_LEFT, i] else t + h
        while done < last and t_new >= jobs.times[done]:
            output, row = jobs.times[done], jobs.place[done]
            if output == t_new:
                for c in range(n_components(kind)):
                    out[row, c] = w[_NEW, c * LANES + i]
            else:
                _evaluate(kind, method, (output - t) / h, i, w, row, out)
            done += 1
        lanes[_DONE, i] = done
        if done == last:
            lanes[_JOB, i] = -1
            continue
        factor = 10.0 if error == 0.0 else min(10.0, max(0.2, 0.9 * error**exponent))
        w[_SIZE, i] = h * (min(1.0, factor) if lanes[_REJECTED, i] else factor)
        lanes[_REJECTED, i] = 0
        w[_ELAPSED, i] = t_new
        for c in range(n_components(kind)):
            w[_STATE, c * LANES + i] = w[_NEW, c * LANES + i]
            w[_SLOPES, c * LANES + i] = w[end_slopes, c * LANES + i]


@njit(cache=True, error_model="numpy")
def integrate_many(kind, method, forces, jobs, rtol, atol, out, status, reached):
    """Integrate every job from its start to the last of its times (compiled). `kind` is
    `OfStates` or `OfMatrices`; `out`, shape (rows, components), receives the solutions. `status`
    and `reached`, shape (n,), receive the status codes of
    `cislunar.dynamics.adaptive.runge_kutta` and, for failed jobs, the elapsed time reached."""
    size = n_components(kind)
    w, lanes = np.zeros((_ROWS, size * LANES)), np.zeros((4, LANES), np.int64)
    status[:] = OK
    if jobs.start.size == 0:
        return
    for i in range(LANES):  # idle lanes evaluate the first start, which is a valid state
        lanes[_JOB, i] = -1
        w[_TIME, i] = jobs.start[0]
        for c in range(size):
            w[_STATE, c * LANES + i] = jobs.state[0, c]
    waiting = 0
    while True:
        for i in range(LANES):
            while lanes[_JOB, i] < 0 and waiting < jobs.start.size:
                _load(waiting, i, method, forces, jobs, rtol, atol, w, lanes, out)
                waiting += 1
        busy = _propose(kind, jobs, w, lanes, status, reached)
        if busy == 0:
            if waiting == jobs.start.size:
                return
            continue
        _step(kind, method, forces, rtol, atol, w)
        if _has_outputs_within(jobs, w, lanes):
            _prepare_dense(kind, method, forces, w)
        _settle(kind, method, jobs, w, lanes, out)
