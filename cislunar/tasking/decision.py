"""Decision at a tasking epoch: one target for each observer, or a schedule of slots."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.estimation.estimator import Prediction
from cislunar.observation import Scene, TargetSurfaces, sensor_limits
from cislunar.runtime import Array
from cislunar.tasking.planning import LearnedDetection, ScheduleModel, facet_margins, sphere_margins
from cislunar.tasking.planning.assignment import IDLE, assign, total_information, values_in_field
from cislunar.tasking.planning.information import pair_information
from cislunar.tasking.planning.preselection import assign_preselected, preselects
from cislunar.tasking.planning.schedule import detection_probabilities, plan_schedule
from cislunar.tasking.planning.schedule_bound import schedule_bound
from cislunar.tasking.planning.slot_observations import slot_observations
from cislunar.tasking.settings import LoopSettings


class Decision(NamedTuple):
    """Targets of the observers until the next tasking epoch.
    `target` (slot, observer): target of each observer, or `IDLE`; `target_by_step` (step,
    observer): the same at every measurement, `IDLE` also while an observer slews. `information`: of
    the observations, nats. `evaluations`: taskings evaluated, or assignments and set packings
    solved. `gap`: relative amount by which a set packing may fall short of the best, or the
    schedule of all slots, if it is bounded. `pairs` (observer, target): information of all pairs,
    where it was computed. `detects` (slot, observer, target, offset): see
    `LearnedDetection.detects`. `starts` (slot,): first step of each slot."""

    target: NDArray[np.int64]
    target_by_step: NDArray[np.int64]
    information: float
    evaluations: int
    gap: float
    pairs: Array | None
    detects: Array | None
    starts: NDArray[np.int64]

    def commanding(self, rows: NDArray[np.int64]) -> Decision:
        """With other observations: step, observer and target of each, shape (n, 3)."""
        target = self.target_by_step.copy()
        target[rows[:, 0], rows[:, 1]] = rows[:, 2]
        return self._replace(target_by_step=target)

    def _slot_of(self, step: NDArray[np.int64]) -> NDArray[np.int64]:
        """Slots of steps."""
        return np.searchsorted(self.starts, step, side="right") - 1

    def detects_at(
        self, target: NDArray[np.int64], step: NDArray[np.int64], observer: NDArray[np.int64]
    ) -> Array:
        """Rows of `detects` of observations, shape (row, offset)."""
        return self.detects[self._slot_of(step), observer, target]

    def trials(
        self, target: NDArray[np.int64], step: NDArray[np.int64], observer: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], Array]:
        """Trials of observations, shape (row,): their targets (trial,) and rows of `detects`. Those
        of a target by one observer in a slot are one trial."""
        each = np.stack([self._slot_of(step), observer, target])
        slot, observer, target = np.unique(each, axis=1)
        return target, self.detects[slot, observer, target]

    def learn(
        self,
        detection: LearnedDetection,
        target: NDArray[np.int64],
        step: NDArray[np.int64],
        observer: NDArray[np.int64],
        outcome: NDArray[np.uint8],
    ) -> None:
        """Update the learned detection with the outcomes of observations, shape (row,)."""
        slot = self._slot_of(step)
        for s, detects in enumerate(() if self.detects is None else self.detects):
            now = slot == s
            detection.learn(target[now], observer[now], outcome[now], detects)


def decide(
    prediction: Prediction,
    n_steps: int,
    scene: Scene,
    surfaces: TargetSurfaces,
    settings: LoopSettings,
    forces: tuple,
    detection: LearnedDetection | None,
    pointing: NDArray[np.int64],
    rng: np.random.Generator,
) -> Decision:
    """Decide at a tasking epoch.

    Parameters
    ----------
    prediction : Prediction
        Estimates at the next measurement time.
    n_steps : int
        Measurements until the next epoch.
    scene, surfaces, settings, forces
        See `cislunar.tasking.closed_loop.run_closed_loop`.
    detection : LearnedDetection or None
        Learned brightness of the targets.
    pointing : ndarray of int, shape (observer,)
        Last target of each observer, or `IDLE` before the first.
    rng : numpy.random.Generator
        For methods that search.

    Returns
    -------
    Decision

    Raises
    ------
    ConfigurationError
        If ``settings.tasking.states`` is "full" and the estimator has no joint Gaussian estimate.
    """
    if settings.schedule.plain:
        return _assigned(prediction, n_steps, scene, surfaces, settings, forces, detection, rng)
    model, step_s = settings.schedule, scene.step_s
    slot_steps = n_steps
    if model.slot_minutes is not None:
        slot_steps = round(60.0 * model.slot_minutes / step_s)
    ends = _interval_ends(prediction, n_steps, scene, settings)
    first_steps = [0, *ends[:-1]]
    starts = np.concatenate(
        [np.arange(begin, end, slot_steps) for begin, end in zip(first_steps, ends, strict=True)]
    )
    observations = slot_observations(
        prediction, starts, scene, settings.sensor, settings.tasking, forces,
        eclipse=settings.eclipse,
    )  # fmt: skip
    lengths = np.diff(np.append(starts, ends[-1]))
    now = np.count_nonzero(starts < n_steps)

    def slew_steps(target: NDArray[np.int64]) -> NDArray[np.int64]:
        return _slew_steps(target, pointing, observations.direction, model, step_s)

    def shares(target: NDArray[np.int64]) -> Array:
        left = lengths[:, None, None] - slew_steps(target)
        return np.maximum(left, 0) / lengths[:, None, None]

    margin = observations.margin[..., None]
    if _by_facets(detection, prediction):
        margin = facet_margins(
            prediction, starts, ends[-1], np.any(observations.factor != 0.0, axis=(3, 4)), scene,
            surfaces, settings.sensor, forces, eclipse=settings.eclipse,
        )  # fmt: skip
    probabilities = detection_probabilities(detection, margin)
    plan = plan_schedule(
        observations,
        probabilities,
        observers_per_target=model.observers_per_target,
        shares=shares if model.slewing else None,
        carried_out=now,
        half_field=_counted_field(scene, settings),
    )
    gap = plan.gap
    if model.bound_steps > 0 and plan.value > 0.0:
        bound = schedule_bound(
            observations,
            probabilities,
            plan.target,
            plan.value,
            observers_per_target=model.observers_per_target,
            steps=model.bound_steps,
        )
        gap = bound / plan.value - 1.0
    target = plan.target[:now]
    target_by_step = np.repeat(target, lengths[:now], axis=0)
    if model.slewing:
        lost_steps = slew_steps(plan.target)
        for s, o in np.argwhere(target != IDLE):
            until = min(lost_steps[s, o, target[s, o]], lengths[s])
            target_by_step[starts[s] : starts[s] + until, o] = IDLE
    pairs = None
    if settings.keep_information:
        given = scene, surfaces, settings.sensor, settings.tasking
        pairs = pair_information(prediction, *given)
    detects = None if detection is None else probabilities.detects[:now]
    return Decision(
        target,
        target_by_step,
        plan.information,
        plan.evaluations,
        gap,
        pairs,
        detects,
        starts[:now],
    )


def _counted_field(scene: Scene, settings: LoopSettings) -> Array | None:
    """Half the fields of view (observer,), if tasking counts on all targets in a field."""
    if not (settings.association.in_field and settings.association.count_neighbors):
        return None
    return sensor_limits(settings.sensor, scene.observer_position.shape[0]).half_field


def _by_facets(detection: LearnedDetection | None, prediction: Prediction) -> bool:
    """Whether magnitudes are those of facets; without an attitude they are those of the sphere."""
    if detection is None or prediction.rotation is None:
        return False
    return detection.model.brightness == "facets"


def _interval_ends(
    prediction: Prediction, n_steps: int, scene: Scene, settings: LoopSettings
) -> list[int]:
    """Steps at which the intervals of the horizon end, within the scene."""
    left = scene.sun_position.shape[0] - prediction.index
    others = settings.steps_per_interval * np.arange(settings.schedule.horizon_epochs)
    return np.unique(np.minimum(n_steps + others, left)).tolist()


def _assigned(
    prediction: Prediction,
    n_steps: int,
    scene: Scene,
    surfaces: TargetSurfaces,
    settings: LoopSettings,
    forces: tuple,
    detection: LearnedDetection | None,
    rng: np.random.Generator,
) -> Decision:
    """One target for each observer until the next epoch, as in the paper."""
    given = scene, surfaces, settings.sensor, settings.tasking
    n_pairs = scene.observer_position.shape[0] * prediction.translation.shape[0]
    pairs = margin = lit = detects = None
    eclipse, by_facets = settings.eclipse, _by_facets(detection, prediction)
    if eclipse or (detection is not None and not by_facets):
        sphere = prediction, scene, settings.sensor, settings.tasking
        margin = sphere_margins(*sphere, eclipse=eclipse)
    if eclipse:
        lit = margin > (0.0 if detection is None else -np.inf)
    half_field = _counted_field(scene, settings)
    few = settings.keep_information or lit is not None or half_field is not None
    if not few and preselects(settings.tasking, settings.method, n_pairs):
        tasking = assign_preselected(prediction, *given)
        information = tasking.information
    else:
        value = pairs = pair_information(prediction, *given, selected=lit)
        if detection is not None:
            seen = pairs > 0.0
            if by_facets:
                expected = facet_margins(
                    prediction, np.zeros(1, dtype=np.int64), n_steps, seen[None], scene, surfaces,
                    settings.sensor, forces, eclipse=eclipse,
                )[0]  # fmt: skip
            else:
                expected = margin[..., None]
            detects = detection.detects(expected, seen)
            value = detection.pair_values(pairs, detects)
        if half_field is not None:
            way = prediction.translation[:, :3] - scene.observer_position[:, prediction.index, None]
            direction = way / np.linalg.norm(way, axis=-1, keepdims=True)
            value = values_in_field(value, direction, half_field)
        tasking = assign(
            value,
            settings.method,
            rng=rng,
            max_evaluations=settings.max_evaluations,
            early_stop=settings.early_stop,
        )
        information = tasking.information
        if detection is not None or half_field is not None:
            information = total_information(pairs, tasking.target)
    return Decision(
        tasking.target[None],
        np.tile(tasking.target, (n_steps, 1)),
        information,
        tasking.history.size,
        0.0,
        pairs,
        None if detects is None else detects[None],
        np.zeros(1, dtype=np.int64),
    )


def _slew_steps(
    target: NDArray[np.int64],
    pointing: NDArray[np.int64],
    direction: Array,
    model: ScheduleModel,
    step_s: float,
) -> NDArray[np.int64]:
    """Measurements lost before each slot's first observation of each target (slot, observer,
    target). An observer slews from the present direction of its last target."""
    n_slots, n_observers, n_targets = direction.shape[:3]
    lost_steps = np.zeros((n_slots, n_observers, n_targets), dtype=np.int64)
    last = pointing.copy()
    for s in range(n_slots):
        for o in np.flatnonzero(last != IDLE):
            time_s = np.full(n_targets, float(model.settle_s))
            if model.slew_deg_s is not None:
                # from a target whose estimate has failed: half a revolution
                cosine = np.nan_to_num(direction[s, o] @ direction[s, o, last[o]], nan=-1.0)
                angle = np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0)))
                time_s += angle / model.slew_deg_s
            # the slew begins at the measurement before; the next is a step later
            steps = np.maximum(np.ceil(time_s / step_s - 1e-9) - 1.0, 0.0)
            lost_steps[s, o] = np.where(np.arange(n_targets) == last[o], 0, steps)
        last = np.where(target[s] == IDLE, last, target[s])
    return lost_steps
