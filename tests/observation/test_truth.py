"""Truth that differs from the assumed model: rigid bodies, torque, surfaces, noise."""

import numpy as np
import pytest
from measured import draw_truth
from oracles.rigid_rotation import propagate_rotation

from cislunar.dynamics.bundle import propagate_bundle
from cislunar.dynamics.cr3bp import CR3BP, EARTH_MOON
from cislunar.errors import ConfigurationError
from cislunar.estimation.kalman.mukf import mukf
from cislunar.observation.body_parameters import BodyParameterPrior
from cislunar.observation.body_sampling import true_deviations
from cislunar.observation.sensor import Sensor
from cislunar.observation.target_surfaces import target_surfaces
from cislunar.photometry.materials import Material
from cislunar.photometry.shapes import facets_from_triangles, icosahedron
from cislunar.photometry.spacecraft import box_with_wings
from cislunar.tasking.closed_loop import run_closed_loop
from cislunar.tasking.demonstration import tracking_problem
from cislunar.tasking.initial_conditions import initial_estimate
from cislunar.tasking.truth import TrueMotion, TruthModel

BRIGHT = Sensor(limiting_magnitude=22.0)
INERTIA = np.diag([1.0, 1.3, 1.6])


@pytest.fixture(scope="module")
def problem():
    return tracking_problem(4, 5, duration_hours=4.0, sensor=BRIGHT)


def _truth(problem, **given):
    scene, _, epoch, ids, loop = problem
    initial = initial_estimate(epoch, loop.initial.components())
    return draw_truth(initial, scene, BRIGHT.noise, 3, ids, **given)


def test_spherical_bodies_keep_their_rate(problem):
    truth = _truth(problem)
    assert truth.angular_velocity.shape == (5, 241, 3)
    assert np.ptp(truth.angular_velocity, axis=1).max() == 0.0
    stated = _truth(problem, inertia=np.tile(7.0 * np.eye(3), (5, 1, 1)))
    np.testing.assert_array_equal(stated.quaternion, truth.quaternion)


def test_each_target_rotates_with_its_inertia(problem):
    plain = _truth(problem)
    bodies = np.array([np.eye(3), INERTIA, INERTIA, np.eye(3), np.eye(3)])
    truth = _truth(problem, inertia=bodies)
    times = 60.0 * np.arange(241)
    for j, spherical in enumerate([True, False, False, True, True]):
        q, w = propagate_rotation(
            plain.quaternion[j, 0], plain.angular_velocity[j, 0], times, bodies[j]
        )
        np.testing.assert_allclose(truth.quaternion[j], q, atol=1e-12)
        np.testing.assert_allclose(truth.angular_velocity[j], w, rtol=1e-12)
        assert (np.ptp(w, axis=0).max() == 0.0) == spherical
    np.testing.assert_array_equal(truth.translation, plain.translation)
    np.testing.assert_array_equal(truth.noise, plain.noise)


def test_torque_acts_on_every_target(problem):
    plain = _truth(problem)
    acceleration = np.array([1e-10, -2e-10, 3e-10])
    truth = _truth(problem, angular_acceleration=acceleration)
    elapsed = 60.0 * np.arange(241)
    gained = truth.angular_velocity - plain.angular_velocity
    np.testing.assert_allclose(gained[2], np.outer(elapsed, acceleration), atol=1e-17)
    start = (plain.quaternion[2, 0], plain.angular_velocity[2, 0])
    q, _ = propagate_rotation(*start, elapsed, 1.0, acceleration)
    np.testing.assert_allclose(truth.quaternion[2], q, atol=1e-12)


def test_truth_by_intervals_is_that_of_the_whole(problem):
    """To the last bit, with spherical and other inertia, and for every observation."""
    scene, _, epoch, ids, loop = problem
    initial = initial_estimate(epoch, loop.initial.components())
    bodies = np.array([np.eye(3), INERTIA, INERTIA, np.eye(3), np.eye(3)])
    whole = _truth(problem, inertia=bodies, observations=2)
    motion = TrueMotion(initial, scene, BRIGHT.noise, 3, ids, inertia=bodies, observations=2)
    start = 0
    for end in (1, 61, 240):
        part = motion.advance(end - start)
        for name, values in whole._asdict().items():
            np.testing.assert_array_equal(getattr(part, name), values[:, start : end + 1], name)
        start = end


