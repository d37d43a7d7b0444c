"""The posterior Cramer-Rao bound against closed forms and the filter itself."""

import numpy as np
import pytest
from bound_problem import BRIGHT, Problem, used_by
from measured import draw_truth, evaluate

from cislunar.attitude.rigid_body import spherical_transition
from cislunar.dynamics.propagation import propagate_stm
from cislunar.errors import ConfigurationError
from cislunar.evaluation.cramer_rao import CramerRaoBound
from cislunar.tasking.closed_loop import run_closed_loop
from cislunar.tasking.demonstration import tracking_problem
from cislunar.tasking.initial_conditions import initial_estimate
from cislunar.tasking.truth import TruthModel


@pytest.fixture(scope="module")
def problem():
    return Problem()


# Closed forms.


def test_without_measurements_the_initial_uncertainty_is_propagated(problem):
    """With spherical inertia, the rate keeps its uncertainty and the attitude gains t J w."""
    never = np.full_like(problem.observer, -1)
    least = problem.bound(never)
    duration = problem.loop.elapsed_s[-1]
    for j in range(3):
        turn = np.empty((6, 6))
        spherical_transition(problem.truth.angular_velocity[j, 0], duration, turn)
        expected = np.sqrt((turn**2) @ problem.sigma[:6] ** 2)
        np.testing.assert_allclose(least[j, -1, :6], expected, rtol=1e-9)
        _, stm = propagate_stm(problem.truth.translation[j, 0], duration * problem.scene.step / 60)
        expected = np.sqrt((stm**2) @ problem.sigma[6:] ** 2)
        np.testing.assert_allclose(least[j, -1, 6:], expected, rtol=1e-6)


def test_linear_case_in_closed_form(problem):
    """One direction, position known far better than range: the mean of n + 1 measurements.

    With known rates and velocities the motion is known, and the components of position across the
    line of sight are averages.
    """
    sigma = problem.sigma.copy()
    sigma[3:6] *= 1e-9
    sigma[9:] *= 1e-9
    sigma[:3] *= 1e-6
    for count in (1, 4, 9):
        observer = np.full_like(problem.observer, -1)
        observer[:, :count] = 1
        least = problem.bound(observer, sigma)
        for j in range(3):
            d = problem.truth.translation[j, count, :3] - problem.scene.observer_position[1, count]
            axes = problem.scene.observer_axes[count]
            b = axes @ d
            declination = np.arcsin(b[2] / np.linalg.norm(b))
            noise = np.array([BRIGHT.noise[1] * np.cos(declination), BRIGHT.noise[2]])
            across = np.linalg.norm(d) * noise
            expected = (count / across**2 + 1.0 / sigma[6] ** 2) ** -0.5
            variance = (sigma[6] ** 2 + (expected**2).sum()) ** 0.5  # the range is not measured
            got = np.sqrt((least[j, count - 1, 6:9] ** 2).sum())
            assert got == pytest.approx(variance, rel=2e-3)


# Properties of a bound.


def test_more_measurements_never_raise_the_bound(problem):
    every = problem.bound(np.where(problem.observer < 0, 0, problem.observer))
    some = problem.bound()
    none = problem.bound(np.full_like(problem.observer, -1))
    assert np.all(every <= some * (1 + 1e-9)) and np.all(some <= none * (1 + 1e-9))
    assert np.all(every[:, -1] < 0.98 * none[:, -1])


def test_bound_does_not_depend_on_units(problem):
    """Ten times the noise and the initial uncertainty give ten times the bound."""
    ten = problem.bound(sigma=10.0 * problem.sigma, noise=10.0 * BRIGHT.noise)
    np.testing.assert_allclose(ten, 10.0 * problem.bound(), rtol=1e-9)


def test_bound_does_not_depend_on_the_area(problem):
    """A larger body is brighter, but its light curve has the same information."""
    larger = problem.surfaces._replace(areas=7.0 * problem.surfaces.areas)
    np.testing.assert_allclose(problem.bound(surfaces=larger), problem.bound(), rtol=1e-9)


def test_bound_ends_where_the_truth_enters_a_primary(problem):
    translation = problem.truth.translation.copy()
    translation[1, 100:, :3] = [0.9878, 0.0, 0.001]
    lost = Problem.__new__(Problem)
    lost.__dict__ = vars(problem) | {"truth": problem.truth._replace(translation=translation)}
    least = lost.bound()
    assert np.all(np.isnan(least[1, 99:])) and np.all(np.isfinite(least[1, :98]))
    np.testing.assert_array_equal(least[[0, 2]], problem.bound()[[0, 2]])


