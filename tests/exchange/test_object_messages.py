"""Attitude and orbit comprehensive messages: they are read back unchanged, agree with independent
readers, and are refused in one line."""

import ccsds_ndm
import numpy as np
import pytest
from message_files import file_of, refused, spoil
from scipy.spatial.transform import Rotation

from cislunar.attitude.quaternion import inverse, to_body
from cislunar.constants import TIME_UNIT_S
from cislunar.dynamics.propagation import propagate
from cislunar.ephemeris.time_scales import clock_seconds, clock_to_tdb
from cislunar.errors import ConfigurationError
from cislunar.exchange import (
    AttitudeSegment,
    Maneuver,
    aem_text,
    arc,
    ocm_text,
    oem_text,
    read_aem,
    read_ocm,
    read_oem,
)

CREATED = "2030-01-01T00:00:00"
HALO = np.array([1.14, 0.0, -0.16, 0.0, -0.223, 0.0])
ELAPSED = np.arange(0.0, 43_200.0, 3_600.0)


@pytest.fixture(scope="module")
def segment(epoch):
    factor = np.random.default_rng(1).normal(size=(ELAPSED.size, 6, 6)) * 1e-5
    path = propagate(HALO, ELAPSED / TIME_UNIT_S)
    covariance = factor @ factor.swapaxes(1, 2)
    return arc("HALO 1", path, ELAPSED, epoch, object_id="2029-001A", covariance=covariance)


@pytest.fixture(scope="module")
def maneuvers(epoch):
    increment = np.array([1.25e-3, -7.0e-4, 3.3e-5])
    return [
        Maneuver("first", epoch.tdb_s + 7_200.5, increment, 60.0, 1.5, 0.5),
        Maneuver("second", epoch.tdb_s + 9_000.0, -increment, basis="PLANNED"),
    ]


@pytest.fixture(scope="module")
def attitudes(segment):
    rng = np.random.default_rng(3)
    quaternion = Rotation.random(ELAPSED.size, random_state=4).as_quat()
    rate = rng.normal(size=(ELAPSED.size, 3))
    return [
        AttitudeSegment("HALO 1", "2029-001A", segment.tdb_s, quaternion, rate),
        AttitudeSegment("HALO 2", "2029-001B", segment.tdb_s, quaternion[::-1]),
    ]


# attitude ephemeris messages


@pytest.mark.parametrize("system", ["UTC", "TDB"])
def test_attitudes_are_read_back(attitudes, tmp_path, system):
    text = aem_text(attitudes, created=CREATED, time_system=system)
    back = read_aem(file_of(tmp_path, text, "a.aem"))
    for found, wanted in zip(back, attitudes, strict=True):
        assert (found.name, found.object_id, found.body) == (wanted[0], wanted[1], "SC_BODY_1")
        np.testing.assert_array_equal(found.quaternion, wanted.quaternion)
        np.testing.assert_array_equal(found.angular_velocity_deg_s, wanted.angular_velocity_deg_s)
        np.testing.assert_allclose(found.tdb_s, wanted.tdb_s, rtol=0.0, atol=1e-6)
    assert aem_text(back, created=CREATED, time_system=system) == text


def test_an_independent_reader_agrees_on_attitudes(attitudes, tmp_path):
    message = ccsds_ndm.Aem.from_str(aem_text(attitudes, created=CREATED))
    message.validate()
    for found, wanted in zip(message.segments, attitudes, strict=True):
        values = np.array([each.values for each in found.data.attitude_states])
        np.testing.assert_array_equal(values[:, :4], wanted.quaternion)
        assert (found.metadata.ref_frame_a, found.metadata.ref_frame_b) == ("ICRF", "SC_BODY_1")
    again = read_aem(file_of(tmp_path, message.to_str("kvn"), "b.aem"))
    np.testing.assert_allclose(again[0].quaternion, attitudes[0].quaternion, rtol=1e-12)


