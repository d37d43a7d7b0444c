"""Search for targets that may have left the field of view, over the set that they can have reached.

A target whose observations find nothing is dark, or it has maneuvered and left the field. With a
share q of trials that found nothing while it was in custody, M trials without a detection have the
probability q^M if it is still there, and 1 if it has gone. A trial is the observations of a target
by an observer in an interval. With the rate of maneuvers this gives the odds that the target has
gone.

A target that has probably gone is represented by particles: maneuvers at times since its last
detection, of sizes with a uniform logarithm and of all directions, and the orbit without a
maneuver. Two observers point, step after step, where most of the weight is within the field. What
they do not find becomes less probable.

Assumptions and limitations
---------------------------
- The observers that search are those that detected the target last.
- Particles cover 5 to 600 m/s, are propagated without the uncertainty of the orbit before, and are
  a low-discrepancy sequence, so that there are no random numbers.
- Measurements arrive at once and have the identity of their targets.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.stats import qmc

from cislunar.dynamics.bundle import propagate_bundle
from cislunar.dynamics.forces import of_targets
from cislunar.dynamics.maneuvers import VELOCITY_UNIT_M_S
from cislunar.observation.records import Measurements, rows_of
from cislunar.observation.scene import Scene
from cislunar.observation.sightline import unit_vectors
from cislunar.runtime import Array, Flags, Indices

_SIZES_M_S = 5.0, 600.0
_PARTICLES, _TIMES, _CENTERS = 1024, 16, 256
"""Numbers of particles, of their times, and of particles that are tried as centers of a field."""

_NOT_FOUND = 0.1
"""Factor on the weight of what a field has not shown."""

SEARCHING = 2
"""Number of observers that search for a target at a time."""

_GONE = 1.0
"""Odds from which on a target is searched for."""

_TRIALS = 2
"""Least number of trials without a detection."""

_STRIDE_S = 240.0


class Particles(NamedTuple):
    """What a target may have done: states (particle, 6) at the time `index`, weights, times of the
    maneuvers and changes of velocity (particle, 3), nondimensional, propagation frame."""

    index: int
    state: Array
    weight: Array
    time: Indices
    change: Array


class ReachableSearch:
    """Search of one realization.

    Parameters
    ----------
    scene : Scene
    forces : NamedTuple
        Assumed force model.
    half_field : ndarray, shape (observer,)
        Half the fields of view, rad.
    n_targets : int
    share : float
        Largest share of all observations that search.
    maneuvers_per_day : float
        Expected number of maneuvers of a target in a day.

    Attributes
    ----------
    lost : dict of int to Particles
        Targets that are searched for.
    """

    def __init__(
        self,
        scene: Scene,
        forces: tuple,
        half_field: Array,
        n_targets: int,
        share: float,
        maneuvers_per_day: float,
    ) -> None:
        self._scene, self._forces, self._half_field = scene, forces, half_field
        self._share, self._rate = share, maneuvers_per_day
        n_observers = scene.observer_position.shape[0]
        self._hits, self._misses, self._run = np.zeros((3, n_targets))
        self.seen = np.full((n_targets, n_observers), -1, dtype=np.int64)
        self.lost: dict[int, Particles] = {}
        self._plan: dict[tuple[int, int], tuple[int, Array]] = {}

    def note(self, measurements: Measurements, used: Flags, first: int) -> None:
        """Count the trials of the observations of an interval, whose steps begin at the index
        `first`."""
        target, step = rows_of(measurements)
        shape = self.seen.shape
        tried, hit = np.zeros(shape, dtype=bool), np.zeros(shape, dtype=bool)
        tried[target, measurements.observer] = True
        hit[target[used], measurements.observer[used]] = True
        np.maximum.at(self.seen, (target[used], measurements.observer[used]), first + step[used])
        found, missed = hit.sum(axis=1), (tried & ~hit).sum(axis=1)
        # a target that is found again was dark meanwhile
        run = self._run + missed
        self._hits += found
        self._misses += np.where(found > 0, run, 0.0)
        self._run = np.where(found > 0, 0.0, run)

    def odds(self, now: int) -> Array:
        """Odds, per target, that it has gone; 0 for one that has never been detected."""
        last = self.seen.max(axis=1)
        days = (now - last) * self._scene.step_s / 86400.0
        dark = (self._misses + 1.0) / (self._hits + self._misses + 2.0)
        return np.where(last < 0, 0.0, self._rate * days * dark**-self._run)

    def gone(self, now: int) -> Indices:
        """Targets that have probably gone and are not searched for yet, the most probable first."""
        odds = self.odds(now)
        found = (odds > _GONE) & (self._run >= _TRIALS)
        found[list(self.lost)] = False
        some = np.flatnonzero(found)
        return some[np.argsort(-odds[some], kind="stable")]

    def begin(self, target: int, base: tuple[int, Array], now: int) -> None:
        """Search for a target, whose orbit had the mean (6,) of `base` at its index."""
        first, mean = base
        step = self._scene.step
        alone = of_targets(self._forces, np.array([target]))
        start = first * step
        path = propagate_bundle(mean[None], step, now - first, forces=alone, start=start)[0]
        u = qmc.Sobol(4, scramble=False).random(_PARTICLES) + 0.5 / _PARTICLES
        low, high = np.log(_SIZES_M_S)
        size = np.exp(low + (high - low) * u[:, 0]) / VELOCITY_UNIT_M_S
        height, longitude = 2.0 * u[:, 1] - 1.0, 2.0 * np.pi * u[:, 2]
        flat = np.sqrt(1.0 - height**2)
        way = np.column_stack([flat * np.cos(longitude), flat * np.sin(longitude), height])
        change = size[:, None] * way
        several = np.linspace(first, now - 1, _TIMES).astype(np.int64)
        time = several[(_TIMES * u[:, 3]).astype(np.int64)]
        state = path[time - first].copy()
        state[:, 3:] += change
        for each in np.unique(time):
            own = time == each
            state[own] = self._moved(target, state[own], int(each), now)
        odds = self.odds(now)[target]
        weight = np.full(_PARTICLES, odds / (1.0 + odds) / _PARTICLES)
        stay = (path[-1:], [1.0 / (1.0 + odds)], [now - 1], np.zeros((1, 3)))
        parts = (state, weight, time, change), stay
        self.lost[target] = Particles(now, *map(np.concatenate, zip(*parts, strict=True)))

    def _moved(self, target: int, state: Array, first: int, last: int) -> Array:
        """States of one target propagated between two times."""
        if last <= first:
            return state
        count = int(np.ceil((last - first) * self._scene.step_s / _STRIDE_S))
        forces = of_targets(self._forces, np.full(state.shape[0], target))
        dt, start = (last - first) * self._scene.step / count, first * self._scene.step
        return propagate_bundle(state, dt, count, forces=forces, start=start)[:, -1]

    def command(self, now: int, n_steps: int) -> Indices:
        """Observations of the next steps that search: step, observer and target of each, shape (n,
        3)."""
        self._plan = {}
        steps = self.rounds(n_steps)
        each, rows, begin = max(1, steps // max(1, len(self.lost))), [], 0
        for target in self.lost:
            stop = min(begin + each, steps)
            if begin < stop:
                rows += self._pointed(target, range(begin, stop), now)
            begin = stop
        return np.array(rows, dtype=np.int64).reshape(-1, 3)

    def rounds(self, n_steps: int) -> int:
        """Number of steps, among some, at which there is a search."""
        observers = min(SEARCHING, self._half_field.size)
        return min(n_steps, int(self._share * self._half_field.size * n_steps) // observers)

    def _pointed(self, target: int, steps: range, now: int) -> list[tuple[int, int, int]]:
        """Point at a target's particles over some steps."""
        given, middle = self.lost[target], now + 1 + steps[len(steps) // 2]
        state = self._moved(target, given.state, given.index, middle)
        weight = np.where(np.isfinite(state).all(axis=1), given.weight, 0.0)
        latest = np.argsort(-self.seen[target], kind="stable")[:SEARCHING]
        # the first points of a low-discrepancy sequence have a low discrepancy, every n-th do not
        centers = np.append(np.arange(_CENTERS), weight.size - 1)
        rows = []
        for step in steps:
            for observer in latest.tolist():
                k = now + 1 + step
                away = np.nan_to_num(state[:, :3]) - self._scene.observer_position[observer, k]
                away /= np.linalg.norm(away, axis=1)[:, None]
                within = away[centers] @ away.T >= np.cos(self._half_field[observer])
                best = int(np.argmax(within @ weight))
                self._plan[k, observer] = target, away[centers[best]]
                weight = np.where(within[best], _NOT_FOUND * weight, weight)
                rows.append((step, observer, target))
        self.lost[target] = given._replace(index=middle, state=state, weight=weight / weight.sum())
        return rows

    def shown(self, measurements: Measurements, first: int) -> tuple[Flags, Flags]:
        """Which observations are of targets that are searched for, and which of them show their
        target within the field, shape (row,) each. The steps begin at the index `first`."""
        target, step = rows_of(measurements)
        of_lost = np.isin(target, list(self.lost))
        found = np.zeros(target.size, dtype=bool)
        for row in np.flatnonzero(of_lost):
            k, o = first + int(step[row]), int(measurements.observer[row])
            planned, way = self._plan.get((k, o), (-1, None))
            ra, dec = measurements.value[row, 1:]
            if planned == target[row] and np.isfinite(ra):
                body = unit_vectors(ra, dec)
                seen = self._scene.observer_axes[k].T @ body
                found[row] = seen @ way >= np.cos(self._half_field[o])
        return of_lost, found

    def end(self, target: int, measured: tuple[int, int, Array]) -> dict[int, Array]:
        """End the search for a target that was found at a time by an observer at right ascension
        and declination (2,); time and change of velocity of the particle nearest to it."""
        k, observer, (ra, dec) = measured
        given = self.lost.pop(target)
        state = self._moved(target, given.state, given.index, max(k, given.index))
        body = unit_vectors(ra, dec)
        seen = self._scene.observer_axes[k].T @ body
        away = np.nan_to_num(state[:, :3]) - self._scene.observer_position[observer, k]
        near = int(np.argmax(away @ seen / np.linalg.norm(away, axis=1)))
        self._run[target] = 0.0
        return {int(given.time[near]): given.change[near]}
