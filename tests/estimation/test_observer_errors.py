"""Estimates whose observers have errors, against plain least squares and the textbook's filter."""

from typing import NamedTuple

import numpy as np
import pytest
from scipy.optimize import least_squares as least_squares_of

from cislunar.constants import LENGTH_UNIT_KM
from cislunar.dynamics.bundle import propagate_bundle
from cislunar.dynamics.cr3bp import EARTH_MOON
from cislunar.errors import CislunarError
from cislunar.estimation.estimator import InitialEstimate
from cislunar.estimation.kalman.mukf import mukf
from cislunar.estimation.light_curves.batch import batch
from cislunar.estimation.navigation import navigated_estimator
from cislunar.estimation.navigation.errors import ERROR_UNITS, ObserverErrors, ObserverErrorSigma
from cislunar.estimation.navigation.factory import navigated
from cislunar.estimation.navigation.table import errors_of_observers, load_observer_errors
from cislunar.observation.records import Measurements, rows_of, schedule
from cislunar.observation.sensor import Sensor
from cislunar.observation.target_surfaces import surfaces_of
from cislunar.tasking.demonstration import tracking_problem

SIGMA = ObserverErrorSigma(position_m=200, pointing_arcsec=3, clock_s=0.05)
HOURS, N_OBSERVERS, N_TARGETS = 4, 2, 3
NOISE = np.deg2rad(1.0 / 3600.0)
KM = 1.0 / LENGTH_UNIT_KM
START = np.concatenate([[0.02] * 3, [1e-6] * 3, [2.0 * KM] * 3, [1e-5 * 0.5] * 3])


class Case(NamedTuple):
    problem: tuple
    initial: InitialEstimate
    measurements: Measurements
    error: np.ndarray  # observer, 6; nondimensional, rad, s
    states: np.ndarray  # target, 6; at the epoch
    rows: tuple


def angles(problem, states, error, rows):
    """Right ascension and declination of each row, from states (target, time, 6), with target and
    observer moved to the time of the exposure one by one."""
    scene = problem.scene
    target, step, observer = rows
    index = step + 1
    late = error[observer, 5, None] * scene.step / scene.step_s
    there = states[target, index]
    position = there[:, :3] + there[:, 3:] * late
    place = scene.observer_position + error[:, None, :3]
    velocity = np.gradient(place, scene.step, axis=1)[observer, index]
    way = position - place[observer, index] - velocity * late
    # the frame turns about z by the time, so that in the axes of the time stamp
    c, s = np.cos(late[:, 0]), np.sin(late[:, 0])
    x, y, z = way.T
    way = np.stack([c * x - s * y, s * x + c * y, z], axis=1)
    x, y, z = np.einsum("nij,nj->in", scene.observer_axes[index], way)
    found = np.stack([np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))], axis=1)
    return found + error[observer, 3:5]


def carried(problem, states):
    """States (target, time, 6) at all times of the scene."""
    n_steps = problem.scene.sun_position.shape[0] - 1
    return propagate_bundle(states, problem.scene.step, n_steps)