def test_a_consistent_estimator_does_not_beat_the_bound():
    """Over targets and realizations with many observations; the filter is near the bound."""
    scene, surfaces, epoch, ids, loop = tracking_problem(5, 5, duration_hours=6.0, sensor=BRIGHT)
    result = run_closed_loop(scene, surfaces, epoch, ids, range(8), loop)
    error = (result.error[:, -60:] ** 2).astype(float)
    least = (result.bound[:, -60:] ** 2).astype(float)
    observed = result.valid.mean(axis=1) > 0.3
    assert observed.sum() >= 30
    for part, above in ((slice(6, 9), 1.5), (slice(9, 12), 1.5), (slice(0, 3), np.inf)):
        squared = (error[..., part].sum(axis=3) / least[..., part].sum(axis=3)).mean(axis=1)
        ratio = np.sqrt(squared[observed].mean())
        assert 0.85 < ratio < above, (part, ratio)


def test_the_loop_records_the_bound_of_the_measurements_used():
    scene, surfaces, epoch, ids, loop = tracking_problem(
        2, 3, duration_hours=3.0, sensor=BRIGHT, record_every=7
    )
    result = run_closed_loop(scene, surfaces, epoch, ids, (5,), loop)
    assert result.bound.shape == result.sigma.shape and result.bound.dtype == np.float32
    sigma = loop.initial.components()
    truth = draw_truth(initial_estimate(epoch, sigma), scene, BRIGHT.noise, 5, ids)
    seen_from = np.full(result.valid.shape[1:], -1)
    for number, start in enumerate(loop.epochs):
        for observer, j in enumerate(result.assignment[0, number]):
            if j >= 0:
                window = slice(start, start + loop.steps_per_interval)
                used = result.valid[0, window, j]
                seen_from[window, j] = np.where(used, observer, -1)
    least = CramerRaoBound(scene, surfaces, sigma).advance(
        truth.translation, truth.quaternion, truth.angular_velocity, used_by(seen_from.T)
    )
    expected = least[:, loop.recorded].swapaxes(0, 1).astype(np.float32)
    np.testing.assert_array_equal(result.bound[0], expected)


def test_bound_is_that_of_the_true_noise():
    """Twice the true noise raises the bound where the same measurements are used."""
    scene, surfaces, epoch, ids, loop = tracking_problem(3, 3, duration_hours=2.0, sensor=BRIGHT)
    found = []
    for factor in (1.0, 2.0):
        model = TruthModel(surfaces, factor * BRIGHT.noise, np.zeros(3))
        found.append(run_closed_loop(scene, surfaces, epoch, ids, (5,), loop, truth=model))
    same = (found[0].valid == found[1].valid).all(axis=1)[0] & found[0].valid.any(axis=1)[0]
    assert same.any()
    near, far = (each.bound[0, -1][same] for each in found)
    assert np.all(near < far) and np.all(far < 2.0 * near)


# The metric.


def test_error_over_bound():
    rng = np.random.default_rng(3)
    least = np.repeat([0.1, 1e-5, 1e-3, 2.0], 3) * np.ones((3, 4000, 12))
    error = least * rng.standard_normal(least.shape) * np.repeat([1.0, 2.0, 3.0, 4.0], 3)
    error[1, 2000:] = np.nan
    used = np.array([[True], [True], [False]])
    ratio = evaluate(error, least, used, 1.0, least).bound_ratio
    np.testing.assert_allclose(ratio[:2], np.tile([1.0, 2.0, 3.0, 4.0], (2, 1)), rtol=0.05)
    assert np.all(np.isnan(ratio[2]))
    error[0], least[1] = np.nan, np.nan
    assert np.all(np.isnan(evaluate(error, least, used, 1.0, least).bound_ratio))


def test_only_the_final_hours_count():
    error, least = np.full((1, 144, 12), 100.0), np.full((1, 144, 12), 1.0)
    error[:, -24:], least[:, -24:] = 0.02, 0.01
    used = np.ones((1, 144), dtype=bool)
    found = evaluate(error, least, used, 600.0, least)
    np.testing.assert_allclose(found.bound_ratio, 2.0, rtol=1e-12)
    assert found.bound_attitude_deg[0] == pytest.approx(np.rad2deg(0.01 * np.sqrt(3.0)))
    assert np.all(np.isnan(evaluate(error, least, used, 600.0).bound_ratio))


# Refused inputs.


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"observer": np.zeros((3, 4), dtype=int), "ends": (180,)}, "translation has shape"),
        ({"sigma": np.zeros(12)}, "sigma"),
        ({"observer": np.full((3, 180), 7)}, "measurements.observer: 7 must be"),
        ({"noise": (0.1, -1.0, 1e-5)}, "variance"),
    ],
)
def test_impossible_inputs_are_named(problem, changes, message):
    with pytest.raises(ConfigurationError, match=message):
        problem.bound(**changes)
