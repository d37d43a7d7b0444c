import numpy as np
import pytest
from measured import constant_schedule, draw_truth, observed_by
from oracles.visibility import directions_to_bodies, outside_exclusion

from cislunar.constants import LENGTH_UNIT_KM, MU
from cislunar.dynamics.cr3bp import primary_positions
from cislunar.errors import ConfigurationError
from cislunar.observation import measurement
from cislunar.observation.measurement import (
    DETECTED,
    EXCLUDED,
    FAINT,
    NOT_TASKED,
    OCCULTED,
    measure,
)
from cislunar.observation.records import highest
from cislunar.observation.scene import make_scene
from cislunar.observation.sensor import ExclusionAngles, Sensor
from cislunar.observation.sightline import (
    EARTH_RADIUS,
    MOON_RADIUS,
    direction_angles,
    occulted,
    wrap_angle,
)
from cislunar.observation.target_surfaces import target_surfaces
from cislunar.photometry.facets import apparent_magnitude
from cislunar.photometry.materials import Material
from cislunar.photometry.shapes import icosahedron, icosphere
from cislunar.tasking.demonstration import tracking_problem
from cislunar.tasking.initial_conditions import initial_estimate


@pytest.fixture(scope="module")
def problem():
    scene, surfaces, epoch, ids, settings = tracking_problem(n_observers=5, duration_hours=2.0)
    initial = initial_estimate(epoch, settings.initial.components())
    truth = draw_truth(initial, scene, settings.sensor.noise, 0, ids)
    return scene, surfaces, truth


def _inertial(scene, k, vector):
    angle = k * scene.step
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ vector


def test_wrap_angle():
    angles = np.linspace(-20.0, 20.0, 401)
    wrapped = np.array([wrap_angle(a) for a in angles])
    assert np.all((wrapped >= -np.pi) & (wrapped < np.pi))
    np.testing.assert_allclose(np.exp(1j * wrapped), np.exp(1j * angles), atol=1e-14)


def test_measurements_are_angles_in_the_observer_frame_and_the_facet_magnitude(problem):
    """Rebuilt from rotations written out by hand and the array photometry."""
    scene, surfaces, truth = problem
    observer_of = np.array([2, 0, 4, 1, 3])
    sensor = Sensor(
        limiting_magnitude=90.0, exclusion_deg=ExclusionAngles(0.0, 0.0, 0.0), occultation=False
    )
    records, outcome = observed_by(observer_of, scene, surfaces, sensor, truth, 7, 30)
    measured = records.value.reshape(5, 30, 3)
    assert np.all(outcome == DETECTED)
    np.testing.assert_array_equal(records.variance, np.tile(sensor.noise**2, (150, 1)))
    for j in range(5):
        for i in (0, 29):
            k = 7 + i
            line = truth.translation[j, k, :3] - scene.observer_position[observer_of[j], k]
            line = _inertial(scene, k, line)
            spin = np.deg2rad(k / 60.0)  # 1 deg/h about z
            ra = np.arctan2(line[1], line[0]) - spin
            dec = np.arcsin(line[2] / np.linalg.norm(line))
            to_sun = _inertial(scene, k, scene.sun_position[k] - truth.translation[j, k, :3])
            magnitude = apparent_magnitude(
                truth.quaternion[j, k],
                to_sun / np.linalg.norm(to_sun),
                -line / np.linalg.norm(line),
                np.linalg.norm(line) * LENGTH_UNIT_KM * 1000.0,
                icosahedron(),
            )
            noise = truth.noise[j, k, 0]
            if np.isfinite(magnitude):
                assert measured[j, i, 0] == pytest.approx(magnitude + noise[0], abs=1e-9)
            assert wrap_angle(measured[j, i, 1] - ra - noise[1]) == pytest.approx(0.0, abs=1e-12)
            assert measured[j, i, 2] == pytest.approx(dec + noise[2], abs=1e-12)


def test_right_ascension_of_an_aligned_frame():
    assert direction_angles(0.0, 2.0, 0.0, np.eye(3)) == pytest.approx((np.pi / 2, 0.0))
    assert direction_angles(-1.0, 0.0, 1.0, np.eye(3)) == pytest.approx((np.pi, np.pi / 4))


def test_outcomes_follow_the_limits(problem):
    """Exclusion against the array function, the limit on the noisy magnitude, tasking."""
    scene, surfaces, truth = problem
    sensor = Sensor(occultation=False, limiting_magnitude=17.0)
    seen = set()
    for observer in range(5):
        observer_of = np.full(5, observer)
        observer_of[4] = -1
        records, row_outcome = observed_by(observer_of, scene, surfaces, sensor, truth)
        outcome = highest(records, row_outcome, NOT_TASKED)
        keen = Sensor(limiting_magnitude=90.0, occultation=False)
        every, _ = observed_by(observer_of, scene, surfaces, keen, truth)
        measured, unlimited = (each.value.reshape(4, 120, 3) for each in (records, every))
        position = scene.observer_position[observer, 1:]
        line = truth.translation[:4, 1:, :3] - position
        bodies = directions_to_bodies(position, scene.sun_position[1:])
        clear = outside_exclusion(line, bodies, ExclusionAngles())
        np.testing.assert_array_equal(outcome[:4] != EXCLUDED, clear)
        np.testing.assert_array_equal(outcome[:4] == DETECTED, unlimited[..., 0] <= 17.0)
        assert np.all(outcome[4] == NOT_TASKED)
        np.testing.assert_array_equal(np.isfinite(measured).all(axis=2), outcome[:4] == DETECTED)
        seen |= set(np.unique(outcome))
    assert seen == {NOT_TASKED, FAINT, EXCLUDED, DETECTED}