def _loop(problem, truth=None, factory="mukf"):
    scene, surfaces, epoch, ids, loop = problem
    return run_closed_loop(scene, surfaces, epoch, ids, [0], loop, truth=truth, estimator=factory)


class Witness:
    """Records the arguments of the estimators and their measurements."""

    def __init__(self):
        self.surfaces, self.sensors, self.measurements, self.used = [], [], [], []

    def __call__(self, scene, surfaces, sensor, initial, rng, forces):
        self.surfaces.append(surfaces)
        self.sensors.append(sensor)
        made = mukf()(scene, surfaces, sensor, initial, rng, forces)
        advance = made.advance

        def watched(measurements, **options):
            self.measurements.append(measurements.value)
            estimates = advance(measurements, **options)
            self.used.append(estimates.used)
            return estimates

        made.advance = watched
        return made


@pytest.fixture(scope="module")
def before():
    """Arguments of the estimators in the usual run."""
    return Witness()


@pytest.fixture(scope="module")
def usual(problem, before):
    """The run whose truth follows the assumed model."""
    return _loop(problem, None, before)


def test_truth_changes_the_measurements_and_not_the_assumed_model(problem, before, usual):
    surfaces = problem[1]
    composite = Material(rms_slope=0.45)
    other = TruthModel(target_surfaces(icosahedron(), composite, 5), BRIGHT.noise, np.zeros(3))
    after = Witness()
    changed = _loop(problem, other, after)
    assert after.surfaces[0] is surfaces
    assert after.sensors[0] == BRIGHT
    np.testing.assert_array_equal(changed.assignment[0, 0], usual.assignment[0, 0])
    first, second = before.measurements[0], after.measurements[0]
    both = np.isfinite(first[..., 0]) & np.isfinite(second[..., 0])
    assert both.sum() > 50
    assert np.abs(first - second)[both][:, 0].max() > 0.05
    np.testing.assert_array_equal(first[both][:, 1:], second[both][:, 1:])
    assert usual.error.tobytes() != changed.error.tobytes()


def test_the_assumed_model_is_the_truth_by_default(problem, usual):
    surfaces = problem[1]
    same = _loop(problem, TruthModel(surfaces, BRIGHT.noise, np.zeros(3)))
    for name in ("error", "sigma", "outcome"):
        assert getattr(usual, name).tobytes() == getattr(same, name).tobytes()


def test_noise_is_the_same_random_numbers_scaled(problem, before, usual):
    surfaces = problem[1]
    doubled = TruthModel(surfaces, BRIGHT.noise * [2.0, 1.0, 1.0], np.zeros(3))
    silent = TruthModel(surfaces, BRIGHT.noise * [0.0, 1.0, 1.0], np.zeros(3))
    found = [before.measurements[0]]
    for truth in (doubled, silent):
        witness = Witness()
        _loop(problem, truth, witness)
        found.append(witness.measurements[0])
    plain, loud, exact = found
    seen = np.isfinite(plain + loud + exact).all(axis=-1)
    assert seen.sum() > 50
    error = (plain - exact)[seen][:, 0]
    np.testing.assert_allclose((loud - exact)[seen][:, 0], 2.0 * error, atol=1e-12)
    assert error.std() == pytest.approx(0.1, rel=0.2)


def test_an_unmodeled_torque_degrades_the_attitude(problem, usual):
    """0.6 deg/h^2 along the mean spin axis: 5 deg in four hours."""
    surfaces = problem[1]
    spin = initial_estimate(problem[2], np.ones(12)).angular_velocity[0]
    acceleration = np.deg2rad(0.6) / 3600.0**2 * spin / np.linalg.norm(spin)
    pushed = TruthModel(surfaces, BRIGHT.noise, acceleration)
    changed = _loop(problem, pushed)
    coverage = [each.metrics.coverage[..., :6].mean() for each in (usual, changed)]
    assert coverage[1] < coverage[0]