def test_other_conventions_are_converted(attitudes, tmp_path):
    """Version 1.0 may have the scalar first, and the opposite direction; vectors agree with the
    rotations of SciPy, whose matrices are those from the body to the reference frame."""
    text = aem_text(attitudes[1:], created=CREATED)
    old = text.replace("VERS = 2.0", "VERS = 1.0").replace(
        "= QUATERNION\n", "= QUATERNION\nATTITUDE_DIR = B2A\nQUATERNION_TYPE = FIRST\n"
    )
    wanted = attitudes[1].quaternion
    first = np.column_stack([inverse(wanted)[:, 3:], inverse(wanted)[:, :3]])
    for row in range(ELAPSED.size):
        line = " ".join(f"{each:.16e}" for each in wanted[row])
        old = old.replace(line, " ".join(f"{each:.16e}" for each in first[row]))
    (back,) = read_aem(file_of(tmp_path, old, "a.aem"))
    np.testing.assert_array_equal(back.quaternion, wanted)
    swapped = text.replace("FRAME_A = ICRF", "FRAME_A = SC_BODY_1")
    swapped = swapped.replace("FRAME_B = SC_BODY_1", "FRAME_B = EME2000")
    (back,) = read_aem(file_of(tmp_path, swapped, "b.aem"))
    np.testing.assert_array_equal(back.quaternion, inverse(wanted))
    text = aem_text(attitudes[:1], created=CREATED)
    swapped = text.replace("FRAME_A = ICRF", "FRAME_A = SC_BODY_1")
    swapped = swapped.replace("FRAME_B = SC_BODY_1", "FRAME_B = EME2000")
    (back,) = read_aem(file_of(tmp_path, swapped, "c.aem"))
    # the file states the angular velocity of the reference frame with respect to the body
    np.testing.assert_array_equal(back.angular_velocity_deg_s, -attitudes[0].angular_velocity_deg_s)
    vector = np.array([1.0, -2.0, 0.5])
    turned = Rotation.from_quat(wanted).inv().apply(vector)
    np.testing.assert_allclose(to_body(wanted, vector), turned, atol=1e-14)


def test_quaternions_of_few_digits_and_centers_are_read(attitudes, tmp_path):
    rounded = attitudes[1]._replace(quaternion=np.array([[0.57543, 0.57543, 0.57543, 0.08167]]))
    rounded = rounded._replace(tdb_s=attitudes[1].tdb_s[:1])
    unit = rounded.quaternion / np.linalg.norm(rounded.quaternion)
    text = aem_text([rounded._replace(quaternion=unit)], created=CREATED)
    row = " ".join(f"{each:.16e}" for each in unit[0])
    text = text.replace(row, "0.57543 0.57543 0.57543 0.08167")
    text = text.replace("META_START\n", "META_START\nCENTER_NAME = MARS BARYCENTER\n")
    (back,) = read_aem(file_of(tmp_path, text, "a.aem"))
    np.testing.assert_allclose(back.quaternion, unit, rtol=1e-15)
    assert abs(np.linalg.norm(rounded.quaternion) - 1.0) > 1e-6


@pytest.mark.parametrize(
    "old, new, message",
    [
        ("= QUATERNION/ANGVEL", "= SPIN", "ATTITUDE_TYPE = SPIN cannot be used"),
        ("FRAME_A = ICRF", "FRAME_A = LVLH", "one of them must be the body frame"),
        ("FRAME_B = SC_BODY_1", "FRAME_B = ICRF", "one of them must be the body frame"),
        ("ANGVEL_FRAME = SC_BODY_1", "ANGVEL_FRAME = ICRF", "ANGVEL_FRAME = ICRF must be SC_BODY"),
        (r"2024-10-01T04\S* \S+", "2024-10-01T04:00:00 3.0", "line 23: the quaternion is not of"),
        (r"(2024-10-01T04\S*) \S+", r"\1", "line 23: 6 numbers after the date where an attitude"),
        (r"2024-10-01T11:00:00\S* .*\n", "", "the attitudes of HALO 1 end before STOP_TIME"),
        (r"(?s)DATA_STOP.*", "", "no DATA_STOP; the file is cut short"),
        (r"2024-10-01T04", "2024-10-01T01", "line 23: not later than the line before"),
    ],
)
def test_a_faulty_attitude_message_is_refused_in_a_line(attitudes, tmp_path, old, new, message):
    text = spoil(aem_text(attitudes[:1], created=CREATED), old, new)
    refused(read_aem, file_of(tmp_path, text, "a.aem"), message)


def test_attitudes_that_are_none_are_not_written(attitudes):
    for wrong, message in (
        (2.0 * attitudes[0].quaternion, "quaternion of HALO 1 of time 0 has norm 2"),
        (np.full((ELAPSED.size, 4), np.nan), "quaternion of HALO 1 of time 0 is not finite"),
        (np.empty((0, 4)), r"quaternion of HALO 1 has shape \(0, 4\)"),
    ):
        with pytest.raises(ConfigurationError, match=message):
            aem_text([attitudes[0]._replace(quaternion=wrong)], created=CREATED)
    for change, message in (
        ({"tdb_s": attitudes[0].tdb_s[1:]}, r"tdb_s of HALO 1 has shape \(11,\)"),
        ({"tdb_s": attitudes[0].tdb_s[::-1]}, "tdb_s of HALO 1 does not increase"),
        ({"angular_velocity_deg_s": np.ones((2, 3))}, "angular velocity of HALO 1 has shape"),
    ):
        with pytest.raises(ConfigurationError, match=message):
            aem_text([attitudes[0]._replace(**change)], created=CREATED)


