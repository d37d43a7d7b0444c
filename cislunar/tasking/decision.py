"""Who looks at what until the next tasking epoch: one target each, or a schedule of slots."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.estimation.estimator import Prediction
from cislunar.observation.scene import Scene, TargetSurfaces
from cislunar.tasking.planning.assignment import IDLE, assign, total_information
from cislunar.tasking.planning.brightness import facet_margins, sphere_margins
from cislunar.tasking.planning.detection import LearnedDetection
from cislunar.tasking.planning.information import pair_information
from cislunar.tasking.planning.looks import slot_looks
from cislunar.tasking.planning.preselection import assign_preselected, preselects
from cislunar.tasking.planning.schedule import chances, plan_schedule
from cislunar.tasking.planning.schedule_bound import schedule_bound
from cislunar.tasking.planning.schedule_model import ScheduleModel
from cislunar.tasking.settings import LoopSettings

Array = NDArray[np.float64]


class Decision(NamedTuple):
    """What is to be looked at until the next tasking epoch.

    Attributes
    ----------
    target : ndarray of int, shape (slot, observer)
        Target of each observer, or `IDLE`.
    looking : ndarray of int, shape (step, observer)
        The same at every measurement; `IDLE` also while an observer turns.
    information : float
        Of the looks, nats.
    evaluations : int
        Taskings tried, or assignments and set packings solved for a schedule.
    gap : float
        By how much, relative to its worth, a set packing may fall short of the best, or the
        schedule of all slots, if that is bounded.
    pairs : ndarray, shape (observer, target), or None
        Information of all pairs, where it was computed.
    detects : ndarray, shape (slot, observer, target, offset), or None
        As of `LearnedDetection.detects`, where detection is learned.
    starts : ndarray of int, shape (slot,)
        First step of each slot.
    """

    target: NDArray[np.int64]
    looking: NDArray[np.int64]
    information: float
    evaluations: int
    gap: float
    pairs: Array | None
    detects: Array | None
    starts: NDArray[np.int64]

    def detects_at(
        self, target: NDArray[np.int64], step: NDArray[np.int64], observer: NDArray[np.int64]
    ) -> Array:
        """The rows of `detects` of looks, shape (look, offset)."""
        slot = np.searchsorted(self.starts, step, side="right") - 1
        return self.detects[slot, observer, target]

    def learn(
        self,
        detection: LearnedDetection,
        target: NDArray[np.int64],
        step: NDArray[np.int64],
        observer: NDArray[np.int64],
        fate: NDArray[np.uint8],
    ) -> None:
        """Let what became of the looks, shape (look,), teach how likely they detect."""
        slot = np.searchsorted(self.starts, step, side="right") - 1
        for s, detects in enumerate(() if self.detects is None else self.detects):
            now = slot == s
            detection.learn(target[now], observer[now], fate[now], detects)


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
        As of `cislunar.tasking.closed_loop.run_closed_loop`.
    detection : LearnedDetection or None
        What has been learned of the targets' brightness, if it is.
    pointing : ndarray of int, shape (observer,)
        Target each observer looked at last, or `IDLE` before the first.
    rng : numpy.random.Generator
        Of methods that search.

    Returns
    -------
    Decision
    """
    if settings.schedule.plain:
        return _assigned(prediction, n_steps, scene, surfaces, settings, forces, detection, rng)
    model, step_s = settings.schedule, scene.step_s
    slot_steps = n_steps
    if model.slot_minutes is not None:
        slot_steps = round(60.0 * model.slot_minutes / step_s)
    ends = _interval_ends(prediction, n_steps, scene, settings)
    begins = [0, *ends[:-1]]
    starts = np.concatenate(
        [np.arange(begin, end, slot_steps) for begin, end in zip(begins, ends, strict=True)]
    )
    looks = slot_looks(
        prediction, starts, scene, settings.sensor, settings.tasking, forces,
        eclipse=settings.eclipse,
    )  # fmt: skip
    lengths = np.diff(np.append(starts, ends[-1]))
    now = np.count_nonzero(starts < n_steps)

    def turning(target: NDArray[np.int64]) -> NDArray[np.int64]:
        return _turning_steps(target, pointing, looks.direction, model, step_s)

    def shares(target: NDArray[np.int64]) -> Array:
        left = lengths[:, None, None] - turning(target)
        return np.maximum(left, 0) / lengths[:, None, None]

    margin = looks.margin[..., None]
    if _by_facets(detection, prediction):
        margin = facet_margins(
            prediction, starts, ends[-1], np.any(looks.factor != 0.0, axis=(3, 4)), scene, surfaces,
            settings.sensor, forces, eclipse=settings.eclipse,
        )  # fmt: skip
    believed = chances(detection, margin)
    plan = plan_schedule(
        looks,
        believed,
        observers_per_target=model.observers_per_target,
        shares=shares if model.turning else None,
        carried_out=now,
    )
    gap = plan.gap
    if model.bound_steps > 0 and plan.worth > 0.0:
        bound = schedule_bound(
            looks,
            believed,
            plan.target,
            plan.worth,
            observers_per_target=model.observers_per_target,
            steps=model.bound_steps,
        )
        gap = bound / plan.worth - 1.0
    target = plan.target[:now]
    looking = np.repeat(target, lengths[:now], axis=0)
    if model.turning:
        lost = turning(plan.target)
        for s, o in np.argwhere(target != IDLE):
            until = min(lost[s, o, target[s, o]], lengths[s])
            looking[starts[s] : starts[s] + until, o] = IDLE
    pairs = None
    if settings.keep_information:
        known = scene, surfaces, settings.sensor, settings.tasking
        pairs = pair_information(prediction, *known)
    detects = None if detection is None else believed.detects[:now]
    return Decision(
        target, looking, plan.information, plan.evaluations, gap, pairs, detects, starts[:now]
    )


