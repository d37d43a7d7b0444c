"""Every observer with a catalogue of its own, made of its own measurements alone.

Each has an estimator of the targets it has looked at. What is handed on of a target is either what
the observer knows that knows it best, by the determinant of its covariance of position and
velocity, or what their covariance intersection says, which is at least as much. Attitude and
angular velocity are those of the observer that knows the attitude best, by its own deviations.

Assumptions and limitations
---------------------------
- Catalogues are compared at every step and at each tasking epoch, and nothing of that goes back to
  the observers: their estimates stay their own.
- Observers that have used no measurement of a target know what all knew at the epoch. They count
  only where there is none that has.
- Targets have no force models of their own, as a filter of the CR3BP among the bodies as they are
  has for low lunar orbits.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cislunar.errors import ConfigurationError
from cislunar.estimation.estimator import (
    HEALTHY,
    NOT_FINITE,
    Estimates,
    Estimator,
    EstimatorFactory,
    InitialEstimate,
    Prediction,
)
from cislunar.estimation.fusion.intersection import best_of, intersect
from cislunar.estimation.fusion.ways import FUSIONS
from cislunar.observation.body_spread import BodySpread
from cislunar.observation.records import Measurements, rows_of
from cislunar.observation.scene import Scene, TargetSurfaces
from cislunar.observation.sensor import Sensor

Array = NDArray[np.float64]


@njit(cache=True, error_model="numpy")
def _fuse(mean, covariance, since, several, fused, spread):
    """Fuse all targets at all steps into `fused` (target, step, 6) and `spread`.

    Of (observer, target, step, ...) are `mean` and `covariance`; `since` (observer, target) has the
    step from which on an observer is informed.
    """
    n_observers, n_targets, n_steps = mean.shape[:3]
    informed = np.empty(n_observers, np.bool_)
    for j in range(n_targets):
        weight = np.full(n_observers, 1.0 / n_observers)
        for i in range(n_steps):
            for o in range(n_observers):
                informed[o] = since[o, j] <= i
            if not np.any(informed):
                informed[0] = True
            means, covariances = mean[:, j, i].copy(), covariance[:, j, i].copy()
            best = best_of(covariances, informed)
            if best < 0:
                fused[j, i], spread[j, i] = np.nan, np.nan
            elif several:
                intersect(means, covariances, informed, weight, fused[j, i], spread[j, i])
            else:
                fused[j, i], spread[j, i] = means[best], covariances[best]


class _Group(NamedTuple):
    """An observer's estimator of the targets, rising, that it first looked at in one interval."""

    observer: int
    targets: NDArray[np.int64]
    estimator: Estimator


class Catalogues:
    """An `Estimator` made of those of single observers.

    A target enters an observer's catalogue with the first look; up to then the estimator that has
    no measurements at all knows as much.

    Parameters
    ----------
    make : callable
        Gives an estimator, at the epoch, of some of the targets, shape (target,).
    n_observers, n_targets : int
    fusion : str
        One of `cislunar.estimation.fusion.ways.FUSIONS` but for the common one.
    """

    def __init__(
        self,
        make: Callable[[NDArray[np.int64]], Estimator],
        n_observers: int,
        n_targets: int,
        fusion: str,
    ) -> None:
        self._make, self._several = make, fusion == "covariance-intersection"
        self._blind, self._steps = make(np.arange(n_targets)), 0
        self._groups: list[_Group] = []
        self._looked, self._informed = np.zeros((2, n_observers, n_targets), dtype=bool)

    @property
    def failed(self) -> NDArray[np.uint8]:
        """Per target, 0 or, if nobody has an estimate any more, why."""
        left = self._blind.failed.copy()
        left[self._informed.any(axis=0)] = NOT_FINITE
        for group in self._groups:
            good = group.estimator.failed == HEALTHY
            left[group.targets[good]] = HEALTHY
        return left

    @property
    def counters(self) -> NDArray[np.int64]:
        """Counts per target, of all observers together; see `Estimator.counters`."""
        total = self._blind.counters.copy()
        for group in self._groups:
            total[group.targets] += group.estimator.counters
        return total

    @property
    def unknowns(self) -> BodySpread:
        """Nothing but the motion is estimated."""
        return BodySpread()

    def predict(self) -> Prediction:
        """What is known at the next measurement time; the estimators do not move on."""
        blind = self._blind.predict()
        known = [(group, group.estimator.predict()) for group in self._groups]
        mean, covariance = (
            self._by_observer(getattr(blind, name), known, name)[:, :, None]
            for name in ("translation", "covariance")
        )
        fused, spread = self._fused(mean, covariance, np.where(self._informed, 0, 1))
        return Prediction(blind.index, fused[:, 0], spread[:, 0])

    def advance(self, measurements: Measurements, *, covariance: bool = False) -> Estimates:
        """Work through the next steps; see `Estimator.advance`."""
        target, step = rows_of(measurements)
        observer, n_steps = measurements.observer, measurements.offset.shape[1] - 1
        self._open(target, observer)
        used = np.zeros(step.size, dtype=bool)
        blind = self._blind.advance(measurements.where(used), covariance=True)
        known = []
        for group in self._groups:
            rows = (observer == group.observer) & np.isin(target, group.targets)
            own = measurements.where(rows)
            own = own._replace(offset=np.ascontiguousarray(own.offset[group.targets]))
            known.append((group, group.estimator.advance(own, covariance=True)))
            used[rows] = known[-1][1].used
        since = np.where(self._informed, 0, n_steps)
        np.minimum.at(since, (observer[used], target[used]), step[used])
        self._informed |= since < n_steps
        self._steps += n_steps
        each = {
            name: self._by_observer(getattr(blind, name), known, name)
            for name in ("quaternion", "angular_velocity", "translation", "sigma", "covariance")
        }
        fused, spread = self._fused(each["translation"], each["covariance"], since)
        unsure = np.prod(each["sigma"][..., :3], axis=-1)
        counts = _informed_at(since, n_steps) & np.isfinite(unsure)
        who = np.argmin(np.where(counts, unsure, np.inf), axis=0)[None, ..., None]
        quaternion, rate, sigma = (
            np.take_along_axis(each[name], who, axis=0)[0]
            for name in ("quaternion", "angular_velocity", "sigma")
        )
        sigma[..., 6:] = np.sqrt(np.diagonal(spread, axis1=-2, axis2=-1))
        kept = spread if covariance else spread[:, :0]
        return Estimates(quaternion, rate, fused, sigma, kept, used)

    def _open(self, target: NDArray[np.int64], observer: NDArray[np.int64]) -> None:
        """Take up targets that observers look at for the first time."""
        looked = np.zeros_like(self._looked)
        looked[observer, target] = True
        for o, new in enumerate(looked & ~self._looked):
            if new.any():
                targets = np.flatnonzero(new)
                own = self._make(targets)
                own.advance(_nothing(targets.size, self._steps))
                self._groups.append(_Group(o, targets, own))
        self._looked |= looked

    def _by_observer(self, blind: Array, known: Sequence[tuple], name: str) -> Array:
        """Values (observer, target, ...) of all: those of `known` where there are any."""
        out = np.repeat(blind[None], self._looked.shape[0], axis=0)
        for group, estimates in known:
            out[group.observer, group.targets] = getattr(estimates, name)
        return out

    def _fused(
        self, mean: Array, covariance: Array, since: NDArray[np.int64]
    ) -> tuple[Array, Array]:
        """Mean (target, step, 6) and covariance of what is handed on."""
        shape = mean.shape[1:3]
        fused, spread = np.empty((*shape, 6)), np.empty((*shape, 6, 6))
        _fuse(mean, covariance, since, self._several, fused, spread)
        return fused, spread


