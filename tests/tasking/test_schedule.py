"""Schedules of slots, against brute force, single taskings and predictions of the filter."""

import dataclasses
from itertools import combinations, product

import numpy as np
import pytest

from cislunar.dynamics.cr3bp import EARTH_MOON
from cislunar.errors import ConfigurationError
from cislunar.estimation.kalman.mukf import MultiplicativeUKF
from cislunar.observation.records import Measurements, pointed_schedule
from cislunar.observation.sensor import Sensor
from cislunar.tasking.closed_loop import run_closed_loop
from cislunar.tasking.decision import _slew_steps, decide
from cislunar.tasking.demonstration import tracking_problem
from cislunar.tasking.initial_conditions import initial_estimate
from cislunar.tasking.planning.assignment import IDLE
from cislunar.tasking.planning.detection import LearnedDetection
from cislunar.tasking.planning.detection_model import DetectionModel
from cislunar.tasking.planning.information import TaskingModel, pair_information
from cislunar.tasking.planning.packing import best_packing
from cislunar.tasking.planning.schedule import (
    _columns,
    detection_probabilities,
    plan_schedule,
)
from cislunar.tasking.planning.schedule_bound import schedule_bound
from cislunar.tasking.planning.schedule_model import ScheduleModel
from cislunar.tasking.planning.slot_observations import SlotObservations, slot_observations

MODEL = DetectionModel(prior_mag=0.8, flicker_mag=0.5, never_detected_bonus=2.0)
BRIGHT = Sensor(limiting_magnitude=22.0)


def _random_observations(rng, n_slots, n_observers, n_targets):
    shape = n_slots, n_observers, n_targets
    factor = rng.normal(size=(*shape, 6, 2)) * rng.choice([0.0, 1.0, 3.0], (*shape, 1, 1))
    return SlotObservations(factor, rng.normal(0.0, 0.7, shape), np.zeros((*shape, 3)))


def _learned(n_targets):
    learned = LearnedDetection(MODEL, n_targets)
    learned.log_weight += np.linspace(-1.0, 1.0, n_targets)[:, None] * learned.grid
    learned.log_weight -= np.log(np.exp(learned.log_weight).sum(axis=1, keepdims=True))
    learned.detected[0] = True
    return learned


def _chances(learned, observations):
    return detection_probabilities(learned, observations.margin[..., None])


@pytest.mark.parametrize("most", [1, 2, 4])
def test_columns_are_all_groups_in_order(most):
    visible = np.random.default_rng(most).random((6, 9)) < np.linspace(0.0, 1.0, 9)
    expected = [
        (j, *group, *(IDLE,) * (most - size))
        for j in range(9)
        for size in range(1, most + 1)
        for group in combinations(np.flatnonzero(visible[:, j]).tolist(), size)
    ]
    targets, groups = _columns(visible, most)
    np.testing.assert_array_equal(np.column_stack([targets, groups]), expected)
    assert _columns(visible[:, :1], most)[1].shape == (0, most)


def _value(observations, learned, schedule):
    """The expectation over outcomes and brightness, term by term."""
    total, each = 0.0, _chances(learned, observations).detects
    for j in range(observations.margin.shape[2]):
        own = [tuple(at) for at in np.argwhere(schedule == j)]
        weight = np.exp(learned.log_weight[j])
        bonus = 0.0 if learned.detected[j] else MODEL.never_detected_bonus
        for size in range(1, len(own) + 1):
            for found in combinations(own, size):
                matrix, probability = np.eye(6), weight.copy()
                for at in own:
                    p = each[at][j]
                    probability *= p if at in found else 1.0 - p
                    if at in found:
                        matrix += observations.factor[at][j] @ observations.factor[at][j].T
                total += probability.sum() * (0.5 * np.linalg.slogdet(matrix)[1] + bonus)
    return total


def _taskings(observations, slot, most):
    """All taskings of a slot by pairs with information."""
    n_observers, n_targets = observations.margin.shape[1:]
    for target in product(range(-1, n_targets), repeat=n_observers):
        busy = [(o, j) for o, j in enumerate(target) if j != IDLE]
        crowd = np.bincount([j for _, j in busy], minlength=1).max()
        if crowd <= most and all(observations.factor[slot, o, j].any() for o, j in busy):
            yield np.array(target)