def _by_facets(detection: LearnedDetection | None, prediction: Prediction) -> bool:
    """Whether facets say how bright targets are; without an attitude it is the sphere."""
    if detection is None or prediction.rotation is None:
        return False
    return detection.model.brightness == "facets"


def _interval_ends(
    prediction: Prediction, n_steps: int, scene: Scene, settings: LoopSettings
) -> list[int]:
    """Steps at which this interval and the others of the horizon end, within the scene."""
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
    known = scene, surfaces, settings.sensor, settings.tasking
    n_pairs = scene.observer_position.shape[0] * prediction.translation.shape[0]
    pairs = margin = lit = detects = None
    eclipse, by_facets = settings.eclipse, _by_facets(detection, prediction)
    if eclipse or (detection is not None and not by_facets):
        given = prediction, scene, settings.sensor, settings.tasking
        margin = sphere_margins(*given, eclipse=eclipse)
    if eclipse:
        lit = margin > (0.0 if detection is None else -np.inf)
    few = settings.keep_information or lit is not None
    if not few and preselects(settings.tasking, settings.method, n_pairs):
        tasking = assign_preselected(prediction, *known)
        information = tasking.information
    else:
        worth = pairs = pair_information(prediction, *known, wanted=lit)
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
            worth = detection.worth(pairs, detects)
        tasking = assign(
            worth,
            settings.method,
            rng=rng,
            max_evaluations=settings.max_evaluations,
            early_stop=settings.early_stop,
        )
        information = tasking.information
        if detection is not None:
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


def _turning_steps(
    target: NDArray[np.int64],
    pointing: NDArray[np.int64],
    direction: Array,
    model: ScheduleModel,
    step_s: float,
) -> NDArray[np.int64]:
    """Measurements lost before each slot's first look at each target (slot, observer, target).

    An observer turns away from where the target is then that it looked at last.
    """
    n_slots, n_observers, n_targets = direction.shape[:3]
    lost = np.zeros((n_slots, n_observers, n_targets), dtype=np.int64)
    last = pointing.copy()
    for s in range(n_slots):
        for o in np.flatnonzero(last != IDLE):
            time_s = np.full(n_targets, float(model.settle_s))
            if model.slew_deg_s is not None:
                # away from a target whose estimate has failed: half a turn
                cosine = np.nan_to_num(direction[s, o] @ direction[s, o, last[o]], nan=-1.0)
                angle = np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0)))
                time_s += angle / model.slew_deg_s
            # it begins at the measurement before; the next is a step later
            steps = np.maximum(np.ceil(time_s / step_s - 1e-9) - 1.0, 0.0)
            lost[s, o] = np.where(np.arange(n_targets) == last[o], 0, steps)
        last = np.where(target[s] == IDLE, last, target[s])
    return lost
