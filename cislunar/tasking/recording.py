"""What a run keeps: pieces of its histories, and on request truth, estimates, measurements ..."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

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
        What became of it, index into `cislunar.tasking.realization.FATE_NAMES`.
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
        its target, rad; NaN for an observer that is idle or turns.
    visible : ndarray of bool, shape (seed, epoch, target)
        Whether any observer could have found the target in the interval, at its true brightness
        and without noise.
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
    visible: NDArray[np.bool_] | None = None


class Piece(NamedTuple):
    """What a run keeps of consecutive intervals of one seed.

    Attributes
    ----------
    seed : int
        Index of the realization.
    places : dict
        Where along "epoch", "step" and "time" (the recorded steps) of the run it lies, as slices.
    kept : dict
        By the names of `cislunar.tasking.closed_loop.LoopResult` and of `Records`: along which of
        these, and the values, shape (that, ...).
    looks : Looks or None
        Those of these intervals, if they were asked for.
    """

    seed: int
    places: dict[str, slice]
    kept: dict[str, tuple[str, NDArray]]
    looks: Looks | None = None


def joined(pieces: Sequence[Piece]) -> Piece:
    """Pieces that follow each other, as one."""
    first, last = pieces[0], pieces[-1]
    places = {
        along: slice(place.start, last.places[along].stop) for along, place in first.places.items()
    }
    kept = {
        name: (along, np.concatenate([piece.kept[name][1] for piece in pieces]))
        for name, (along, _) in first.kept.items()
    }
    return Piece(first.seed, places, kept, joined_looks([piece.looks for piece in pieces]))


def joined_looks(parts: Sequence[Looks | None]) -> Looks | None:
    """Looks one after the other, if there were any to keep."""
    if not parts or parts[0] is None:
        return None
    return Looks(*map(np.concatenate, zip(*parts, strict=True)))


def fill(whole: Mapping[str, Any], piece: Piece) -> None:
    """Put a piece into arrays (or variables of an open file) that hold all of a run, by name."""
    for name, (along, values) in piece.kept.items():
        whole[name][piece.seed, piece.places[along]] = values


def gathered(
    pieces: Iterable[Piece], n_seeds: int, lengths: Mapping[str, int]
) -> tuple[dict[str, NDArray], Looks | None]:
    """All pieces of a run as arrays, shape (seed, ...), and its looks."""
    whole: dict[str, NDArray] = {}
    looks = []
    for piece in pieces:
        for name, (along, values) in piece.kept.items():
            if name not in whole:
                whole[name] = np.empty((n_seeds, lengths[along], *values.shape[1:]), values.dtype)
        fill(whole, piece)
        looks.append(piece.looks)
    return whole, joined_looks(looks)


def interval_records(
    start: int,
    seed: int,
    looking: NDArray[np.int64],
    motion: Truth,
    estimates: Estimates,
    measurements: Measurements,
    fate: NDArray[np.uint8],
    settings: LoopSettings,
    scene: Scene,
) -> tuple[dict[str, tuple[str, NDArray]], Looks | None]:
    """What `settings.record` asks for of the steps from `start` on, as in `Piece`.

    `looking` (step, observer) has the targets looked at or -1; `motion` begins a step before the
    first.
    """
    asked = settings.record
    steps = settings.recorded_within(start, measurements.offset.shape[1] - 1)
    found: dict[str, Array] = {}
    if "truth" in asked:
        found |= {f"true_{name}": getattr(motion, name)[:, steps + 1] for name in _MOTION}
    if "estimates" in asked:
        found |= {name: getattr(estimates, name)[:, steps] for name in _MOTION}
    if "covariance" in asked:
        found["covariance"] = estimates.covariance[:, steps]
    if "pointing" in asked:
        found["pointing"] = _pointing(start, steps, looking[steps], estimates, scene)
    looks = None
    if "measurements" in asked:
        target, step = rows_of(measurements)
        rest = measurements.observer, measurements.value, measurements.variance, fate
        looks = Looks(np.full(target.size, seed), start + step, target, *rest)
    return {name: ("time", values.swapaxes(0, 1)) for name, values in found.items()}, looks


def _pointing(
    start: int,
    steps: NDArray[np.int64],
    looking: NDArray[np.int64],
    estimates: Estimates,
    scene: Scene,
) -> Array:
    """Angles (observer, time, 2) at some steps after `start`, towards the targets of each then."""
    place = estimates.translation[looking.T, steps, :3]
    # index 0 of the scene is the epoch, without a measurement
    at = start + steps + 1
    way = place - scene.observer_position[:, at]
    x, y, z = np.einsum("tij,otj->iot", scene.observer_axes[at], way)
    angles = np.stack([np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))], axis=-1)
    return np.where((looking.T >= 0)[..., None], angles, np.nan)


_MOTION = ("translation", "quaternion", "angular_velocity")