@pytest.mark.parametrize("most", [1, 2])
def test_one_slot_is_the_best_of_all_taskings(most):
    learned = _learned(3)
    for seed in range(4):
        observations = _random_observations(np.random.default_rng(seed), 1, 3, 3)
        plan = plan_schedule(
            observations, _chances(learned, observations), observers_per_target=most
        )
        assert plan.value == pytest.approx(_value(observations, learned, plan.target), rel=1e-9)
        best = max(
            _value(observations, learned, each[None]) for each in _taskings(observations, 0, most)
        )
        assert plan.value == pytest.approx(best, rel=1e-9)
        assert plan.gap < 1e-6


def test_no_single_slot_can_be_improved_and_all_together_hardly():
    learned = _learned(3)
    for seed in range(3):
        observations = _random_observations(np.random.default_rng(seed), 2, 2, 3)
        plan = plan_schedule(observations, _chances(learned, observations))
        assert plan.value == pytest.approx(_value(observations, learned, plan.target), rel=1e-9)
        singles = [list(_taskings(observations, slot, 1)) for slot in range(2)]
        for slot in range(2):
            for other in singles[slot]:
                changed = plan.target.copy()
                changed[slot] = other
                assert _value(observations, learned, changed) <= plan.value + 1e-8
        best = max(_value(observations, learned, np.array(both)) for both in product(*singles))
        assert plan.value > 0.95 * best
        for most, least in ((1, best), (2, plan.value)):
            given = observations, _chances(learned, observations), plan.target, plan.value
            bound = schedule_bound(*given, observers_per_target=most, steps=60)
            assert bound >= least * (1.0 - 1e-12)
            assert most == 2 or bound < 1.05 * best


def test_packings_are_those_of_brute_force():
    rng = np.random.default_rng(5)
    groups = [(o, IDLE) for o in range(4)] + list(combinations(range(4), 2))
    target = np.repeat(np.arange(3), len(groups))
    observers = np.tile(np.array(groups), (3, 1))
    value = rng.uniform(-0.2, 1.0, target.size) + 0.5 * (observers[:, 1] != IDLE)
    found = best_packing(target, observers, value, 4)
    best = 0.0
    for size in range(1, 4):
        for columns in combinations(range(target.size), size):
            used = [o for c in columns for o in observers[c] if o != IDLE]
            if len({*target[list(columns)]}) == size and len({*used}) == len(used):
                best = max(best, value[list(columns)].sum())
    assert found.value == pytest.approx(best, abs=1e-8) and found.gap < 1e-6


@pytest.fixture(scope="module")
def problem():
    return tracking_problem(4, 8, duration_hours=3.0, sensor=BRIGHT)


def test_observations_agree_with_the_prediction_of_the_filter_at_each_slot(problem):
    scene, surfaces, epoch, _, loop = problem
    filt = MultiplicativeUKF(
        scene, surfaces, BRIGHT, initial_estimate(epoch, loop.initial.components())
    )
    model = TaskingModel()
    observations = slot_observations(
        filt.predict(), np.array([0, 30]), scene, BRIGHT, model, EARTH_MOON
    )
    known = scene, surfaces, BRIGHT, model
    nothing = Measurements(*pointed_schedule(np.full((30, 4), IDLE), 8), *np.empty((2, 0, 3)))
    for slot, tolerance in ((0, 1e-9), (1, 1e-3)):
        gram = np.einsum("ojia,ojib->ojab", observations.factor[slot], observations.factor[slot])
        found = 0.5 * np.linalg.slogdet(np.eye(2) + gram)[1]
        expected = pair_information(filt.predict(), *known)
        np.testing.assert_allclose(found, expected, rtol=tolerance, atol=1e-9)
        assert (expected > 0.0).sum() > 8
        filt.advance(nothing)


def test_one_slot_per_interval_is_plain_tasking(problem):
    scene, surfaces, epoch, ids, loop = problem
    runs = []
    for detection in (None, MODEL):
        for minutes in (None, 60.0):
            settings = dataclasses.replace(
                loop,
                tasking=TaskingModel(detection=detection),
                schedule=ScheduleModel(slot_minutes=minutes),
            )
            runs.append(run_closed_loop(scene, surfaces, epoch, ids, [1], settings))
    for plain, slotted in (runs[:2], runs[2:]):
        np.testing.assert_array_equal(slotted.assignment[:, :, 0], plain.assignment)
        np.testing.assert_array_equal(slotted.error, plain.error)
        np.testing.assert_allclose(slotted.information, plain.information, rtol=1e-8)


