"""Adaptive Runge-Kutta kernels with dense output (compiled).

For the pairs see `cislunar.dynamics.tableau`; the step-size control follows Hairer, Norsett &
Wanner, "Solving Ordinary Differential Equations I", section II.4.

A vector of 6 entries is a state. A vector of 42 entries is a state followed by its state transition
matrix (STM) in row order, whose variational equations are integrated as well.
"""

import numpy as np

from cislunar.compiled import njit
from cislunar.dynamics.forces import acceleration, acceleration_change, at, partials
from cislunar.dynamics.tableau import (
    A5,
    A8,
    C5,
    C8,
    DENSE5,
    DENSE8,
    ERROR5,
    ERROR8_3,
    ERROR8_5,
    FIRST5,
    FIRST8,
    STAGES5,
    STAGES8,
)

DOPRI5, DOP853 = 0, 1
OK, STEP_UNDERFLOW, TOO_MANY_STEPS = 0, 1, 2
MAX_STEPS = 2_000_000
SHORTEST_STEP = 1e-13
"""Nondimensional (38 ns), unless a shorter time remains. Only within some ten meters of the center
of the Moon are shorter steps needed, of which rounding can require hundreds of thousands."""


@njit(cache=True, error_model="numpy")
def derivative(forces, t, y, dy):
    """Write the time derivative of a state (6), or of a state and its STM (42), into `dy`."""
    field = at(forces, t)
    dy[0] = y[3]
    dy[1] = y[4]
    dy[2] = y[5]
    dy[3], dy[4], dy[5] = acceleration(field, y[0], y[1], y[2], y[3], y[4], y[5])
    if y.size == 6:
        return
    u = partials(field, y[0], y[1], y[2], y[3], y[4], y[5])
    for j in range(6, 12):  # the STM column by column
        vx, vy, vz = y[j + 18], y[j + 24], y[j + 30]
        dy[j] = vx
        dy[j + 6] = vy
        dy[j + 12] = vz
        dy[j + 18], dy[j + 24], dy[j + 30] = acceleration_change(
            u, y[j], y[j + 6], y[j + 12], vx, vy, vz
        )


@njit(cache=True, error_model="numpy")
def _stage(forces, t, y, h, slopes, row, first, count, work):
    """Slope at time t of y + h sum_j row[j] slopes[j], into slopes[count]. Coefficients from 1 to
    `first` - 1 are zero and skipped."""
    n = y.size
    if n == 6:
        # Six running sums in registers, for the most frequent case.
        y0, y1, y2, y3, y4, y5 = y[0], y[1], y[2], y[3], y[4], y[5]
        for j in range(count):
            if 0 < j < first:
                continue
            c = h * row[j]
            y0 += c * slopes[j, 0]
            y1 += c * slopes[j, 1]
            y2 += c * slopes[j, 2]
            y3 += c * slopes[j, 3]
            y4 += c * slopes[j, 4]
            y5 += c * slopes[j, 5]
        work[0], work[1], work[2], work[3], work[4], work[5] = y0, y1, y2, y3, y4, y5
        ax, ay, az = acceleration(at(forces, t), y0, y1, y2, y3, y4, y5)
        slope = slopes[count]
        slope[0], slope[1], slope[2], slope[3], slope[4], slope[5] = y3, y4, y5, ax, ay, az
        return
    c = h * row[0]
    for i in range(n):
        work[i] = y[i] + c * slopes[0, i]
    for j in range(first, count):
        c = h * row[j]
        for i in range(n):
            work[i] += c * slopes[j, i]
    derivative(forces, t, work, slopes[count])


@njit(cache=True, error_model="numpy")
def _step(method, forces, t, y, h, slopes, y_new):
    """All stages of a step; slopes[0] holds f(y), the row after the last stage gets f(y_new)."""
    if method == DOPRI5:
        for s in range(1, STAGES5 + 1):
            _stage(forces, t + C5[s] * h, y, h, slopes, A5[s], FIRST5[s], s, y_new)
    else:
        for s in range(1, STAGES8 + 1):
            _stage(forces, t + C8[s] * h, y, h, slopes, A8[s], FIRST8[s], s, y_new)


