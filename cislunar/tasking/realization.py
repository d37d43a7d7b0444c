"""One realization of a cell: truth, estimator, bound and metrics, from epoch to epoch.

Its state does not grow with the length of the run, except for the light curves of a batch
estimator; histories are returned in pieces.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from cislunar.association.tracks import known_tracks
from cislunar.estimation import Estimates, Prediction, without_dimming
from cislunar.estimation.light_curves.model_selection.characterization import UNIQUE
from cislunar.evaluation import CramerRaoBound, Evaluation
from cislunar.observation import DETECTED, FAINT, NOT_TASKED, OCCULTED, detectable_targets, measure
from cislunar.observation.body_sampling import true_deviations
from cislunar.observation.records import Measurements, highest, pointed_schedule, rows_of
from cislunar.observation.sensor import sensor_limits
from cislunar.observation.sightline import dimming
from cislunar.runtime import Array
from cislunar.tasking.communication import Reception, arrivals
from cislunar.tasking.decision import Decision, decide
from cislunar.tasking.field_observations import associate_interval, observe_field
from cislunar.tasking.histories import kept_histories
from cislunar.tasking.initial_conditions import ESTIMATOR, TASKING, stream
from cislunar.tasking.observer_truth import draw_observer_errors, shifted_angles
from cislunar.tasking.planning import IDLE, LearnedDetection, expected_update
from cislunar.tasking.recording import (
    Piece,
    concatenate,
    observation_log,
    observer_errors,
    recorded_motion,
    tested_maneuvers,
)
from cislunar.tasking.settings import LoopSettings
from cislunar.tasking.state import Realization, SimulationInputs
from cislunar.tasking.truth import Truth, estimation_errors

TARGET_STEPS_AT_ONCE = 1_000_000
"""Targets times steps of an interval that are simulated at once, if it can be divided. It bounds
the memory, about 0.8 kB each."""

USED = DETECTED + 1
"""Outcome of an observation whose measurement was used, in addition to those of
`cislunar.observation.measurement`. A measurement that is pending at the end of its interval counts
as used."""

OUTCOME_NAMES = ("not_tasked", "faint", "excluded", "occulted", "rejected", "used")
"""Names of the detection outcomes. Rejected: outside the field of view, or the estimate had failed.
"""


def start_realization(inputs: SimulationInputs, number: int, seed: int) -> Realization:
    """A realization at the epoch."""
    scene, settings = inputs.scene, inputs.settings
    truth = inputs.truth.sampled(seed, inputs.ids)
    observers = draw_observer_errors(truth.observer_sigma, truth.observer_errors, scene, seed)
    true_scene = scene if observers is None else observers.scene(scene)
    motion = inputs.true_motion(truth, seed)
    variance = truth.noise**2
    if truth.sensor is not None:
        # photon noise is as recorded; the constant noise may differ
        assumed, true = (
            sensor_limits(each, scene.observer_position.shape[0]).noise_variance
            for each in (settings.sensor, truth.sensor)
        )
        variance = true - assumed
    own = stream(ESTIMATOR, seed)
    given = settings.sensor, inputs.initial, own, inputs.forces
    estimator = inputs.factory(scene, inputs.surfaces, *given)
    bound = CramerRaoBound(
        true_scene,
        truth.surfaces,
        inputs.initial.sigma,
        roots=None if inputs.initial.covariance is None else inputs.initial.roots(),
        estimated_parameters=inputs.abilities.estimated_parameters,
        forces=truth.forces,
    )
    evaluation = Evaluation(inputs.ids.size, settings.n_steps, settings.step_s, settings.custody)
    learned = settings.tasking.detection
    detection = None if learned is None else LearnedDetection(learned, inputs.ids.size)
    pointing = np.full(scene.observer_position.shape[0], IDLE, dtype=np.int64)
    reception = None
    if settings.communication.late:
        reception = Reception(
            arrivals(settings.communication, scene),
            settings.steps_between_updates,
            (estimator, bound),
            (scene, true_scene, inputs.surfaces, truth.surfaces, inputs.forces, truth.forces),
            inputs.ids.size,
        )
    return Realization(
        number, seed, truth, variance, motion, estimator, bound, evaluation, detection, pointing,
        reception, known_tracks(inputs.ids.size) if settings.association.in_field else None,
        observers,
    )  # fmt: skip


def advance_interval(inputs: SimulationInputs, own: Realization, number: int) -> Piece:
    """Assign the observers at an epoch and simulate the interval that follows."""
    settings, start = inputs.settings, int(inputs.settings.epochs[number])
    n_steps = min(settings.steps_per_interval, settings.n_steps - start)
    estimated = _received(inputs, own, start)
    prediction = _with_pending(inputs, own, start, estimated)
    tasking = decide(
        prediction, n_steps, inputs.scene, inputs.surfaces, settings,
        inputs.forces, own.detection, own.pointing, stream(TASKING, own.seed, number),
    )  # fmt: skip
    if inputs.abilities.searches_field:
        tasking = tasking.commanding(own.estimator.command_search(n_steps))
    for target in tasking.target:
        own.pointing[:] = np.where(target == IDLE, own.pointing, target)
    divided = inputs.divisible and getattr(type(own.estimator), "divisible", False)
    length = max(1, TARGET_STEPS_AT_ONCE // inputs.ids.size) if divided else n_steps
    parts = []
    for first in range(0, n_steps, length):
        part = tasking._replace(target_by_step=tasking.target_by_step[first : first + length])
        given = own, number, start + first, part, prediction, estimated, first + length >= n_steps
        parts.append(_simulate(inputs, *given))
    return concatenate(parts)


def _simulate(
    inputs: SimulationInputs,
    own: Realization,
    number: int,
    start: int,
    tasking: Decision,
    prediction: Prediction,
    estimated: Prediction,
    final: bool,
) -> Piece:
    """Simulate steps of an interval from the step `start` on. The `final` ones, with which it ends,
    have the values of the epoch."""
    settings, n_steps = inputs.settings, tasking.target_by_step.shape[0]
    motion, dimmed, visible = _moved(inputs, own, start, n_steps)
    selected = own.evaluation.final(n_steps)
    selected[settings.recorded_within(start, n_steps)] = True
    if not settings.association.in_field:
        measurements, outcome = _observed(inputs, own, start, tasking, motion, dimmed)
        shaded = np.zeros(outcome.size, dtype=bool)
        if settings.eclipse:
            given = estimated, inputs.scene, inputs.forces
            measurements, shaded = without_dimming(measurements, *given)
        estimates, least, observed = _judged(
            inputs, own, start, motion, measurements, selected, final
        )
        commanded, of_tracks = np.ones(outcome.size, dtype=bool), {}
    else:
        field = observe_field(inputs, own, start, tasking, prediction, motion, dimmed)
        found = associate_interval(inputs, own, start, n_steps, field)
        measurements, outcome, estimates, commanded = found[:4]
        shaded = np.zeros(outcome.size, dtype=bool)
        least = _bounded(own, motion, measurements.where(estimates.used & found.right), selected)
        observed = found.counts[:, 0] > 0
        of_tracks = found.histories(motion, own.tracks, settings.association.gospa_cutoff_km)
    outcome[estimates.used & (outcome == DETECTED)] = USED
    _report(own, start, tasking, measurements, outcome, commanded, shaded)
    error = estimation_errors(1, motion, estimates)
    known = own.estimator.attitude_status == UNIQUE if inputs.abilities.reports_status else None
    own.evaluation.update(error, estimates.sigma, observed, least, known)
    names = kept_histories(settings, inputs.outputs)
    some = settings.recorded_within(start, n_steps)
    values = {
        "assignment": _in_slots(tasking.target, settings)[None],
        "information": [tasking.information],
        "evaluations": [tasking.evaluations],
        "planning_gap": [tasking.gap],
        "outcome": highest(measurements, outcome, NOT_TASKED).T,
        "error": error[:, some].swapaxes(0, 1),
        "sigma": estimates.sigma[:, some].swapaxes(0, 1),
        "bound": least[:, some].swapaxes(0, 1),
        "pair_information": [tasking.pairs],
        "visible": [visible],
        **_learned(inputs, own),
        **observer_errors(inputs, own, start + n_steps),
        **tested_maneuvers(inputs, own),
        **of_tracks,
        **recorded_motion(
            names, start, tasking.target_by_step, motion, estimates, settings, inputs.scene
        ),
    }
    kept = {
        name: np.asarray(values[name], dtype=each.dtype)
        for name, each in names.items()
        if final or each.along != "epoch"
    }
    log = None
    if "measurements" in settings.record:
        log = observation_log(start, own.number, measurements, outcome)
    stop = start + n_steps
    times = slice(*np.searchsorted(settings.recorded, [start, stop]).tolist())
    extent = {"epoch": slice(number, number + 1), "step": slice(start, stop), "time": times}
    return Piece(own.number, extent, kept, log)


def _learned(inputs: SimulationInputs, own: Realization) -> dict[str, list[Array]]:
    """Values of the histories of learned brightness and estimated body parameters."""
    found: dict[str, list[Array]] = {}
    if own.detection is not None:
        mean, sigma = own.detection.offset()
        found |= {"brightness_offset": [mean], "brightness_offset_sigma": [sigma]}
    prior = inputs.abilities.estimated_parameters
    if prior:
        mean, sigma = own.estimator.learned()
        true = true_deviations(
            prior,
            inputs.surfaces,
            own.truth.surfaces,
            np.full(3, np.nan) if own.truth.torque else own.truth.angular_acceleration,
        )
        found |= {"parameter_error": [true - mean], "parameter_sigma": [sigma]}
        found["searches"] = [own.estimator.searches]
    if inputs.abilities.reports_status:
        found["attitude_status"] = [own.estimator.attitude_status]
    return found


def _in_slots(target: NDArray[np.int64], settings: LoopSettings) -> NDArray[np.int64]:
    """Targets (slot, observer), filled up to the number of slots; without slots (observer,)."""
    if settings.slots is None:
        return target[0]
    missing = settings.slots - target.shape[0]
    return np.pad(target, ((0, missing), (0, 0)), constant_values=IDLE)


def _moved(
    inputs: SimulationInputs, own: Realization, start: int, n_steps: int
) -> tuple[Truth, Array, NDArray[np.bool_] | None]:
    """True motion from the time before the step `start` on, and its dimming by shadows (target,
    time). The last value states which targets any observer could have detected, if that is
    recorded."""
    scene, sensor = inputs.scene, inputs.settings.sensor
    motion = own.motion.advance(n_steps)
    dimmed = np.zeros(motion.noise.shape[:2])
    if inputs.settings.eclipse:
        here = slice(start, start + n_steps + 1)
        given = scene.sun_position[here], scene.primaries[here]
        dimmed = dimming(motion.translation[..., :3], *given)
    visible = None
    if "visibility" in inputs.settings.record:
        true = own.scene(inputs), own.truth.surfaces, sensor, motion.translation, motion.quaternion
        # index 0 of the scene is the start of the run, without a measurement
        visible = detectable_targets(start + 1, *true, origin=start, dimmed=dimmed)
    return motion, dimmed, visible


def _observed(
    inputs: SimulationInputs,
    own: Realization,
    start: int,
    tasking: Decision,
    motion: Truth,
    dimmed: Array,
) -> tuple[Measurements, NDArray[np.uint8]]:
    """Measurements of the tasked targets from the step `start` on, and detection outcomes."""
    scene = own.scene(inputs)
    measurements, outcome = measure(
        start + 1,
        pointed_schedule(tasking.target_by_step, inputs.ids.size),
        scene,
        own.truth.surfaces,
        inputs.settings.sensor,
        motion.translation,
        motion.quaternion,
        motion.noise,
        origin=start,
        true=own.truth.sensor,
        dimmed=dimmed,
    )
    if own.observers is None:
        return measurements, outcome
    target, step = rows_of(measurements)
    rows = measurements.observer, start + 1 + step, motion.translation[target, step + 1]
    offset = own.observers.offsets(scene, *rows)
    return measurements._replace(value=shifted_angles(measurements.value, offset)), outcome


def _report(
    own: Realization,
    start: int,
    tasking: Decision,
    measurements: Measurements,
    outcome: NDArray[np.uint8],
    commanded: NDArray[np.bool_],
    shaded: NDArray[np.bool_],
) -> None:
    """Report the detection outcomes of the tasked targets to the scheduler. A target that was
    outside the field of view was not detected; `shaded` marks those that may be in a shadow."""
    if own.detection is None and own.reception is None:
        return
    target, step = rows_of(measurements)
    reported = np.where(outcome == USED, DETECTED, np.where(outcome == DETECTED, FAINT, outcome))
    # a non-detection in a shadow is no information on the brightness of the target
    reported[shaded & (reported == FAINT)] = OCCULTED
    if own.reception is not None:
        own.reception.note(start, tasking, measurements, reported)
    else:
        rows = target, step, measurements.observer, reported
        tasking.learn(own.detection, *(column[commanded] for column in rows))


def _received(inputs: SimulationInputs, own: Realization, start: int) -> Prediction:
    """Prediction from the measurements received before the step `start`."""
    if own.reception is not None:
        own.reception.receive(start, partial(_worked, inputs, own))
        own.reception.learn(start, own.detection)
    return own.estimator.predict()


def _with_pending(
    inputs: SimulationInputs, own: Realization, start: int, prediction: Prediction
) -> Prediction:
    """Prediction on which tasking is based: with the expected effect of pending measurements. The
    learned detection is told of them as well."""
    settings = inputs.settings
    if own.reception is None or not settings.communication.use_pending_measurements:
        return prediction
    if own.detection is not None:
        own.reception.expect(own.detection)
    observations = own.reception.pending(start, own.detection)
    return expected_update(
        prediction, observations, inputs.scene, settings.sensor, settings.tasking, inputs.forces
    )


def _worked(
    inputs: SimulationInputs,
    own: Realization,
    motion: Truth,
    measurements: Measurements,
    selected: NDArray[np.bool_] | None,
    final: bool = True,
) -> tuple[Estimates, Array]:
    """Estimates of the steps of measurements, and the bound of the used measurements; None selects
    no step, neither for the bound nor for the estimates."""
    estimates = own.estimator.advance(
        measurements,
        covariance="covariance" in inputs.settings.record,
        final=final,
        histories=selected is not None,
    )
    if selected is None:
        selected = np.zeros(measurements.offset.shape[1] - 1, dtype=bool)
    return estimates, _bounded(own, motion, measurements.where(estimates.used), selected)


def _bounded(
    own: Realization, motion: Truth, used: Measurements, selected: NDArray[np.bool_]
) -> Array:
    """Bound of the used measurements at the selected steps."""
    if own.truth.sensor is None:
        variance = np.broadcast_to(own.variance, used.variance.shape).copy()
    else:
        variance = used.variance + own.variance[used.observer]
    return own.bound.advance(
        motion.translation,
        motion.quaternion,
        motion.angular_velocity,
        used._replace(variance=variance),
        selected,
    )


def _judged(
    inputs: SimulationInputs,
    own: Realization,
    start: int,
    motion: Truth,
    measurements: Measurements,
    selected: NDArray[np.bool_],
    final: bool,
) -> tuple[Estimates, Array, NDArray[np.bool_]]:
    """Estimates of steps, the bound at the selected ones, and which targets have been observed."""
    work = partial(_worked, inputs, own)
    if own.reception is None:
        estimates, least = work(motion, measurements, selected, final)
        observed = np.isin(np.arange(inputs.ids.size), rows_of(measurements)[0][estimates.used])
        return estimates, least, observed
    estimates, least = own.reception.advance(start, motion, measurements, selected, work)
    return estimates, least, own.reception.observed
