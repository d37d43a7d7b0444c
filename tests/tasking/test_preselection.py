"""Assignments from few pairs against those of the whole matrix, and bounds against the pairs."""

import numpy as np
import pytest

from cislunar.estimation.kalman.mukf import MultiplicativeUKF
from cislunar.observation.sensor import Sensor
from cislunar.tasking.closed_loop import run_closed_loop
from cislunar.tasking.demonstration import tracking_problem
from cislunar.tasking.initial_conditions import initial_estimate
from cislunar.tasking.planning import preselection
from cislunar.tasking.planning.assignment import IDLE, assign
from cislunar.tasking.planning.information import TaskingModel, information_bound, pair_information

N_TARGETS = 600


@pytest.fixture(scope="module")
def problem():
    scene, surfaces, epoch, _, settings = tracking_problem(12, N_TARGETS, duration_hours=1.0)
    initial = initial_estimate(epoch, settings.initial.components())
    return scene, surfaces, MultiplicativeUKF(scene, surfaces, Sensor(), initial).predict()


def _covariances(covariance, kind, rng):
    """Covariances of targets tracked well, unobserved for long, or known except along a line."""
    if kind == "epoch":
        return covariance
    if kind == "any":
        return covariance * 10.0 ** rng.uniform(-4.0, 5.0, (N_TARGETS, 1, 1))
    if kind == "lost":
        return covariance * 10.0 ** rng.uniform(3.0, 9.0, (N_TARGETS, 1, 1))
    line = rng.standard_normal((N_TARGETS, 6)) * 10.0 ** rng.uniform(-6.0, -0.5, (N_TARGETS, 1))
    return covariance + np.einsum("ni,nj->nij", line, line)


STATES = ("epoch", "any", "lost", "along a line")


@pytest.mark.parametrize("kind", STATES)
@pytest.mark.parametrize("gate", [True, False])
def test_no_pair_gains_more_than_its_bound(problem, kind, gate):
    scene, surfaces, prediction = problem
    rng = np.random.default_rng(1)
    translation = prediction.translation.copy()
    # Some targets straight above and below an observer, where right ascension has its pole.
    above = scene.observer_position[0, prediction.index]
    translation[:20, :3] = above + rng.uniform(-0.05, 0.05, (20, 1)) * [0.0, 0.0, 1.0]
    translation[:20, :3] += rng.normal(0.0, 1e-3, (20, 3))
    covariance = _covariances(prediction.covariance, kind, rng)
    prediction = prediction._replace(translation=translation, covariance=covariance)
    model, sensor = (
        TaskingModel(pointing_uncertainty_gate=gate, measurements=3),
        Sensor(limiting_magnitude=22.0),
    )
    gain = pair_information(prediction, scene, surfaces, sensor, model)
    bound = information_bound(prediction, scene, sensor, model)
    seen = gain > 0.0
    assert np.all(bound >= gain)
    assert seen.sum() > 50
    if kind == "epoch":
        assert np.median((bound - gain)[seen]) < 1e-5
    if gate:
        assert np.mean(bound[~seen] == 0.0) > 0.5


@pytest.mark.parametrize("kind", STATES)
def test_few_pairs_give_the_assignment_of_all(problem, kind, monkeypatch):
    scene, surfaces, prediction = problem
    covariance = _covariances(prediction.covariance, kind, np.random.default_rng(2))
    covariance[3] = -1.0
    translation = prediction.translation.copy()
    translation[7] = np.nan
    arguments = (
        prediction._replace(translation=translation, covariance=covariance),
        *(scene, surfaces, Sensor(), TaskingModel()),
    )
    computed = []

    def count(*args, selected, out):
        computed.append(int(selected.sum()))
        return pair_information(*args, selected=selected, out=out)

    monkeypatch.setattr(preselection, "pair_information", count)
    found = preselection.assign_preselected(*arguments)
    whole = assign(pair_information(*arguments))
    np.testing.assert_array_equal(found.target, whole.target)
    assert found.information == whole.information
    assert sum(computed) < 0.2 * 12 * N_TARGETS


@pytest.mark.parametrize("shape", [(4, 60), (15, 200), (30, 40), (20, 9), (3, 1)])
def test_assignments_by_bounds_are_those_of_the_matrix(shape):
    """Competing, blind and idle observers, useless targets, and loose or infinite bounds."""
    rng = np.random.default_rng(shape)
    for trial in range(20):
        common = rng.exponential(1.0, shape[1])
        gain = common + rng.exponential(0.1 + trial % 3, shape)
        gain[rng.random(shape) < rng.choice([0.0, 0.5, 0.97])] = 0.0
        gain[rng.random(shape[0]) < 0.2] = 0.0
        bound = gain + rng.exponential(0.3, shape)
        bound[rng.random(shape) < 0.1] = np.inf
        bound[(gain == 0.0) & (rng.random(shape) < 0.5)] = 0.0

        def compute(selected, out, gain=gain):
            out[selected] = gain[selected]

        found, whole = preselection.assign_by_bounds(bound, compute), assign(gain)
        np.testing.assert_array_equal(found.target, whole.target)
        assert found.information == whole.information


@pytest.mark.parametrize("difference, few", [(0.0, False), (1e-10, False), (2e-9, True)])
def test_ties_are_settled_as_by_the_whole_matrix(difference, few):
    """With equal observers and targets all pairs are computed, and SciPy decides. Information that
    differs after rounding is not equal."""
    rng = np.random.default_rng(5)
    for _ in range(40):
        # no two sums of different pairs are equal, unless observers 1 and 3 are
        gain = rng.integers(0, 4, (6, 40)) + rng.random((6, 40)) * (difference > 1e-9)
        gain[3] = gain[1] + difference * np.arange(40) * (gain[1] > 0.0)
        known = np.zeros(gain.shape, dtype=bool)

        def compute(selected, out, gain=gain, known=known):
            known |= selected
            out[selected] = gain[selected]

        found, whole = preselection.assign_by_bounds(1.01 * gain, compute), assign(gain)
        np.testing.assert_array_equal(found.target, whole.target)
        assert found.information == whole.information
        assert np.all(known[gain > 0.0]) != few


def test_the_loop_is_the_same_whether_pairs_are_preselected(monkeypatch):
    results = []
    for fewest in (1, 10**9):
        monkeypatch.setattr(preselection, "FEWEST_PAIRS", fewest)
        problem = tracking_problem(5, 40, duration_hours=3.0)
        results.append(run_closed_loop(*problem[:4], [0], problem[4]))
    few, whole = results
    assert np.any(few.assignment != IDLE)
    for name in ("assignment", "information", "evaluations", "error", "outcome"):
        np.testing.assert_array_equal(getattr(few, name), getattr(whole, name), name)
