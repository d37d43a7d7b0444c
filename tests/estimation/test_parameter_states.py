"""Body parameters and the variance of magnitudes as further estimates of the unscented filter."""

import re

import numpy as np
import pytest
import scipy.integrate
from measured import SENSOR, during, measured_problem
from oracles.reference_filter import ReferenceFilter
from scipy.spatial.transform import Rotation

from cislunar.attitude.quaternion import compose, inverse
from cislunar.constants import LENGTH_UNIT_KM
from cislunar.errors import ConfigurationError
from cislunar.estimation.initial_sigma import ProcessNoise
from cislunar.estimation.kalman.mukf import MultiplicativeUKF, mukf
from cislunar.observation.body_parameters import BodyParameterPrior
from cislunar.observation.measurement import DETECTED
from cislunar.observation.records import no_measurements, rows_of
from cislunar.observation.target_surfaces import target_surfaces
from cislunar.photometry.facets import facet_magnitude
from cislunar.photometry.materials import Material
from cislunar.photometry.shapes import icosahedron
from cislunar.tasking.closed_loop import run_closed_loop
from cislunar.tasking.demonstration import tracking_problem
from cislunar.tasking.truth import TruthModel

# All filters here estimate five parameters: another number would compile the kernels again.
BODY = BodyParameterPrior(0.25, 0.25, 0.5, log_inertia=0.05)
KNOWN = 1e-9
SPREAD = (0.05, 0.05, 0.25, 0.25, 0.5)


def test_equals_filterpy_with_body_parameters():
    """Two hours of predict and update of inertia and material with the motion."""
    process = ProcessNoise(0.03, 0.01, 0.05, 0.001)
    inertia = np.array([1.0, 1.6, 2.2])
    scene, _, initial, _, measurements, outcome = measured_problem(hours=2.0)
    surfaces = target_surfaces(icosahedron(), Material(), 5, inertia=inertia)
    given = {"process_noise": process, "estimated_parameters": BODY}
    filt = MultiplicativeUKF(scene, surfaces, SENSOR, initial, **given)
    j = int(np.flatnonzero((outcome == DETECTED).mean(axis=1) > 0.9)[0])
    reference = ReferenceFilter(
        scene, icosahedron(), Material(), SENSOR.noise, initial,
        process.components() ** 2, j, inertia, SPREAD,
    )  # fmt: skip
    for i in range(outcome.shape[1]):
        estimates = filt.advance(during(measurements, i, i + 1))
        reference.predict()
        row = measurements.offset[j, i]
        if outcome[j, i] == DETECTED:
            reference.update(measurements.value[row], measurements.observer[row])
        reference.reset()
        sigma = np.sqrt(np.diag(reference.ukf.P))
        mean, deviation = filt.learned()
        np.testing.assert_allclose(deviation[j], sigma[:5], rtol=1e-4)
        np.testing.assert_allclose(estimates.sigma[j, 0], sigma[5:], rtol=1e-4)
        error = compose(estimates.quaternion[j, 0], inverse(reference.quaternion))
        turn = Rotation.from_quat(error).as_rotvec() / sigma[5:8]
        assert np.max(np.abs(turn)) < 1e-4
        state = np.r_[mean[j], estimates.angular_velocity[j, 0], estimates.translation[j, 0]]
        difference = np.delete(reference.ukf.x, slice(5, 8)) - state
        assert np.max(np.abs(difference / np.delete(sigma, slice(5, 8)))) < 1e-4
    assert np.all(deviation[j, 2:] < 0.9 * np.array(SPREAD[2:]))
    root = filt.predict().root[j]
    assert np.all(np.diagonal(root) > 0.0) and not np.any(np.triu(root, 1))
    np.testing.assert_allclose(
        (root @ root.T)[6:, 6:], filt.predict().covariance[j], rtol=1e-10, atol=1e-22
    )


def _known_motion(hours=1.0, **settings):
    """A filter whose motion is known, with one linear parameter: the scale of all light, in mag."""
    sigma = np.r_[np.full(3, 1e-8), np.full(3, 1e-13), np.full(3, 1e-8), np.full(3, 1e-9)]
    scene, surfaces, initial, truth, measurements, outcome = measured_problem(hours=hours)
    start = initial._replace(
        quaternion=truth.quaternion[:, 0],
        angular_velocity=truth.angular_velocity[:, 0],
        translation=truth.translation[:, 0],
        sigma=sigma,
    )
    filt = MultiplicativeUKF(scene, surfaces, SENSOR, start, **settings)
    return filt, measurements, outcome


