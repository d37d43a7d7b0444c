"""Orbits by least squares from angles, with full covariance, under any force model.

Levenberg-Marquardt iterations (Marquardt 1963, J. SIAM 11, 431) minimize the squared residuals of
all directions, in their variances, over the six components of the state at an epoch. Derivatives
come from the state transition matrix. Components are those along and across the first line of
sight, and the normal equations are scaled to a unit diagonal, since angles determine the range less
well than the direction by many orders of magnitude. The covariance is the inverse of the normal
matrix at the solution (Tapley, Schutz & Born 2004, Statistical Orbit Determination, section 4.3).

The result of a fit to other directions may be a prior of the state at the epoch: its squared
normalized distance is added to the squared residuals (Tapley, Schutz & Born 2004, section 4.4).

A residual is the offset of the predicted direction in the plane tangent to the sphere at the
measured one. Derivatives neglect those of the light time, which are below 1e-4 of the others.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cislunar.compiled import njit, njit_noalloc
from cislunar.dynamics import EARTH_MOON, require_span
from cislunar.dynamics.adaptive import DOP853, OK, integrate
from cislunar.errors import ConfigurationError
from cislunar.estimation.triangular import cholesky, solve_lower, solve_transposed
from cislunar.orbit_determination.angles import Angles, frame_rate, require_order
from cislunar.runtime.arguments import Array, Indices, array_of, indices_of

CONVERGED, NOT_CONVERGED, SINGULAR, NOT_PROPAGATED = 0, 1, 2, 3
"""Status of a fit. The normal matrix of a singular one has no inverse in double precision; the
start of one that is not propagated meets a body or is not in front of an observer."""

_TOLERANCE = 1e-11
"""Of the propagation; its error of some meters in a week is below those of angles."""

_DONE = 1e-6
"""Decrease of chi squared, as predicted by the normal equations, at which a fit has converged."""

_ABANDON_AFTER = 4
"""Iterations after which a fit is abandoned if its chi squared is too large."""

_LEAST_PIVOT = 1e-15
"""Least pivot of a scaled normal matrix that is not singular in double precision."""


class OrbitFits(NamedTuple):
    """Least-squares solutions.

    Attributes
    ----------
    epoch : ndarray, shape (fit,)
        Nondimensional, since the epoch of the force model.
    state : ndarray, shape (fit, 6)
        Nondimensional, propagation frame.
    covariance : ndarray, shape (fit, 6, 6)
        Of the state, nondimensional, propagation frame; NaN unless the fit has converged.
    root : ndarray, shape (fit, 6, 6)
        A factor of the covariance, root^T root, whose small singular values are accurate where
        those of the covariance are lost to rounding. NaN unless the fit has converged.
    chi_squared : ndarray, shape (fit,)
        Squared residuals in variances; infinite if the start cannot be propagated.
    degrees : ndarray of int, shape (fit,)
        Degrees of freedom: twice the number of rows, less six; with a prior, those of both.
    status : ndarray of int, shape (fit,)
        CONVERGED, NOT_CONVERGED, SINGULAR or NOT_PROPAGATED.
    begin : ndarray of int, shape (fit + 1,)
    row : ndarray of int, shape (n,)
        Rows ``begin[k]:begin[k + 1]`` of it are the rows of angles of fit k.
    position : ndarray, shape (n, 3)
        Of the object at each row of angles, when its light left it, relative to the observer;
        nondimensional, propagation frame.
    """

    epoch: Array
    state: Array
    covariance: Array
    root: Array
    chi_squared: Array
    degrees: Indices
    status: Indices
    begin: Indices
    row: Indices
    position: Array

    def detections(self, k: int) -> Indices:
        """Rows of the angles that fit k uses."""
        return self.row[self.begin[k] : self.begin[k + 1]]

    def updated(self, which: ArrayLike, state: Array, covariance: Array) -> "OrbitFits":
        """Fits with other states (m, 6) and covariances (m, 6, 6) of some orbits (m,)."""
        states, covariances, roots = (each.copy() for each in self[1:4])
        value, axes = np.linalg.eigh(covariance)
        states[which], covariances[which] = state, covariance
        roots[which] = np.sqrt(np.maximum(value, 0.0))[:, :, None] * axes.swapaxes(1, 2)
        return self._replace(state=states, covariance=covariances, root=roots)

    def take(self, which: ArrayLike) -> "OrbitFits":
        """Some of the fits, in the order of their indices."""
        chosen = np.atleast_1d(np.asarray(which, dtype=np.int64))
        parts = [np.arange(self.begin[k], self.begin[k + 1]) for k in chosen]
        members = np.concatenate([np.empty(0, dtype=np.int64), *parts])
        begin = np.concatenate([[0], np.cumsum([part.size for part in parts])]).astype(np.int64)
        return OrbitFits(
            *(each[chosen] for each in self[:7]), begin, self.row[members], self.position[members]
        )


@njit_noalloc
def _factor(normal, scale, damping, root):
    """Cholesky factor of a normal matrix that is scaled to a unit diagonal, with damping added to
    it; false if there is none."""
    n = scale.size
    for i in range(n):
        if not normal[i, i] > 0.0:
            return False
        scale[i] = 1.0 / np.sqrt(normal[i, i])
    for i in range(n):
        for j in range(i + 1):
            root[i, j] = normal[i, j] * scale[i] * scale[j]
        root[i, i] += damping
    return cholesky(root)


@njit(cache=True, error_model="numpy")
def _evaluate(forces, rate, data, rows, prior, state, axes, work, normal, gradient, position):
    """Chi squared of a state; normal matrix and gradient along `axes`. Infinite if the state cannot
    be propagated or an observer looks away from it. `prior` is the epoch, a state, and a matrix
    whose product with the distance from this state is standardized."""
    epoch, center, weight = prior
    time, observer_position, direction, white, drift, delay = data
    elapsed, path, nothing = work
    n = rows.size
    # derivatives by the components along the axes
    y = np.zeros(42)
    y[:6] = state
    for i in range(6):
        for c in range(3):
            y[6 + 6 * (c + i // 3 * 3) + i] = axes[i % 3, c]
    first = 0
    while first < n and time[rows[first]] < epoch:
        first += 1
    for k in range(first):
        elapsed[k] = time[rows[first - 1 - k]] - epoch
    for k in range(first, n):
        elapsed[k] = time[rows[k]] - epoch
    for low, high in ((0, first), (first, n)):
        if high > low:
            status, _ = integrate(
                DOP853, forces, epoch, y, elapsed[low:high], _TOLERANCE, _TOLERANCE,
                path[low:high], nothing, nothing,
            )  # fmt: skip
            if status != OK:
                return np.inf
    normal[:] = 0.0
    gradient[:] = 0.0
    total = 0.0
    partial, slope = np.empty(3), np.empty(6)
    for a in range(6):
        error = 0.0
        for i in range(6):
            error += weight[a, i] * (state[i] - center[i])
            slope[i] = 0.0
            for c in range(3):
                slope[i] += weight[a, c + i // 3 * 3] * axes[i % 3, c]
        for i in range(6):
            gradient[i] -= slope[i] * error
            for j in range(i + 1):
                normal[i, j] += slope[i] * slope[j]
        total += error * error
    for q in range(n):
        k = first - 1 - q if q < first else q
        row, here = rows[q], path[k]
        v = here[3] - rate * here[1], here[4] + rate * here[0], here[5]
        distance = 0.0
        for c in range(3):
            position[q, c] = here[c] - observer_position[row, c]
            distance += position[q, c] ** 2
        lag = delay * np.sqrt(distance)
        along = 0.0
        for c in range(3):
            position[q, c] -= lag * (v[c] + drift[row, c])
            along += position[q, c] * direction[row, c]
        if not along > 0.0:
            return np.inf
        squared = 0.0
        for a in range(2):
            error = 0.0
            for c in range(3):
                error += white[row, a, c] * position[q, c]
            error /= along
            for c in range(3):
                partial[c] = (white[row, a, c] - error * direction[row, c]) / along
            for i in range(6):
                slope[i] = 0.0
                for c in range(3):
                    slope[i] += partial[c] * here[6 + 6 * c + i]
                gradient[i] -= slope[i] * error
                for j in range(i + 1):
                    normal[i, j] += slope[i] * slope[j]
            squared += error * error
        total += squared
    return total


@njit(cache=True, error_model="numpy")
def _fit_all(forces, rate, data, begin, row, prior, axes, limits, out):
    """Fit every start in place; see `fit_orbits`. The Cholesky factor of the normal matrix along
    the axes is returned for each fit that has converged."""
    state, factor, chi_squared, status, position = out
    most, abandon_above = limits
    epoch, center, weight = prior
    longest = 0
    for k in range(epoch.size):
        longest = max(longest, begin[k + 1] - begin[k])
    work = np.empty(longest), np.empty((longest, 42)), np.empty(0)
    normals, gradients = np.empty((2, 6, 6)), np.empty((2, 6))
    positions, root = np.empty((2, longest, 3)), np.zeros((6, 6))
    scale, step, trial = np.empty(6), np.empty(6), np.empty(6)
    for k in range(epoch.size):
        rows = row[begin[k] : begin[k + 1]]
        n, now = rows.size, 0
        known = epoch[k], center[k], weight[k]
        best = _evaluate(
            forces, rate, data, rows, known, state[k], axes[k], work, normals[0], gradients[0],
            positions[0],
        )  # fmt: skip
        chi_squared[k] = best
        if not np.isfinite(best):
            status[k] = NOT_PROPAGATED
            continue
        damping, growth, code = 1e-3, 4.0, NOT_CONVERGED
        for iteration in range(most):
            if iteration == _ABANDON_AFTER and best > abandon_above:
                break
            if not _factor(normals[now], scale, damping, root):
                code = SINGULAR
                break
            for i in range(6):
                step[i] = gradients[now, i] * scale[i]
            solve_lower(root, step)
            solve_transposed(root, step)
            gain = 0.0
            for i in range(6):
                step[i] *= scale[i]
                gain += step[i] * (gradients[now, i] + damping * step[i] / scale[i] ** 2)
            if gain < _DONE:
                code = CONVERGED
                break
            for c in range(6):
                trial[c] = state[k, c]
                for m in range(3):
                    trial[c] += axes[k, m, c % 3] * step[m + c // 3 * 3]
            value = _evaluate(
                forces, rate, data, rows, known, trial, axes[k], work, normals[1 - now],
                gradients[1 - now], positions[1 - now],
            )  # fmt: skip
            if value < best:
                # the faster, the better the prediction (Nielsen 1999, IMM-REP-1999-05)
                ratio = (best - value) / gain
                damping = max(damping * max(1.0 / 10.0, 1.0 - (2.0 * ratio - 1.0) ** 3), 1e-14)
                growth, best, now = 4.0, value, 1 - now
                state[k] = trial
            else:
                damping *= growth
                growth *= 2.0
                if damping > 1e12:
                    break
        if code == CONVERGED:
            regular = _factor(normals[now], scale, 0.0, root)
            for i in range(6):
                regular = regular and root[i, i] ** 2 > _LEAST_PIVOT
                for j in range(i + 1):
                    factor[k, i, j] = root[i, j] / scale[i]
            code = CONVERGED if regular else SINGULAR
        chi_squared[k], status[k] = best, code
        position[begin[k] : begin[k + 1]] = positions[now, :n]


def fit_orbits(
    angles: Angles,
    rows: list[ArrayLike],
    state: ArrayLike,
    epoch: ArrayLike,
    *,
    forces: tuple = EARTH_MOON,
    iterations: int = 40,
    abandon_above: float = np.inf,
    prior: OrbitFits | None = None,
) -> OrbitFits:
    """Fit orbits to sets of directions, each from a start of its own.

    Parameters
    ----------
    angles : Angles
    rows : list of array_like of int
        Rows of the angles of each fit in increasing order; at least three without a prior.
    state : array_like, shape (fit, 6)
        Starts, nondimensional, propagation frame.
    epoch : array_like, shape () or (fit,)
        Times of the starts and of the solutions, nondimensional.
    forces : NamedTuple
        Force model.
    iterations : int
        Largest number of Levenberg-Marquardt iterations of a fit.
    abandon_above : float
        Chi squared above which a fit is abandoned after four iterations.
    prior : OrbitFits, optional
        Fits to other rows at the same epochs, one for each fit: their states and covariances are
        further measurements, and their chi squared and degrees of freedom are added, but not their
        rows, on which `log_evidence` depends. A prior that has not converged does not count.

    Returns
    -------
    OrbitFits
        A fit that does not converge has its status and no covariance.

    Raises
    ------
    ConfigurationError
        If a fit has fewer than three rows and no prior, rows do not exist or do not increase,
        shapes or epochs disagree, or the force model does not cover the times.
    """
    given = array_of("state", state, finite=False)
    if given.size and given.shape != (6,):
        array_of("state", given, ("fit", 6), finite=False)
    starts = given.reshape(-1, 6).copy()
    parts = [np.ravel(each) for each in rows]
    if len(parts) != len(starts):
        raise ConfigurationError(
            f"rows: sets {len(parts)}, states {len(starts)}; give one set of rows for each state"
        )
    usable = np.zeros(len(starts), dtype=bool) if prior is None else prior.status == CONVERGED
    if usable.shape != (len(starts),):
        raise ConfigurationError(f"prior: {usable.size} fits; give one for each state")
    for k, part in enumerate(parts):
        if part.size < 3 - 2 * usable[k]:
            needed = "a prior needs one" if usable[k] else "six components need at least three"
            raise ConfigurationError(f"fit {k} has {part.size} directions; {needed}")
    times = array_of("epoch", epoch)
    times = np.broadcast_to(times, len(starts)) if times.shape in ((), (1,)) else times
    epochs = array_of("epoch", times, (len(starts),)).copy()
    if prior is not None and not np.array_equal(epochs[usable], prior.epoch[usable]):
        raise ConfigurationError("prior: the epochs of the fits differ; give those of the prior")
    begin = np.concatenate([[0], np.cumsum([part.size for part in parts])]).astype(np.int64)
    row = indices_of("rows", np.concatenate([np.empty(0), *parts]), angles.time.size)
    increases = np.diff(row) > 0
    increases[begin[1:-1] - 1] = True  # from one fit to the next
    if not np.all(increases):
        raise ConfigurationError("rows of a fit do not increase; sort them and use each once")
    in_order = np.diff(angles.time[row]) >= 0.0
    in_order[begin[1:-1] - 1] = True
    if not np.all(in_order):
        require_order(angles.time)
    n, m = len(starts), row.size
    out = OrbitFits(
        epochs, starts, np.full((n, 6, 6), np.nan), np.full((n, 6, 6), np.nan),
        np.full(n, np.inf), 2 * np.diff(begin) - 6, np.full(n, NOT_PROPAGATED), begin, row,
        np.full((m, 3), np.nan),
    )  # fmt: skip
    if n == 0:
        return out
    lowest = min(epochs.min(), angles.time[row].min())
    require_span(forces, lowest, max(epochs.max(), angles.time[row].max()))
    first = row[begin[:-1]]
    axes = np.concatenate([angles.direction[first][:, None], angles.basis[first]], axis=1)
    used, at = np.unique(row, return_inverse=True)
    own = angles.rows(used)
    # products of these vectors with an offset over the range are standardized errors
    white = np.linalg.solve(np.linalg.cholesky(own.covariance), own.basis)
    data = (
        own.time, own.observer_position, own.direction, white, own.origin_velocity,
        float(angles.light_delay),
    )  # fmt: skip
    factor, center, weight = np.zeros((n, 6, 6)), np.zeros((n, 6)), np.zeros((n, 6, 6))
    if prior is not None:
        center[usable] = prior.state[usable]
        try:
            weight[usable] = np.linalg.inv(prior.root[usable].swapaxes(1, 2))
        except np.linalg.LinAlgError:
            raise ConfigurationError(
                "prior: a covariance is singular; give a regular one"
            ) from None
    _fit_all(
        forces, frame_rate(forces), data, begin, at, (epochs, center, weight), axes,
        (int(iterations), float(abandon_above)),
        (out.state, factor, out.chi_squared, out.status, out.position),
    )  # fmt: skip
    if prior is not None:
        out.chi_squared[usable] += prior.chi_squared[usable]
        out.degrees[usable] += 6 + prior.degrees[usable]
    good = out.status == CONVERGED
    root = np.linalg.inv(factor[good]).reshape(-1, 6, 2, 3) @ axes[good][:, None]
    out.root[good] = root = root.reshape(-1, 6, 6)
    out.covariance[good] = root.swapaxes(1, 2) @ root
    return out
