"""Exposures against astropy, a search over all targets, and the statistics of their detections."""

import numpy as np
import pytest
from astropy.wcs import WCS
from measured import constant_schedule
from scipy.stats import chi2, expon, kstest, norm, uniform

from cislunar.constants import EARTH_RADIUS_KM, LENGTH_UNIT_KM, MOON_RADIUS_KM
from cislunar.detection import (
    FALSE_ALARM,
    DetectionProcess,
    Exposures,
    expose,
    point_at,
    tangent_offset,
)
from cislunar.detection.exposures import _direction
from cislunar.observation.measurement import (
    DETECTED,
    EXCLUDED,
    FAINT,
    NOT_TASKED,
    OCCULTED,
    measure,
)
from cislunar.observation.scene import make_scene
from cislunar.observation.sensor import Sensor
from cislunar.observation.target_surfaces import target_surfaces
from cislunar.photometry.materials import Material
from cislunar.photometry.shapes import icosahedron

QUIET = DetectionProcess(false_alarms_deg2=0, detection_loss=0)
SUN = np.array([200.0, -300.0, 40.0])
PLACES = np.array([[1.15, 0.2, 0.1], [-0.6, 0.4, -0.3]])


def plane(ra0, dec0):
    """The tangent plane of astropy, in degrees."""
    wcs = WCS(naxis=2)
    wcs.wcs.ctype = ["RA---TAN", "DEC--TAN"]
    wcs.wcs.crval = np.rad2deg([ra0, dec0])
    wcs.wcs.crpix = [1.0, 1.0]
    wcs.wcs.cdelt = [1.0, 1.0]
    wcs.wcs.lonpole = 180.0
    return wcs


def still_scene(n_times, places=PLACES, rate=(0.0, 0.0, 0.0), step_s=1e-6):
    """Observers, Sun and frames that do not move, in steps within which nothing else moves."""
    observers = np.tile(places[:, None], (1, n_times, 1))
    sun = np.tile(SUN, (n_times, 1))
    return make_scene(observers, sun, step_s, observer_rate_deg_h=rate, axes=np.eye(3))


def held(places, n_times):
    """States and attitudes of targets at rest."""
    n_targets = len(places)
    states = np.zeros((n_targets, n_times, 6))
    states[..., :3] = np.asarray(places)[:, None]
    return states, np.tile([0.0, 0.0, 0.0, 1.0], (n_targets, n_times, 1))


def bodies(n_targets):
    return target_surfaces(icosahedron(), Material(), n_targets)


def directions(scene, places, observer, k=0):
    """Unit vectors, right ascensions and declinations in the body frame of an observer."""
    way = np.asarray(places) - scene.observer_position[observer, k]
    unit = way @ scene.observer_axes[k].T
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    return unit, np.arctan2(unit[:, 1], unit[:, 0]), np.arcsin(unit[:, 2])


def exposures_of(step, observer, boresight, sensors):
    limits = [sensors[o].limits() for o in observer]
    return Exposures(
        np.asarray(step),
        np.asarray(observer),
        np.asarray(boresight, dtype=float),
        np.array([each.half_field for each in limits]),
        np.array([each.limiting_magnitude for each in limits]),
    )


