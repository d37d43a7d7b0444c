"""Intervals in which telescopes return everything in their field of view, without identities.

Observers are commanded to follow predicted directions. Detections are associated with tracks window
by window; each window begins from the estimates after the one before. With `known-identity` the
simulation passes the origins on instead, as a reference for what association costs.

Assumptions and limitations
---------------------------
- Directions are commanded at the tasking epoch for the whole interval.
- Detections are processed at once; links with a delay need known identities.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.association import KNOWN, LOST, Expectation, TrackStatus, associate, find_candidates
from cislunar.association.maneuvered import associate_maneuvered
from cislunar.association.window import Association, Window
from cislunar.constants import LENGTH_UNIT_KM
from cislunar.detection.exposures import FALSE_ALARM, Detections, Exposures, expose, point_at
from cislunar.dynamics.bundle import propagate_bundle
from cislunar.estimation.estimator import Estimates, OrbitEstimates, Prediction
from cislunar.evaluation.gospa import gospa
from cislunar.observation import DETECTED, NOT_TASKED, Measurements, arranged
from cislunar.observation.sensor import SensorLimits, limits_of, noise_variance_at, sensor_limits
from cislunar.runtime import Array, Indices
from cislunar.tasking.decision import Decision
from cislunar.tasking.initial_conditions import ALARM, LOSS, stream
from cislunar.tasking.state import Realization, SimulationInputs
from cislunar.tasking.truth import Truth


class FieldObservations(NamedTuple):
    """What the exposures of an interval have returned: with `command` (exposure,), the track that
    an exposure was to follow; `origin` (row,), the target of each detection or `FALSE_ALARM`, which
    is hidden from association and estimators; and `outcome` (exposure,), that of the commanded
    track's target."""

    exposures: Exposures
    detections: Detections
    command: Indices
    origin: Indices
    outcome: NDArray[np.uint8]


class Associated(NamedTuple):
    """An interval after association: a row for each detection that a track has taken and for each
    exposure in which a commanded track has none. `commanded` and `right` (row,): whether the
    exposure was to follow the track, and whether the detection is of its target. `counts` (target,
    2): detections that a track has taken with a probability above a half, and those of another
    origin among them. `origin` (target,): target that most detections of a track are of, or
    `FALSE_ALARM`; -2 without a detection."""

    measurements: Measurements
    outcome: NDArray[np.uint8]
    estimates: Estimates
    commanded: NDArray[np.bool_]
    right: NDArray[np.bool_]
    counts: Indices
    origin: Indices

    def histories(self, motion: Truth, tracks: TrackStatus, cutoff_km: float) -> dict[str, list]:
        """Values of the histories of tracks at the end of the interval."""
        true, place = (
            each.translation[:, -1, :3] * LENGTH_UNIT_KM for each in (motion, self.estimates)
        )
        found = gospa(true, place[np.all(np.isfinite(place), axis=1)], cutoff_km)
        return {
            "associations": [self.counts[:, 0]],
            "wrong_associations": [self.counts[:, 1]],
            "association_origin": [self.origin],
            "existence": [tracks.existence.copy()],
            "track_status": [tracks.status.copy()],
            "gospa": [found[:4]],
        }


def observe_field(
    inputs: SimulationInputs,
    own: Realization,
    start: int,
    tasking: Decision,
    prediction: Prediction,
    motion: Truth,
    dimmed: Array,
) -> FieldObservations:
    """Point the observers and simulate what their exposures return over an interval that begins
    after the step `start`. The commanded directions follow from the prediction; the true `motion`
    begins at the time before the first step, and `dimmed` (target, time) is its dimming by shadows,
    mag."""
    scene, settings, model = inputs.scene, inputs.settings, inputs.settings.association
    command = tasking.target_by_step
    n_steps, n_observers = command.shape
    place = propagate_bundle(
        prediction.translation,
        scene.step,
        n_steps - 1,
        forces=inputs.forces,
        start=prediction.index * scene.step,
    )
    exposures = point_at(scene, settings.sensor, start + 1, command, place)
    true_scene, pointed = own.scene(inputs), exposures
    if own.observers is not None:
        at = exposures.observer, start + 1 + exposures.step
        pointed = exposures._replace(
            boresight=exposures.boresight - own.observers.error[at][:, 3:5]
        )
    kept = np.ones((place.shape[0], n_steps, n_observers), dtype=bool)
    if model.detection_loss > 0.0:
        for j, number in enumerate(inputs.ids):
            rng = stream(LOSS, own.seed, int(number), start)
            kept[j] = rng.random((n_steps, n_observers)) >= model.detection_loss
    detections, origin, outcome = expose(
        start + 1,
        pointed,
        model,
        true_scene,
        own.truth.surfaces,
        settings.sensor,
        motion.translation,
        motion.quaternion,
        motion.noise,
        stream(ALARM, own.seed, start),
        n_steps=n_steps,
        command=command,
        kept=kept,
        origin=start,
        true=own.truth.sensor,
        dimmed=dimmed,
    )
    if own.observers is not None:
        given = exposures, detections, origin
        detections, origin = own.observers.measured(true_scene, start, motion.translation, *given)
    followed = command[exposures.step, exposures.observer]
    return FieldObservations(exposures, detections, followed, origin, outcome)


