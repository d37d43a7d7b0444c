"""Adaptive Runge-Kutta kernels for the CR3BP, compiled.

Two embedded pairs with dense output: Dormand-Prince 5(4), the propagator of Paul & Fan
(table 1), and DOP853 (Dormand-Prince 8(5,3)) for periodic orbits and their monodromy. The
tableaus are those of `scipy.integrate.RK45` and `scipy.integrate.DOP853`; step-size control
follows Hairer, Norsett & Wanner, "Solving Ordinary Differential Equations I", section II.4.

A vector of 6 entries is a state; one of 42 is a state followed by the state transition matrix
(STM), row by row, whose variational equations are integrated along with it.
"""

import numpy as np
from numba import njit
from scipy.integrate import DOP853, RK45

from cislunar.dynamics.cr3bp import acceleration, hessian

DOPRI5, DOP853_METHOD = 0, 1
OK, STEP_UNDERFLOW, TOO_MANY_STEPS = 0, 1, 2
MAX_STEPS = 2_000_000

_A5 = np.zeros((6, 6))
_A5[:, :5] = RK45.A
_B5 = np.ascontiguousarray(RK45.B)
_E5 = np.ascontiguousarray(RK45.E)
_P5 = np.ascontiguousarray(RK45.P)

_A8 = np.zeros((16, 16))
_A8[:12, :12] = DOP853.A
_A8[12, :12] = DOP853.B
_A8[13:] = DOP853.A_EXTRA
# First nonzero column after column 0, row by row: the columns between are all zero.
_FIRST8 = np.array([1 + np.argmax(np.append(row[1:], 1.0) != 0.0) for row in _A8])
_ERR3 = np.ascontiguousarray(DOP853.E3)
_ERR5 = np.ascontiguousarray(DOP853.E5)
_D8 = np.ascontiguousarray(DOP853.D)


@njit(cache=True, error_model="numpy")
def derivative(y, dy, mu):
    """Time derivative of a state (6) or of a state and its STM (42), written into `dy`."""
    dy[0] = y[3]
    dy[1] = y[4]
    dy[2] = y[5]
    dy[3], dy[4], dy[5] = acceleration(y[0], y[1], y[2], y[3], y[4], mu)
    if y.size == 6:
        return
    uxx, uyy, uzz, uxy, uxz, uyz = hessian(y[0], y[1], y[2], mu)
    # dPhi/dt = A Phi with A = [[0, I], [U_rr, 2J]]: three copied rows, three short products.
    for j in range(6, 12):
        px, py, pz = y[j], y[j + 6], y[j + 12]
        vx, vy, vz = y[j + 18], y[j + 24], y[j + 30]
        dy[j] = vx
        dy[j + 6] = vy
        dy[j + 12] = vz
        dy[j + 18] = uxx * px + uxy * py + uxz * pz + 2.0 * vy
        dy[j + 24] = uxy * px + uyy * py + uyz * pz - 2.0 * vx
        dy[j + 30] = uxz * px + uyz * py + uzz * pz


@njit(cache=True, error_model="numpy")
def _stage(y, h, slopes, row, first, count, work, mu):
    """Slope of one stage: f(y + h sum_j row[j] slopes[j]) into slopes[count].

    Coefficients from 1 to `first` - 1 are zero and skipped.
    """
    n = y.size
    if n == 6:
        # Six running sums in registers: a state alone is what campaigns propagate most.
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
        ax, ay, az = acceleration(y0, y1, y2, y3, y4, mu)
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
    derivative(work, slopes[count], mu)


