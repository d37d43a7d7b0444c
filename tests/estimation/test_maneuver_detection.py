"""Detection of maneuvers against plain Kalman filters, least squares and simulation."""

import numpy as np
import pytest
from plain_kalman import (
    N_STEPS,
    OBSERVERS,
    PRIOR,
    SIGMA,
    SPACING,
    advanced,
    angles,
    empty_test,
    filtered,
    monitored,
    observed_steps,
    schedule_of,
    transitions,
)
from scipy.optimize import least_squares
from scipy.stats import chi2, kstest

from cislunar.dynamics.bundle import propagate_bundle
from cislunar.dynamics.cr3bp import EARTH_MOON
from cislunar.dynamics.maneuvers import VELOCITY_UNIT_M_S, Impulses, propagate_with_impulses
from cislunar.errors import ConfigurationError
from cislunar.estimation.initial_sigma import ProcessNoise
from cislunar.estimation.maneuvers import (
    ManeuverTest,
    detectable_impulse,
    exceedance_probability,
    false_alarm_threshold,
    impulse_bound,
    impulse_detection_probability,
    planned_bound,
    planned_information,
    threshold_of_schedule,
    whitened_tests,
)
from cislunar.observation.records import pointed_schedule, rows_of
from cislunar.tasking.demonstration import tracking_problem


@pytest.fixture(scope="module")
def problem():
    return tracking_problem(4, 3, duration_hours=N_STEPS / 60)


@pytest.fixture(scope="module")
def orbit(problem):
    """Mean state, its path and transition matrices."""
    scene, _, epoch, *_ = problem
    start = epoch[2]
    path = propagate_bundle(start[None], scene.step, N_STEPS)[0]
    return start, path, transitions(path, scene)


CHANGE = np.array([0.4, -0.8, 0.6]) / VELOCITY_UNIT_M_S


def test_impulse_and_statistic_are_those_of_least_squares(problem, orbit):
    """Against the fits of all measurements with and without an impulse at the known time."""
    scene, start = problem.scene, orbit[0]
    run = filtered(problem, orbit, np.random.default_rng(2), (2 * SPACING, CHANGE))
    test, found, _ = monitored(scene, start, [run])
    now = test.hypotheses(N_STEPS)
    root = np.linalg.cholesky(np.linalg.inv(PRIOR)).T

    def residuals(parameters, step):
        impulse = Impulses(
            np.zeros(1, dtype=np.int64), np.array([step * scene.step]), parameters[None, 6:]
        )
        path = propagate_with_impulses(
            (start + parameters[:6])[None], scene.step, N_STEPS, impulse
        )[0]
        rows = [angles(scene, path[k], k, o) for k in observed_steps() for o in OBSERVERS]
        return np.concatenate([((run[0] - rows) / SIGMA).ravel(), root @ parameters[:6]])

    scale = np.concatenate([np.sqrt(np.diag(PRIOR)), np.full(3, 1e-3)])
    fine = {"xtol": 1e-14, "jac": "3-point", "diff_step": 1e-3}
    coasting = least_squares(
        lambda p: residuals(np.append(p * scale[:6], np.zeros(3)), 0), np.zeros(6), **fine
    )
    for h in (0, 1, 2, 3, 4):
        step = SPACING * h
        fit = least_squares(lambda p, step=step: residuals(p * scale, step), np.zeros(9), **fine)
        at = now.index[0].tolist().index(step)
        statistic = 2.0 * (coasting.cost - fit.cost)
        assert now.statistic[0, at] == pytest.approx(statistic, rel=2e-3, abs=0.02)
        covariance = np.linalg.inv(fit.jac.T @ fit.jac)[6:, 6:] * 1e-6 * VELOCITY_UNIT_M_S**2
        sigma = np.sqrt(np.diag(covariance))
        estimate = fit.x[6:] * 1e-3 * VELOCITY_UNIT_M_S
        assert np.all(np.abs(now.impulse_m_s[0, at] - estimate) < 0.03 * sigma)
        np.testing.assert_allclose(
            now.covariance[0, at] / np.outer(sigma, sigma),
            covariance / np.outer(sigma, sigma),
            atol=0.01,
        )
    assert found[0].statistic[0] >= now.statistic[0].max() * (1 - 1e-12)


def test_time_and_impulse_of_a_larger_maneuver(problem, orbit):
    change = 3.0 * CHANGE
    run = filtered(problem, orbit, np.random.default_rng(2), (2 * SPACING, change))
    _, (best,), _ = monitored(problem.scene, orbit[0], [run])
    assert best.statistic[0] > 200.0 and best.index[0] == 2 * SPACING
    assert 2 * SPACING < best.tested[0] <= N_STEPS
    off = best.impulse_m_s[0] - VELOCITY_UNIT_M_S * change
    assert off @ np.linalg.solve(best.covariance[0], off) < chi2.isf(1e-3, 3)


