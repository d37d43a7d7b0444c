"""A maneuver estimated after an alarm: a bank of times, each with an open change of velocity.

For each hypothesized time, the orbit before follows from the filter without a maneuver. The orbit
after it has the same position, and a velocity to which a change with a normal prior is added. Its
six components are estimated by nonlinear least squares from all later observations
(Levenberg-Marquardt), and the evidence of the time by Laplace's method (MacKay 2003, Information
Theory, Inference, and Learning Algorithms, chapter 27). The solutions form a Gaussian mixture,
together with the orbit without a maneuver. Times are refined around the best of them.

A change v at a time that is off by up to half the spacing w of the times displaces the later
position. The prior covariance of the position is therefore increased by ``v v^T w^2 / 12``, the
variance of a uniform error.

Assumptions and limitations
---------------------------
- Until the maneuver the orbit is that of a filter linearized about its mean, and its distribution
  at the first hypothesized time is normal.
- The target maneuvers at most once between the first hypothesized time and the present.
- After the maneuver, process noise is neglected.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cislunar.dynamics.maneuvers import VELOCITY_UNIT_M_S
from cislunar.errors import ConfigurationError
from cislunar.estimation.linearization import SIZE
from cislunar.estimation.maneuvers.bank_kernels import filter_orbit, normal_equations
from cislunar.observation.scene import Scene
from cislunar.runtime import Array, Indices

_SCALES = np.array([1.0, 500.0]) / VELOCITY_UNIT_M_S
"""Prior standard deviations of a component of the change of velocity, with equal weights."""

_FAR = 10.0
"""Change of velocity, in standard deviations of a prior, from which this prior is negligible."""

_SEVERAL = 7
"""Number of times in a refined grid."""

_LEVELS = 5
"""Largest number of grids."""

_SPREAD = 2.5
"""Effective number of times in the posterior, from which on a grid is fine enough."""

_UNLIKELY = 1e-3
"""Probability of a time below which it bounds the next grid."""

_ITERATIONS = 12
_CONVERGED = 1e-2
"""Largest number of least-squares iterations, and change of chi squared at which they end."""


class AngleRows(NamedTuple):
    """Observations of a target in the order of time: time (row,), an index of the scene; observer
    (row,); right ascension and declination (row, 2), rad, and their variances (row, 2), rad^2."""

    time: Indices
    observer: Indices
    value: Array
    variance: Array


class EstimatedManeuver(NamedTuple):
    """An estimated maneuver.

    Attributes
    ----------
    time_s, time_sigma_s : float
        Since the start of the run, and its standard deviation; s.
    velocity_m_s : ndarray, shape (3,)
        Change of velocity, propagation frame.
    covariance : ndarray, shape (3, 3)
        Its covariance, m^2/s^2.
    probability : float
        Probability that the target has maneuvered.
    """

    time_s: float
    time_sigma_s: float
    velocity_m_s: Array
    covariance: Array
    probability: float


UNKNOWN_MANEUVER = EstimatedManeuver(
    np.nan, np.nan, np.full(3, np.nan), np.full((3, 3), np.nan), np.nan
)


class BankSolution(NamedTuple):
    """State at the present: moments of the mixture (6,) and (6, 6), and the maneuver."""

    translation: Array
    covariance: Array
    maneuver: EstimatedManeuver


class _Component(NamedTuple):
    """A solution: twice the negative logarithm of its evidence; its change of velocity with
    covariance; mean and variance of the time after the hypothesized one, in widths of the time; the
    state then; mean and covariance at the present."""

    evidence: float
    change: Array
    spread: Array
    shift: float
    variance: float
    start: Array
    mean: Array
    covariance: Array


class ManeuverBank:
    """The bank of one target.

    Parameters
    ----------
    scene : Scene
    forces : NamedTuple
        Assumed force model of all targets.
    process : ndarray, shape (6, 6)
        Process noise of a step.
    target : int
        Index among the targets of the force model.
    base : tuple
        Time (an index of the scene), mean (6,) and covariance (6, 6) of the orbit before all
        hypothesized times.
    times : ndarray of int
        First hypothesized times, indices of the scene from that of `base` on.
    maneuvers_per_day : float
        Expected number of maneuvers of a target in a day.
    starts : dict of int to ndarray, optional
        Changes of velocity (3,), nondimensional, by the times at which iterations begin with them.
    """

    def __init__(
        self,
        scene: Scene,
        forces: tuple,
        process: Array,
        target: int,
        base: tuple[int, Array, Array],
        times: Indices,
        maneuvers_per_day: float,
        starts: dict[int, Array] | None = None,
    ) -> None:
        self._model, self._target, self._base = (scene, forces, process), target, base
        self._times, self._rate = np.unique(times), maneuvers_per_day
        self._starts = dict(starts or {})  # changes of velocity of earlier solutions, by time

    def solve(self, rows: AngleRows, now: int) -> BankSolution:
        """The present orbit and the maneuver.

        Parameters
        ----------
        rows : AngleRows
            All observations after the time of `base`, in order of time.
        now : int
            The present, an index of the scene.

        Raises
        ------
        ConfigurationError
            If the rows are not in order of time.
        """
        if np.any(np.diff(rows.time) < 0):
            raise ConfigurationError("rows: sort the observations by time")
        first, mean, covariance = self._base
        steps = now - first + 1
        means, spreads = np.empty((steps, SIZE)), np.empty((steps, SIZE, SIZE))
        before = means, spreads, np.zeros(steps)
        given = mean.copy(), covariance.copy(), rows, *before
        filter_orbit(self._target, self._model, first, *given)
        last = max(first, int(rows.time[-1]) - 1) if rows.time.size else first
        times = np.unique(np.clip(self._times, first, last))
        for level in range(_LEVELS):
            found, width = self._solved(times, rows, now, before), _widths(times)
            weight, none = self._weights(found, width, before[2][-1])
            each = weight.sum(axis=1) / max(weight.sum(), np.finfo(float).tiny)
            fine = level > 0 and _SPREAD * np.sum(each**2) < 1.0
            if fine or width[np.argmax(each)] <= 1.0 or level == _LEVELS - 1:
                break
            likely = np.flatnonzero(each > _UNLIKELY)
            low, high = (0, times.size - 1) if likely.size == 0 else likely[[0, -1]]
            beyond = int(level > 0) * (times[-1] - times[0])
            begin = times[low - 1] if low > 0 else times[0] - beyond
            end = times[high + 1] if high < times.size - 1 else times[-1] + beyond
            grid = np.linspace(max(begin, first), min(end, last), _SEVERAL)
            if each.max() > 0.5:
                # a large change is likely within few steps only, which the grid must not miss
                best, spacing = times[np.argmax(each)], max(grid[1] - grid[0], 1.0)
                edges = (grid[[0, -1]] - best) / spacing
                grid = best + spacing * np.arange(np.floor(edges[0]), np.ceil(edges[1]) + 1.0)
            times = np.unique(np.clip(np.rint(grid).astype(np.int64), first, last))
        return self._combined(times, width, found, weight, none, (means[-1], spreads[-1]))

    def _solved(
        self, times: Indices, rows: AngleRows, now: int, before: tuple[Array, Array, Array]
    ) -> list[list[_Component | None]]:
        """Solutions by time and prior."""
        widths = _widths(times)
        return [
            self._at(
                int(time), width, rows, now, tuple(each[time - self._base[0]] for each in before)
            )
            for time, width in zip(times, widths, strict=True)
        ]

    def _at(
        self, time: int, width: float, rows: AngleRows, now: int, before: tuple[Array, Array, float]
    ) -> list[_Component | None]:
        """Solutions for a maneuver at a time, by prior; None for one that is negligible."""
        mean, covariance, evidence = before
        start = mean
        if self._starts:
            near = min(self._starts, key=lambda each: (abs(each - time), each))
            start = np.concatenate([mean[:3], mean[3:] + self._starts[near]])
        out: list[_Component | None] = [None] * _SCALES.size
        for number in reversed(range(_SCALES.size)):
            # a wider prior says whether this one matters
            if number < _SCALES.size - 1 and _beyond(out[number + 1], _FAR * _SCALES[number]):
                break
            for _ in range(2):
                late = (start[3:] - mean[3:]) * width * self._model[0].step
                given = time, now, rows, mean, covariance, start, _SCALES[number], late
                if (each := self._fitted(*given)) is None:
                    break
                start = each.start
            if each is None:
                continue
            if np.linalg.norm(each.change) < _FAR * _SCALES[-1]:
                self._starts[time] = each.start[3:] - mean[3:]
            out[number] = each._replace(evidence=each.evidence + evidence)
        return out

    def _fitted(
        self,
        time: int,
        now: int,
        rows: AngleRows,
        mean: Array,
        covariance: Array,
        start: Array,
        scale: float,
        late: Array,
    ) -> _Component | None:
        """Least-squares solution of the state after the maneuver; None if there is none. `late`
        (3,) is the displacement between maneuvers at both ends of the time's extent."""
        prior = covariance.copy()
        prior[3:, 3:] += scale**2 * np.eye(3)
        prior[:3, :3] += np.outer(late, late) / 12.0
        unit = np.sqrt(np.diag(prior))
        correlation = prior / np.outer(unit, unit)
        information = np.linalg.inv(correlation)
        state, best, damping = start, np.inf, 1e-6
        for _ in range(_ITERATIONS):
            normal, gradient = np.empty((SIZE, SIZE)), np.empty(SIZE)
            end, path = np.empty(SIZE), np.empty((SIZE, SIZE))
            given = rows, normal, gradient, end, path
            cost = normal_equations(self._target, self._model, time, now, state, *given)
            off = (mean - state) / unit
            cost += off @ information @ off
            if np.isfinite(cost) and cost < best:
                done, best, damping = best - cost < _CONVERGED, cost, 0.1 * damping
                matrix = normal * np.outer(unit, unit) + information
                right = gradient * unit + information @ off
                kept = state, end, path, matrix
                if done:
                    break
            elif not np.isfinite(best):
                return None
            else:
                damping = max(100.0 * damping, 1e-4)
            step = np.linalg.solve(matrix + damping * np.diag(np.diag(matrix)), right)
            if right @ step < _CONVERGED:
                break
            state = kept[0] + unit * step
        state, end, path, matrix = kept
        # to unit diagonal; the time of a maneuver may hardly be determined
        root = 1.0 / np.sqrt(np.diag(matrix))
        scaled = np.outer(root, root) * matrix
        if not np.all(np.isfinite(scaled)) or np.linalg.matrix_rank(scaled, hermitian=True) < SIZE:
            return None
        posterior = np.outer(unit * root, unit * root) * np.linalg.inv(scaled)
        later = rows.time > time
        evidence = best + np.linalg.slogdet(matrix)[1] + np.linalg.slogdet(correlation)[1]
        evidence += np.sum(np.log(rows.variance[later]))
        # change of velocity and time given the state: the rest is the error of the orbit before
        joint = np.zeros((4, SIZE))
        joint[:3, 3:], joint[3, :3] = scale**2 * np.eye(3), -late / 12.0
        gain = joint @ (information / np.outer(unit, unit))
        spread = np.diag([*np.full(3, scale**2), 1.0 / 12.0])
        spread += gain @ (posterior @ gain.T - joint.T)
        *change, shift = gain @ (state - mean)
        return _Component(
            evidence, np.array(change), spread[:3, :3], float(shift), float(spread[3, 3]), state,
            end, path @ posterior @ path.T,
        )  # fmt: skip

    def _weights(
        self, found: list[list[_Component | None]], width: Array, none: float
    ) -> tuple[Array, float]:
        """Posterior weights by time and prior, and of the orbit without a maneuver."""
        value = np.array([[np.inf if c is None else c.evidence for c in each] for each in found])
        days = width * self._model[0].step_s / 86400.0
        prior = self._rate * days / _SCALES.size
        least = min(none, float(value.min()))
        weight = prior[:, None] * np.exp(-0.5 * (value - least))
        rest = np.exp(-0.5 * (none - least))
        total = weight.sum() + rest
        return weight / total, rest / total

    def _combined(
        self,
        times: Indices,
        width: Array,
        found: list[list[_Component | None]],
        weight: Array,
        none: float,
        coasting: tuple[Array, Array],
    ) -> BankSolution:
        """Moments of the mixture."""
        several = [(t, s) for t in range(times.size) for s in range(_SCALES.size)]
        several = [each for each in several if weight[each] > 0.0]
        parts = [found[t][s] for t, s in several]
        w = np.array([weight[each] for each in several])
        means = np.array([*(c.mean for c in parts), coasting[0]])
        spreads = np.array([*(c.covariance for c in parts), coasting[1]])
        translation, covariance = _moments(np.append(w, none), means, spreads)
        if (share := w.sum()) == 0.0:
            return BankSolution(translation, covariance, UNKNOWN_MANEUVER._replace(probability=0.0))
        own = w / share
        changes = np.array([c.change for c in parts]).reshape(-1, 3)
        change, spread = _moments(own, changes, np.array([c.spread for c in parts]))
        step_s = self._model[0].step_s
        extent = np.array([width[t] for t, _ in several])
        at = np.array([times[t] for t, _ in several]) + extent * [c.shift for c in parts]
        within = extent**2 * [c.variance for c in parts]
        middle = own @ at
        sigma = np.sqrt(own @ (within + (at - middle) ** 2))
        # the next solution begins about this one
        near = middle + 1.5 * max(sigma, 1.0) * np.linspace(-2.0, 2.0, _SEVERAL)
        self._times = np.unique(np.maximum(np.rint(near), self._base[0]).astype(np.int64))
        estimate = EstimatedManeuver(
            step_s * middle, step_s * sigma, VELOCITY_UNIT_M_S * change,
            VELOCITY_UNIT_M_S**2 * spread, share,
        )  # fmt: skip
        return BankSolution(translation, covariance, estimate)


def _beyond(found: _Component | None, size: float) -> bool:
    """Whether the change of velocity of a solution is certainly larger than a size."""
    if found is None:
        return False
    least = np.linalg.norm(found.change) - 4.0 * np.sqrt(np.trace(found.spread))
    return bool(least > size)


def _widths(times: Indices) -> Array:
    """Extent of each time of a grid: half the distance of its neighbors, steps."""
    if times.size == 1:
        return np.ones(1)
    middle = 0.5 * (times[1:] + times[:-1])
    ends = np.concatenate([[times[0]], middle, [times[-1]]]).astype(float)
    width = np.diff(ends)
    width[0], width[-1] = 2.0 * width[0], 2.0 * width[-1]
    return width


def _moments(weight: Array, means: Array, covariances: Array) -> tuple[Array, Array]:
    """Mean and covariance of a Gaussian mixture."""
    mean = weight @ means
    off = means - mean
    covariance = np.einsum("m,mij->ij", weight, covariances) + (weight * off.T) @ off
    return mean, 0.5 * (covariance + covariance.T)
