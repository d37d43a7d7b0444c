"""Observers and targets of a study: orbits, states, covariances and units as given."""

import numpy as np
import pandas as pd
import pytest
from example_study import EPOCH, OBSERVERS, SETTINGS, TARGETS

import cislunar as cs
from cislunar.constants import LENGTH_UNIT_KM, MU, TIME_UNIT_S
from cislunar.errors import ConfigurationError
from cislunar.estimation.estimator import InitialEstimate
from cislunar.exchange import Segment, epoch_at, oem_text
from cislunar.quantities import date_of, in_kilometers
from cislunar.study.objects import StudyObject, read_objects
from cislunar.study.study_file import read_study


def test_a_covariance_given_by_the_user_is_that_of_the_estimate():
    spread = np.diag([4.0, 9.0, 16.0, 1e-8, 1e-8, 4e-8])
    targets = TARGETS | {"mike": TARGETS["mike"] | {"covariance_km": spread.tolist()}}
    study = cs.Study(OBSERVERS, targets, EPOCH, **SETTINGS)
    initial: InitialEstimate = study._placement(study._inputs()).initial
    sigma = initial.deviations()[:, 6:] * np.repeat(
        [LENGTH_UNIT_KM, LENGTH_UNIT_KM / TIME_UNIT_S], 3
    )
    assert sigma[2] == pytest.approx([2.0, 3.0, 4.0, 1e-4, 1e-4, 2e-4])
    assert sigma[0, :3] == pytest.approx([31.6227766] * 3)


def test_an_icrf_state_is_exact_in_ephemeris_dynamics():
    """The position at the epoch is that given, by way of the Moon's position from SPICE."""
    import spiceypy

    from cislunar.ephemeris.kernel import kernel_path, loaded
    from cislunar.ephemeris.time_scales import tdb_seconds

    state = [60_000.0, -20_000.0, 5_000.0, 0.1, 0.9, -0.2]
    target = {"orbiter": {"icrf_km": state, "center": "moon"}}
    dynamics = {"truth": "ephemeris", "filter": "ephemeris"}
    study = cs.Study(OBSERVERS, target, EPOCH, dynamics=dynamics, **SETTINGS)
    placed = study._placement(study._inputs())
    with loaded(kernel_path("de421")):
        moon = spiceypy.spkgeo(301, tdb_seconds(EPOCH), "J2000", 3)[0]
    assert placed.epoch_state[0, :3] * LENGTH_UNIT_KM == pytest.approx(
        moon[:3] + state[:3], abs=1e-2
    )


def test_quantities_are_converted():
    u = pytest.importorskip("astropy.units")
    sensor = cs.Sensor(angle_noise_arcsec=10.0 * u.urad, limiting_magnitude=19 * u.mag)
    assert sensor.angle_noise_arcsec == pytest.approx(2.0626480624709638)
    study = cs.Study(
        {"south": {"family": "Halo_L2_S", "period_days": 157.44 * u.h}},
        TARGETS,
        EPOCH,
        duration_hours=0.0625 * u.day,
        step_s=1 * u.min,
        sensor={"field_of_view_deg": 60 * u.arcmin},
    )
    assert study.settings.duration_hours == 1.5
    assert study.settings.sensor.field_of_view_deg == pytest.approx(1.0)
    plain = read_objects("observer", {"south": OBSERVERS["south"]}, None, 1.0)
    assert study.observers[0].state == pytest.approx(plain[0].state, abs=1e-12)


def test_a_state_is_a_position_and_a_velocity_in_this_order():
    u = pytest.importorskip("astropy.units")
    place, speed = np.array([1e5, 0.0, 0.0]) * u.km, np.array([100.0, 200.0, 300.0]) * u.m / u.s
    expected = [1e5, 0.0, 0.0, 0.1, 0.2, 0.3]
    single = [*place, *speed]
    for given in ((place, speed), single):
        np.testing.assert_allclose(in_kilometers("state", given), expected, rtol=1e-15)
    for wrong in ((speed, place), single[::-1], np.ones(6) * u.km):
        with pytest.raises(ConfigurationError, match="state"):
            in_kilometers("state", wrong)
    time = pytest.importorskip("astropy.time").Time("2025-01-01T00:00:00.987654")
    assert date_of(time) == "2025-01-01T00:00:00.987654"


def test_collections_of_all_kinds():
    members = cs.periodic_orbits("Halo_L2_S", count=3)
    named = read_objects("target", members, None, 1.0)
    assert [each.name for each in named] == ["Halo_L2_S 1", "Halo_L2_S 2", "Halo_L2_S 3"]
    listed = read_objects("target", [members.state[0], "Lyap_L2,period=15"], None, 1.0)
    assert [each.name for each in listed] == ["target 1", "target 2"]
    assert isinstance(listed[0], StudyObject)
    tables = read_objects("observer", "config/examples/observers.csv", None, 1.0)
    assert [each.name for each in tables] == ["gateway", "gate"] or len(tables) == 2
    with_sensor = [each for each in tables if each.sensor]
    assert all("limiting_magnitude" in each.sensor for each in with_sensor)
    assert len(read_objects("target", "config/examples/targets.csv", None, 1.0)) == 12


def test_read_study_is_a_study(tmp_path):
    path = tmp_path / "own.yaml"
    path.write_text("observers: {a: 'Halo_L2_S,period=6.56'}\ntargets: {b: 'Lyap_L2,period=15'}\n")
    assert read_study(path).targets[0].name == "b"