@njit(cache=True, error_model="numpy")
def _error_norm(method, y, y_new, h, slopes, rtol, atol):
    """Error norm of a step relative to the tolerances; acceptable below 1."""
    n = y.size
    if method == DOPRI5:
        total = 0.0
        for i in range(n):
            e = 0.0
            for j in range(STAGES5 + 1):
                e += ERROR5[j] * slopes[j, i]
            e *= h / (atol + rtol * max(abs(y[i]), abs(y_new[i])))
            total += e * e
        return np.sqrt(total / n)
    total3 = 0.0
    total5 = 0.0
    for i in range(n):
        e3 = 0.0
        e5 = 0.0
        for j in range(STAGES8):
            e3 += ERROR8_3[j] * slopes[j, i]
            e5 += ERROR8_5[j] * slopes[j, i]
        scale = 1.0 / (atol + rtol * max(abs(y[i]), abs(y_new[i])))
        e3 *= scale
        e5 *= scale
        total3 += e3 * e3
        total5 += e5 * e5
    if total5 == 0.0:
        return 0.0
    return abs(h) * total5 / np.sqrt((total5 + 0.01 * total3) * n)


@njit(cache=True, error_model="numpy")
def _prepare_dense(method, forces, t, y, y_new, h, slopes, dense, work):
    """Coefficients of the continuous extension over an accepted step, into `dense` (7, n)."""
    n = y.size
    if method == DOPRI5:
        for p in range(4):
            for i in range(n):
                c = 0.0
                for j in range(STAGES5 + 1):
                    c += DENSE5[j, p] * slopes[j, i]
                dense[p, i] = h * c
        return
    for s in range(STAGES8 + 1, 16):
        _stage(forces, t + C8[s] * h, y, h, slopes, A8[s], FIRST8[s], s, work)
    for i in range(n):
        delta = y_new[i] - y[i]
        dense[0, i] = delta
        dense[1, i] = h * slopes[0, i] - delta
        dense[2, i] = 2.0 * delta - h * (slopes[12, i] + slopes[0, i])
    for p in range(4):
        for i in range(n):
            c = 0.0
            for j in range(16):
                c += DENSE8[p, j] * slopes[j, i]
            dense[3 + p, i] = h * c


@njit(cache=True, error_model="numpy")
def extended5(fraction, y, a, b, c, d):
    """Continuous extension of Dormand-Prince 5(4) for one component."""
    return y + (((d * fraction + c) * fraction + b) * fraction + a) * fraction


@njit(cache=True, error_model="numpy")
def extended8(fraction, y, a, b, c, d, e, f, g):
    """Continuous extension of DOP853 for one component."""
    rest = 1.0 - fraction
    value = ((g * fraction + f) * rest + e) * fraction
    return y + ((((value + d) * rest + c) * fraction + b) * rest + a) * fraction


@njit(cache=True, error_model="numpy")
def _evaluate_dense(method, y, dense, fraction, out):
    """Continuous extension at a fraction (0 to 1) of the step, into `out` (n,)."""
    for i in range(y.size):
        a, b, c, d = dense[0, i], dense[1, i], dense[2, i], dense[3, i]
        if method == DOPRI5:
            out[i] = extended5(fraction, y[i], a, b, c, d)
        else:
            e, f, g = dense[4, i], dense[5, i], dense[6, i]
            out[i] = extended8(fraction, y[i], a, b, c, d, e, f, g)


@njit(cache=True, error_model="numpy")
def initial_step(method, forces, t, y, slope, span, rtol, atol, work, work_slope):
    """First step size, always positive (Hairer, Norsett & Wanner, section II.4)."""
    n = y.size
    d0 = 0.0
    d1 = 0.0
    for i in range(n):
        scale = atol + abs(y[i]) * rtol
        d0 += (y[i] / scale) ** 2
        d1 += (slope[i] / scale) ** 2
    d0 = np.sqrt(d0 / n)
    d1 = np.sqrt(d1 / n)
    h0 = 1e-6 if d0 < 1e-5 or d1 < 1e-5 else 0.01 * d0 / d1
    h0 = min(h0, abs(span))
    direction = 1.0 if span > 0 else -1.0
    for i in range(n):
        work[i] = y[i] + h0 * direction * slope[i]
    derivative(forces, t + h0 * direction, work, work_slope)
    d2 = 0.0
    for i in range(n):
        d2 += ((work_slope[i] - slope[i]) / (atol + abs(y[i]) * rtol)) ** 2
    d2 = np.sqrt(d2 / n) / h0
    exponent = 0.2 if method == DOPRI5 else 0.125
    steepest = max(d1, d2)
    h1 = (0.01 / steepest) ** exponent if steepest > 1e-15 else max(1e-6, 1e-3 * h0)
    return min(100.0 * h0, h1, abs(span))