@njit(cache=True, error_model="numpy")
def try_step(method, y, h, slopes, y_new, mu, rtol, atol):
    """Take one trial step.

    Parameters
    ----------
    method : int
        `DOPRI5` or `DOP853_METHOD`.
    y : ndarray, shape (n,)
        Start, n = 6 or 42.
    h : float
        Step, either sign.
    slopes : ndarray, shape (16, n)
        Stage slopes; row 0 must hold f(y) and the row after the last stage receives f(y_new).
    y_new : ndarray, shape (n,)
        Receives the end.
    mu, rtol, atol : float
        Mass ratio and tolerances.

    Returns
    -------
    float
        Error norm; the step is acceptable below 1.
    """
    n = y.size
    if method == DOPRI5:
        for s in range(1, 6):
            _stage(y, h, slopes, _A5[s], 1, s, y_new, mu)
        _stage(y, h, slopes, _B5, 1, 6, y_new, mu)
        total = 0.0
        for i in range(n):
            e = 0.0
            for j in range(7):
                e += _E5[j] * slopes[j, i]
            e *= h / (atol + rtol * max(abs(y[i]), abs(y_new[i])))
            total += e * e
        return np.sqrt(total / n)
    for s in range(1, 13):
        _stage(y, h, slopes, _A8[s], _FIRST8[s], s, y_new, mu)
    total3 = 0.0
    total5 = 0.0
    for i in range(n):
        e3 = 0.0
        e5 = 0.0
        for j in range(12):
            e3 += _ERR3[j] * slopes[j, i]
            e5 += _ERR5[j] * slopes[j, i]
        scale = 1.0 / (atol + rtol * max(abs(y[i]), abs(y_new[i])))
        e3 *= scale
        e5 *= scale
        total3 += e3 * e3
        total5 += e5 * e5
    if total5 == 0.0:
        return 0.0
    return abs(h) * total5 / np.sqrt((total5 + 0.01 * total3) * n)


@njit(cache=True, error_model="numpy")
def prepare_dense(method, y, y_new, h, slopes, dense, work, mu):
    """Coefficients of the continuous extension over an accepted step, into `dense` (7, n)."""
    n = y.size
    if method == DOPRI5:
        for p in range(4):
            for i in range(n):
                c = 0.0
                for j in range(7):
                    c += _P5[j, p] * slopes[j, i]
                dense[p, i] = h * c
        return
    for s in range(13, 16):
        _stage(y, h, slopes, _A8[s], _FIRST8[s], s, work, mu)
    for i in range(n):
        delta = y_new[i] - y[i]
        dense[0, i] = delta
        dense[1, i] = h * slopes[0, i] - delta
        dense[2, i] = 2.0 * delta - h * (slopes[12, i] + slopes[0, i])
    for p in range(4):
        for i in range(n):
            c = 0.0
            for j in range(16):
                c += _D8[p, j] * slopes[j, i]
            dense[3 + p, i] = h * c


@njit(cache=True, error_model="numpy")
def evaluate_dense(method, y, dense, fraction, out):
    """Continuous extension at a fraction (0 to 1) of the step, into `out` (n,)."""
    rest = 1.0 - fraction
    for i in range(y.size):
        if method == DOPRI5:
            value = dense[3, i]
            for p in range(2, -1, -1):
                value = value * fraction + dense[p, i]
            out[i] = y[i] + value * fraction
        else:
            value = dense[6, i] * fraction
            for p in range(5, -1, -1):
                value = (value + dense[p, i]) * (fraction if p % 2 == 0 else rest)
            out[i] = y[i] + value


@njit(cache=True, error_model="numpy")
def initial_step(method, y, slope, span, mu, rtol, atol, work, work_slope):
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
    derivative(work, work_slope, mu)
    d2 = 0.0
    for i in range(n):
        d2 += ((work_slope[i] - slope[i]) / (atol + abs(y[i]) * rtol)) ** 2
    d2 = np.sqrt(d2 / n) / h0
    exponent = 0.2 if method == DOPRI5 else 0.125
    steepest = max(d1, d2)
    h1 = (0.01 / steepest) ** exponent if steepest > 1e-15 else max(1e-6, 1e-3 * h0)
    return min(100.0 * h0, h1, abs(span))


@njit(cache=True, error_model="numpy")
def _close_in(method, y, dense, primary_x, point):
    """Bisect a step for the least distance to a primary; `point` is left there."""
    low = 0.0
    high = 1.0
    for _ in range(45):
        middle = 0.5 * (low + high)
        evaluate_dense(method, y, dense, middle, point)
        if _radial_rate(point, primary_x) < 0.0:
            low = middle
        else:
            high = middle


@njit(cache=True, error_model="numpy")
def _radial_rate(y, primary_x):
    return (y[0] - primary_x) * y[3] + y[1] * y[4] + y[2] * y[5]


