"""Candidates against sampled orbits, and their weights against the likelihood ratio by hand."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import norm

from cislunar.association import Expectation, find_candidates, gate_threshold
from cislunar.detection import DetectionProcess, Detections, Exposures
from cislunar.dynamics.bundle import propagate_bundle
from cislunar.dynamics.cr3bp import EARTH_MOON
from cislunar.estimation.estimator import OrbitEstimates
from cislunar.observation.sensor import Sensor, sensor_limits
from cislunar.observation.sightline import METERS
from cislunar.photometry.sphere import faintness_per_squared_range, phase_angle, sphere_magnitude
from cislunar.tasking.demonstration import tracking_problem

INDEX, N_STEPS, N_SAMPLES = 20, 8, 40_000
HALF, GATE, SIGMA, UNKNOWN = np.deg2rad(0.05), 0.999, 0.8, 2e-3
PROCESS = DetectionProcess(false_alarms_deg2=0.3, false_alarm_slope=0.35, detection_loss=0.1)


class Case:
    """A track with a known covariance, seen by one observer whose limit is near its magnitude;
    everything besides the window itself is computed with NumPy from sampled orbits."""

    def __init__(self, turn, limit_offset=0.3):
        problem = tracking_problem(n_observers=1, n_targets=5, duration_hours=2)
        rng = np.random.default_rng(1)
        self.scene = problem.scene._replace(observer_axes=turn @ problem.scene.observer_axes)
        self.mean = problem.epoch[2]
        shape = rng.normal(size=(6, 6)) + 3.0 * np.eye(6)
        root = np.diag([1e-5] * 3 + [4e-5] * 3) @ shape
        self.covariance = root @ root.T
        sample = self.mean + rng.normal(size=(N_SAMPLES, 6)) @ root.T
        both = propagate_bundle(
            np.concatenate([[self.mean], sample]), self.scene.step, N_STEPS,
            start=INDEX * self.scene.step,
        )  # fmt: skip
        self.index = INDEX + 1 + np.arange(N_STEPS)
        way = both[:, 1:, :3] - self.scene.observer_position[0, self.index]
        self.unit = np.einsum("kij,nkj->nki", self.scene.observer_axes[self.index], way)
        self.unit /= np.linalg.norm(way, axis=-1, keepdims=True)
        x, y, z = np.moveaxis(self.unit, -1, 0)
        ra, dec = np.arctan2(y, x), np.arcsin(z)
        self.center = np.column_stack([ra[0], dec[0]])
        turned = (ra[1:] - ra[0] + np.pi) % (2.0 * np.pi) - np.pi
        self.sample = np.stack([turned, dec[1:] - dec[0]], axis=-1)
        off = both[0, 1:, :3] - self.scene.sun_position[self.index]
        self.magnitude = sphere_magnitude(
            np.linalg.norm(way[0], axis=-1) * METERS, phase_angle(way[0], off), radius_m=1.5,
            diffuse_reflection_coefficient=0.4,
        )  # fmt: skip
        self.limit = float(self.magnitude.mean() + limit_offset)
        self.sensor = Sensor(
            field_of_view_deg=np.rad2deg(2.0 * HALF), limiting_magnitude=self.limit,
            magnitude_noise=0.2,
        )  # fmt: skip

    def exposures(self, offset):
        """Exposures whose boresights are off by a vector (2,) in units of half the field."""
        ra, dec = self.center.T
        zero = np.zeros(N_STEPS, dtype=np.int64)
        boresight = np.column_stack([ra - offset[0] * HALF / np.cos(dec), dec - offset[1] * HALF])
        return Exposures(
            np.arange(N_STEPS), zero, boresight, np.full(N_STEPS, HALF),
            np.full(N_STEPS, self.limit),
        )  # fmt: skip

    def window(self, exposures, detections, translation=None, covariance=None, process=PROCESS):
        faintness = METERS**2 * faintness_per_squared_range(
            self.limit, radius_m=1.5, diffuse_reflection_coefficient=0.4
        )
        translation = self.mean[None] if translation is None else translation
        covariance = self.covariance[None] if covariance is None else covariance
        return find_candidates(
            OrbitEstimates(INDEX, translation, covariance), exposures, detections, self.scene,
            EARTH_MOON, sensor_limits(self.sensor, 1),
            Expectation(process, UNKNOWN, SIGMA, GATE, np.array([faintness])),
        )  # fmt: skip

    def near(self, shift=(1e-4, -2e-4), fainter=0.2):
        """A detection of each exposure near the expected direction and magnitude."""
        value = np.column_stack([self.magnitude + fainter, self.center + shift])
        variance = np.tile(self.sensor.noise**2, (N_STEPS, 1))
        return Detections(np.arange(N_STEPS), value, variance)


@pytest.fixture(scope="module", params=["low", "high"])
def case(request):
    """At low and at high declination in the body frame."""
    if request.param == "low":
        return Case(np.eye(3))
    toward = Case(np.eye(3)).unit[0, N_STEPS // 2]
    about = np.cross(toward, [0.0, 0.0, 1.0])
    tilt = np.arccos(toward[2]) - np.deg2rad(15.0)
    return Case(Rotation.from_rotvec(tilt * about / np.linalg.norm(about)).as_matrix())


def test_directions_are_those_of_sampled_orbits(case):
    window = case.window(case.exposures((0.0, 0.0)), case.near())
    assert window.exposure.tolist() == window.detection.tolist() == list(range(N_STEPS))
    np.testing.assert_array_equal(window.covariance, np.eye(6)[None])
    predicted = case.near().value[:, 1:] - window.residual
    np.testing.assert_allclose(predicted, case.center, atol=1e-10)
    for k in range(N_STEPS):
        covariance = window.design[k] @ window.design[k].T
        sampled = np.cov(case.sample[:, k].T)
        scale = np.sqrt(np.diag(sampled))
        assert np.all(np.abs(case.sample[:, k].mean(axis=0)) < 4.5 * scale / np.sqrt(N_SAMPLES))
        np.testing.assert_allclose(
            covariance / np.outer(scale, scale), sampled / np.outer(scale, scale), atol=0.025
        )
    # the deviations of all exposures are of one state at the begin of the window
    first, last = case.sample[:, 0], case.sample[:, -1]
    across = (first.T @ last) / N_SAMPLES
    scale = np.outer(first.std(axis=0), last.std(axis=0))
    np.testing.assert_allclose(
        (window.design[0] @ window.design[-1].T) / scale, across / scale, atol=0.025
    )
    np.testing.assert_array_equal(window.noise, case.near().variance[:, 1:])
    dec = case.center[:, 1]
    assert np.all(dec > 1.2) or np.all(np.abs(dec) < 0.9)


@pytest.mark.parametrize("offset", [(0.0, 0.0), (0.8, 0.0), (0.0, -1.1), (1.05, 0.3)])
def test_detection_probabilities_are_those_of_sampled_orbits(case, offset):
    exposures = case.exposures(offset)
    window = case.window(exposures, case.near())
    assert window.seen.tolist() == [[k, 0] for k in range(N_STEPS)]
    found = -np.expm1(window.log_miss) / GATE
    rng = np.random.default_rng(2)
    ra0, dec0 = exposures.boresight.T
    toward = np.stack(
        [np.cos(dec0) * np.cos(ra0), np.cos(dec0) * np.sin(ra0), np.sin(dec0)], axis=-1
    )
    east = np.stack([-np.sin(ra0), np.cos(ra0), 0.0 * ra0], axis=-1)
    north = np.cross(toward, east)
    shares = []
    for k in range(N_STEPS):
        unit = case.unit[1:, k]
        x, y = unit @ east[k] / (unit @ toward[k]), unit @ north[k] / (unit @ toward[k])
        inside = (np.abs(x) <= np.tan(HALF)) & (np.abs(y) <= np.tan(HALF))
        spread = np.hypot(SIGMA, 0.2) * rng.normal(size=N_SAMPLES)
        bright = case.magnitude[k] + spread <= case.limit
        lost = rng.random(N_SAMPLES) < 0.1
        share = np.mean(inside & bright & ~lost)
        # offsets along both axes are taken as independent
        assert found[k] == pytest.approx(share, abs=0.012)
        shares.append(share)
    assert np.all((np.array(shares) > 0.1) & (np.array(shares) < 0.75))


def test_weights_are_the_likelihood_ratio_by_hand(case):
    exposures, near = case.exposures((0.8, 0.0)), case.near()
    window = case.window(exposures, near)
    square = np.rad2deg(1.0) ** 2
    kappa = (0.3 + UNKNOWN) * square * 0.35 * np.log(10.0)
    kappa *= 10.0 ** (0.35 * (near.value[:, 0] - case.limit))
    # the area of a step in right ascension shrinks with the cosine of the declination
    kappa *= np.cos(near.value[:, 2])
    # the magnitude's density includes that of being brighter than the limit, and a detection lies
    # in the field: only the share that is lost remains
    magnitude = norm(case.magnitude, np.hypot(SIGMA, 0.2)).logpdf(near.value[:, 0])
    expected = magnitude + np.log(1.0 - PROCESS.detection_loss) - np.log(kappa)
    np.testing.assert_allclose(window.log_weight, expected, rtol=0.0, atol=1e-6)


def test_false_alarms_are_as_dense_as_the_weights_assume():
    """Sampled uniformly over the field: the number per right ascension, declination and magnitude
    is the assumed density at a high declination too."""
    rng = np.random.default_rng(3)
    case = Case(np.eye(3))
    dec0, half, n = 1.1, np.deg2rad(2.0), 400_000
    x, y = rng.uniform(-1.0, 1.0, size=(2, n)) * np.tan(half)
    way = np.array([np.cos(dec0) - y * np.sin(dec0), x, np.sin(dec0) + y * np.cos(dec0)])
    ra, dec = np.arctan2(way[1], way[0]), np.arctan2(way[2], np.hypot(way[0], way[1]))
    side = np.deg2rad(0.5)
    box = (np.abs(ra) < side) & (np.abs(dec - dec0) < side)
    per_square = n / (2.0 * np.tan(half)) ** 2
    process = DetectionProcess(false_alarms_deg2=per_square / np.rad2deg(1.0) ** 2)
    magnitude = np.linspace(-10.0, case.limit, 20001)
    whole = np.trapezoid(np.exp(process.log_intensity(magnitude, case.limit, 0.0)), magnitude)
    expected = whole * np.cos(dec0) * (2.0 * side) ** 2
    assert box.sum() == pytest.approx(expected, abs=4.0 * np.sqrt(expected))


def test_gates_keep_what_is_near_in_direction_and_magnitude(case):
    """Detections on both sides of each gate; those of other exposures do not matter."""
    exposures = case.exposures((0.0, 0.0))
    whole = case.window(exposures, case.near())
    total = whole.design @ whole.design.swapaxes(1, 2)
    total[:, [0, 1], [0, 1]] += case.near().variance[:, 1:]
    axis = np.linalg.cholesky(total) @ [0.8, 0.6]
    each = np.sqrt(GATE)  # both gates together keep the share GATE
    reach = np.sqrt(gate_threshold(each, 2))
    bright = np.sqrt(gate_threshold(each, 1)) * np.hypot(SIGMA, 0.2)
    assert reach == pytest.approx(np.sqrt(-2.0 * np.log(1.0 - each)))
    assert bright == pytest.approx(norm.isf(0.5 * (1.0 - each)) * np.hypot(SIGMA, 0.2))
    value, kept = [], []
    for k in range(N_STEPS):
        for share, fainter, keep in (
            (0.99, 0.0, True), (1.01, 0.0, False), (-0.99, 0.0, True), (0.0, 0.99, True),
            (0.0, -0.99, True), (0.0, -1.01, False),
        ):  # fmt: skip
            direction = case.center[k] + share * reach * axis[k]
            value.append([case.magnitude[k] + fainter * bright, *direction])
            kept.append(keep)
    exposure = np.repeat(np.arange(N_STEPS), 6)
    variance = np.tile(case.sensor.noise**2, (exposure.size, 1))
    window = case.window(exposures, Detections(exposure, np.array(value), variance))
    assert window.detection.tolist() == np.flatnonzero(kept).tolist()
    np.testing.assert_array_equal(window.exposure, exposure[window.detection])
    np.testing.assert_array_equal(window.log_miss, whole.log_miss)
    np.testing.assert_array_equal(window.misses(), whole.log_miss[window.exposure])


def test_tracks_that_no_exposure_can_detect_are_left_out(case):
    """A failed estimate, an orbit elsewhere, and a field that points away."""
    away = case.mean.copy()
    away[1] += 0.3
    states = np.array([np.full(6, np.nan), away, case.mean])
    covariances = np.tile(case.covariance, (3, 1, 1))
    covariances[0] = np.nan
    exposures, near = case.exposures((0.0, 0.0)), case.near()
    alone, window = case.window(exposures, near), case.window(exposures, near, states, covariances)
    assert set(window.track.tolist()) == set(window.seen[:, 1].tolist()) == {2}
    np.testing.assert_array_equal(window.log_weight, alone.log_weight)
    np.testing.assert_array_equal(window.design, alone.design)
    nothing = case.window(case.exposures((40.0, 0.0)), near)
    assert nothing.seen.shape == (0, 2) and nothing.design.shape == (0, 2, 6)
    blind = case.window(
        Exposures(*(each[:0] for each in exposures)), Detections(*(each[:0] for each in near))
    )
    assert blind.seen.shape == (0, 2) and blind.track.dtype.kind == "i"


def test_a_hidden_track_is_no_chance(case):
    """The Sun, moved behind the target, forbids the observation."""
    scene = case.scene
    try:
        way = case.mean[:3] - scene.observer_position[0, INDEX]
        case.scene = scene._replace(
            sun_position=scene.observer_position[0] + 389.0 * way / np.linalg.norm(way)
        )
        window = case.window(case.exposures((0.0, 0.0)), case.near())
    finally:
        case.scene = scene
    assert window.seen.size == 0 and window.track.size == 0
