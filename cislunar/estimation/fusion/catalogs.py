"""A catalog for every observer, made from its own measurements alone (docs/tasking.md).

Assumptions and limitations
---------------------------
- Estimates are fused at every step and at each tasking epoch. Observers receive nothing back.
- The estimate of an observer without a used measurement of a target is that of the start. It counts
  only if no observer has used one.
- Tracks cannot be added or removed during a run.
- Force models per target, which a filter with the instantaneous-frame CR3BP has for low lunar
  orbits, are not supported.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.compiled import njit
from cislunar.errors import ConfigurationError
from cislunar.estimation.estimator import (
    HEALTHY,
    NOT_FINITE,
    Estimates,
    Estimator,
    EstimatorFactory,
    InitialEstimate,
    Prediction,
    abilities_of,
)
from cislunar.estimation.fusion.intersection import best_of, intersect
from cislunar.estimation.fusion.methods import FUSIONS
from cislunar.observation.records import Measurements, no_measurements, rows_of
from cislunar.observation.scene import Scene
from cislunar.observation.sensor import Sensor
from cislunar.observation.target_surfaces import TargetSurfaces, surfaces_of
from cislunar.runtime import Array
from cislunar.runtime.arguments import require_choice


@njit(cache=True, error_model="numpy")
def _fuse(mean, covariance, since, several, fused, spread):
    """Fuse all targets at all steps into `fused` (target, step, 6) and `spread`. `mean` and
    `covariance` have the dimensions (observer, target, step, ...); `since` (observer, target) is
    the step from which on an observer is informed."""
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
    """An observer's estimator of the targets that it first observed in one interval."""

    observer: int
    targets: NDArray[np.int64]
    estimator: Estimator


class _Catalogs:
    """An `Estimator` made of the estimators of single observers: `make` returns an estimator of
    some of the targets, shape (target,), at the start. A target enters an observer's catalog with
    the first observation; before, an estimator without any measurements has the same estimate."""

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
        self._observed, self._informed = np.zeros((2, n_observers, n_targets), dtype=bool)

    @property
    def failed(self) -> NDArray[np.uint8]:
        """Per target, 0 or, if no observer has an estimate, the reason."""
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

    def predict(self) -> Prediction:
        """See `Estimator.predict`."""
        blind = self._blind.predict()
        known = [(group, group.estimator.predict()) for group in self._groups]
        mean, covariance = (
            self._by_observer(getattr(blind, name), known, name)[:, :, None]
            for name in ("translation", "covariance")
        )
        fused, spread = self._fused(mean, covariance, np.where(self._informed, 0, 1))
        return Prediction(blind.index, fused[:, 0], spread[:, 0])

    def advance(
        self,
        measurements: Measurements,
        *,
        covariance: bool = False,
        histories: bool = True,
        final: bool = True,
    ) -> Estimates:
        """See `Estimator.advance`; the estimates at all steps are needed in any case."""
        target, step = rows_of(measurements)
        observer, n_steps = measurements.observer, measurements.offset.shape[1] - 1
        self._open(target, observer)
        used = np.zeros(step.size, dtype=bool)
        blind = self._blind.advance(measurements.where(used), covariance=True, final=final)
        known = []
        for group in self._groups:
            rows = (observer == group.observer) & np.isin(target, group.targets)
            own = measurements.where(rows)
            own = own._replace(offset=np.ascontiguousarray(own.offset[group.targets]))
            known.append((group, group.estimator.advance(own, covariance=True, final=final)))
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

    def correct(self, shift: Array, covariance: Array) -> NDArray[np.bool_]:
        """Raise ConfigurationError: see `Estimator.correct`."""
        raise ConfigurationError("fusion: orbits are corrected with fusion = 'common' only")

    def add(self, *_: object, **__: object) -> None:
        """Raise ConfigurationError: see `Estimator.add`."""
        raise ConfigurationError("fusion: tracks are added with fusion = 'common' only")

    def remove(self, targets: ArrayLike) -> None:
        """Raise ConfigurationError: see `Estimator.remove`."""
        raise ConfigurationError("fusion: tracks are removed with fusion = 'common' only")

    def _open(self, target: NDArray[np.int64], observer: NDArray[np.int64]) -> None:
        """Add estimators of targets that observers observe for the first time."""
        observed_now = np.zeros_like(self._observed)
        observed_now[observer, target] = True
        for o, new in enumerate(observed_now & ~self._observed):
            if new.any():
                targets = np.flatnonzero(new)
                own = self._make(targets)
                own.advance(no_measurements(targets.size, self._steps))
                self._groups.append(_Group(o, targets, own))
        self._observed |= observed_now

    def _by_observer(self, blind: Array, known: Sequence[tuple], name: str) -> Array:
        """Values (observer, target, ...): those of `known` where there are any, else `blind`."""
        out = np.repeat(blind[None], self._observed.shape[0], axis=0)
        for group, estimates in known:
            out[group.observer, group.targets] = getattr(estimates, name)
        return out

    def _fused(
        self, mean: Array, covariance: Array, since: NDArray[np.int64]
    ) -> tuple[Array, Array]:
        """Mean (target, step, 6) and covariance of the fused estimates."""
        shape = mean.shape[1:3]
        fused, spread = np.empty((*shape, 6)), np.empty((*shape, 6, 6))
        _fuse(mean, covariance, since, self._several, fused, spread)
        return fused, spread


def _informed_at(since: NDArray[np.int64], n_steps: int) -> NDArray[np.bool_]:
    """Whether an observer counts (observer, target, step): it is informed, or the first if none
    is."""
    informed = since[..., None] <= np.arange(n_steps)
    informed[0] |= ~informed.any(axis=0)
    return informed


def catalogs(factory: EstimatorFactory, fusion: str) -> EstimatorFactory:
    """Factory of estimators with a catalog for every observer.

    Parameters
    ----------
    factory : EstimatorFactory
        Factory of the observers' estimators, which estimate no body parameters.
    fusion : {"common", "alone", "covariance-intersection"}
        Fused estimate: that of the best observer, or the covariance intersection of all. "common"
        returns `factory`: one estimator of all measurements.
    """
    require_choice("fusion", fusion, FUSIONS)
    if fusion == "common":
        return factory
    abilities = abilities_of(factory)
    if abilities.estimated_parameters:
        raise ConfigurationError(
            f"fusion = {fusion!r}: body parameters are estimated with fusion = 'common' only"
        )

    if abilities.chooses_models:
        raise ConfigurationError(
            f"fusion = {fusion!r}: models of bodies are chosen with fusion = 'common' only"
        )

    def make(scene, surfaces, sensor, initial, rng, forces):
        some = partial(_of_some, factory, scene, surfaces, sensor, initial, rng, forces)
        counts = scene.observer_position.shape[0], initial.translation.shape[0]
        return _Catalogs(some, *counts, fusion)

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
    """Make an estimator of some of the targets."""
    own = surfaces_of(surfaces, targets)
    return factory(scene, own, sensor, initial.of_targets(targets), rng.spawn(1)[0], forces)