def simulated(problem, sigma, start=START):
    """Measurements of random states by observers with random errors."""
    rng = np.random.default_rng(5)
    step = np.repeat(np.arange(60 * HOURS), N_OBSERVERS)
    observer = np.tile(np.arange(N_OBSERVERS), 60 * HOURS)
    target = (step // 7 + observer) % N_TARGETS
    plan = schedule(target, step, observer, N_TARGETS, 60 * HOURS)
    order = np.lexsort((step, target))
    rows = target[order], step[order], observer[order]
    states = problem.epoch + start[6:] * rng.standard_normal((N_TARGETS, 6))
    error = sigma.constant() * rng.standard_normal((N_OBSERVERS, 6))
    value = np.full((step.size, 3), 15.0)
    value[:, 1:] = angles(problem, carried(problem, states), error, rows)
    value[:, 1:] += NOISE * rng.standard_normal((step.size, 2))
    variance = np.tile([0.01, NOISE**2, NOISE**2], (step.size, 1))
    initial = InitialEstimate(
        np.tile([0.0, 0.0, 0.0, 1.0], (N_TARGETS, 1)),
        np.full((N_TARGETS, 3), 1e-4),
        problem.epoch,
        start,
    )
    return Case(problem, initial, Measurements(*plan, value, variance), error, states, rows)


@pytest.fixture(scope="module")
def case():
    return simulated(tracking_problem(N_OBSERVERS, N_TARGETS, duration_hours=HOURS), SIGMA)


@pytest.fixture(scope="module")
def linear(case):
    """Derivatives of the measured angles (row, 2, 28) by all states and errors in units of their
    prior deviations, and residuals (row, 2) of the prior means."""
    unit = np.concatenate([np.tile(START[6:], N_TARGETS), np.tile(SIGMA.constant(), N_OBSERVERS)])

    def expected(theta):
        n = 6 * N_TARGETS
        states = case.problem.epoch + theta[:n].reshape(-1, 6)
        error = theta[n:].reshape(-1, 6)
        return angles(case.problem, carried(case.problem, states), error, case.rows)

    center = expected(np.zeros(unit.size))
    columns = [
        (expected(0.5 * unit * one) - expected(-0.5 * unit * one)) for one in np.eye(unit.size)
    ]
    return np.stack(columns, axis=2), case.measurements.value[:, 1:] - center


def transitions(case):
    """Transition matrices (target, 6, 6) to the last time, in units of the prior deviations."""
    out = np.empty((N_TARGETS, 6, 6))
    for c in range(6):
        change = np.zeros(6)
        change[c] = 0.5 * START[6 + c]
        out[:, :, c] = (
            carried(case.problem, case.problem.epoch + change)
            - carried(case.problem, case.problem.epoch - change)
        )[:, -1]
    return out


def advanced(case, treatment, factory, pieces=1, sigma=SIGMA):
    """The treating estimator after all measurements, in some pieces, and its last estimates."""
    sensor = Sensor(angle_noise_arcsec=1, occultation=False)
    given = case.problem.scene, case.problem.surfaces, sensor, case.initial
    make = navigated(factory, treatment, sigma)
    estimator = make(*given, np.random.default_rng(0), EARTH_MOON)
    _, step = rows_of(case.measurements)
    n_steps = case.measurements.offset.shape[1] - 1
    size = n_steps // pieces
    for start in range(0, n_steps, size):
        part = case.measurements.where((step >= start) & (step < start + size))
        offset = np.ascontiguousarray(part.offset[:, start : start + size + 1])
        found = estimator.advance(part._replace(offset=offset), covariance=True)
    return estimator, found


def least_squares(linear):
    """Mean and covariance of all states and errors, in units of their prior deviations."""
    design, residual = linear
    rows = design.reshape(-1, design.shape[2]) / NOISE
    covariance = np.linalg.inv(np.eye(rows.shape[1]) + rows.T @ rows)
    return covariance @ rows.T @ residual.ravel() / NOISE, covariance


def at_the_end(case, mean, covariance, target):
    """State of a target at the last time, and its covariance."""
    phi, own = transitions(case)[target], slice(6 * target, 6 * target + 6)
    nominal = carried(case.problem, case.problem.epoch)[target, -1]
    return nominal + phi @ mean[own], phi @ covariance[own, own] @ phi.T


def close(first, second, covariance, share):
    """Whether two means differ by less than a share of a standard deviation in any direction."""
    difference = first - second
    return difference @ np.linalg.solve(covariance, difference) < share**2


@pytest.mark.parametrize("pieces", [1, 4])
@pytest.mark.parametrize("factory", [mukf(use_magnitude=False), batch("single-start")])
def test_the_calibration_is_the_least_squares_of_all_targets_and_errors(
    case, linear, factory, pieces
):
    estimator, _ = advanced(case, "calibrated", factory, pieces)
    mean, covariance = least_squares(linear)
    n = 6 * N_TARGETS
    unit = SIGMA.constant() / ERROR_UNITS
    errors = estimator.observers()
    for o in range(N_OBSERVERS):
        own = slice(n + 6 * o, n + 6 * o + 6)
        expected = unit[:, None] * covariance[own, own] * unit
        assert close(errors.mean[o], unit * mean[own], expected, 0.05)
        np.testing.assert_allclose(np.diag(errors.covariance[o]), np.diag(expected), rtol=0.02)
    orbits = estimator.orbits()
    for j in range(N_TARGETS):
        state, spread = at_the_end(case, mean, covariance, j)
        assert close(orbits.translation[j], state, spread, 0.05)
        ratio = np.linalg.eigvals(np.linalg.solve(spread, orbits.covariance[j]))
        np.testing.assert_allclose(ratio.real, 1.0, atol=0.05)
    # the errors are worth estimating here, and their prior has been left behind
    assert np.sqrt(np.diag(errors.covariance[0]))[3] < 0.7 * unit[3]


def test_errors_are_estimated_near_an_observer():
    """At 150 km from a target that is known to 5 m, the second-order effect of a position error of
    1 km on an angle is up to 9 arcsec, or 7 m. The nonlinear least squares is that of SciPy."""
    problem = tracking_problem(N_OBSERVERS, N_TARGETS, duration_hours=HOURS)
    beside = problem.scene.observer_position.copy()
    beside[0] = carried(problem, problem.epoch)[0, :, :3] + KM * np.array([120.0, -80.0, 40.0])
    near = problem._replace(scene=problem.scene._replace(observer_position=beside))
    sigma, start = ObserverErrorSigma(position_m=1000), np.append(START[:6], 2.5e-3 * START[6:])
    case = simulated(near, sigma, start)
    unit = np.concatenate([np.tile(start[6:], N_TARGETS), np.repeat(1000 * ERROR_UNITS[0], 6)])
    n = 6 * N_TARGETS

    def residuals(theta):
        states = near.epoch + (unit * theta)[:n].reshape(-1, 6)
        error = np.zeros((N_OBSERVERS, 6))
        error[:, :3] = (unit * theta)[n:].reshape(-1, 3)
        found = angles(near, carried(near, states), error, case.rows)
        return np.append((case.measurements.value[:, 1:] - found) / NOISE, theta)

    found = least_squares_of(residuals, np.zeros(unit.size), diff_step=1e-5)
    covariance = np.linalg.inv(found.jac.T @ found.jac) * unit[:, None] * unit
    estimator, _ = advanced(case, "calibrated", mukf(use_magnitude=False), sigma=sigma)
    errors = estimator.observers()
    for o in range(N_OBSERVERS):
        own = slice(n + 3 * o, n + 3 * o + 3)
        mean, expected = (
            (unit * found.x)[own] / ERROR_UNITS[0],
            covariance[own, own] / ERROR_UNITS[0] ** 2,
        )
        assert close(errors.mean[o, :3], mean, expected, 0.5)
        sigmas = np.sqrt(np.diag(errors.covariance[o])[:3] / np.diag(expected))
        assert np.all((sigmas > 0.9) & (sigmas < 1.3)), sigmas
        assert close(errors.mean[o, :3], case.error[o, :3] / ERROR_UNITS[0], expected, 3.5)


def test_an_estimate_at_a_step_is_that_of_its_own_target_alone(case, linear, monkeypatch):
    """Before the information is added up, a target has its own rows."""
    monkeypatch.setattr(navigated_estimator, "_BLOCK_S", 3600.0 * HOURS)
    _, found = advanced(case, "calibrated", mukf(use_magnitude=False))
    design, residual = linear
    for j in range(N_TARGETS):
        of = case.rows[0] == j
        mean, covariance = least_squares((design[of], residual[of]))
        state, spread = at_the_end(case, mean, covariance, j)
        assert close(found.translation[j, -1], state, spread, 0.05)
        ratio = np.linalg.eigvals(np.linalg.solve(spread, found.covariance[j, -1]))
        np.testing.assert_allclose(ratio.real, 1.0, atol=0.05)


@pytest.mark.parametrize("factory", [mukf(use_magnitude=False), batch("single-start")])
def test_the_considered_errors_give_the_filter_of_schmidt(case, linear, factory):
    """Textbook recursion (Jazwinski 1970, section 8.4) for the states at the epoch."""
    _, found = advanced(case, "considered", factory, 2)
    design, residual = linear
    n = 6 * N_TARGETS
    for j in range(N_TARGETS):
        own = slice(6 * j, 6 * j + 6)
        state, p, c = np.zeros(6), np.eye(6), np.zeros((6, design.shape[2] - n))
        b = np.eye(c.shape[1])
        for row in np.flatnonzero(case.rows[0] == j):
            h, k = design[row][:, own], design[row][:, n:]
            s = h @ p @ h.T + h @ c @ k.T + k @ c.T @ h.T + k @ b @ k.T + NOISE**2 * np.eye(2)
            gain = (p @ h.T + c @ k.T) @ np.linalg.inv(s)
            state = state + gain @ (residual[row] - h @ state)
            p, c = p - gain @ (h @ p + k @ c.T), c - gain @ (h @ c + k @ b)
        mean, covariance = np.zeros(n), np.zeros((n, n))
        mean[own], covariance[own, own] = state, p
        expected, spread = at_the_end(case, mean, covariance, j)
        assert close(found.translation[j, -1], expected, spread, 0.05)
        ratio = np.linalg.eigvals(np.linalg.solve(spread, found.covariance[j, -1]))
        np.testing.assert_allclose(ratio.real, 1.0, atol=0.05)


def test_without_errors_both_treatments_leave_the_filter_as_it_is(case):
    tiny = ObserverErrorSigma(position_m=1e-6)
    for treatment in ("considered", "calibrated"):
        estimator, found = advanced(case, treatment, mukf(use_magnitude=False), sigma=tiny)
        plain = advanced(case, "none", mukf(use_magnitude=False))[1]
        spread = plain.covariance[:, -1]
        for j in range(N_TARGETS):
            assert close(found.translation[j, -1], plain.translation[j, -1], spread[j], 1e-2)
        np.testing.assert_allclose(found.sigma, plain.sigma, rtol=1e-3)
        assert estimator.predict().root.shape == (N_TARGETS, 12, 12)


@pytest.mark.parametrize("treatment", ["considered", "calibrated"])
def test_predictions_are_those_of_the_next_step(case, treatment):
    """The joint root has the covariance of the orbit; that of calibrated errors is less than the
    covariance of the estimates, by what the errors of the observers contribute."""
    estimator, _ = advanced(case, treatment, mukf(use_magnitude=False))
    ahead = estimator.predict()
    if treatment == "calibrated":
        excess = estimator.orbits().covariance - ahead.covariance
        assert np.all(np.linalg.eigvalsh(excess[:, :3, :3]) > 0.0)
    lower = ahead.root[:, 6:]
    np.testing.assert_allclose(lower @ lower.swapaxes(1, 2), ahead.covariance, rtol=1e-6)
    now = estimator.orbits()
    step = case.problem.scene.step
    moved = propagate_bundle(now.translation, step, 1)[:, 1]
    np.testing.assert_allclose(moved, ahead.translation, atol=1e-9)


def test_tracks_are_added_and_removed_with_their_sensitivities(case):
    estimator, _ = advanced(case, "calibrated", mukf(use_magnitude=False), 2)
    before = estimator.orbits()
    one = np.array([1])
    estimator.add(case.initial.of_targets(one), surfaces_of(case.problem.surfaces, one))
    estimator.remove([0])
    after = estimator.orbits()
    np.testing.assert_array_equal(after.translation[:2], before.translation[1:])
    np.testing.assert_array_equal(after.covariance[:2], before.covariance[1:])
    with pytest.raises(CislunarError, match="cannot be replaced"):
        estimator.replace_orbits([0], after.translation[:1], after.covariance[:1])


def test_a_prior_is_needed_and_values_are_checked(tmp_path):
    with pytest.raises(CislunarError, match="needs a prior") as caught:
        ObserverErrors(treatment="calibrated")
    assert "\n" not in str(caught.value)
    with pytest.raises(CislunarError, match="needs a prior"):
        navigated(mukf(), "considered", ObserverErrorSigma())
    with pytest.raises(CislunarError, match="must be one of none"):
        navigated(mukf(), "ignored", SIGMA)
    with pytest.raises(CislunarError, match="position_m"):
        ObserverErrorSigma(position_m=-1)
    # a table replaces the random constants, so that its size is no prior of zero
    given = ObserverErrors(table="t.csv", treatment="calibrated", prior={"position_m": 100})
    assert given.truth.present is False and given.assumed.position_m == 100


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("observer,clock_s\nfar,1\n", "there is no observer 'far'"),
        ("observer,clock_s\n2,1\n", "there is no observer '2'"),
        ("observer,clock_s\n0,1\nhere,2\n", "the same observer"),
        ("observer,clock_s\n0,x\n", "clock_s = 'x' must be a finite number"),
        ("observer,clock\n0,1\n", "column 'clock' is none of"),
        ("observer\n0\n", "no column of errors"),
        ("clock_s\n0\n", "no column observer"),
    ],
)
def test_a_faulty_table_is_refused_in_one_line(tmp_path, text, message):
    path = tmp_path / "observers.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(CislunarError, match=message) as caught:
        errors_of_observers(path, load_observer_errors(path), [["0", "here"], ["1"]])
    assert "\n" not in str(caught.value)


def test_a_table_has_errors_by_name_or_number(tmp_path):
    path = tmp_path / "observers.csv"
    path.write_text("observer,position_y_m,clock_s\nhere,50,\n1,,0.5\n", encoding="utf-8")
    found = errors_of_observers(path, load_observer_errors(path), [["0", "here"], ["1"]])
    np.testing.assert_array_equal(found, [[0, 50, 0, 0, 0, 0], [0, 0, 0, 0, 0, 0.5]])