@njit(cache=True, error_model="numpy")
def _close_in(method, y, dense, center, point):
    """Bisect a step for the least distance to a primary; `point` receives the state there."""
    low = 0.0
    high = 1.0
    for _ in range(45):
        middle = 0.5 * (low + high)
        _evaluate_dense(method, y, dense, middle, point)
        if _radial_rate(point, center) < 0.0:
            low = middle
        else:
            high = middle


@njit(cache=True, error_model="numpy")
def _radial_rate(y, center):
    return (y[0] - center) * y[3] + y[1] * y[4] + y[2] * y[5]


@njit(cache=True, error_model="numpy")
def _distance(y, center):
    return np.sqrt((y[0] - center) ** 2 + y[1] * y[1] + y[2] * y[2])


@njit(cache=True, error_model="numpy")
def integrate(method, forces, start, y0, times, rtol, atol, out, centers, closest):
    """Integrate from `start` and evaluate the continuous extension at output times (compiled).

    `y0` has 6 or 42 entries. `times` are elapsed since `start`, monotone and of one sign (or zero);
    the integration ends at the last. `out`, shape (m, n), receives the solution. `closest` receives
    the least distances to `centers`, points on the x axis (forward integration only). Returns the
    status and the elapsed time reached."""
    n = y0.size
    last = STAGES8 if method == DOP853 else STAGES5
    exponent = -0.125 if method == DOP853 else -0.2
    y = y0.copy()
    y_new = np.empty(n)
    work = np.empty(n)
    slopes = np.empty((16, n))
    dense = np.empty((7, n))
    derivative(forces, start, y, slopes[0])
    for k in range(centers.size):
        closest[k] = _distance(y, centers[k])
    m = times.size
    done = 0
    while done < m and times[done] == 0.0:
        out[done] = y
        done += 1
    if done == m:
        return OK, 0.0
    end = times[m - 1]
    direction = 1.0 if end > 0.0 else -1.0
    t = 0.0
    h = initial_step(method, forces, start, y, slopes[0], end, rtol, atol, work, slopes[1])
    rejected = False
    for _ in range(MAX_STEPS):
        remaining = abs(end - t)
        h = min(h, remaining)
        # Written so that a NaN (a step into the center of a primary) also counts as underflow.
        if not h > min(SHORTEST_STEP, 1e-3 * remaining):
            return STEP_UNDERFLOW, t
        step = h * direction
        _step(method, forces, start + t, y, step, slopes, y_new)
        error = _error_norm(method, y, y_new, step, slopes, rtol, atol)
        if not error < 1.0:
            h *= max(0.2, 0.9 * error**exponent) if np.isfinite(error) else 0.2
            rejected = True
            continue
        t_new = end if h == remaining else t + step
        has_output = done < m and (t_new - times[done]) * direction >= 0.0
        ready = False
        if has_output and times[done] != t_new:
            _prepare_dense(method, forces, start + t, y, y_new, step, slopes, dense, work)
            ready = True
        while done < m and (t_new - times[done]) * direction >= 0.0:
            if times[done] == t_new:
                out[done] = y_new
            else:
                _evaluate_dense(method, y, dense, (times[done] - t) / step, out[done])
            done += 1
        for k in range(centers.size):
            center = centers[k]
            closest[k] = min(closest[k], _distance(y_new, center))
            if _radial_rate(y, center) < 0.0 and _radial_rate(y_new, center) > 0.0:
                if not ready:
                    _prepare_dense(method, forces, start + t, y, y_new, step, slopes, dense, work)
                    ready = True
                _close_in(method, y, dense, center, work)
                closest[k] = min(closest[k], _distance(work, center))
        if done == m:
            return OK, t_new
        factor = 10.0 if error == 0.0 else min(10.0, max(0.2, 0.9 * error**exponent))
        h *= min(1.0, factor) if rejected else factor
        rejected = False
        t = t_new
        y[:] = y_new
        slopes[0] = slopes[last]
    return TOO_MANY_STEPS, t