def associate_interval(
    inputs: SimulationInputs, own: Realization, start: int, n_steps: int, field: FieldObservations
) -> Associated:
    """Associate the detections of an interval with tracks, window by window, and update the
    estimates and the status of the tracks. The origins of detections are read only if identities
    are known, and to count wrong associations."""
    model = inputs.settings.association
    known, keep = model.method == KNOWN, "covariance" in inputs.settings.record
    commit = n_steps if known else model.committed_steps
    columns, estimates, telescopes = [], [], _telescopes(inputs)
    for begin in range(0, n_steps, commit):
        end = min(begin + commit, n_steps)
        if known:
            rows = _identified(field)
        else:
            stop = min(begin + model.window_steps, n_steps)
            rows = _associate_window(
                inputs,
                own,
                field.exposures,
                field.detections,
                telescopes,
                start,
                (begin, end, stop),
            )
        part = _columns(telescopes.faintest, inputs.ids.size, field, rows, begin, end)
        measurements, order = arranged(*part[:5], inputs.ids.size, end - begin)
        found = own.estimator.advance(measurements, covariance=keep, final=end == n_steps)
        used = np.empty(order.size, dtype=bool)
        used[order] = found.used
        columns.append((part.target, part.step + begin, *part[2:], used))
        estimates.append(found)
    *histories, _ = zip(*estimates, strict=True)
    histories = [np.concatenate(history, axis=1) for history in histories]
    *row, exposure, detection, weight, used = (
        np.concatenate(part) for part in zip(*columns, strict=True)
    )
    measurements, order = arranged(*row, inputs.ids.size, n_steps)
    target, exposure, detection, weight, used = (
        column[order] for column in (row[0], exposure, detection, weight, used)
    )
    taken, source = detection >= 0, np.append(field.origin, FALSE_ALARM)[detection]
    right = taken & (source == target)
    # by track and origin, the last column for false alarms
    of = np.zeros((inputs.ids.size, inputs.ids.size + 1), dtype=np.int64)
    counted = taken & used & (weight > 0.5)
    np.add.at(of, (target[counted], source[counted]), 1)
    total = of.sum(axis=1)
    counts = np.column_stack([total, total - np.diagonal(of)])
    most = of.argmax(axis=1)
    origin = np.where(total == 0, -2, np.where(most == inputs.ids.size, FALSE_ALARM, most))
    outcome = field.outcome[exposure]
    # a target outside the field, and one whose detection was given to no track, are rejected
    outcome[taken | (outcome == NOT_TASKED)] = DETECTED
    commanded = field.command[exposure] == target
    return Associated(
        measurements, outcome, Estimates(*histories, used), commanded, right, counts, origin
    )


class _Telescopes(NamedTuple):
    """Limits of all observers, variances (observer, 3) of a measurement at the limit, and what the
    association expects of their detections."""

    limits: SensorLimits
    faintest: Array
    expected: Expectation


def _telescopes(inputs: SimulationInputs) -> _Telescopes:
    """Telescopes of a run as the association assumes them."""
    settings = inputs.settings
    model, tasking = settings.association, settings.tasking
    limits = sensor_limits(settings.sensor, inputs.scene.observer_position.shape[0])
    faintest = np.empty((limits.half_field.size, 3))
    for o, limit in enumerate(limits.limiting_magnitude):
        noise_variance_at(limits_of(limits, o), limit, faintest[o])
    faintness = np.array([tasking.faintness(limit) for limit in limits.limiting_magnitude])
    gates = model.magnitude_sigma, model.gate_probability
    return _Telescopes(limits, faintest, Expectation(model, model.unknown_deg2, *gates, faintness))


