import numpy as np
import pytest
from measured import SENSOR, during, measured_problem
from oracles.reference_filter import ReferenceFilter
from oracles.rigid_rotation import propagate_rotation
from scipy.spatial.transform import Rotation

from cislunar.attitude.quaternion import compose, inverse
from cislunar.constants import LENGTH_UNIT_KM, MU
from cislunar.errors import ConfigurationError
from cislunar.estimation.estimator import (
    CHOLESKY_FAILURES,
    FLOOR_HITS,
    INSIDE_PRIMARY,
    NOT_FINITE,
    OUT_OF_FIELD,
    UPDATES,
)
from cislunar.estimation.initial_sigma import PAPER_INITIAL_SIGMA, InitialSigma, ProcessNoise
from cislunar.estimation.kalman.mukf import MultiplicativeUKF, mukf
from cislunar.observation.measurement import DETECTED
from cislunar.observation.records import no_measurements
from cislunar.observation.target_surfaces import target_surfaces
from cislunar.photometry.materials import Material
from cislunar.photometry.shapes import icosahedron
from cislunar.tasking.closed_loop import run_closed_loop
from cislunar.tasking.demonstration import tracking_problem
from cislunar.tasking.initial_conditions import initial_estimate


@pytest.mark.parametrize("inertia", [1.0, [1.0, 1.6, 2.2]])
def test_equals_filterpy_with_the_same_model(inertia):
    """Two hours of predict and update; the references carry full covariances and naive weights."""
    process = ProcessNoise(0.03, 0.01, 0.05, 0.001)
    scene, surfaces, initial, _, measurements, outcome = measured_problem(hours=2.0)
    surfaces = target_surfaces(icosahedron(), Material(), 5, inertia=inertia)
    filt = MultiplicativeUKF(scene, surfaces, SENSOR, initial, process_noise=process)
    estimates = filt.advance(measurements)
    compared = 0
    for j in np.flatnonzero((outcome == DETECTED).mean(axis=1) > 0.9)[:2]:
        reference = ReferenceFilter(
            scene, icosahedron(), Material(), SENSOR.noise, initial,
            process.components() ** 2, j, inertia,
        )  # fmt: skip
        for i in range(outcome.shape[1]):
            reference.predict()
            row = measurements.offset[j, i]
            if outcome[j, i] == DETECTED:
                reference.update(measurements.value[row], measurements.observer[row])
            reference.reset()
            sigma = np.sqrt(np.diag(reference.ukf.P))
            np.testing.assert_allclose(estimates.sigma[j, i], sigma, rtol=1e-4)
            error = compose(estimates.quaternion[j, i], inverse(reference.quaternion))
            turn = Rotation.from_quat(error).as_rotvec() / sigma[:3]
            assert np.max(np.abs(turn)) < 1e-4
            rate = estimates.angular_velocity[j, i] - reference.ukf.x[3:6]
            state = estimates.translation[j, i] - reference.ukf.x[6:]
            assert np.max(np.abs(np.r_[rate, state]) / sigma[3:]) < 1e-4
        compared += 1
    assert compared == 2


def test_general_inertia_joins_the_closed_form_and_follows_the_truth():
    """An all but spherical body is integrated to the closed form; another keeps its true rate."""
    scene, _, initial, *_ = measured_problem(hours=2.0)
    nothing = no_measurements(5, 60)

    def coast(inertia, sigma=1.0):
        bodies = target_surfaces(icosahedron(), Material(), 5, inertia=inertia)
        start = initial._replace(sigma=sigma * initial.sigma)
        return MultiplicativeUKF(scene, bodies, SENSOR, start).advance(nothing)

    exact, close = coast(1.0), coast([1.0, 1.0, 1.0 + 1e-10])
    np.testing.assert_allclose(close.quaternion, exact.quaternion, atol=1e-8)
    np.testing.assert_allclose(close.sigma, exact.sigma, rtol=1e-7)
    inertia = [1.0, 1.6, 2.2]
    tight = coast(inertia, 1e-6)
    times = 60.0 * np.arange(61)
    attitude, rate = propagate_rotation(
        initial.quaternion[0], initial.angular_velocity[0], times, inertia
    )
    np.testing.assert_allclose(tight.quaternion[0], attitude[1:], atol=1e-9)
    np.testing.assert_allclose(tight.angular_velocity[0], rate[1:], rtol=1e-7)
    assert np.abs(rate[-1] - rate[0]).max() > 0.01 * np.abs(rate[0]).max()
    assert np.abs(coast(inertia).sigma - exact.sigma).max() > 1e-4


def test_prediction_is_one_step_ahead_and_changes_no_state():
    scene, surfaces, initial, *_ = measured_problem(hours=0.5)
    filt = MultiplicativeUKF(scene, surfaces, SENSOR, initial)
    first, again = filt.predict(), filt.predict()
    np.testing.assert_array_equal(first.translation, again.translation)
    assert first.index == 1
    estimates = filt.advance(no_measurements(5, 1))
    np.testing.assert_array_equal(estimates.translation[:, 0], first.translation)
    np.testing.assert_allclose(
        estimates.sigma[:, 0, 6:] ** 2, np.einsum("jaa->ja", first.covariance), rtol=1e-13
    )
    assert not estimates.used.any()
    assert filt.predict().index == 2