@pytest.mark.parametrize("dec0", [0.0, 0.7, -1.2, 1.5707, -1.56, 0.5 * np.pi])
def test_offsets_are_those_of_a_gnomonic_projection(dec0):
    rng = np.random.default_rng(1)
    ra0, offset = 3.1, rng.uniform(-5.0, 5.0, size=(400, 2))
    ra, dec = np.deg2rad(plane(ra0, dec0).wcs_pix2world(offset, 0)).T
    found = np.array([tangent_offset(*each, ra0, dec0) for each in zip(ra, dec, strict=True)])
    np.testing.assert_allclose(found, np.deg2rad(offset), rtol=0.0, atol=1e-13)
    x, y = np.deg2rad(offset).T
    back = _direction(x, y, np.full(x.size, ra0), np.full(x.size, dec0))
    np.testing.assert_allclose(np.exp(1j * back[0]), np.exp(1j * ra), rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(back[1], dec, rtol=0.0, atol=1e-13)
    assert np.all((back[0] >= -np.pi) & (back[0] < np.pi))


def test_a_direction_behind_the_tangent_plane_has_no_offset():
    assert tangent_offset(0.5 * np.pi + 1e-6, 0.0, 0.0, 0.0) == (np.inf, np.inf)
    assert tangent_offset(np.pi, 0.1, 0.0, 0.0) == (np.inf, np.inf)
    assert np.isfinite(tangent_offset(0.5 * np.pi - 1e-6, 0.0, 0.0, 0.0)).all()


def clear(place, target, sensor):
    """Whether no bright body is near a line of sight and none hides the target, by sampling the
    line of sight."""
    way = target - place
    centers = {
        "sun": SUN,
        "earth": np.array([-0.0121505856, 0.0, 0.0]),
        "moon": np.array([1.0 - 0.0121505856, 0.0, 0.0]),
    }
    for name, center in centers.items():
        toward = center - place
        cosine = way @ toward / np.linalg.norm(way) / np.linalg.norm(toward)
        if np.rad2deg(np.arccos(cosine)) <= getattr(sensor.exclusion_deg, name):
            return EXCLUDED
    along = place + np.linspace(0.0, 1.0, 20001)[:, None] * way
    for name, radius in (("earth", EARTH_RADIUS_KM), ("moon", MOON_RADIUS_KM)):
        if np.linalg.norm(along - centers[name], axis=1).min() < radius / LENGTH_UNIT_KM:
            return OCCULTED
    return DETECTED


def test_an_exposure_returns_exactly_the_visible_targets_in_its_field():
    """The observers turn; every target is tried in each of the fields."""
    rng = np.random.default_rng(2)
    n_times, n_targets = 6, 400
    scene = still_scene(n_times, rate=(40.0, 20.0, 70.0), step_s=600.0)
    places = np.concatenate([
        rng.normal(0.0, 0.8, size=(n_targets - 120, 3)),
        rng.normal([0.98785, 0.0, 0.0], 0.012, size=(120, 3)),
    ])  # fmt: skip
    states, attitudes = held(places, n_times)
    exclusion = {"sun": 35.0, "moon": 0.01, "earth": 10.0}
    sensors = [
        Sensor(field_of_view_deg=width, limiting_magnitude=1e6, exclusion_deg=exclusion)
        for width in (20.0, 70.0)
    ]
    command = np.array([[300, 5], [301, 6], [302, 7], [303, -1], [304, 9]])
    exposures = point_at(scene, sensors, 1, command, states)
    assert exposures.step.tolist() == [0, 0, 1, 1, 2, 2, 3, 4, 4]
    assert exposures.observer.tolist() == [0, 1, 0, 1, 0, 1, 0, 0, 1]
    given = exposures, QUIET, scene, bodies(n_targets), sensors, states, attitudes
    noise = np.zeros((n_targets, n_times, 2, 3))
    kept = np.ones((n_targets, 5, 2), dtype=bool)
    detections, origin, outcome = expose(
        1, *given, noise, rng, n_steps=5, command=command, kept=kept
    )
    crowded, kinds = 0, set()
    for e, (i, o) in enumerate(zip(exposures.step, exposures.observer, strict=True)):
        _, ra, dec = directions(scene, places, o, 1 + i)
        j = command[i, o]
        np.testing.assert_allclose(exposures.boresight[e], [ra[j], dec[j]], atol=1e-13)
        pixel = plane(ra[j], dec[j]).wcs_world2pix(np.rad2deg(np.column_stack([ra, dec])), 0)
        edge = np.rad2deg(np.tan(exposures.half_field[e]))
        inside = np.all(np.abs(pixel) <= edge, axis=1)
        way = [clear(PLACES[o], place, sensors[o]) for place in places]
        expected = np.flatnonzero(inside & (np.array(way) == DETECTED))
        rows = detections.exposure == e
        assert sorted(origin[rows]) == expected.tolist()
        np.testing.assert_allclose(
            detections.value[rows, 1:], np.column_stack([ra, dec])[origin[rows]], atol=1e-12
        )
        assert outcome[e] == way[j]
        crowded += expected.size
        kinds |= {each for each, within in zip(way, inside, strict=True) if within}
    assert crowded > 200 and kinds == {DETECTED, EXCLUDED, OCCULTED}


def test_a_commanded_target_outside_the_field_was_not_observed():
    """Without noise; there is no exposure toward a track without an estimate."""
    scene = still_scene(3)
    states, attitudes = held([[0.3, 0.5, 0.2], [0.4, 0.7, 0.6]], 3)
    command = np.array([[0, 0], [1, 0]])
    wrong = states[[1, 0]].copy()
    wrong[0, 1] = np.nan
    sensor = Sensor(field_of_view_deg=3.0, limiting_magnitude=1e6)
    exposures = point_at(scene, sensor, 1, command, wrong)
    assert exposures.step.tolist() == [0, 0, 1] and exposures.observer.tolist() == [0, 1, 0]
    detections, origin, outcome = expose(
        1, exposures, QUIET, scene, bodies(2), sensor, states, attitudes,
        np.zeros((2, 3, 2, 3)), np.random.default_rng(1), n_steps=2, command=command,
        kept=np.ones((2, 2, 2), dtype=bool),
    )  # fmt: skip
    assert outcome.tolist() == [NOT_TASKED] * 3
    assert origin.tolist() == [1, 1, 0] and detections.exposure.tolist() == [0, 1, 2]


def test_the_share_of_detections_is_that_of_the_noise_and_the_losses():
    rng = np.random.default_rng(3)
    n_times, sigma, loss = 4001, 0.3, 0.15
    scene = still_scene(n_times)
    places = [[0.3, 0.5, 0.2], [0.4, 0.7, 0.6]]
    states, attitudes = held(places, n_times)
    quiet, command = np.zeros((2, n_times, 2, 3)), np.zeros((n_times - 1, 2), dtype=np.int64)
    command[:, 1] = 1
    bright = Sensor(limiting_magnitude=1e6, magnitude_noise=sigma)
    magnitude = measure(
        1, constant_schedule([0, 1], 2, 1), scene, bodies(2), bright, states, attitudes, quiet
    )[0].value[:, 0]
    sensors = [
        Sensor(limiting_magnitude=m + step * sigma, magnitude_noise=sigma)
        for m, step in zip(magnitude, (0.4, -0.6), strict=True)
    ]
    kept = rng.random((2, n_times - 1, 2)) >= loss
    noise = sensors[0].noise * rng.normal(size=quiet.shape)
    exposures = point_at(scene, sensors, 1, command, states)
    detections, origin, outcome = expose(
        1, exposures, QUIET, scene, bodies(2), sensors, states, attitudes, noise, rng,
        n_steps=n_times - 1, command=command, kept=kept,
    )  # fmt: skip
    observer = exposures.observer[detections.exposure]
    np.testing.assert_array_equal(observer, origin)
    for o, step in enumerate((0.4, -0.6)):
        chance, n = norm.cdf(step) * (1.0 - loss), n_times - 1
        count = np.count_nonzero(origin == o)
        assert abs(count - chance * n) < 4.0 * np.sqrt(n * chance * (1.0 - chance))
        seen = kept[o, :, o] & (magnitude[o] + noise[o, 1:, o, 0] <= sensors[o].limiting_magnitude)
        assert count == np.count_nonzero(seen)
        np.testing.assert_array_equal(
            outcome[exposures.observer == o], np.where(seen, DETECTED, FAINT)
        )
        error = detections.value[origin == o, 0] - magnitude[o]
        np.testing.assert_allclose(error, noise[o, 1:, o, 0][seen], atol=1e-12)


WIDTHS, LIMITS, RATE, SLOPE = (3.0, 8.0), (18.0, 15.0), 0.12, 0.4


def alarms(boresight, step, observer, *, n_steps, rate=RATE, seed=4):
    """False alarms of exposures that have no target in their fields."""
    sensors = [
        Sensor(field_of_view_deg=width, limiting_magnitude=limit)
        for width, limit in zip(WIDTHS, LIMITS, strict=True)
    ]
    scene = still_scene(n_steps + 1)
    states, attitudes = held([PLACES[0] - [0.0, 0.0, 9.0]], n_steps + 1)
    exposures = exposures_of(step, observer, boresight, sensors)
    process = DetectionProcess(false_alarms_deg2=rate, false_alarm_slope=SLOPE, detection_loss=0)
    found, origin, _ = expose(
        1, exposures, process, scene, bodies(1), sensors, states, attitudes,
        np.zeros((1, n_steps + 1, 2, 3)), np.random.default_rng(seed), n_steps=n_steps,
        command=np.full((n_steps, 2), -1), kept=np.ones((1, n_steps, 2), dtype=bool),
    )  # fmt: skip
    assert np.all(origin == FALSE_ALARM)
    return exposures, found


def all_pairs(n_steps):
    return np.repeat(np.arange(n_steps), 2), np.tile([0, 1], n_steps)


def in_plane(exposures, found):
    """Offsets of detections in units of half the field, by astropy."""
    out = np.empty((found.exposure.size, 2))
    of = exposures.boresight[found.exposure]
    for each in np.unique(of, axis=0):
        rows = np.all(of == each, axis=1)
        out[rows] = np.deg2rad(plane(*each).wcs_world2pix(np.rad2deg(found.value[rows, 1:]), 0))
    return out / np.tan(exposures.half_field[found.exposure])[:, None]


def test_false_alarms_are_a_uniform_poisson_process():
    n_steps = 2000
    step, observer = all_pairs(n_steps)
    boresight = np.array([[1.0, 0.4], [-2.0, 1.55]])[observer]
    exposures, found = alarms(boresight, step, observer, n_steps=n_steps)
    counts = np.bincount(found.exposure, minlength=step.size)
    for o, width in enumerate(WIDTHS):
        own, mean = counts[observer == o], RATE * width**2
        assert abs(own.mean() - mean) < 4.0 * np.sqrt(mean / n_steps)
        dispersion = np.sum((own - own.mean()) ** 2) / own.mean()
        assert 1e-4 < chi2.sf(dispersion, n_steps - 1) < 1.0 - 1e-4
    of = observer[found.exposure]
    offsets = in_plane(exposures, found)
    for o, limit in enumerate(LIMITS):
        rows = of == o
        for axis in range(2):
            assert kstest(offsets[rows, axis], uniform(-1.0, 2.0).cdf).pvalue > 1e-3
        assert abs(np.corrcoef(offsets[rows].T)[0, 1]) < 4.0 / np.sqrt(rows.sum())
        depth = limit - found.value[rows, 0]
        assert depth.min() >= 0.0
        assert kstest(depth, expon(scale=1.0 / (SLOPE * np.log(10.0))).cdf).pvalue > 1e-3


def test_the_intensity_of_false_alarms_is_the_density_that_the_association_assumes():
    """Per square radian of the tangent plane and magnitude: the integral over all is the mean."""
    process = DetectionProcess(false_alarms_deg2=RATE, false_alarm_slope=SLOPE)
    magnitude = np.linspace(-20.0, 18.0, 200001)
    density = np.exp(process.log_intensity(magnitude, 18.0, 0.0))
    total = np.trapezoid(density, magnitude) * np.deg2rad(1.0) ** 2
    assert total == pytest.approx(RATE, rel=1e-6)
    assert process.log_intensity(15.0, 18.0, 0.0) == pytest.approx(
        process.log_intensity(18.0, 18.0, 0.0) - 3.0 * SLOPE * np.log(10.0)
    )
    # without a magnitude, the density per square radian alone
    assert np.exp(process.log_intensity(np.nan, 18.0, 0.0)) == pytest.approx(
        process.false_alarms_deg2 * np.rad2deg(1.0) ** 2
    )


def test_false_alarms_do_not_depend_on_where_an_observer_points_or_who_is_idle():
    n_steps = 300
    step, observer = all_pairs(n_steps)
    here = np.array([[1.0, 0.4], [-2.0, 1.55]])[observer]
    rng = np.random.default_rng(5)
    there = np.column_stack([rng.uniform(-3.0, 3.0, 2), rng.uniform(-1.4, 1.4, 2)])[observer]
    busy = rng.random(step.size) < 0.6
    first, one = alarms(here, step, observer, n_steps=n_steps)
    second, other = alarms(there[busy], step[busy], observer[busy], n_steps=n_steps)
    key = 2 * first.step[one.exposure] + first.observer[one.exposure]
    rows = busy[key]
    with_key = 2 * second.step[other.exposure] + second.observer[other.exposure]
    np.testing.assert_array_equal(np.sort(key[rows]), np.sort(with_key))
    assert rows.sum() > 500 and not rows.all()

    def arranged(exposures, found, name, chosen):
        table = np.column_stack([name, found.value[:, 0], in_plane(exposures, found)])[chosen]
        return table[np.lexsort((table[:, 1], table[:, 0]))]

    whole = np.ones(with_key.size, dtype=bool)
    np.testing.assert_allclose(
        arranged(first, one, key, rows), arranged(second, other, with_key, whole), atol=1e-9
    )


def test_no_false_alarms_without_a_rate():
    step, observer = all_pairs(50)
    _, found = alarms(np.zeros((100, 2)), step, observer, n_steps=50, rate=0)
    assert found.exposure.size == 0 and found.value.shape == (0, 3)


def test_the_order_of_detections_does_not_tell_their_origin():
    """Half of the detections are of targets; neither order nor variance separates them."""
    rng = np.random.default_rng(6)
    n_times, n_targets = 201, 20
    scene = still_scene(n_times)
    center = np.array([0.3, 0.5, 0.2])
    places = center + rng.normal(0.0, 0.01, size=(n_targets, 3))
    states, attitudes = held(places, n_times)
    sensor = Sensor(field_of_view_deg=6.0, limiting_magnitude=30.0)
    process = DetectionProcess(false_alarms_deg2=20.0 / 36.0, detection_loss=0)
    command = np.zeros((n_times - 1, 2), dtype=np.int64)
    exposures = point_at(scene, sensor, 1, command, states)
    noise = sensor.noise * rng.normal(size=(n_targets, n_times, 2, 3))
    found, origin, _ = expose(
        1, exposures, process, scene, bodies(n_targets), sensor, states, attitudes, noise, rng,
        n_steps=n_times - 1, command=command,
        kept=rng.random((n_targets, n_times - 1, 2)) < 0.5,
    )  # fmt: skip
    assert np.all(np.diff(found.exposure) >= 0)
    place, false = [], []
    for e in range(exposures.step.size):
        rows = np.flatnonzero(found.exposure == e)
        assert np.all(np.diff(found.value[rows, 1]) >= 0.0)
        place.append(np.linspace(0.0, 1.0, rows.size))
        false.append(origin[rows] == FALSE_ALARM)
    false, place = np.concatenate(false), np.concatenate(place)
    # targets cluster at the center: the mean place of both is the middle
    assert 0.3 < false.mean() < 0.8
    for each in (place[false], place[~false]):
        assert abs(each.mean() - 0.5) < 0.02
    np.testing.assert_array_equal(found.variance, np.tile(sensor.noise**2, (false.size, 1)))


def test_many_detections_of_one_exposure_find_room():
    rng = np.random.default_rng(7)
    n_targets = 700
    scene = still_scene(2)
    states, attitudes = held(rng.normal([0.3, 0.5, 0.2], 0.002, (n_targets, 3)), 2)
    sensor = Sensor(field_of_view_deg=20.0, limiting_magnitude=1e6)
    command = np.array([[0, -1]])
    exposures = point_at(scene, sensor, 1, command, states)
    found, origin, outcome = expose(
        1, exposures, QUIET, scene, bodies(n_targets), sensor, states, attitudes,
        np.zeros((n_targets, 2, 2, 3)), rng, n_steps=1, command=command,
        kept=np.ones((n_targets, 1, 2), dtype=bool),
    )  # fmt: skip
    assert sorted(origin) == list(range(n_targets)) and outcome.tolist() == [DETECTED]
    assert found.exposure.size == n_targets