def test_a_linear_parameter_has_its_normal_posterior():
    """With known motion the mean of n magnitudes has the closed form of a conjugate normal."""
    prior = BodyParameterPrior(KNOWN, KNOWN, log_scale=0.4, log_inertia=KNOWN)
    filt, measurements, _ = _known_motion(estimated_parameters=prior)
    shift = np.array([0.3, 0.0, 0.0])
    moved = measurements._replace(value=measurements.value + shift)
    estimates = filt.advance(moved)
    mean, sigma = filt.learned()
    slope, noise = -2.5 / np.log(10.0), SENSOR.magnitude_noise
    used = np.bincount(rows_of(measurements)[0], weights=estimates.used, minlength=5)
    information = 1.0 / 0.4**2 + used * slope**2 / noise**2
    np.testing.assert_allclose(sigma[:, 4], information**-0.5, rtol=2e-3)
    expected = slope * shift[0] * used / noise**2 / information
    assert np.all(used[used > 0] > 30) and np.any(used > 0)
    assert np.all(np.abs(mean[:, 4] - expected) < 4.0 * sigma[:, 4])


def test_torque_and_inertia_of_sigma_points_follow_eulers_equations():
    """The mean body rotates as integrated by SciPy after deviations are set."""
    prior = BodyParameterPrior(log_inertia=0.05, angular_acceleration_deg_h2=5.0)
    inertia, deviation = np.array([1.0, 1.6, 2.2]), np.array([0.04, -0.03])
    torque = np.deg2rad([4.0, -6.0, 8.0]) / 3600.0**2
    scene, _, initial, *_ = measured_problem(hours=1.0)
    surfaces = target_surfaces(icosahedron(), Material(), 5, inertia=inertia)
    tight = initial._replace(sigma=1e-6 * initial.sigma)
    filt = MultiplicativeUKF(scene, surfaces, SENSOR, tight, estimated_parameters=prior)
    filt._state.parameters[:] = np.r_[deviation, torque]
    filt._state.root[:, :5, :5] *= 1e-6
    estimates = filt.advance(no_measurements(5, 60))
    moments = inertia * np.exp([0.0, *deviation])

    def euler(_t, w):
        return -np.cross(w, moments * w) / moments + torque

    found = scipy.integrate.solve_ivp(
        euler, (0.0, 3600.0), initial.angular_velocity[0], rtol=1e-11, atol=1e-16
    )
    np.testing.assert_allclose(estimates.angular_velocity[0, -1], found.y[:, -1], rtol=1e-7)
    mean, _ = filt.learned()
    np.testing.assert_allclose(mean[0], [*deviation, 4.0, -6.0, 8.0], rtol=1e-6)


