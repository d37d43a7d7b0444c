"""Pieces of the histories of a run: made interval by interval, concatenated and collected."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.estimation.estimator import Estimates
from cislunar.estimation.navigation.errors import N_PARAMETERS, ObserverEstimate
from cislunar.observation import Measurements, Scene, angles_of_vectors, rows_of
from cislunar.runtime import Array
from cislunar.tasking.histories import HISTORIES, ObservationLog
from cislunar.tasking.settings import LoopSettings
from cislunar.tasking.state import Realization, SimulationInputs
from cislunar.tasking.truth import Truth


class Piece(NamedTuple):
    """The histories of consecutive intervals of one realization.

    Attributes
    ----------
    seed : int
        Index of the realization.
    extent : dict of str to slice
        Extent of the piece along "epoch", "step" and "time" (the recorded times) of the run.
    kept : dict of str to ndarray
        Values by the names of `cislunar.tasking.histories.HISTORIES`, shape (time axis, ...).
    observations : ObservationLog or None
    """

    seed: int
    extent: dict[str, slice]
    kept: dict[str, NDArray]
    observations: ObservationLog | None = None


def concatenate(pieces: Sequence[Piece]) -> Piece:
    """Concatenate pieces that follow each other, some of which may lack values of the epochs."""
    first, last = pieces[0], pieces[-1]
    extent = {
        along: slice(part.start, last.extent[along].stop) for along, part in first.extent.items()
    }
    kept = {
        name: np.concatenate([piece.kept[name] for piece in pieces if name in piece.kept])
        for name in last.kept
    }
    log = _concatenate_logs([piece.observations for piece in pieces])
    return Piece(first.seed, extent, kept, log)


def _concatenate_logs(logs: Sequence[ObservationLog | None]) -> ObservationLog | None:
    """Concatenate logs of observations; None if the run records none."""
    if not logs or logs[0] is None:
        return None
    return ObservationLog(*map(np.concatenate, zip(*logs, strict=True)))


def fill(whole: Mapping[str, Any], piece: Piece) -> None:
    """Put a piece into arrays (or variables of an open file) of the whole run, by name."""
    for name, values in piece.kept.items():
        whole[name][piece.seed, piece.extent[HISTORIES[name].along]] = values


def collect(
    pieces: Iterable[Piece], n_seeds: int, lengths: Mapping[str, int]
) -> tuple[dict[str, NDArray], ObservationLog | None]:
    """Collect all pieces of a run: arrays of shape (seed, time axis, ...), and its observations."""
    whole: dict[str, NDArray] = {}
    logs = []
    for piece in pieces:
        for name, values in piece.kept.items():
            if name not in whole:
                shape = n_seeds, lengths[HISTORIES[name].along], *values.shape[1:]
                whole[name] = np.empty(shape, values.dtype)
        fill(whole, piece)
        logs.append(piece.observations)
    return whole, _concatenate_logs(logs)


def recorded_motion(
    names: Collection[str],
    start: int,
    target_by_step: NDArray[np.int64],
    motion: Truth,
    estimates: Estimates,
    settings: LoopSettings,
    scene: Scene,
) -> dict[str, Array]:
    """Values (time, ...) of motion, covariance and pointing of the steps from `start` on. `names`
    has the histories that are kept, `target_by_step` (step, observer) the target of each observer
    or -1; `motion` begins one step before the first."""
    steps = settings.recorded_within(start, target_by_step.shape[0])
    found: dict[str, Array] = {}
    for name in ("translation", "quaternion", "angular_velocity"):
        if f"true_{name}" in names:
            found[f"true_{name}"] = getattr(motion, name)[:, steps + 1]
        if f"estimated_{name}" in names:
            found[f"estimated_{name}"] = getattr(estimates, name)[:, steps]
    if "covariance" in names:
        found["covariance"] = estimates.covariance[:, steps]
    if "pointing" in names:
        found["pointing"] = _pointing(start, steps, target_by_step[steps], estimates, scene)
    return {name: values.swapaxes(0, 1) for name, values in found.items()}


def tested_maneuvers(inputs: SimulationInputs, own: Realization) -> dict[str, list[Array]]:
    """Values of the histories of the tests for maneuvers."""
    if not inputs.abilities.tests_maneuvers:
        return {}
    found = own.estimator.tested_maneuvers()
    index, tested = (
        np.where(each < 0, np.nan, inputs.scene.step_s * each)
        for each in (found.index, found.tested)
    )
    return {
        "maneuver_alarm": [found.statistic > own.estimator.maneuver_threshold],
        "maneuver_statistic": [found.statistic],
        "maneuver_estimated_time": [index],
        "maneuver_tested_time": [tested],
        "maneuver_estimate": [found.impulse_m_s],
        "maneuver_estimate_covariance": [found.covariance],
    }


def observer_errors(
    inputs: SimulationInputs, own: Realization, index: int
) -> dict[str, list[Array]]:
    """Values of the histories of the observers' errors, true at a time of the scene."""
    if "observers" not in inputs.settings.record:
        return {}
    shape = inputs.scene.observer_position.shape[0], N_PARAMETERS
    true = np.zeros(shape) if own.observers is None else own.observers.at(index)
    nothing = ObserverEstimate(np.full(shape, np.nan), np.full((*shape, N_PARAMETERS), np.nan))
    treated = getattr(own.estimator, "observers", None)
    found = nothing if treated is None else treated()
    return {
        "observer_error": [true],
        "estimated_observer_error": [found.mean],
        "observer_error_covariance": [found.covariance],
    }


def observation_log(
    start: int, seed: int, measurements: Measurements, outcome: NDArray[np.uint8]
) -> ObservationLog:
    """Log of the observations of the steps from `start` on, of realization number `seed`."""
    target, step = rows_of(measurements)
    rest = measurements.observer, measurements.value, measurements.variance, outcome
    return ObservationLog(np.full(target.size, seed), start + step, target, *rest)


def _pointing(
    start: int,
    steps: NDArray[np.int64],
    target_by_step: NDArray[np.int64],
    estimates: Estimates,
    scene: Scene,
) -> Array:
    """Angles (observer, time, 2) toward the estimated targets at some steps after `start`."""
    position = estimates.translation[target_by_step.T, steps, :3]
    # index 0 of the scene is the epoch, without a measurement
    at = start + steps + 1
    way = position - scene.observer_position[:, at]
    angles = angles_of_vectors(np.einsum("tij,otj->oti", scene.observer_axes[at], way))
    return np.where((target_by_step.T >= 0)[..., None], angles, np.nan)