def test_intervals_do_not_matter():
    """One call over two hours equals many short ones."""
    scene, surfaces, initial, _, measurements, _ = measured_problem(hours=2.0)
    whole = MultiplicativeUKF(scene, surfaces, SENSOR, initial)
    parts = MultiplicativeUKF(scene, surfaces, SENSOR, initial)
    expected = whole.advance(measurements)
    starts = range(0, 120, 17)
    pieces = [parts.advance(during(measurements, i, min(i + 17, 120))) for i in starts]
    for name in expected._fields:
        joined = np.concatenate([getattr(piece, name).reshape(5, -1) for piece in pieces], axis=1)
        whole_run = getattr(expected, name).reshape(5, -1)
        np.testing.assert_array_equal(joined, whole_run, err_msg=name)


def test_without_magnitude_the_attitude_uncertainty_follows_the_closed_form():
    """Only the error of the rate along the rate accumulates; the rest turns round with the body.

    With phi = |omega| t the attitude error is e + J(t) d_omega, where J is the left Jacobian of
    the rotation times t: its variance on the axis is t^2, across it t^2 (2 - 2 cos phi) / phi^2.
    That is the rotation vector; the GRP exceeds it by the factor 1 + theta^2 / 24. The transform
    sees the fourth moment (n + lambda) s^4 = 0.75 s^4 of an angle of variance s^2 (a Gaussian has
    3 s^4), so the standard deviation on the axis grows by 1 + s^2 / 32.
    """
    scene, surfaces, epoch, ids, loop = tracking_problem(2, 2, duration_hours=24.0, sensor=SENSOR)
    estimator = mukf(use_magnitude=False)
    result = run_closed_loop(scene, surfaces, epoch, ids, [0], loop, estimator=estimator)
    assert result.valid.any(axis=1).all()
    hours = 24.0
    phi = np.deg2rad(np.linalg.norm([-44.723808, -6.6573, -8.514216])) * hours
    along = 5.0**2 + (2.4 * hours) ** 2
    across = 5.0**2 + (2.4 * hours) ** 2 * (2.0 - 2.0 * np.cos(phi)) / phi**2
    along *= (1.0 + np.deg2rad(np.sqrt(along)) ** 2 / 32.0) ** 2
    expected = np.sqrt((along + 2.0 * across) / 3.0)
    final = np.rad2deg(np.sqrt(np.mean(result.sigma[0, -1, :, :3] ** 2, axis=-1)))
    np.testing.assert_allclose(final, expected, rtol=0.005)
    assert np.all((final > 34.0) & (final < 35.0))


def test_process_noise_grows_with_time_not_with_steps():
    process = ProcessNoise(attitude_deg=0.1, position_km=1.0)
    finals = []
    for step_s in (30.0, 60.0, 120.0):
        scene, surfaces, epoch, _, loop = tracking_problem(1, 1, duration_hours=1.0, step_s=step_s)
        initial = initial_estimate(epoch, 1e-9 * PAPER_INITIAL_SIGMA.components())
        filt = MultiplicativeUKF(scene, surfaces, SENSOR, initial, process_noise=process)
        finals.append(filt.advance(no_measurements(1, loop.n_steps)).sigma[0, -1])
    for final in finals:
        attitude = np.linalg.norm(final[:3])  # the covariance only turns
        assert np.rad2deg(attitude) == pytest.approx(0.1 * np.sqrt(60.0 * 3.0), rel=1e-6)
        assert final[6] * LENGTH_UNIT_KM == pytest.approx(np.sqrt(60.0), rel=0.02)


def test_a_rate_that_has_diverged_ends_the_estimate_and_the_others_continue():
    scene, surfaces, initial, _, measurements, _ = measured_problem(hours=0.2)
    expected = MultiplicativeUKF(scene, surfaces, SENSOR, initial).advance(measurements)
    rate = initial.angular_velocity.copy()
    rate[1] = [0.0, 1e9, 0.0]  # steps of 0.03 rad would take years
    filt = MultiplicativeUKF(scene, surfaces, SENSOR, initial._replace(angular_velocity=rate))
    estimates = filt.advance(measurements)
    np.testing.assert_array_equal(filt.failed, [0, NOT_FINITE, 0, 0, 0])
    others = [0, 2, 3, 4]
    np.testing.assert_array_equal(estimates.sigma[others], expected.sigma[others])


