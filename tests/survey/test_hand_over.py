"""Hand-over of a survey's orbits to the tracking loop, by either estimator."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cislunar.attitude import grp
from cislunar.dynamics import EARTH_MOON, propagate
from cislunar.errors import ConfigurationError
from cislunar.estimation.estimator import InitialEstimate
from cislunar.observation import Sensor
from cislunar.orbit_determination import LinkedOrbits, fit_orbits, make_angles
from cislunar.survey import hand_over, uniform_attitude_sigma
from cislunar.tasking import TruthModel, run_closed_loop, tracking_problem

HOURS, TRACKED = 2, 4
PROBLEM = tracking_problem(n_observers=6, n_targets=3, duration_hours=HOURS)
SENSOR = Sensor(limiting_magnitude=20)


def catalog(n_observed=TRACKED, seed=5):
    """Orbits fitted to angles of the first two hours, as a survey would link them."""
    rng, scene, sigma = np.random.default_rng(seed), PROBLEM.scene, float(SENSOR.noise[1])
    steps = np.arange(0, HOURS * 60, 10)
    times, observers = np.repeat(steps * scene.step, n_observed), np.arange(n_observed)
    here = scene.observer_position[:n_observed, steps].swapaxes(0, 1)
    paths = np.array(
        [propagate(each, steps * scene.step, method="dop853") for each in PROBLEM.epoch]
    )
    way = paths[:, :, None, :3] - here
    unit = way / np.linalg.norm(way, axis=3)[..., None]
    unit += sigma * rng.standard_normal(unit.shape)
    # sorted by time, observer and object
    n, truth = len(paths), paths[:, -1]
    angles = make_angles(
        np.repeat(times, n),
        np.repeat(np.tile(observers, steps.size), n),
        np.repeat(here.reshape(-1, 3), n, axis=0),
        np.moveaxis(unit, 0, 2).reshape(-1, 3),
        sigma,
    )
    fits = [np.arange(k, angles.time.size, n) for k in range(n)]
    found = fit_orbits(angles, fits, truth, steps[-1] * scene.step, forces=EARTH_MOON)
    linked = LinkedOrbits(
        found, np.full(n, 100.0), ("orbit",) * n, np.zeros(n, int), np.array([True, False, True]),
        (found.take([]),) * n, {},
    )  # fmt: skip
    return linked, truth, steps[-1] * scene.step


def test_attitudes_of_the_prior_are_uniform():
    """Against random rotations of another package."""
    drawn = grp.from_quaternion(Rotation.random(400_000, random_state=3).as_quat())
    spread = np.sqrt(np.mean(drawn**2, axis=0))
    assert np.abs(spread / uniform_attitude_sigma() - 1.0).max() < 5e-3


def test_confirmed_orbits_are_targets_with_their_covariance():
    linked, truth, time = catalog()
    later = time + 0.05
    handed = hand_over(linked, later, forces=EARTH_MOON)
    assert handed.orbit.tolist() == [0, 2]
    initial = handed.initial.checked()
    assert handed.initial.roots().shape == (2, 12, 12)
    # the covariance is that of states that are drawn at the epoch and propagated
    rng = np.random.default_rng(1)
    for j, k in enumerate(handed.orbit.tolist()):
        draws = rng.multivariate_normal(linked.fits.state[k], linked.fits.covariance[k], 400)
        moved = np.array([propagate(each, [0.05], method="dop853")[0] for each in draws])
        sample, given = np.cov(moved.T), initial.covariance[j, 6:, 6:]
        assert np.abs(np.diag(sample) / np.diag(given) - 1.0).max() < 0.35
        error = initial.translation[j] - propagate(truth[k], [0.05], method="dop853")[0]
        assert error @ np.linalg.solve(given, error) < 30.0
    assert not initial.covariance[:, :6, 6:].any()
    np.testing.assert_allclose(initial.covariance[:, 0, 0], uniform_attitude_sigma() ** 2)


@pytest.mark.parametrize("estimator", ["mukf", "batch"])
def test_either_estimator_tracks_the_orbits(estimator):
    """The truth is that of the objects, in attitudes of which nothing is known."""
    linked, truth, time = catalog()
    handed = hand_over(linked, time, forces=EARTH_MOON)
    n = handed.orbit.size
    turns = Rotation.random(n, random_state=8).as_quat()
    start = InitialEstimate(turns, np.zeros((n, 3)), truth[handed.orbit], np.zeros(12))
    surfaces = tracking_problem(n_observers=1, n_targets=n, duration_hours=1).surfaces
    given = TruthModel(surfaces, SENSOR.noise, np.zeros(3), start=start)
    settings = replace(PROBLEM.loop, sensor=SENSOR, interval_minutes=20, record=("truth",))
    result = run_closed_loop(
        PROBLEM.scene, surfaces, handed.initial.translation, handed.orbit, [4], settings,
        estimator=estimator, initial=handed.initial, truth=given,
    )  # fmt: skip
    assert not result.failed.any() and result.valid.any(axis=(0, 1)).all()
    error, sigma = (each[0, -1][:, 6:9] for each in (result.error, result.sigma))
    before = np.sqrt(np.diagonal(handed.initial.covariance, axis1=1, axis2=2))[:, 6:9]
    assert np.all(np.abs(error) < 4.0 * sigma)
    assert np.all(np.linalg.norm(sigma, axis=1) < np.linalg.norm(before, axis=1))
    # the truth is not drawn from the estimates
    for state, found in zip(start.translation, result.true_translation[0, -1], strict=True):
        last = propagate(state, [PROBLEM.loop.n_steps * PROBLEM.scene.step], method="dop853")[0]
        np.testing.assert_allclose(found, last, atol=1e-6)


def test_the_truth_has_as_many_targets_as_the_estimates():
    linked, truth, time = catalog()
    handed = hand_over(linked, time, forces=EARTH_MOON)
    start = InitialEstimate(np.eye(4)[[3] * 3], np.zeros((3, 3)), truth, np.zeros(12))
    surfaces = tracking_problem(n_observers=1, n_targets=2, duration_hours=1).surfaces
    given = TruthModel(surfaces, SENSOR.noise, np.zeros(3), start=start)
    with pytest.raises(ConfigurationError, match=r"'truth\.start': 3"):
        run_closed_loop(
            PROBLEM.scene, surfaces, handed.initial.translation, handed.orbit, [4], PROBLEM.loop,
            initial=handed.initial, truth=given,
        )  # fmt: skip


def test_nothing_to_hand_over_is_refused():
    linked, _, time = catalog()
    none = linked._replace(confirmed=np.zeros(3, dtype=bool))
    for orbits, given, words in (
        (none, time, "none of 3 orbits, 0 of them confirmed"),
        (linked, np.nan, "time = nan must be a finite number"),
    ):
        with pytest.raises(ConfigurationError, match=words) as caught:
            hand_over(orbits, given, forces=EARTH_MOON)
        assert "\n" not in str(caught.value)
