import numpy as np
import pytest
from oracles.unscented import central_weights, sigma_points
from oracles.visibility import visible

from cislunar.errors import ConfigurationError
from cislunar.estimation.estimator import Prediction
from cislunar.estimation.kalman.mukf import MultiplicativeUKF
from cislunar.estimation.unscented import UNSCENTED_WEIGHTS
from cislunar.observation.sensor import ExclusionAngles, Sensor
from cislunar.observation.sightline import direction_angles
from cislunar.photometry.sphere import phase_angle, sphere_magnitude
from cislunar.tasking.demonstration import tracking_problem
from cislunar.tasking.initial_conditions import initial_estimate
from cislunar.tasking.planning.assignment import assign
from cislunar.tasking.planning.information import TaskingModel, pair_information
from cislunar.visibility.counts import VisibilitySettings

LENGTH_M = 384_400_000.0


@pytest.fixture(scope="module")
def problem():
    scene, surfaces, epoch, _, settings = tracking_problem(n_observers=9, duration_hours=1.0)
    sensor = Sensor()
    initial = initial_estimate(epoch, settings.initial.components())
    prediction = MultiplicativeUKF(scene, surfaces, sensor, initial).predict()
    return scene, surfaces, sensor, prediction


def _information(problem, model=None, **changes):
    scene, surfaces, sensor, prediction = problem
    return pair_information(
        prediction._replace(**changes), scene, surfaces, sensor, model or TaskingModel()
    )


def _posterior(problem, o, j):
    """Textbook unscented update of the translation, weights and all."""
    scene, _, sensor, prediction = problem
    covariance = prediction.covariance[j]
    points = sigma_points(
        prediction.translation[j], np.linalg.cholesky(covariance), UNSCENTED_WEIGHTS
    )
    lines = points[:, :3] - scene.observer_position[o, prediction.index]
    images = np.array([direction_angles(*d, scene.observer_axes[prediction.index]) for d in lines])
    outer = np.full(12, UNSCENTED_WEIGHTS.outer)
    mean_central, covariance_central = central_weights(6)
    mean = np.r_[mean_central, outer] @ images
    wc = np.r_[covariance_central, outer][:, None]
    innovation = (wc * (images - mean)).T @ (images - mean) + np.diag(sensor.noise[1:] ** 2)
    cross = (wc * (points - prediction.translation[j])).T @ (images - mean)
    return covariance - cross @ np.linalg.solve(innovation, cross.T)


def test_the_sum_over_pairs_is_the_log_det_of_the_joint_covariance(problem):
    """Equations 60 and 61 of the paper with the block-diagonal matrices written out."""
    information = _information(problem, TaskingModel(diffuse_reflection_coefficient=5.0))
    assignment = assign(information)
    pairs = [(o, j) for o, j in enumerate(assignment.target) if j >= 0]
    assert len(pairs) >= 4
    n = 6 * len(pairs)
    before, after = np.zeros((n, n)), np.zeros((n, n))
    # A common scaling of the components leaves the ratio alone and the determinants representable.
    scale = np.repeat([1e4, 1e5], 3)
    for i, (o, j) in enumerate(pairs):
        block = slice(6 * i, 6 * i + 6)
        before[block, block] = problem[3].covariance[j] * np.outer(scale, scale)
        after[block, block] = _posterior(problem, o, j) * np.outer(scale, scale)
    expected = 0.5 * (np.linalg.slogdet(before)[1] - np.linalg.slogdet(after)[1])
    assert assignment.information == pytest.approx(expected, rel=1e-6)


def test_only_observable_pairs_gain(problem):
    scene, _, sensor, prediction = problem
    model = TaskingModel(diffuse_reflection_coefficient=0.05, pointing_uncertainty_gate=False)
    information = _information(problem, model)
    k = prediction.index
    sphere = VisibilitySettings(sensor.limiting_magnitude, 1.0, 0.05, ExclusionAngles())
    expected = np.array(
        [
            visible(
                scene.observer_position[o, k][None],
                prediction.translation[:, :3],
                scene.sun_position[k][None],
                sphere,
            )[0]
            for o in range(9)
        ]
    )
    np.testing.assert_array_equal(information > 0.0, expected)
    assert 0 < expected.sum() < expected.size


def test_faint_spheres_gain_nothing(problem):
    scene, _, _, prediction = problem
    k = prediction.index
    line = prediction.translation[None, :, :3] - scene.observer_position[:, None, k]
    from_sun = prediction.translation[:, :3] - scene.sun_position[k]
    magnitude = sphere_magnitude(
        np.linalg.norm(line, axis=-1) * LENGTH_M,
        phase_angle(line, from_sun),
        diffuse_reflection_coefficient=0.5,
    )
    limit = float(np.median(magnitude))
    loose = Sensor(
        limiting_magnitude=limit, exclusion_deg=ExclusionAngles(0, 0, 0), occultation=False
    )
    information = pair_information(
        prediction, scene, problem[1], loose, TaskingModel(pointing_uncertainty_gate=False)
    )
    np.testing.assert_array_equal(information > 0.0, magnitude < limit)


def test_the_pointing_uncertainty_gate_excludes_targets_outside_the_field_of_view(problem):
    scene, _, sensor, prediction = problem
    open_gate = TaskingModel(pointing_uncertainty_gate=False)
    covariance = prediction.covariance.copy()
    covariance[1] *= 1e4  # from about 32 km to 3200 km
    lost = _information(problem, open_gate, covariance=covariance)
    assert np.any(lost[:, 1] > _information(problem, open_gate)[:, 1])
    gated = _information(problem, covariance=covariance)
    assert np.all(gated[:, 1] == 0.0)
    np.testing.assert_array_equal(np.delete(gated, 1, axis=1), np.delete(lost, 1, axis=1))
    # 32 km is within 1.5 degrees beyond 1200 km; all pairs here are farther apart.
    line = prediction.translation[None, :, :3] - scene.observer_position[:, None, prediction.index]
    assert np.linalg.norm(line, axis=-1).min() * 384_400.0 > 2000.0
    assert sensor.field_of_view_deg == 3.0
    np.testing.assert_array_equal(_information(problem), _information(problem, open_gate))


def test_a_failed_target_gains_nothing(problem):
    translation = problem[3].translation.copy()
    translation[2] = np.nan
    information = _information(problem, translation=translation)
    assert np.all(information[:, 2] == 0.0)
    assert np.any(information > 0.0)


def test_all_states_carry_more_information_than_the_translation(problem):
    translation = _information(problem)
    full = _information(problem, TaskingModel(states="full"))
    np.testing.assert_array_equal(full > 0.0, translation > 0.0)
    # Sigma points differ (12 states or 6), hence a small slack.
    assert np.all(full >= translation - 1e-3)
    assert np.max(full - translation) > 0.1
    repeated = _information(problem, TaskingModel(measurements=60))
    seen = translation > 0.0
    assert np.all(repeated[seen] > translation[seen])


def test_missing_states_and_impossible_settings_are_refused(problem):
    scene, surfaces, sensor, prediction = problem
    bare = Prediction(prediction.index, prediction.translation, prediction.covariance)
    with pytest.raises(ConfigurationError, match="states"):
        pair_information(bare, scene, surfaces, sensor, TaskingModel(states="full"))
    for bad in ({"states": "all"}, {"measurements": 0}, {"radius_m": -1.0}):
        with pytest.raises(ConfigurationError, match=next(iter(bad)).replace("radius_m", "radius")):
            TaskingModel(**bad)