def test_occultation_against_points_along_the_segment():
    rng = np.random.default_rng(3)
    hidden = 0
    for _ in range(400):
        center, radius = (
            (np.array([1.0 - MU, 0.0, 0.0]), MOON_RADIUS)
            if rng.random() < 0.5
            else (np.array([-MU, 0.0, 0.0]), EARTH_RADIUS)
        )
        start = center + 3.0 * radius * rng.normal(size=3)
        end = center + 3.0 * radius * rng.normal(size=3)
        points = start + np.linspace(0.0, 1.0, 4001)[:, None] * (end - start)
        nearest = np.linalg.norm(points - center, axis=1).min()
        if abs(nearest - radius) < 1e-3 * radius:
            continue
        assert occulted(*start, *(end - start), primary_positions(MU)) == (nearest < radius)
        hidden += nearest < radius
    assert 20 < hidden < 380


def test_a_target_behind_the_moon_is_occulted():
    """5.2 degrees from the center is outside the exclusion angle, but within a near Moon's disk."""
    moon = np.array([1.0 - MU, 0.0, 0.0])
    observer = moon + np.array([0.0, 5.0 * MOON_RADIUS, 0.0])
    off = np.deg2rad(5.2)
    target = observer + 0.1 * np.array([np.sin(off), -np.cos(off), 0.0])
    scene = make_scene(np.tile(observer, (1, 2, 1)), np.tile([0.0, 389.0, 0.0], (2, 1)), 60.0)
    surfaces = target_surfaces(icosphere(1), Material(), 1)
    state = np.zeros((1, 2, 6))
    state[..., :3] = target
    attitude = np.tile([0.0, 0.0, 0.0, 1.0], (1, 2, 1))
    outcomes = [
        measure(
            1, constant_schedule([0], 1, 1), scene, surfaces,
            Sensor(occultation=flag, limiting_magnitude=90.0), state, attitude,
            np.zeros((1, 2, 1, 3)),
        )[1].item()
        for flag in (True, False)
    ]  # fmt: skip
    assert outcomes == [OCCULTED, DETECTED]


@pytest.mark.parametrize(
    "bad",
    [
        {"magnitude_noise": 0.0},
        {"angle_noise_arcsec": -3.0},
        {"field_of_view_deg": np.nan},
        {"limiting_magnitude": np.inf},
    ],
)
def test_impossible_sensors_are_refused(bad):
    with pytest.raises(ConfigurationError, match=next(iter(bad))):
        Sensor(**bad)


def test_scene_errors_name_the_key():
    with pytest.raises(ConfigurationError, match="observer_position has no observers"):
        make_scene(np.empty((0, 3, 3)), np.zeros((3, 3)), 60.0)
    with pytest.raises(ConfigurationError, match="sun_position"):
        make_scene(np.ones((1, 3, 3)), np.zeros((4, 3)), 60.0)
    with pytest.raises(ConfigurationError, match="step_s"):
        make_scene(np.ones((1, 3, 3)), np.ones((3, 3)), 0.0)
    for axes in (np.ones((3, 3)), np.diag([1.0, 1.0, -1.0])):
        with pytest.raises(ConfigurationError, match="axes must be a rotation matrix"):
            make_scene(np.ones((1, 3, 3)), np.ones((3, 3)), 60.0, axes=axes)
    with pytest.raises(ConfigurationError, match="material"):
        target_surfaces(icosahedron(), [Material()], 2)


def test_shapes_and_materials_may_differ_between_targets(problem):
    scene, _, truth = problem
    shapes = [icosahedron(2.0), icosphere(2), icosahedron()]
    materials = [Material(), Material(specular_weight=0.0), Material(diffuse_albedo=0.1)]
    mixed = target_surfaces(shapes, materials, 3)
    for j in range(3):
        alone = target_surfaces(shapes[j], materials[j], 1)
        place, sun = np.array([0.3, 0.1, 0.2]), np.array([0.3, 0.1, 0.2]) + scene.sun_position[1]
        given = place, np.zeros(3), sun, scene.frame_axes[1]
        quaternion = tuple(truth.quaternion[j, 1])
        got = measurement.target_magnitude(*given, quaternion, mixed, j)
        expected = measurement.target_magnitude(*given, quaternion, alone, 0)
        assert got == expected