class _Columns(NamedTuple):
    """Rows of measurements in any order; `detection` is -1 for an exposure without one."""

    target: Indices
    step: Indices
    observer: Indices
    value: Array
    variance: Array
    exposure: Indices
    detection: Indices
    weight: Array


def _identified(field: FieldObservations) -> Association:
    """The association that takes every detection for what it is of."""
    rows = np.flatnonzero(field.origin != FALSE_ALARM)
    return Association(
        field.detections.exposure[rows],
        field.origin[rows],
        rows,
        np.ones(rows.size),
        np.zeros((rows.size, 2)),
        field.detections.variance[rows, 1:],
    )


def _associate_window(
    inputs: SimulationInputs,
    own: Realization,
    exposures: Exposures,
    detections: Detections,
    telescopes: _Telescopes,
    start: int,
    steps: tuple[int, int, int],
) -> Association:
    """Associate the detections of the steps from the first to the last of `steps`, and keep what is
    decided before the second."""
    model, (begin, end, stop) = inputs.settings.association, steps
    here = exposures.between(begin, stop)
    rows = slice(*np.searchsorted(detections.exposure, [here.start, here.stop]).tolist())
    given = Exposures(exposures.step[here] - begin, *(each[here] for each in exposures[1:]))
    found = Detections(
        detections.exposure[rows] - here.start, *(each[rows] for each in detections[1:])
    )

    def candidates(orbits: OrbitEstimates, some: Indices | slice = slice(None)) -> Window:
        known = inputs.scene, inputs.forces, telescopes.limits, telescopes.expected
        return find_candidates(orbits, given, Detections(*(e[some] for e in found)), *known)

    orbits = own.estimator.orbits()
    wide = orbits.covariance.copy()
    wide[own.tracks.status == LOST] *= model.lost_gate_factor**2
    window = candidates(orbits._replace(covariance=wide))
    taken = associate(window, model)
    if inputs.abilities.maneuvers_per_day > 0.0:
        last, scene = own.tracks.last, inputs.scene
        waited = (orbits.index - last + model.window_steps) * np.where(last < 0, np.nan, scene.step)
        expected = inputs.abilities.maneuvers_per_day * model.window_steps * scene.step_s / 86400.0
        first = window, taken, found.exposure.size
        taken = associate_maneuvered(candidates, orbits, waited, *first, model, expected)
    early = given.step[taken.exposure] < end - begin
    taken = Association(*(column[early] for column in taken))
    own.tracks.update(window, taken, start + begin, given.step, end - begin)
    return taken._replace(
        exposure=taken.exposure + here.start, detection=taken.detection + rows.start
    )


def _columns(
    faintest: Array,
    n_targets: int,
    field: FieldObservations,
    rows: Association,
    begin: int,
    end: int,
) -> _Columns:
    """Rows of the steps from `begin` to `end`: detections of tracks, and commanded exposures of
    which the track has none."""
    exposures, found = field.exposures, field.detections
    value = found.value[rows.detection].copy()
    value[:, 1:] += rows.offset
    variance = found.variance[rows.detection].copy()
    variance[:, 0] /= rows.weight
    variance[:, 1:] = rows.noise
    here = exposures.between(begin, end)
    inside = (rows.exposure >= here.start) & (rows.exposure < here.stop)
    inside &= np.isfinite(rows.noise[:, 0])
    taken = (rows.exposure * n_targets + rows.track)[inside]
    every = np.arange(here.start, here.stop)
    missed = every[~np.isin(every * n_targets + field.command[here], taken)]
    nothing = np.full((missed.size, 3), np.nan)
    exposure = np.concatenate([rows.exposure[inside], missed])
    return _Columns(
        np.concatenate([rows.track[inside], field.command[missed]]),
        exposures.step[exposure] - begin,
        exposures.observer[exposure],
        np.concatenate([value[inside], nothing]),
        np.concatenate([variance[inside], faintest[exposures.observer[missed]]]),
        exposure,
        np.concatenate([rows.detection[inside], np.full(missed.size, -1)]),
        np.concatenate([rows.weight[inside], np.zeros(missed.size)]),
    )
