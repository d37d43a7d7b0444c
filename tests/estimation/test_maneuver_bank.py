"""Tests for the bank of maneuver times: against least squares of all parameters at once."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from cislunar.constants import LENGTH_UNIT_KM
from cislunar.dynamics.cr3bp import EARTH_MOON
from cislunar.dynamics.maneuvers import VELOCITY_UNIT_M_S, Impulses, propagate_with_impulses
from cislunar.estimation.maneuvers import AngleRows, ManeuverBank
from cislunar.observation.sightline import direction_angles, wrapped
from cislunar.tasking.demonstration import tracking_problem

SIGMA = np.array([1e-3] * 3 + [1e-3] * 3) * [1.0, 1.0, 1.0, 0.1, 0.1, 0.1]
NOISE = np.deg2rad(3.0 / 3600.0)
IMPULSE_AT, LAST = 241.4, 600


@pytest.fixture(scope="module")
def problem():
    scene, _, epoch, *_ = tracking_problem(3, 2, duration_hours=10.0)
    return scene, epoch[1]


def path(scene, state, time=0.0, change=(0.0, 0.0, 0.0)):
    """States at all times; `time` in steps."""
    impulse = Impulses(np.zeros(1, dtype=int), np.array([time * scene.step]), np.array([change]))
    return propagate_with_impulses(state[None], scene.step, LAST, impulse)[0]


def angles(scene, states, time, observer):
    away = states[time, :3] - scene.observer_position[observer, time]
    axes = scene.observer_axes[time]
    return np.array([direction_angles(*w, each) for w, each in zip(away, axes, strict=True)])


def rows_of(scene, states, rng):
    """Three observers in turn, with gaps of two hours between half hours of observations."""
    time = np.concatenate([np.arange(k, k + 30, 3) for k in range(30, LAST - 30, 150)])
    observer = (time // 3) % 3
    value = angles(scene, states, time, observer) + NOISE * rng.standard_normal((time.size, 2))
    return AngleRows(time, observer, value, np.full((time.size, 2), NOISE**2))


def bank_of(scene, mean, times=(100, 200, 300, 400)):
    process = np.zeros((6, 6))
    base = 0, mean, np.diag(SIGMA**2)
    return ManeuverBank(scene, EARTH_MOON, process, 0, base, np.array(times), 0.14)


@pytest.mark.parametrize(("size_m_s", "prior_m_s"), [(1.0, 1.0), (30.0, 500.0), (400.0, 500.0)])
def test_orbit_and_maneuver_are_those_of_least_squares(problem, size_m_s, prior_m_s):
    scene, epoch = problem
    rng = np.random.default_rng(4)
    change = size_m_s / VELOCITY_UNIT_M_S * np.array([0.6, -0.64, 0.48])
    mean = epoch + SIGMA * rng.standard_normal(6)
    true = path(scene, epoch, IMPULSE_AT, change)
    rows = rows_of(scene, true, rng)
    found = bank_of(scene, mean).solve(rows, LAST)

    unit = np.concatenate([SIGMA, [1.0], np.full(3, size_m_s / VELOCITY_UNIT_M_S)])

    def residuals(x):
        value = x * unit
        states = path(scene, mean + value[:6], value[6], value[7:])
        off = angles(scene, states, rows.time, rows.observer) - rows.value
        prior = x[:6], x[7:] * size_m_s / prior_m_s
        return np.concatenate([*prior, (wrapped(off) / NOISE).ravel()])

    start = np.concatenate([np.zeros(6), [IMPULSE_AT], change / unit[7:]])
    best = least_squares(residuals, start, method="lm", diff_step=1e-5)
    covariance = np.linalg.inv(best.jac.T @ best.jac) * np.outer(unit, unit)
    time, velocity = best.x[6] * unit[6], best.x[7:] * unit[7:]
    maneuver, step_s = found.maneuver, scene.step_s
    assert maneuver.probability > 0.999
    deviation = np.sqrt(np.diag(covariance))
    assert abs(maneuver.time_s / step_s - time) < 0.5 * deviation[6]
    if size_m_s > 1.0:
        assert maneuver.time_sigma_s / step_s == pytest.approx(deviation[6], rel=0.1)
    else:  # all times between two sets of observations are possible, about equally
        assert maneuver.time_sigma_s / step_s == pytest.approx(120.0 / np.sqrt(12.0), rel=0.15)
    error = maneuver.velocity_m_s - VELOCITY_UNIT_M_S * velocity
    assert np.all(np.abs(error) < 0.5 * VELOCITY_UNIT_M_S * deviation[7:])
    np.testing.assert_allclose(
        np.sqrt(np.diag(maneuver.covariance)), VELOCITY_UNIT_M_S * deviation[7:], rtol=0.4
    )
    state = path(scene, mean + best.x[:6] * unit[:6], time, velocity)[-1]
    spread = np.sqrt(np.diag(found.covariance))
    assert np.all(np.abs(found.translation - state) < 0.3 * spread)
    off = found.translation - true[-1]
    assert off @ np.linalg.solve(found.covariance, off) < 22.5  # 99.9 % of six degrees of freedom
    assert np.linalg.norm(off[:3]) * LENGTH_UNIT_KM < 10.0


@pytest.mark.parametrize("size_m_s", [3.0, 30.0])
def test_errors_of_time_and_vector_are_near_the_cramer_rao_bound(problem, size_m_s):
    """Root mean square errors of 40 cases, relative to the bound for an unknown orbit and time."""
    scene, epoch = problem
    unit = np.concatenate([SIGMA, [1.0], np.full(3, size_m_s / VELOCITY_UNIT_M_S)])
    change = unit[7:] * [0.6, -0.64, 0.48]
    states = path(scene, epoch, IMPULSE_AT, change)
    rows = rows_of(scene, states, np.random.default_rng(0))
    true = np.concatenate([epoch, [IMPULSE_AT], change])

    def measured(x):
        return angles(scene, path(scene, x[:6], x[6], x[7:]), rows.time, rows.observer)

    step = unit * [*[1e-3] * 6, 0.3, *[1e-2] * 3]
    sides = [measured(true + each) - measured(true - each) for each in np.diag(step)]
    jacobian = np.array([wrapped(each).ravel() for each in sides]).T / NOISE
    jacobian *= 0.5 * unit / step
    information = jacobian.T @ jacobian + np.diag([1.0] * 6 + [0.0] * 4)  # that of the prior orbit
    bound = (np.sqrt(np.diag(np.linalg.inv(information))) * unit)[6:]
    errors, normalized = [], []
    for seed in range(40):
        rng = np.random.default_rng([7, seed])
        mean = epoch + SIGMA * rng.standard_normal(6)
        found = bank_of(scene, mean).solve(rows_of(scene, states, rng), LAST).maneuver
        off = found.velocity_m_s / VELOCITY_UNIT_M_S - change
        errors.append([found.time_s / scene.step_s - IMPULSE_AT, *off])
        covariance = found.covariance / VELOCITY_UNIT_M_S**2
        normalized.append(off @ np.linalg.solve(covariance, off) / 3.0)
    ratio = np.sqrt(np.mean(np.square(errors), axis=0)) / bound
    assert np.all((ratio > 0.7) & (ratio < 1.5)), ratio
    assert np.mean(normalized) < 2.0


def test_a_change_during_a_set_of_observations(problem):
    """The refined times keep the only likely one among times that are far apart."""
    scene, epoch = problem
    change = np.array([-120.0, -42.0, -280.0]) / VELOCITY_UNIT_M_S
    states = path(scene, epoch, 193.5, change)
    rows = rows_of(scene, states, np.random.default_rng(2))
    rows = AngleRows(*(column[rows.time <= 207] for column in rows))
    found = bank_of(scene, epoch, times=(60, 100, 180, 192, 207)).solve(rows, 220)
    assert abs(found.maneuver.time_s / scene.step_s - 193.5) < 2.0
    off = found.translation - states[220]
    assert off @ np.linalg.solve(found.covariance, off) < 22.5


def test_a_target_that_coasts_keeps_its_orbit(problem):
    """The mixture is the orbit of the filter, unless it has maneuvered."""
    scene, epoch = problem
    rng = np.random.default_rng(5)
    mean = epoch + SIGMA * rng.standard_normal(6)
    rows = rows_of(scene, path(scene, epoch), rng)
    bank = bank_of(scene, mean)
    first = bank.solve(rows, LAST)
    assert first.maneuver.probability < 0.1
    again = bank.solve(rows, LAST)  # from the times of the first
    off = again.translation - first.translation
    assert np.all(np.abs(off) < 0.2 * np.sqrt(np.diag(first.covariance)))


def test_without_later_observations_the_prior_remains(problem):
    scene, epoch = problem
    nothing = AngleRows(*(np.empty(0, dtype=int),) * 2, *(np.empty((0, 2)),) * 2)
    found = bank_of(scene, epoch, times=(0,)).solve(nothing, 60)
    # a maneuver that nothing speaks for has its prior probability, times the width of a step
    assert found.maneuver.probability == pytest.approx(0.14 / 1440.0, rel=1e-3)


def test_without_any_solution_the_target_coasts(problem, monkeypatch):
    scene, epoch = problem
    rng = np.random.default_rng(6)
    rows = rows_of(scene, path(scene, epoch), rng)
    monkeypatch.setattr(ManeuverBank, "_fitted", lambda *given: None)
    found = bank_of(scene, epoch).solve(rows, LAST)
    assert found.maneuver.probability == 0.0 and np.isnan(found.maneuver.time_s)
    off = LENGTH_UNIT_KM * np.linalg.norm(found.translation[:3] - path(scene, epoch)[-1, :3])
    assert off < 10.0