@pytest.mark.parametrize("true_factor", [0.25, 16.0])
def test_adaptive_noise_finds_the_noise_of_a_series(true_factor):
    """Known motion, magnitudes whose noise is not that of the sensor; compared with the filter of
    Sarkka and Nummenmaa in its own form, shape and scale of the inverse gamma distribution."""
    memory = 40.0
    filt, measurements, outcome = _known_motion(hours=6.0, noise_memory=memory)
    plain, *_ = _known_motion(hours=6.0, use_magnitude=False)
    rng = np.random.default_rng(5)
    noise = SENSOR.magnitude_noise
    j = int(np.argmax((outcome == DETECTED).sum(axis=1)))
    expected = _noiseless(plain, measurements)
    draws = np.sqrt(true_factor) * noise * rng.standard_normal(expected.size)
    value = measurements.value.copy()
    value[:, 0] = expected + draws
    own, shape, scale = [], 0.5 * memory, 0.5 * memory
    kept = 1.0 - 1.0 / memory
    for i in range(outcome.shape[1]):
        filt.advance(during(measurements._replace(value=value), i, i + 1))
        if outcome[j, i] == DETECTED:
            error = draws[measurements.offset[j, i]] / noise
            shape, scale = kept * shape + 0.5, kept * scale + 0.5 * error**2
        np.testing.assert_allclose(filt.noise_factor[j], scale / shape, rtol=2e-3)
        own.append(filt.noise_factor[j])
    assert shape == pytest.approx(0.5 * memory)
    steady = np.array(own[-len(own) // 2 :])
    assert np.mean(steady) == pytest.approx(true_factor, rel=0.25)


def _noiseless(filt, measurements):
    """Magnitudes that a filter of known motion expects, one for each record."""
    recorded = measurements.value[:, 0].copy()
    bright = np.isfinite(recorded)
    scene = filt._scene
    target, step = rows_of(measurements)
    coast = filt.advance(no_measurements(filt.failed.size, measurements.offset.shape[1] - 1))
    facets, material = icosahedron(), Material().as_array()
    for row in np.flatnonzero(bright):
        j, i = target[row], step[row]
        k, place = i + 1, coast.translation[j, i, :3]
        line = place - scene.observer_position[measurements.observer[row], k]
        to_sun = scene.sun_position[k] - place
        recorded[row] = facet_magnitude(
            coast.quaternion[j, i],
            scene.frame_axes[k] @ to_sun / np.linalg.norm(to_sun),
            -scene.frame_axes[k] @ line / np.linalg.norm(line),
            np.linalg.norm(line) * LENGTH_UNIT_KM * 1000.0,
            facets.areas,
            facets.normals,
            material,
            False,
            True,
        )
    return recorded


def test_extra_noise_equals_that_of_a_noisier_sensor():
    scene, surfaces, initial, _, measurements, _ = measured_problem(hours=2.0)
    filt = MultiplicativeUKF(scene, surfaces, SENSOR, initial, extra_magnitude_noise=0.3)
    found = filt.advance(measurements)
    noisier = measurements.variance + np.array([0.3**2, 0.0, 0.0])
    plain = MultiplicativeUKF(scene, surfaces, SENSOR, initial)
    expected = plain.advance(measurements._replace(variance=noisier))
    np.testing.assert_allclose(found.sigma, expected.sigma, rtol=1e-9)
    np.testing.assert_allclose(found.quaternion, expected.quaternion, atol=1e-9)


def test_material_is_learned_in_the_loop_with_mixtures_and_tracks():
    """Material that deviates: the closed loop with splitting, added and removed tracks."""
    scene, surfaces, epoch, ids, loop = tracking_problem(6, 10, duration_hours=12.0, sensor=SENSOR)
    truth = TruthModel(surfaces, SENSOR.noise, np.zeros(3), parameter_sigma=BODY)
    given = scene, surfaces, epoch, ids, [0, 1], loop
    medians = []
    for estimator in (
        mukf(splitting=True),
        mukf(splitting=True, estimated_parameters=BODY, noise_memory=30.0),
    ):
        result = run_closed_loop(*given, estimator=estimator, truth=truth)
        medians.append(np.nanmedian(result.final_attitude_error_deg))
    assert medians[1] < 0.8 * medians[0]
    # the posterior of this filter is too narrow, but its mean is better than that of the prior
    wrong = np.abs(result.parameter_error[:, -1, :, 2:]) / [0.25, 0.25, 0.5]
    assert np.nanmedian(wrong) < 0.5 * 0.6745
    assert np.nanmedian(result.parameter_sigma[:, -1, :, 2]) < 0.2
    assert not result.searches.any()


def test_tracks_with_parameters_are_added_and_removed():
    scene, surfaces, initial, _, measurements, _ = measured_problem(hours=1.0)
    make = lambda start, own: MultiplicativeUKF(  # noqa: E731
        scene, own, SENSOR, start, estimated_parameters=BODY
    )
    whole = make(initial, surfaces)
    whole.advance(measurements)
    joined = make(initial, surfaces)
    joined.add(initial, surfaces, index=0)
    joined.remove(np.arange(5))
    joined.advance(measurements)
    np.testing.assert_array_equal(joined.learned()[0], whole.learned()[0])
    assert joined.learned()[1].shape == (5, 5)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"extra_magnitude_noise": -0.1}, "extra_magnitude_noise = -0.1"),
        ({"extra_magnitude_noise": np.nan}, "extra_magnitude_noise = nan"),
        ({"noise_memory": 1.0}, "noise_memory = 1.0"),
        ({"use_magnitude": False, "noise_memory": 9.0}, "use_magnitude = False"),
        ({"use_magnitude": False, "estimated_parameters": BODY}, "use_magnitude = False"),
        ({"estimated_parameters": BodyParameterPrior(log_facets=0.2)}, "log_facets = 0.2"),
    ],
)
def test_impossible_settings_are_refused(given, message):
    scene, surfaces, initial, *_ = measured_problem(hours=0.5)
    with pytest.raises(ConfigurationError, match=re.escape(message)):
        MultiplicativeUKF(scene, surfaces, SENSOR, initial, **given)


def test_a_body_without_specular_light_has_no_slope():
    scene, _, initial, *_ = measured_problem(hours=0.5)
    dull = target_surfaces(icosahedron(), Material(specular_weight=0.0), 5)
    with pytest.raises(ConfigurationError, match=r"log_slope = 0\.25"):
        MultiplicativeUKF(scene, dull, SENSOR, initial, estimated_parameters=BODY)