def _nothing(n_targets: int, n_steps: int) -> Measurements:
    """No measurements at so many steps."""
    offset = np.zeros((n_targets, n_steps + 1), dtype=np.int64)
    return Measurements(offset, np.empty(0, dtype=np.int64), *np.empty((2, 0, 3)))


def _informed_at(since: NDArray[np.int64], n_steps: int) -> NDArray[np.bool_]:
    """Who counts (observer, target, step): who is informed, or the first, if there is nobody."""
    informed = since[..., None] <= np.arange(n_steps)
    informed[0] |= ~informed.any(axis=0)
    return informed


def catalogues(factory: EstimatorFactory, fusion: str) -> EstimatorFactory:
    """Factory of estimators of one's own for every observer.

    Parameters
    ----------
    factory : EstimatorFactory
        Of each of them; none that has `unknowns`.
    fusion : {"common", "alone", "covariance-intersection"}
        What is handed on of a target: what the best of them knows, or the intersection of all.
        "common" leaves it at one estimator of all measurements.

    Returns
    -------
    EstimatorFactory

    Raises
    ------
    ConfigurationError
        If there is no such fusion, or more than the motion is to be estimated.
    """
    if fusion not in FUSIONS:
        raise ConfigurationError(f"fusion = {fusion!r} is unknown: use one of {list(FUSIONS)}")
    if fusion == "common":
        return factory
    if getattr(factory, "unknowns", BodySpread()):
        raise ConfigurationError(
            f"fusion = {fusion!r}: unknowns of the targets are estimated in common alone"
        )

    def make(scene, surfaces, sensor, initial, rng, forces):
        some = partial(_of_some, factory, scene, surfaces, sensor, initial, rng, forces)
        counts = scene.observer_position.shape[0], initial.translation.shape[0]
        return Catalogues(some, *counts, fusion)

    return make


def _of_some(
    factory: EstimatorFactory,
    scene: Scene,
    surfaces: TargetSurfaces,
    sensor: Sensor,
    initial: InitialEstimate,
    rng: np.random.Generator,
    forces: tuple,
    targets: NDArray[np.int64],
) -> Estimator:
    """An estimator of some of the targets."""
    own = surfaces_of(surfaces, targets)
    motion = (each[targets] for each in initial[:3])
    begins = InitialEstimate(*motion, initial.sigma)
    return factory(scene, own, sensor, begins, rng.spawn(1)[0], forces)


def surfaces_of(surfaces: TargetSurfaces, targets: NDArray[np.int64]) -> TargetSurfaces:
    """Bodies of some of the targets.

    Parameters
    ----------
    surfaces : TargetSurfaces
    targets : ndarray of int, shape (target,)

    Returns
    -------
    TargetSurfaces
        Theirs, in this order.
    """
    facets, first = _ranges(surfaces.first, targets)
    materials, first_material = _ranges(surfaces.first_material, targets)
    return surfaces._replace(
        areas=surfaces.areas[facets],
        normals=surfaces.normals[facets],
        first=first,
        material=surfaces.material[materials],
        inertia=surfaces.inertia[targets],
        first_material=first_material,
        rows=surfaces.rows[facets],
        shadows=surfaces.shadows._replace(column=surfaces.shadows.column[facets]),
        lengths=surfaces.lengths[targets],
        rough=surfaces.rough[targets],
        phong=surfaces.phong[targets],
    )


def _ranges(first: NDArray[np.int64], targets: NDArray[np.int64]) -> tuple[NDArray, NDArray]:
    """Indices of what some of the targets own, and where each of them begins among those."""
    own = [np.arange(first[j], first[j + 1]) for j in targets]
    starts = np.cumsum([0, *(each.size for each in own)]).astype(np.int64)
    return np.concatenate(own), starts
