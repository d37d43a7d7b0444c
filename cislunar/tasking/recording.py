"""What a run keeps on request: truth, estimates, covariance, measurements, pointing."""

from collections import defaultdict
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.estimation.estimator import Estimates
from cislunar.observation.records import Measurements, rows_of
from cislunar.observation.scene import Scene
from cislunar.tasking.settings import LoopSettings
from cislunar.tasking.simulation import Truth

Array = NDArray[np.float64]


class Looks(NamedTuple):
    """All looks of all seeds, by seed, interval, target and step; arrays, shape (row, ...).

    Attributes
    ----------
    seed, step, target, observer : ndarray of int
        Indices; step 0 is the first measurement time.
    value, variance : ndarray, shape (row, 3)
        As in `cislunar.observation.records.Measurements`; NaN where nothing was found.
    fate : ndarray of uint8
        What became of it, index into `cislunar.tasking.closed_loop.FATE_NAMES`.
    """

    seed: NDArray[np.int64]
    step: NDArray[np.int64]
    target: NDArray[np.int64]
    observer: NDArray[np.int64]
    value: Array
    variance: Array
    fate: NDArray[np.uint8]


class Records(NamedTuple):
    """What was asked for, None for what was not; times are the recorded ones.

    Attributes
    ----------
    true_translation, translation : ndarray, shape (seed, time, target, 6)
        True and estimated states, nondimensional, rotating frame. Estimates are those after the
        update, NaN after the end of a failed one.
    true_quaternion, quaternion : ndarray, shape (seed, time, target, 4)
        Inertial to body.
    true_angular_velocity, angular_velocity : ndarray, shape (seed, time, target, 3)
        rad/s, body frame.
    covariance : ndarray, shape (seed, time, target, 6, 6)
        Of the estimated translation.
    looks : Looks
        The measurements of all steps.
    pointing : ndarray, shape (seed, time, observer, 2)
        Right ascension and declination, in the observer's body frame, of the estimated place of
        its target, rad; NaN for an idle observer.
    """

    true_translation: Array | None = None
    true_quaternion: Array | None = None
    true_angular_velocity: Array | None = None
    translation: Array | None = None
    quaternion: Array | None = None
    angular_velocity: Array | None = None
    covariance: Array | None = None
    looks: Looks | None = None
    pointing: Array | None = None


class Recorder:
    """Gathers the `Records` of a run, interval by interval, seed by seed."""

    def __init__(self, settings: LoopSettings, scene: Scene) -> None:
        self._asked, self._recorded, self._scene = settings.record, settings.recorded, scene
        self._seeds: list[dict[str, list[Array]]] = []
        self._looks: list[Looks] = []

    def next_seed(self) -> None:
        """What follows is of another seed."""
        self._seeds.append(defaultdict(list))

    def interval(
        self,
        start: int,
        assigned: NDArray[np.int64],
        motion: Truth,
        estimates: Estimates,
        measurements: Measurements,
        fate: NDArray[np.uint8],
    ) -> None:
        """Add the steps from `start` on; `assigned` has the target of each observer or -1."""
        if not self._asked:
            return
        stop = start + measurements.offset.shape[1] - 1
        some = slice(*np.searchsorted(self._recorded, [start, stop]))
        steps, kept = self._recorded[some], self._seeds[-1]
        # index 0 of truth and scene is the epoch, without a measurement
        known = {
            "truth": {f"true_{name}": getattr(motion, name)[:, steps + 1] for name in _MOTION},
            "estimates": {name: getattr(estimates, name)[:, steps - start] for name in _MOTION},
            "pointing": {"pointing": self._pointing(start, steps, assigned, estimates)},
        }
        if "covariance" in self._asked:
            known["covariance"] = {"covariance": estimates.covariance[:, steps - start]}
        for name in {*self._asked} & {*known}:
            for key, values in known[name].items():
                kept[key].append(values.swapaxes(0, 1))
        if "measurements" in self._asked:
            target, step = rows_of(measurements)
            seed = np.full(target.size, len(self._seeds) - 1)
            rest = measurements.observer, measurements.value, measurements.variance, fate
            self._looks.append(Looks(seed, start + step, target, *rest))

    def _pointing(
        self,
        start: int,
        steps: NDArray[np.int64],
        assigned: NDArray[np.int64],
        estimates: Estimates,
    ) -> Array:
        """Angles (observer, time, 2) at some steps."""
        place = estimates.translation[assigned][:, steps - start, :3]
        way = place - self._scene.observer_position[:, steps + 1]
        x, y, z = np.einsum("tij,otj->iot", self._scene.observer_axes[steps + 1], way)
        angles = np.stack([np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))], axis=-1)
        return np.where((np.asarray(assigned) >= 0)[:, None, None], angles, np.nan)

    def result(self) -> Records:
        """All of it."""
        found = {
            key: np.array([np.concatenate(seed[key]) for seed in self._seeds])
            for key in self._seeds[0]
        }
        if self._looks:
            found["looks"] = Looks(*map(np.concatenate, zip(*self._looks, strict=True)))
        return Records(**found)


_MOTION = ("translation", "quaternion", "angular_velocity")
