"""Observers and targets of a study: orbits, states, covariances and units as given."""

import numpy as np
import pytest
from example_study import EPOCH, OBSERVERS, SETTINGS, TARGETS

import cislunar as cs
from cislunar.constants import LENGTH_UNIT_KM, TIME_UNIT_S
from cislunar.estimation.estimator import InitialEstimate
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