def test_a_page_names_observers_and_targets(tmp_path):
    import base64
    import gzip
    import re

    text = cs.Study(OBSERVERS, TARGETS, EPOCH, **SETTINGS).page(tmp_path / "page.html")
    packed = re.search(r'await unpack\("([^"]+)"\)', text)[1]
    script = gzip.decompress(base64.b64decode(packed)).decode()
    assert all(f'"{name}, ' in script for name in TARGETS)
    assert all(f'"{name} (1)"' in script for name in OBSERVERS)
    assert (tmp_path / "page.html").read_text(encoding="utf-8") == text


def test_the_truth_differs_from_an_estimate_as_its_covariance_states():
    """With 400 realizations and no measurement, against the chi-square distribution."""
    spread = np.diag([4.0, 9.0, 16.0, 1e-8, 1e-8, 4e-8])
    spread[0, 1] = spread[1, 0] = 5.0
    targets = {"mike": TARGETS["mike"] | {"covariance_km": spread.tolist()}}
    study = cs.Study(OBSERVERS, targets, EPOCH, **SETTINGS)
    inputs = study._loop(study._inputs())[0].inputs
    found = []
    for seed in range(400):
        motion = inputs.true_motion(inputs.truth.sampled(seed, inputs.ids), seed)
        found.append(motion.advance(1).translation[0, 0] - inputs.initial.translation[0])
    error = np.array(found) * np.repeat([LENGTH_UNIT_KM, LENGTH_UNIT_KM / TIME_UNIT_S], 3)
    nees = np.einsum("si,ij,sj->s", error, np.linalg.inv(spread), error)
    assert nees.mean() == pytest.approx(6.0, abs=4.0 * np.sqrt(12.0 / 400.0))
    assert np.corrcoef(error[:, :2].T)[0, 1] == pytest.approx(5.0 / 6.0, abs=0.06)


@pytest.mark.parametrize(
    ("dynamics", "expected"),
    [
        ({}, ("ephemeris", "ephemeris")),
        ({"srp": {"area_to_mass": 0.01}}, ("ephemeris", "ephemeris")),
        ({"truth": "ephemeris"}, ("ephemeris", "ephemeris")),
        ({"filter": "cr3bp"}, ("ephemeris", "cr3bp")),
        ({"truth": "cr3bp"}, ("cr3bp", "cr3bp")),
    ],
)
def test_dynamics_of_observations_are_of_the_ephemeris_unless_stated(dynamics, expected):
    row = {"obsTime": "2027-03-01T06:10:00Z", "stn": "south", "artSat": "alpha"}
    table = pd.DataFrame([row | {"ra": 10.0, "dec": 5.0, "mag": 15.0}])
    study = cs.Study(OBSERVERS, TARGETS, EPOCH, observations=table, dynamics=dynamics, **SETTINGS)
    found = study.settings.dynamics
    assert (found.truth, found.filter) == expected


def test_units_of_precise_estimates_are_converted_or_refused():
    u = pytest.importorskip("astropy.units")
    rate = np.array([0.0, 0.0, 0.0125]) * u.deg / u.s
    given = TARGETS["mike"] | {"angular_velocity_deg_h": rate}
    (found,) = read_objects("target", {"mike": given}, None, 1.0)
    assert found.angular_velocity_deg_h == pytest.approx([0.0, 0.0, 45.0])
    given = TARGETS["mike"] | {"covariance_km": np.eye(6) * 1e6 * u.m**2}
    with pytest.raises(ConfigurationError, match="covariance_km has the unit m2; give numbers"):
        read_objects("target", {"mike": given}, None, 1.0)


def test_messages_keep_paths_and_identifiers(tmp_path):
    """An observer that stands on the Moon, and two objects of one name."""
    epoch = epoch_at(EPOCH)
    times = epoch.tdb_s + np.arange(0.0, 7_201.0, 600.0)
    angle, rate, zero = 2.66e-6 * (times - times[0]), 2.66e-6, np.zeros(times.size)
    unit = np.stack([np.cos(angle), np.sin(angle), zero], axis=1)
    ahead = np.stack([-np.sin(angle), np.cos(angle), zero], axis=1)
    standing = 1_740.0 * np.hstack([unit, rate * ahead])
    segments = [Segment("lander", "2027-009A", "MOON", times, standing)]
    path = tmp_path / "a.oem"
    path.write_text(oem_text(segments, created=EPOCH))
    two = read_segments_of(tmp_path, [segments[0]._replace(object_id=each) for each in "AB"])
    assert [each.name for each in read_objects("target", two, epoch, 1.0)] == [
        "lander A",
        "lander B",
    ]
    study = cs.Study(path, {"alpha": TARGETS["alpha"]}, EPOCH, **SETTINGS)
    observers, _ = study.paths()
    moon = np.array([1.0 - MU, 0.0, 0.0])
    radius = np.linalg.norm(observers["lander"][1] - moon, axis=1) * LENGTH_UNIT_KM
    assert np.abs(radius - 1_740.0).max() < 25_000.0 and np.ptp(radius) < 500.0
    study.page(tmp_path / "page.html")
    assert study.observers[0].designator == "2027-009A"


def read_segments_of(folder, segments):
    path = folder / "two.oem"
    path.write_text(oem_text(segments, created=EPOCH))
    return path