def test_pieces_give_the_same_and_nis_is_that_of_the_filter(problem, orbit):
    noise = ProcessNoise(position_km=0.01, velocity_m_s=0.001)
    rng = np.random.default_rng(4)
    runs = [filtered(problem, orbit, rng, noise=noise) for _ in range(3)]
    given = problem.scene, orbit[0], runs, noise
    one, whole, squared = monitored(*given)
    several, parts, each = monitored(*given, pieces=4)
    for first, second in zip(one._own, several._own, strict=True):
        np.testing.assert_allclose(first, second, rtol=1e-9, atol=1e-12 * np.abs(first).max())
    largest = np.max([part.statistic for part in parts], axis=0)
    np.testing.assert_allclose(largest, whole[0].statistic, rtol=1e-9)
    (target, nis), expected = squared[0], np.array([run[3] for run in runs])
    for j in range(3):
        np.testing.assert_allclose(nis[target == j], expected[j], rtol=1e-4, atol=1e-5)
    assert sum(part[1].size for part in each) == nis.size


def test_tracks_come_and_go(problem, orbit):
    """The others keep their statistics; a new track is tested from the next hypothesized time."""
    rng, half = np.random.default_rng(11), N_STEPS // 2
    runs = [filtered(problem, orbit, rng) for _ in range(3)]
    whole, _, _ = monitored(problem.scene, orbit[0], runs)
    test = empty_test(problem.scene, 3)
    advanced(test, orbit[0], runs, 0, half)
    test.remove([1])
    test.add(1)
    advanced(test, orbit[0], [runs[0], runs[2], runs[1]], half, N_STEPS)
    before, after = whole.hypotheses(N_STEPS), test.hypotheses(N_STEPS)
    for name in ("statistic", "impulse_m_s", "covariance"):
        first, second = getattr(before, name), getattr(after, name)
        np.testing.assert_allclose(second[:2], first[[0, 2]], rtol=1e-6, atol=1e-9)
        later = before.index[1] > half
        assert later.sum() == 3
        np.testing.assert_allclose(second[2, later], first[1, later], rtol=1e-6, atol=1e-9)
    assert np.all(after.statistic[2, after.index[2] <= half] == 0.0)


def test_without_a_maneuver_the_statistic_is_chi_squared(problem, orbit):
    rng = np.random.default_rng(5)
    runs = [filtered(problem, orbit, rng) for _ in range(150)]
    test, _, _ = monitored(problem.scene, orbit[0], runs)
    now = test.hypotheses(N_STEPS)
    for h in range(4):
        at = now.index[0].tolist().index(SPACING * h)
        assert kstest(now.statistic[:, at], chi2(3).cdf).pvalue > 0.01


@pytest.fixture(scope="module")
def planned(problem, orbit):
    return planned_information(
        problem.scene,
        EARTH_MOON,
        orbit[0][None],
        PRIOR[None],
        schedule_of(1),
        np.full(2 * len(observed_steps()), SIGMA**2),
        spacing_minutes=SPACING,
    )


def test_planned_information_is_that_of_the_test(problem, orbit, planned):
    """The bound before any measurement, and the covariance of the test afterwards."""
    times, whitened = planned
    np.testing.assert_allclose(times, 60.0 * SPACING * np.arange(7))
    assert np.all(np.isinf(impulse_bound(whitened)[6]))  # at the end of the run
    run = filtered(problem, orbit, np.random.default_rng(6))
    test, _, _ = monitored(problem.scene, orbit[0], [run])
    now, bound = test.hypotheses(N_STEPS), impulse_bound(whitened)
    for h in range(5):
        at = now.index[0].tolist().index(SPACING * h)
        sigma = np.sqrt(np.diag(bound[h]))
        np.testing.assert_allclose(
            (now.covariance[0, at] - bound[h]) / np.outer(sigma, sigma), 0.0, atol=0.02
        )