# orbit comprehensive messages


@pytest.mark.parametrize("system", ["UTC", "TAI"])
def test_an_object_is_read_back(segment, maneuvers, tmp_path, system):
    given = {"created": CREATED, "comments": ["filter"], "time_system": system}
    text = ocm_text(segment, maneuvers, **given, user_defined={"TRACK_STATUS": "confirmed"})
    back = read_ocm(file_of(tmp_path, text, "a.ocm"))
    assert back.arc[:3] == segment[:3] and back.user_defined == {"TRACK_STATUS": "confirmed"}
    np.testing.assert_array_equal(back.arc.state, segment.state)
    np.testing.assert_array_equal(back.arc.covariance, segment.covariance)
    np.testing.assert_allclose(back.arc.tdb_s, segment.tdb_s, rtol=0.0, atol=1e-6)
    for found, wanted in zip(back.maneuvers, maneuvers, strict=True):
        assert (found.name, found.basis, found.duration_s) == (wanted[0], wanted[6], wanted[3])
        assert found.tdb_s == pytest.approx(wanted.tdb_s, abs=1e-6)
        np.testing.assert_array_equal(found.delta_v_km_s, wanted.delta_v_km_s)
        np.testing.assert_array_equal(found[4:6], wanted[4:6])
    assert ocm_text(*back[:2], **given, user_defined=back.user_defined) == text


def test_an_independent_reader_agrees_on_an_object(segment, maneuvers, tmp_path):
    message = ccsds_ndm.Ocm.from_str(ocm_text(segment, maneuvers, created=CREATED))
    message.validate()
    data = message.segment.data
    states = np.array([each.values for each in data.traj[0].traj_lines], dtype=float)
    np.testing.assert_array_equal(states, segment.state)
    rows = np.array([each.values for each in data.cov[0].cov_lines], dtype=float)
    np.testing.assert_array_equal(rows, segment.covariance[:, *np.tril_indices(6)])
    assert [each.man_id for each in data.man] == ["first", "second"]
    values = np.array(data.man[0].man_lines[0].values, dtype=float)
    np.testing.assert_array_equal(values, [60.0, *maneuvers[0].delta_v_km_s, 1.5, 0.5])
    again = read_ocm(file_of(tmp_path, message.to_str("kvn"), "b.ocm"))
    np.testing.assert_allclose(again.arc.state, segment.state, rtol=1e-12)
    assert [each.name for each in again.maneuvers] == ["first", "second"]


def test_the_states_are_those_of_an_orbit_ephemeris_message(segment, tmp_path):
    (one,) = read_oem(file_of(tmp_path, oem_text([segment], created=CREATED), "a.oem"))
    two = read_ocm(file_of(tmp_path, ocm_text(segment, created=CREATED), "a.ocm")).arc
    for found, wanted in zip(two, one, strict=True):
        np.testing.assert_array_equal(found, wanted)


def test_seconds_since_the_epoch_and_other_elements_of_maneuvers_are_read(segment, tmp_path):
    """The layout of figures G-15 and G-18 of the standard: relative times, mass changes."""
    states = "\n".join(
        f"{60.0 * k:.1f} {' '.join(map(repr, map(float, row)))}"
        for k, row in enumerate([[7000, 0, 0, 0, 7.5, 0], [6999, 450, 0, 0, 7.5, 0]])
    )
    text = f"""CCSDS_OCM_VERS = 3.0
CREATION_DATE = 2022-11-06T09:23:57
ORIGINATOR = TEST
META_START
TIME_SYSTEM = UTC
EPOCH_TZERO = 2016-12-31T23:59:30
META_STOP
TRAJ_START
CENTER_NAME = EARTH
TRAJ_REF_FRAME = EME2000
TRAJ_TYPE = CARTPV
{states}
TRAJ_STOP
PHYS_START
WET_MASS = 100.0 [kg]
PHYS_STOP
MAN_START
MAN_ID = E W
MAN_DEVICE_ID = THR
MAN_REF_FRAME = GCRF
DC_TYPE = CONTINUOUS
MAN_COMPOSITION = TIME_RELATIVE, DELTA_MASS, DV_X, DV_Y, DV_Z
30.0 -1.5 0.001 0.0 0.0
90.0 -0.5 0.0 0.002 0.0
MAN_STOP
"""
    back = read_ocm(file_of(tmp_path, text, "a.ocm"))
    leap = clock_to_tdb(clock_seconds("2017-01-01T00:00:29"), "UTC")  # 60 s later, a leap second
    assert back.arc.tdb_s[1] == pytest.approx(leap, abs=1e-6)
    assert [each.name for each in back.maneuvers] == ["E W 1", "E W 2"]
    np.testing.assert_array_equal(back.maneuvers[1].delta_v_km_s, [0.0, 0.002, 0.0])
    assert back.maneuvers[1].tdb_s - back.maneuvers[0].tdb_s == pytest.approx(60.0, abs=1e-6)
    assert back.arc.object_id == "UNKNOWN" and np.isnan(back.maneuvers[0].direction_sigma_deg)


