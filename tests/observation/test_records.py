"""Layout of records, and several observations of a target at a step."""

import numpy as np
import pytest
from measured import constant_schedule, draw_truth, during, observed_by

from cislunar.errors import ConfigurationError
from cislunar.observation.measurement import DETECTED, FAINT, NOT_TASKED, measure
from cislunar.observation.records import arranged, highest, pointed_schedule, rows_of, schedule
from cislunar.observation.sensor import Sensor
from cislunar.tasking.demonstration import tracking_problem
from cislunar.tasking.initial_conditions import initial_estimate

BRIGHT = Sensor(limiting_magnitude=30.0)


@pytest.fixture(scope="module")
def problem():
    scene, surfaces, epoch, ids, loop = tracking_problem(4, 3, duration_hours=1.0)
    initial = initial_estimate(epoch, loop.initial.components())
    return (
        scene,
        surfaces,
        [draw_truth(initial, scene, BRIGHT.noise, 5, ids, observations=n) for n in (1, 2)],
    )


def _measured(problem, observations, truth):
    scene, surfaces, _ = problem
    motion = truth.translation, truth.quaternion, truth.noise
    return measure(1, observations, scene, surfaces, BRIGHT, *motion)


def test_rows_are_sorted_by_target_and_step_and_keep_their_order():
    observations = schedule([2, 0, 2, 0, 2], [1, 3, 1, 0, 0], [7, 5, 6, 4, 3], 3, 4)
    target, step = rows_of(observations)
    np.testing.assert_array_equal(target, [0, 0, 2, 2, 2])
    np.testing.assert_array_equal(step, [0, 3, 0, 1, 1])
    np.testing.assert_array_equal(observations.observer, [4, 5, 3, 7, 6])
    np.testing.assert_array_equal(observations.offset, [[0, 1, 1, 1, 2], [2] * 5, [2, 3, 5, 5, 5]])
    best = highest(observations, np.array([1, 4, 2, 3, 1], dtype=np.uint8), NOT_TASKED)
    np.testing.assert_array_equal(best, [[1, 0, 0, 4], [0] * 4, [2, 3, 0, 0]])


def test_idle_observers_observe_nothing_and_two_may_observe_one_target():
    observations = constant_schedule([1, -1, 1, 0], 3, 2)
    np.testing.assert_array_equal(observations.observer, [3, 3, 0, 2, 0, 2])
    np.testing.assert_array_equal(np.diff(observations.offset), [[1, 1], [2, 2], [0, 0]])


@pytest.mark.parametrize("wrong", [{"target": [3]}, {"step": [-1]}, {"observer": [0, 1]}])
def test_indices_out_of_range_are_refused(wrong):
    with pytest.raises(ConfigurationError, match=next(iter(wrong))):
        schedule(**({"target": [0], "step": [0], "observer": [0]} | wrong), n_targets=3, n_steps=2)


@pytest.mark.parametrize(
    "call, name",
    [
        (lambda: pointed_schedule([[0.5]], 2), "schedule: target"),
        (lambda: pointed_schedule([0, 1], 2), "target"),
        (lambda: pointed_schedule([[2]], 2), "schedule: target"),
        (lambda: arranged([0], [2], [0], np.ones((1, 3)), np.ones((1, 3)), 1, 2), "schedule: step"),
        (lambda: arranged([0], [0], [0], np.ones((1, 2)), np.ones((1, 3)), 1, 2), "value"),
        (lambda: arranged([0], [0], [0], np.ones((1, 3)), np.ones((2, 3)), 1, 2), "variance"),
    ],
)
def test_impossible_schedules_and_records_are_refused(call, name):
    with pytest.raises(ConfigurationError, match=f"^{name} "):
        call()


def test_two_observations_have_independent_errors(problem):
    scene, surfaces, (single, double) = problem
    np.testing.assert_array_equal(double.noise[:, :, :1], single.noise)
    both, _ = _measured(problem, constant_schedule([1, -1, 1], 3, 20), double)
    first, _ = observed_by([-1, 0, -1], scene, surfaces, BRIGHT, single, n_steps=20)
    np.testing.assert_array_equal(both.value[::2], first.value)
    again, _ = _measured(problem, schedule([1, 1], [4, 4], [0, 0], 3, 20), double)
    apart = double.noise[1, 5, 1] - double.noise[1, 5, 0]
    np.testing.assert_allclose(again.value[1] - again.value[0], apart, rtol=0.0, atol=1e-12)
    assert np.abs(apart).min() > 0.0


def test_more_observations_than_errors_are_refused(problem):
    with pytest.raises(ConfigurationError, match="noise: 2 observations"):
        _measured(problem, constant_schedule([1, 1], 3, 5), problem[2][0])


def test_some_rows_and_some_steps(problem):
    records, outcome = _measured(problem, constant_schedule([0, 1, 1], 3, 6), problem[2][1])
    assert set(outcome) <= {FAINT, DETECTED} | set(range(5))
    chosen = records.observer == 2
    some = records.where(chosen)
    np.testing.assert_array_equal(some.value, records.value[chosen])
    np.testing.assert_array_equal(np.diff(some.offset), [[0] * 6, [1] * 6, [0] * 6])
    late = during(records, 4, 6)
    np.testing.assert_array_equal(np.diff(late.offset), [[1, 1], [2, 2], [0, 0]])
    np.testing.assert_array_equal(late.value, records.value[rows_of(records)[1] >= 4])


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"states": lambda a: a[:, :1]}, r"attitudes has shape \(3, 61, 4\)"),
        ({"states": lambda a: a[:1]}, r"states has shape \(1,"),
        ({"attitudes": lambda a: a[..., :3]}, "attitudes has shape"),
        ({"noise": lambda a: a[0]}, "noise has shape"),
        ({"dimmed": lambda a: a[:, :2]}, "dimmed has shape"),
        ({"first": lambda _: 58}, "first = 58"),
        ({"observer": lambda a: a + 9}, r"observations\.observer: 9 must be .* below 4"),
    ],
)
def test_arrays_that_do_not_belong_together_are_refused(problem, wrong, words):
    scene, surfaces, truth = problem[0], problem[1], problem[2][0]
    tasked = constant_schedule([1, -1, 2], 3, 5)
    given = {"first": 1, "states": truth.translation, "attitudes": truth.quaternion,
             "noise": truth.noise, "dimmed": np.zeros(truth.translation.shape[:2]),
             "observer": tasked.observer}  # fmt: skip
    name, change = next(iter(wrong.items()))
    given[name] = change(given[name])
    tasked = tasked._replace(observer=given.pop("observer"))
    with pytest.raises(ConfigurationError, match=words):
        measure(observations=tasked, scene=scene, surfaces=surfaces, sensor=BRIGHT, **given)