def test_the_correct_inertia_improves_the_filter(problem):
    scene, _, epoch, ids, loop = problem
    true = target_surfaces(icosahedron(), Material(), 5, inertia=INERTIA)
    truth = TruthModel(true, BRIGHT.noise, np.zeros(3))
    informed = _loop((scene, true, epoch, ids, loop), truth)
    misled = _loop(problem, truth)
    last = [np.rad2deg(np.abs(each.error[0, -60:, :, :3])).mean() for each in (informed, misled)]
    assert last[0] < last[1]
    assert not informed.failed.any()


def test_truth_that_moves_by_another_force_model(problem, usual):
    """The filter keeps its force model: the unmodeled force degrades position and velocity."""
    heavy = CR3BP(1.002 * EARTH_MOON.mu)
    plain, moved = _truth(problem), _truth(problem, forces=heavy)
    expected = propagate_bundle(plain.translation[:, 0], problem[0].step, 240, forces=heavy)
    np.testing.assert_array_equal(moved.translation, expected)
    truth = TruthModel(problem[1], BRIGHT.noise, np.zeros(3), heavy)
    changed = _loop(problem, truth)
    coverage = [each.metrics.coverage[..., 6:].mean() for each in (usual, changed)]
    assert coverage[1] < coverage[0]


def test_truth_of_another_number_of_targets_is_refused(problem):
    fewer = TruthModel(target_surfaces(icosahedron(), Material(), 4), BRIGHT.noise, np.zeros(3))
    with pytest.raises(ConfigurationError, match=r"truth\.surfaces"):
        _loop(problem, fewer)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"noise": [0.1, np.nan, 1e-5]}, r"truth\.noise"),
        ({"noise": [0.1, -1e-5, 1e-5]}, r"truth\.noise = \[0\.1, -1e-05, 1e-05\]: give no neg"),
        ({"noise": [0.1, 1e-5]}, r"truth\.noise has shape \(2,\)"),
        ({"angular_acceleration": np.zeros((4, 3))}, r"truth\.angular_acceleration has shape"),
        ({"angular_acceleration": [0.0, np.inf, 0.0]}, r"truth\.angular_acceleration"),
        ({"observer_errors": np.full((3, 6), np.nan)}, r"truth\.observer_errors"),
    ],
)
def test_impossible_truth_is_refused_in_a_line(problem, change, message):
    given = TruthModel(problem[1], BRIGHT.noise, np.zeros(3))._replace(**change)
    with pytest.raises(ConfigurationError, match=message) as caught:
        _loop(problem, given)
    assert len(str(caught.value).splitlines()) == 1


def test_the_unit_of_a_truth_is_refused(problem):
    u = pytest.importorskip("astropy.units")
    pushed = TruthModel(problem[1], BRIGHT.noise, np.zeros(3) * u.deg / u.h**2)
    with pytest.raises(ConfigurationError, match=r"truth\.angular_acceleration has the unit"):
        _loop(problem, pushed)


@pytest.mark.parametrize("inertia", [[1.0, 1.0, 3.0], np.ones((4, 3, 3))])
def test_impossible_inertia_of_targets_is_refused(inertia):
    with pytest.raises(ConfigurationError, match="inertia"):
        target_surfaces(icosahedron(), Material(), 5, inertia=inertia)


def test_deviations_are_of_the_facets_of_the_assumed_body():
    """A true body may have more facets, whose deviations are undefined."""
    mesh = box_with_wings()
    wings = facets_from_triangles(mesh.vertices, mesh.triangles)
    assumed = target_surfaces(icosahedron(1.0), Material(), 2)
    true = target_surfaces(wings, Material(rms_slope=0.33), 2)
    estimated_parameters = BodyParameterPrior(log_slope=0.25, log_facets=0.2)
    found = true_deviations(estimated_parameters, assumed, true, np.zeros(3))
    assert found.shape == (2, len(estimated_parameters.named(20)))
    np.testing.assert_allclose(found[:, 0], np.log(1.1))
    assert np.isnan(found[:, 1:]).all()