def test_defaults_of_the_standard_may_be_left_out(segment, maneuvers, tmp_path):
    """Table 6-3 and 6-9 of CCSDS 502.0-B-3; an object without a name has its designator."""
    text = ocm_text(segment._replace(object_id="2029-001A"), maneuvers, created=CREATED)
    whole = read_ocm(file_of(tmp_path, text, "a.ocm"))
    for line in ("TIME_SYSTEM = UTC\n", "DC_TYPE = CONTINUOUS\n", "OBJECT_NAME = HALO 1\n"):
        assert line in text
        text = text.replace(line, "")
    back = read_ocm(file_of(tmp_path, text, "b.ocm"))
    assert back.arc.name == "2029-001A"
    np.testing.assert_array_equal(back.arc.tdb_s, whole.arc.tdb_s)
    assert [each.tdb_s for each in back.maneuvers] == [each.tdb_s for each in whole.maneuvers]


@pytest.mark.parametrize(
    "old, new, message",
    [
        ("META_START", "", "no META_START; the file is cut short"),
        ("TRAJ_TYPE = CARTPV", "TRAJ_TYPE = KEPLERIAN", "TRAJ_TYPE = KEPLERIAN cannot be used"),
        ("CENTER_NAME = EARTH", "CENTER_NAME = MARS", "CENTER_NAME = MARS cannot be used"),
        ("COV_ORDERING = LTM", "COV_ORDERING = FULL", "COV_ORDERING = FULL cannot be used"),
        ("MAN_REF_FRAME = ICRF", "MAN_REF_FRAME = RTN", "MAN_REF_FRAME = RTN cannot be used"),
        ("DV_X,DV_Y,DV_Z", "ACC_X,ACC_Y,ACC_Z", "MAN_COMPOSITION must be a time, DV_X"),
        ("MAN_REF_FRAME = ICRF\n", "", "the section MAN lacks MAN_REF_FRAME"),
        ("DC_TYPE = CONTINUOUS", "DC_TYPE = TIME", "DC_TYPE = TIME cannot be used"),
        ("TRAJ_STOP", "", "no TRAJ_STOP; the file is cut short"),
        (r"(?s)TRAJ_START.*TRAJ_STOP", "", "0 sections TRAJ; one of them can be read"),
        (r"2024-10-01T03:00:00\S* \S+ ", "2024-10-01T03:00:00 ", "5 numbers after the date where"),
        (r"(?s)\nMAN_START", "\nnothing", "'nothing' where NOTHING_START must stand|nothing"),
    ],
)
def test_a_faulty_object_is_refused_in_a_line(segment, maneuvers, tmp_path, old, new, message):
    text = spoil(ocm_text(segment, maneuvers, created=CREATED), old, new)
    refused(read_ocm, file_of(tmp_path, text, "a.ocm"), message)


@pytest.mark.parametrize(
    "change, message",
    [
        ({"name": "second"}, "maneuver 'second' of HALO 1: give it a name of its own"),
        ({"basis": "GUESSED"}, "maneuver 'first' of HALO 1: .* no basis or one of CANDIDATE"),
        ({"duration_s": -1.0}, "the duration not negative"),
        ({"delta_v_km_s": np.array([np.nan, 0, 0])}, "must be finite"),
        ({"direction_sigma_deg": np.nan}, "give both standard deviations"),
    ],
)
def test_impossible_maneuvers_are_not_written(segment, maneuvers, change, message):
    wrong = [maneuvers[0]._replace(**change), maneuvers[1]]
    with pytest.raises(ConfigurationError, match=message):
        ocm_text(segment, wrong, created=CREATED)
    with pytest.raises(ConfigurationError, match="must consist of capital letters"):
        ocm_text(segment, created=CREATED, user_defined={"small": 1})