def test_observations_follow_the_schedule(problem):
    scene, surfaces, epoch, ids, loop = problem
    settings = dataclasses.replace(
        loop,
        interval_minutes=90.0,
        record=("measurements", "pointing"),
        schedule=ScheduleModel(
            slot_minutes=40.0, observers_per_target=2, slew_deg_s=0.5, settle_s=90.0
        ),
    )
    found = run_closed_loop(scene, surfaces, epoch, ids, [3], settings)
    assert found.assignment.shape == (1, 2, 3, 4) and np.all(found.planning_gap < 1e-6)
    observations = found.observations
    when, slot = observations.step // 90, observations.step % 90 // 40
    np.testing.assert_array_equal(
        found.assignment[0, when, slot, observations.observer], observations.target
    )
    pairs = {*zip(observations.step.tolist(), observations.observer.tolist(), strict=True)}
    assert len(pairs) == observations.step.size  # no observer has two targets at once
    crowd = np.bincount(observations.step * 8 + observations.target)
    assert crowd.max() == 2
    seen = np.zeros((180, 4), dtype=bool)
    seen[observations.step, observations.observer] = True
    np.testing.assert_array_equal(np.isfinite(found.pointing[0, :, :, 0]), seen)
    changes = np.argwhere(np.diff(found.assignment[0, 0], axis=0) != 0)
    assert changes.size and all(not seen[40 * (s + 1), o] for s, o in changes)


def test_slewing_takes_time():
    angles = np.deg2rad([0.0, 10.0, 90.0])
    direction = np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=-1)[None, None]
    model = ScheduleModel(slew_deg_s=0.25, settle_s=30.0)
    found = _slew_steps(np.array([[1]]), np.array([0]), direction, model, 60.0)
    # slews of 70 s and 390 s: the first measurement, or the first six, are lost
    np.testing.assert_array_equal(found, [[[0, 1, 6]]])
    first = _slew_steps(np.array([[1]]), np.array([IDLE]), direction, model, 60.0)
    np.testing.assert_array_equal(first, 0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"schedule": ScheduleModel(slot_minutes=0.5)}, "slot_minutes = 0.5 must be a multiple"),
        ({"schedule": ScheduleModel(slot_minutes=20.0), "method": "greedy"}, "method = 'greedy'"),
    ],
)
def test_schedules_that_cannot_be_planned_are_refused(problem, change, message):
    with pytest.raises(ConfigurationError, match=message):
        dataclasses.replace(problem[4], **change)


@pytest.mark.parametrize("key", ["slot_minutes", "slew_deg_s", "observers_per_target"])
def test_impossible_models_are_refused(key):
    with pytest.raises(ConfigurationError, match=key):
        ScheduleModel(**{key: 0})


def test_the_first_interval_of_a_horizon_is_executed(problem):
    scene, surfaces, epoch, _, loop = problem
    filt = MultiplicativeUKF(
        scene, surfaces, BRIGHT, initial_estimate(epoch, loop.initial.components())
    )
    settings = dataclasses.replace(loop, schedule=ScheduleModel(40.0, horizon_epochs=9))
    nowhere = np.full(4, IDLE)
    given = scene, surfaces, settings, EARTH_MOON, None, nowhere, np.random.default_rng(0)
    found = decide(filt.predict(), 60, *given)
    starts = np.array([0, 40, 60, 100, 120, 160])  # the run has three intervals
    observations = slot_observations(
        filt.predict(), starts, scene, BRIGHT, TaskingModel(), EARTH_MOON
    )
    plan = plan_schedule(observations, _chances(None, observations))
    np.testing.assert_array_equal(found.target, plan.target[:2])
    np.testing.assert_array_equal(
        found.target_by_step, np.repeat(plan.target[:2], [40, 20], axis=0)
    )
    of_two = SlotObservations(*(each[:2] for each in observations))
    learned = _learned(8)
    learned.log_weight[:] = -1e9
    learned.log_weight[:, 0] = 0.0  # far brighter than the limit
    learned.detected[:] = True
    value = _value(of_two._replace(margin=of_two.margin + 99.0), learned, plan.target[:2])
    assert found.information == pytest.approx(value, rel=1e-9)
    assert found.information < plan.information
    result = run_closed_loop(scene, surfaces, epoch, problem.ids, (0,), settings)
    assert result.assignment.shape == (1, 3, 2, 4)
    with pytest.raises(
        ConfigurationError, match="horizon_epochs = 0 must be a whole number at least 1"
    ):
        ScheduleModel(horizon_epochs=0)
