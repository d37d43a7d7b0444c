"""Every observer with a catalogue of its own, made of its own measurements alone.

Each has an estimator of all targets. What is handed on of a target is either what the observer
knows that knows it best, by the determinant of its covariance of position and velocity, or what
their covariance intersection says, which is at least as much. Attitude and angular velocity are
those of the observer that knows the attitude best, by its own deviations.

Assumptions and limitations
---------------------------
- Catalogues are compared at every step and at each tasking epoch, and nothing of that goes back to
  the observers: their estimates stay their own.
- Observers that have used no measurement of a target know what all knew at the epoch. They count
  only where there is none that has.
"""

from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cislunar.errors import ConfigurationError
from cislunar.estimation.estimator import (
    HEALTHY,
    Estimates,
    Estimator,
    EstimatorFactory,
    Prediction,
)
from cislunar.estimation.fusion.intersection import best_of, intersect
from cislunar.estimation.fusion.ways import FUSIONS
from cislunar.observation.body_spread import BodySpread
from cislunar.observation.records import Measurements, rows_of

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


class Catalogues:
    """An `Estimator` made of one for each observer.

    Parameters
    ----------
    estimators : sequence of Estimator
        By observer.
    fusion : str
        One of `cislunar.estimation.fusion.ways.FUSIONS` but for the common one.
    """

    def __init__(self, estimators: Sequence[Estimator], fusion: str) -> None:
        self._own, self._several = list(estimators), fusion == "covariance-intersection"
        shape = len(self._own), self._own[0].failed.size
        self._informed = np.zeros(shape, dtype=bool)

    @property
    def failed(self) -> NDArray[np.uint8]:
        """Per target, 0 or, if no observer has an estimate any more, why."""
        codes = np.array([own.failed for own in self._own])
        return np.where(np.any(codes == HEALTHY, axis=0), HEALTHY, codes[0]).astype(np.uint8)

    @property
    def counters(self) -> NDArray[np.int64]:
        """Counts per target, of all observers together; see `Estimator.counters`."""
        return np.sum([own.counters for own in self._own], axis=0)

    @property
    def unknowns(self) -> BodySpread:
        """Nothing but the motion is estimated."""
        return BodySpread()

    def predict(self) -> Prediction:
        """What is known at the next measurement time; the estimators do not move on."""
        known = [own.predict() for own in self._own]
        mean = np.array([each.translation for each in known])[:, :, None]
        covariance = np.array([each.covariance for each in known])[:, :, None]
        fused, spread = self._fused(mean, covariance, np.where(self._informed, 0, 1))
        return Prediction(known[0].index, fused[:, 0], spread[:, 0])

    def advance(self, measurements: Measurements, *, covariance: bool = False) -> Estimates:
        """Work through the next steps; see `Estimator.advance`."""
        target, step = rows_of(measurements)
        used, several = np.empty(step.size, dtype=bool), []
        n_steps = measurements.offset.shape[1] - 1
        since = np.where(self._informed, 0, n_steps)
        for o, own in enumerate(self._own):
            rows = measurements.observer == o
            several.append(own.advance(measurements.where(rows), covariance=True))
            used[rows] = several[-1].used
        np.minimum.at(since, (measurements.observer[used], target[used]), step[used])
        self._informed |= since < n_steps
        mean, spreads = (
            np.array([getattr(each, name) for each in several])
            for name in ("translation", "covariance")
        )
        fused, spread = self._fused(mean, spreads, since)
        sigma = np.array([each.sigma for each in several])
        unsure = np.prod(sigma[..., :3], axis=-1)
        counts = _informed_at(since, n_steps) & np.isfinite(unsure)
        who = np.argmin(np.where(counts, unsure, np.inf), axis=0)
        quaternion, rate, deviations = (
            np.take_along_axis(each, who[None, ..., None], axis=0)[0]
            for each in (
                np.array([each.quaternion for each in several]),
                np.array([each.angular_velocity for each in several]),
                sigma,
            )
        )
        deviations[..., 6:] = np.sqrt(np.diagonal(spread, axis1=-2, axis2=-1))
        kept = spread if covariance else spread[:, :0]
        return Estimates(quaternion, rate, fused, deviations, kept, used)

    def _fused(
        self, mean: Array, covariance: Array, since: NDArray[np.int64]
    ) -> tuple[Array, Array]:
        """Mean (target, step, 6) and covariance of what is handed on."""
        shape = mean.shape[1:3]
        fused, spread = np.empty((*shape, 6)), np.empty((*shape, 6, 6))
        _fuse(mean, covariance, since, self._several, fused, spread)
        return fused, spread


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
        n_observers = scene.observer_position.shape[0]
        given = sensor, initial
        return Catalogues(
            [factory(scene, surfaces, *given, own, forces) for own in rng.spawn(n_observers)],
            fusion,
        )

    return make