def test_planned_bounds_count_the_observations_of_a_target_until_a_time(problem, planned):
    """All of them in the end, none within a minute, and those of the first half in between."""
    step_s, half = problem.scene.step_s, 0.5 * N_STEPS * problem.scene.step_s / 3600.0
    spans = [1.0 / 60.0, half, 2.0 * half]
    bound = planned_bound(planned, schedule_of(1), step_s, spans)
    assert bound.shape == (1, planned[0].size, 3, 3, 3)
    np.testing.assert_array_equal(bound[0, :, 2], impulse_bound(planned[1]))
    assert np.all(np.isinf(bound[0, :, 0]))
    step = rows_of(schedule_of(1))[1] + 1
    early = planned[1][step <= N_STEPS // 2][:, :1]
    np.testing.assert_allclose(bound[0, 0, 1], impulse_bound(early)[0], rtol=1e-9)
    least = detectable_impulse(bound, 28.2)
    assert least.shape == (1, planned[0].size, 3, 2)
    assert np.all(np.isinf(least[0, :, 0])) and np.all(least[0, 0, 2] < least[0, 0, 1])
    two = pointed_schedule(np.full((3, 1), 1), 2)
    few = planned[0], np.zeros((3, planned[0].size, 2, 3))
    assert np.all(np.isinf(planned_bound(few, two, step_s)))
    with pytest.raises(ConfigurationError, match="planned whitened"):
        planned_bound(planned, two, step_s)
    with pytest.raises(ConfigurationError, match="bound has shape"):
        detectable_impulse(np.ones(3), 28.2)
    with pytest.raises(ConfigurationError, match="bound is not positive definite"):
        detectable_impulse(-np.eye(3), 28.2)


def test_power_is_that_of_simulated_impulses(planned):
    _, whitened = planned
    bound, threshold = impulse_bound(whitened)[2], 20.0
    worst = np.linalg.eigh(bound)
    least = detectable_impulse(bound, threshold, 0.7)
    impulse = least[1] * worst[1][:, -1]
    assert impulse_detection_probability(impulse, bound, threshold) == pytest.approx(0.7, abs=1e-9)
    rng, rows = np.random.default_rng(7), whitened[:, 2].reshape(-1, 3)
    left = np.linalg.svd(rows, full_matrices=False)[0]
    noise = rng.standard_normal((20_000, rows.shape[0])) + rows @ impulse
    share = np.mean(np.sum((noise @ left) ** 2, axis=1) > threshold)
    assert share == pytest.approx(0.7, abs=4 * np.sqrt(0.21 / 20_000))
    with pytest.raises(ConfigurationError, match="probability"):
        detectable_impulse(bound, threshold, 1.0)


def test_power_of_unknown_and_impossible_bounds():
    bounds = np.array([np.full((3, 3), np.inf), np.eye(3)])
    found = impulse_detection_probability([1.0, 0.0, 0.0], bounds, 20.0)
    assert found[0] == chi2.sf(20.0, 3)
    assert found[1] == impulse_detection_probability([1.0, 0.0, 0.0], np.eye(3), 20.0) > found[0]
    for impulse, bound, message in (
        (np.ones(3), np.zeros((3, 3)), "bound is singular"),
        (np.ones(3), np.eye(2), "bound has shape"),
        (np.ones(3), np.full((3, 3), np.nan), "bound must not be NaN"),
        (np.ones(2), np.eye(3), "impulse_m_s has shape"),
        (np.full(3, np.nan), np.eye(3), "impulse_m_s is not finite"),
        (np.ones((3, 3)), bounds, "bound has shape .* and impulse_m_s"),
    ):
        with pytest.raises(ConfigurationError, match=message):
            impulse_detection_probability(impulse, bound, 20.0)
    with pytest.raises(ConfigurationError, match="bound must not be NaN"):
        detectable_impulse(np.full((3, 3), np.nan), 20.0)


def test_false_alarms_are_those_of_a_simulation(planned):
    """Of all tests of a linear system, each a linear function of white innovations."""
    tests = whitened_tests(planned[1])
    for matrix in tests[::20]:
        np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-9)
    wanted, n = 0.02, 40_000
    threshold = threshold_of_schedule(tests, wanted, samples=2000)
    assert chi2.isf(wanted, 3) < threshold < false_alarm_threshold(wanted, len(tests))
    found, error = exceedance_probability(tests, threshold, np.random.default_rng(9), samples=2000)
    assert abs(found - wanted) < 5.0 * error
    noise = np.random.default_rng(8).standard_normal((n, tests.shape[2]))
    largest = np.zeros(n)
    for matrix in tests:
        largest = np.maximum(largest, np.sum((noise @ matrix.T) ** 2, axis=1))
    share = np.mean(largest > threshold)
    assert abs(share - found) < 4.0 * np.hypot(np.sqrt(wanted / n), error)


def test_impossible_settings(problem):
    for given, words in (
        ({"spacing_minutes": 0.1}, "spacing_minutes = 0.1 must be a multiple of step_s"),
        ({"spacing_minutes": 7.5}, "spacing_minutes = 7.5 must be a multiple of step_s"),
        ({"spacing_minutes": 120, "window_hours": 1}, "at most window_hours"),
        ({"window_hours": float("nan")}, "window_hours"),
    ):
        with pytest.raises(ConfigurationError, match=words):
            ManeuverTest(problem.scene, (), 1, **given)
    for rate in (0.0, 1.0, np.nan):
        with pytest.raises(ConfigurationError, match="false_alarms_per_target_day"):
            false_alarm_threshold(rate)