def test_a_target_that_hits_the_moon_is_marked_and_the_others_continue():
    scene, surfaces, initial, _, measurements, _ = measured_problem(hours=1.0)
    impact = initial.translation.copy()
    impact[1] = [1.0 - MU, 0.0, -0.007, 0.0, 0.0, 0.5]
    alone = MultiplicativeUKF(scene, surfaces, SENSOR, initial)
    expected = alone.advance(measurements)
    filt = MultiplicativeUKF(scene, surfaces, SENSOR, initial._replace(translation=impact))
    estimates = filt.advance(measurements)
    assert filt.failed[1] != 0
    assert np.all(np.isnan(estimates.translation[1, -1]))
    assert not estimates.used.reshape(5, -1)[1, -1]
    others = [0, 2, 3, 4]
    np.testing.assert_array_equal(filt.failed[others], 0)
    np.testing.assert_array_equal(estimates.sigma[others], expected.sigma[others])
    assert np.all(np.isnan(filt.predict().translation[1]))
    inside = initial.translation.copy()
    inside[1, :3] = [1.0 - MU, 0.001, 0.0]
    filt = MultiplicativeUKF(scene, surfaces, SENSOR, initial._replace(translation=inside))
    filt.advance(measurements)
    assert filt.failed[1] == INSIDE_PRIMARY


def test_a_measurement_outside_the_field_of_view_is_rejected():
    scene, surfaces, initial, _, measurements, outcome = measured_problem(hours=1.0)
    j = int(np.argmax((outcome == DETECTED).sum(axis=1)))
    shifted = measurements.value.reshape(5, -1, 3).copy()
    shifted[j, :, 2] += np.deg2rad(1.6)
    filt = MultiplicativeUKF(scene, surfaces, SENSOR, initial)
    estimates = filt.advance(measurements._replace(value=shifted.reshape(-1, 3)))
    assert not estimates.used.reshape(5, -1)[j].any()
    assert filt.counters[j, OUT_OF_FIELD] == (outcome[j] == DETECTED).sum()
    assert filt.counters[j, UPDATES] == 0


def test_updates_across_the_wrap_of_right_ascension():
    """Turning all observers by a constant angle about z must not change the estimates."""
    scene, surfaces, initial, _, measurements, outcome = measured_problem(hours=1.0)
    plain = MultiplicativeUKF(scene, surfaces, SENSOR, initial)
    expected = plain.advance(measurements)
    j = int(np.argmax((outcome == DETECTED).sum(axis=1)))
    values = measurements.value.reshape(5, -1, 3)
    shift = np.pi - np.nanmedian(values[j, :, 1])  # so that its measurements straddle pi
    c, s = np.cos(shift), np.sin(shift)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    turned = scene._replace(observer_axes=turn @ scene.observer_axes)
    moved = values.copy()
    moved[..., 1] = (moved[..., 1] + shift + np.pi) % (2.0 * np.pi) - np.pi
    assert np.ptp(moved[j, :, 1][outcome[j] == DETECTED]) > 6.0
    filt = MultiplicativeUKF(turned, surfaces, SENSOR, initial)
    estimates = filt.advance(measurements._replace(value=moved.reshape(-1, 3)))
    np.testing.assert_array_equal(estimates.used, expected.used)
    scale = expected.sigma[..., 6:]
    assert np.max(np.abs(estimates.translation - expected.translation) / scale) < 1e-6


def test_undetectable_sigma_points_leave_the_filter_finite():
    """A target in front of the Sun: some sigma points are unlit and get the floor magnitude."""
    scene, surfaces, initial, _, measurements, _ = measured_problem(hours=1.0)
    against = scene.sun_position.copy()
    # Sun behind target 0 as seen from its observer
    line = initial.translation[0, :3] - scene.observer_position[0, 0]
    against[:] = initial.translation[0, :3] + 389.0 * line / np.linalg.norm(line)
    filt = MultiplicativeUKF(scene._replace(sun_position=against), surfaces, SENSOR, initial)
    measured = measurements.value.reshape(5, -1, 3).copy()
    measured[0, :, 0] = 24.0
    measured[0, :, 1:] = np.nan_to_num(measured[0, :, 1:])
    estimates = filt.advance(measurements._replace(value=measured.reshape(-1, 3)))
    assert np.all(np.isfinite(estimates.sigma))
    assert filt.counters[:, CHOLESKY_FAILURES].sum() == 0
    assert filt.counters[0, FLOOR_HITS] > 0


def test_bad_uncertainties_are_refused():
    scene, surfaces, initial, *_ = measured_problem(hours=0.5)
    with pytest.raises(ConfigurationError, match="sigma"):
        MultiplicativeUKF(scene, surfaces, SENSOR, initial._replace(sigma=np.zeros(12)))
    with pytest.raises(ConfigurationError, match="position_km"):
        InitialSigma(position_km=-1.0)


def test_initial_uncertainty_is_that_of_the_paper():
    sigma = PAPER_INITIAL_SIGMA.components()
    assert np.rad2deg(sigma[0]) == pytest.approx(5.0)
    assert np.rad2deg(sigma[3]) * 3600.0 == pytest.approx(2.4)
    assert (sigma[6] * LENGTH_UNIT_KM * 1000.0) ** 2 == pytest.approx(0.1 * 100_000.0**2)
    unit_m_s = LENGTH_UNIT_KM * 1000.0 / 375_190.3
    assert (sigma[9] * unit_m_s) ** 2 == pytest.approx(0.1 * 0.1**2, rel=1e-5)