@njit(cache=True, error_model="numpy")
def _distance(y, primary_x):
    return np.sqrt((y[0] - primary_x) ** 2 + y[1] * y[1] + y[2] * y[2])


@njit(cache=True, error_model="numpy")
def integrate(method, y0, times, mu, rtol, atol, out, closest):
    """Integrate from time 0 and evaluate the continuous extension at the wanted times.

    Parameters
    ----------
    method : int
        `DOPRI5` or `DOP853_METHOD`.
    y0 : ndarray, shape (n,)
        Start at time 0, n = 6 or 42.
    times : ndarray, shape (m,)
        Monotone and all of one sign (or zero); the last is where the integration ends.
    mu, rtol, atol : float
        Mass ratio and tolerances.
    out : ndarray, shape (m, n)
        Receives the solution.
    closest : ndarray, shape (2,) or (0,)
        If it has two entries, receives the least distances to the Earth and to the Moon
        (forward integration only).

    Returns
    -------
    status : int
        `OK`, `STEP_UNDERFLOW` or `TOO_MANY_STEPS`.
    t : float
        Time reached.
    """
    n = y0.size
    last = 12 if method == DOP853_METHOD else 6
    exponent = -0.125 if method == DOP853_METHOD else -0.2
    y = y0.copy()
    y_new = np.empty(n)
    work = np.empty(n)
    slopes = np.empty((16, n))
    dense = np.empty((7, n))
    derivative(y, slopes[0], mu)
    track = closest.size == 2
    if track:
        closest[0] = _distance(y, -mu)
        closest[1] = _distance(y, 1.0 - mu)
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
    h = initial_step(method, y, slopes[0], end, mu, rtol, atol, work, slopes[1])
    rejected = False
    for _ in range(MAX_STEPS):
        remaining = abs(end - t)
        h = min(h, remaining)
        # Written so that a NaN (a step into the centre of a primary) also counts as underflow.
        if not h > 4e-16 * max(abs(t), 1e-3):
            return STEP_UNDERFLOW, t
        error = try_step(method, y, h * direction, slopes, y_new, mu, rtol, atol)
        if not error < 1.0:
            h *= max(0.2, 0.9 * error**exponent) if np.isfinite(error) else 0.2
            rejected = True
            continue
        t_new = end if h == remaining else t + h * direction
        wanted = done < m and (t_new - times[done]) * direction >= 0.0
        ready = False
        if wanted and times[done] != t_new:
            prepare_dense(method, y, y_new, h * direction, slopes, dense, work, mu)
            ready = True
        while done < m and (t_new - times[done]) * direction >= 0.0:
            if times[done] == t_new:
                out[done] = y_new
            else:
                fraction = (times[done] - t) / (h * direction)
                evaluate_dense(method, y, dense, fraction, out[done])
            done += 1
        if track:
            for k in range(2):
                centre = -mu if k == 0 else 1.0 - mu
                closest[k] = min(closest[k], _distance(y_new, centre))
                if _radial_rate(y, centre) < 0.0 and _radial_rate(y_new, centre) > 0.0:
                    if not ready:
                        prepare_dense(method, y, y_new, h * direction, slopes, dense, work, mu)
                        ready = True
                    _close_in(method, y, dense, centre, work)
                    closest[k] = min(closest[k], _distance(work, centre))
        if done == m:
            return OK, t_new
        factor = 10.0 if error == 0.0 else min(10.0, max(0.2, 0.9 * error**exponent))
        h *= min(1.0, factor) if rejected else factor
        rejected = False
        t = t_new
        y[:] = y_new
        slopes[0] = slopes[last]
    return TOO_MANY_STEPS, t


@njit(cache=True, error_model="numpy")
def step_dop853(state, dt, mu):
    """One DOP853 step of fixed size, without error control.

    Parameters
    ----------
    state : ndarray, shape (6,) or (42,)
        Nondimensional, rotating frame; 42 entries carry the STM row by row.
    dt : float
        Step, nondimensional.
    mu : float
        Mass ratio.

    Returns
    -------
    ndarray, same shape
    """
    slopes = np.empty((13, state.size))
    y_new = np.empty(state.size)
    derivative(state, slopes[0], mu)
    for s in range(1, 13):
        _stage(state, dt, slopes, _A8[s], _FIRST8[s], s, y_new, mu)
    return y_new
