"""Tracking data, attitude and orbit comprehensive messages, and ADES files: they are read back
unchanged, agree with the readers of independent packages, and are refused in one line."""

import re
import subprocess
import sys

import ccsds_ndm
import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from cislunar.attitude.quaternion import inverse, to_body
from cislunar.constants import EPOCH_JD, TIME_UNIT_S
from cislunar.detection import read_detections
from cislunar.dynamics.propagation import propagate
from cislunar.ephemeris.time_scales import clock_seconds, clock_to_tdb, tdb_seconds
from cislunar.errors import ConfigurationError, InputFileError
from cislunar.exchange import (
    AttitudeSegment,
    Maneuver,
    ades_text,
    aem_text,
    arc,
    epoch_at,
    observation_dates,
    ocm_text,
    oem_text,
    read_ades,
    read_aem,
    read_ocm,
    read_oem,
    read_tdm,
    tdm_text,
)

CREATED = "2030-01-01T00:00:00"
N = 40
HALO = np.array([1.14, 0.0, -0.16, 0.0, -0.223, 0.0])
ELAPSED = np.arange(0.0, 43_200.0, 3_600.0)
CONTEXT = {
    "submitter": {"name": "A. Observer", "institution": "None"},
    "measurers": {"name": ["A. Observer", "B. Measurer"]},
    "telescope": {"design": "Reflector", "aperture": "0.5", "detector": "CCD"},
}


def observations():
    """Two observers of two named objects and of three tracklets, one a second, some without a
    magnitude; the dates are on both sides of a leap second."""
    rng = np.random.default_rng(5)
    start = tdb_seconds("2016-12-31T23:59:31")
    names = np.array(["HALO 1", "2029-001A", "", "", ""])
    which = rng.integers(0, 5, N)
    table = pd.DataFrame(
        {
            "obsID": [f"{k}-{k % 2}-0" for k in range(N)],
            "stn": np.where(np.arange(N) % 2, "O002", "O001"),
            "artSat": names[which],
            "trkSub": [f"t{k}" if k > 1 else "" for k in which],
            "obsTime": start + np.arange(N) * 2.0 + 0.000123,
            "ra": rng.uniform(0.0, 360.0, N),
            "dec": np.rad2deg(np.arcsin(rng.uniform(-1.0, 1.0, N))),
            "rmsRA": rng.uniform(0.2, 30.0, N),
            "rmsDec": rng.uniform(0.2, 30.0, N),
            "rmsCorr": rng.uniform(-0.9, 0.9, N),
            "mag": np.where(rng.random(N) < 0.2, np.nan, rng.uniform(8.0, 22.0, N)),
            "rmsMag": rng.uniform(0.01, 0.3, N),
            "sys": "ICRF_KM",
            "ctr": "399",
            **{f"pos{k}": rng.uniform(-5e5, 5e5, N) for k in (1, 2, 3)},
        }
    )
    table["obsTime"] = observation_dates(table["obsTime"])
    return table


@pytest.fixture
def table():
    return observations()


@pytest.fixture(scope="module")
def epoch():
    return epoch_at(EPOCH_JD)


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


def file_of(folder, text, name):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def spoil(text, old, new):
    assert re.search(old, text)
    return re.sub(old, new, text, count=1)


def refused(read, path, message):
    with pytest.raises(InputFileError, match=message) as caught:
        read(path)
    assert str(path) in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


# tracking data messages


@pytest.mark.parametrize("system", ["UTC", "TAI", "TT", "TDB"])
def test_observations_are_read_back_from_a_tracking_data_message(table, tmp_path, system):
    given = {"created": CREATED, "comments": ["simulated"], "time_system": system}
    text = tdm_text(table, **given, ephemerides={"O001": "observer 1.oem"})
    back = read_tdm(file_of(tmp_path, text, "a.tdm"))
    for name in ("ra", "dec", "mag"):
        np.testing.assert_array_equal(back[name], table[name])
    assert back["obsTime"].tolist() == table["obsTime"].tolist()
    for name in ("stn", "artSat", "trkSub"):
        assert back[name].tolist() == table[name].tolist()
    assert set(back["ephemeris"][back["stn"] == "O001"]) == {"observer 1.oem"}
    assert set(back["ephemeris"][back["stn"] == "O002"]) == {""}
    assert tdm_text(back, **given, ephemerides={"O001": "observer 1.oem"}) == text


def test_an_independent_reader_agrees_on_a_tracking_data_message(table, tmp_path):
    text = tdm_text(table, created=CREATED)
    message = ccsds_ndm.Tdm.from_str(text)
    message.validate()
    found = {
        (s.metadata.participant_1, o.epoch, o.keyword): (s.metadata.participant_2, o.value)
        for s in message.segments
        for o in s.data.observations
    }
    assert len(found) == 2 * N + table["mag"].notna().sum()
    for row in table.to_dict("records"):
        at = row["stn"], row["obsTime"].removesuffix("Z")
        assert found[*at, "ANGLE_1"] == (row["artSat"] or "UNKNOWN", row["ra"])
        assert found[*at, "ANGLE_2"][1] == row["dec"]
        assert found.get((*at, "MAG"), (0, np.nan))[1] == pytest.approx(row["mag"], nan_ok=True)
    segment = message.segments[0].metadata
    assert (str(segment.time_system), segment.path, segment.angle_type) == ("UTC", "2,1", "RADEC")
    again = read_tdm(file_of(tmp_path, message.to_str("kvn"), "again.tdm"))
    np.testing.assert_array_equal(again[["ra", "dec"]], table[["ra", "dec"]])


def test_detections_without_a_name_are_unknown_objects(table, tmp_path):
    alone = table.drop(columns=["artSat", "trkSub"])
    text = tdm_text(alone, created=CREATED)
    assert text.count("PARTICIPANT_2 = UNKNOWN") == N
    back = read_tdm(file_of(tmp_path, text, "a.tdm"))
    assert back["trkSub"].tolist() == alone["obsID"].tolist() and set(back["artSat"]) == {""}


@pytest.mark.parametrize(
    "old, new, message",
    [
        ("CCSDS_TDM_VERS = 2.0", "CCSDS_OEM_VERS = 2.0", "line 1: not an TDM in keyword-value"),
        ("RADEC", "AZEL", "line 14: ANGLE_TYPE = AZEL cannot be used"),
        ("REFERENCE_FRAME = ICRF", "REFERENCE_FRAME = TOD_EARTH", "TOD_EARTH cannot be used"),
        ("REFERENCE_FRAME = ICRF\n", "", "the segment lacks REFERENCE_FRAME"),
        ("TIME_SYSTEM = UTC", "TIME_SYSTEM = GPS", "TIME_SYSTEM = GPS cannot be used"),
        ("= RECEIVE", "= TRANSMIT", "TIMETAG_REF = TRANSMIT cannot be used"),
        ("PATH = 2,1", "PATH = 3,1", "PATH = 3,1 must end with the numbers of the object"),
        ("PATH = 2,1\n", "", "the segment lacks PATH"),
        (r"(?s)DATA_STOP.*", "", "no DATA_STOP; the file is cut short"),
        (r"ANGLE_2 = \S+ \S+\n", "", "dates with only ANGLE_1 or ANGLE_2"),
        (r"(ANGLE_1 = \S+ )\S+", r"\1x", "line 18: 'x' must be a finite number"),
        (r"(ANGLE_2 = \S+ )\S+", r"\g<1>91.0", "a declination beyond 90 degrees"),
        (r"(ANGLE_1 = \S+ \S+\n)", r"\1\1", "line 19: a second ANGLE_1"),
        (r"ANGLE_1 = \S+ ", "ANGLE_1 = yesterday ", "line 18: 'yesterday' is not a date"),
        (r"(?s)ANGLE_1.*MAG[^\n]*", "RANGE = 2016-12-31T00:00:00 1.0", "neither angles nor"),
    ],
)
def test_a_faulty_tracking_data_message_is_refused_in_a_line(table, tmp_path, old, new, message):
    few = table[table["mag"].notna()].head(1)
    text = spoil(tdm_text(few, created=CREATED, comments=["one"]), old, new)
    refused(read_tdm, file_of(tmp_path, text, "a.tdm"), message)


# ADES


@pytest.mark.parametrize("context", [None, CONTEXT], ids=["plain", "with headers"])
def test_observations_are_read_back_from_ades(table, tmp_path, context):
    """Numbers are rounded to the digits of the standard, and the next time to nothing."""
    table["observatory"] = table["stn"].map({"O001": "First telescope", "O002": "Second"})
    text = ades_text(table.assign(trkSub="t"), context=context)
    back = read_ades(file_of(tmp_path, text, "a.psv"))
    for name in ("stn", "artSat", "obsID", "obsTime", "sys", "ctr"):
        assert back[name].tolist() == table[name].tolist()
    step = {"ra": 1e-9, "dec": 1e-9, "rmsRA": 1e-4, "rmsCorr": 1e-9, "mag": 1e-4, "pos1": 1e-6}
    for name, each in step.items():
        np.testing.assert_allclose(back[name], table[name], rtol=0.0, atol=0.51 * each)
    assert back["rmsMag"].isna().tolist() == table["mag"].isna().tolist()
    if context:
        assert back["observatory"].tolist() == table["observatory"].tolist()
    assert ades_text(back, context=context) == text


CONVERT = """
import sys
from ades.psvtoxml import psvtoxml
from ades.xmltopsv import xmltopsv
from ades import adesutility
from lxml import etree
psvtoxml(sys.argv[1], sys.argv[2])
folder = adesutility.__file__.replace("adesutility.py", "data/xsd/")
schema = etree.XMLSchema(etree.parse(folder + sys.argv[4] + ".xsd"))
schema.assertValid(etree.parse(sys.argv[2]))
xmltopsv(sys.argv[2], sys.argv[3])
"""


@pytest.mark.parametrize("schema, context", [("general", None), ("submit", CONTEXT)])
def test_the_tools_of_the_standard_accept_the_file(table, tmp_path, schema, context):
    """Validated against the published schema, converted to XML and back by its own tools."""
    if schema == "submit":  # only the Minor Planet Center assigns these
        table["trkSub"] = np.where(table["trkSub"] == "", "a", table["trkSub"])
    path = file_of(tmp_path, ades_text(table, context=context), "a.psv")
    files = [str(path), str(tmp_path / "a.xml"), str(tmp_path / "b.psv")]
    done = subprocess.run(
        [sys.executable, "-c", CONVERT, *files, schema], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr[-2000:]
    first, again = read_ades(path), read_ades(files[2])
    by_station = first.sort_values(["stn", "obsTime"], kind="stable", ignore_index=True)
    again = again.sort_values(["stn", "obsTime"], kind="stable", ignore_index=True)
    for name in ("ra", "dec", "mag", "rmsRA", "pos2"):
        np.testing.assert_array_equal(again[name], by_station[name])
    assert again["artSat"].tolist() == by_station["artSat"].tolist()


def test_detections_are_read_from_ades(table, tmp_path):
    table["trkSub"], table["mag"] = "t", table["mag"].fillna(15.0)
    path = file_of(tmp_path, ades_text(table), "a.psv")
    found = read_detections(path)
    assert found["expID"].nunique() == N and found["obsID"].tolist() == table["obsID"].tolist()
    wanted = [tdb_seconds(date) for date in table["obsTime"]]
    np.testing.assert_array_equal(found["tdb"], wanted)
    refused(
        read_detections,
        file_of(tmp_path, ades_text(table.drop(columns="rmsRA")), "b.psv"),
        "columns rmsRA are missing",
    )


def test_a_file_in_the_style_of_the_minor_planet_center_is_read(tmp_path):
    text = """# version=2017
# observatory
! mpcCode 568
! name Mauna Kea
# telescope
! design Reflector
permID |trkSub |mode|stn |prog|obsTime                |ra          |dec         |rmsRA|astCat|mag
       | aa1   | CCD|568 |  31|2016-08-29T12:32:34.1Z |  0.25      |-30.5       |0.15 |Gaia2 |21.9
 12345 |       | CCD|568 |  31|2016-08-29T12:30:34.1Z |  0.1       | 30.0       |     |Gaia2
"""
    found = read_ades(file_of(tmp_path, text, "a.psv"))
    assert found["permID"].tolist() == ["12345", ""] and found["trkSub"].tolist() == ["", "aa1"]
    assert set(found["observatory"]) == {"Mauna Kea"} and found["prog"].tolist() == ["31", "31"]
    np.testing.assert_array_equal(found["mag"], [np.nan, 21.9])
    np.testing.assert_array_equal(found["ra"], [0.1, 0.25])
    assert found["obsTime"][0] == "2016-08-29T12:30:34.100000Z"


@pytest.mark.parametrize(
    "old, new, message",
    [
        ("version=2022", "version=2040", "line 1: not a pipe-separated ADES file"),
        (r"\|ra ", "|deltaRA ", "line 2: no column ra; give optical observations"),
        (r"\|dec ", "|ra ", "line 2: no column dec"),
        (r"\|V\n", "|V|more\n", "line 3: 15 fields where the line of names has 14"),
        ("2016-12-31T", "2016-31-12T", "line 3: obsTime: .* is not a date"),
        (r"\|CCD \|O001", "|CCD |    ", "line 3: stn =  must be given"),
        (r"(Z\|[^|]*\|)[^|]*", r"\g<1>97.5", "line 3: dec = 97.5 must be a number between"),
        (r"(Z\|)[^|]*", r"\g<1>12:30:00", "line 3: ra = 12:30:00 must be a finite number"),
        ("HALO 1", "      ", "line 3: trkSub =  must be given, or one of permID, provID, artSat"),
        (r"(?s)\nHALO.*", "\n", "contains no observation"),
    ],
)
def test_a_faulty_ades_file_is_refused_in_a_line(table, tmp_path, old, new, message):
    few = table[table["mag"].notna()].head(1)
    few = few.assign(artSat="HALO 1", trkSub="").drop(columns=["sys", "ctr", "pos1"])
    few = few.drop(columns=["pos2", "pos3"])
    text = spoil(ades_text(few), old, new)
    refused(read_ades, file_of(tmp_path, text, "a.psv"), message)


@pytest.mark.parametrize(
    "change, message",
    [
        ({"stn": "first"}, r"row 1: stn = first must be the code of an observatory"),
        ({"artSat": "a" * 26}, "row 1: artSat = a.* must have at most 25"),
        ({"artSat": "a|b"}, "row 1: artSat = a.b must have at most 25"),
        ({"artSat": "", "trkSub": ""}, "row 1: trkSub =  must be given, or one of permID"),
        ({"artSat": "a", "permID": "1"}, "row 1: artSat = a must be empty where permID"),
        ({"rmsRA": 1e-9}, "rmsRA = 1e-09 has more digits than the standard"),
        ({"dec": 100.0}, "row 1: dec = 100.0 must be a number between -90 and 90"),
        ({"dec": np.nan}, "row 1: dec = nan must be a number"),
        ({"ra": "east"}, "row 1: ra = east must be a finite number"),
        ({"obsTime": "noon"}, "row 1: obsTime: 'noon' is not a date"),
        ({"ctr": "301"}, "row 1: ctr = 301 must be 399"),
    ],
)
def test_observations_that_the_standard_does_not_allow_are_refused(table, change, message):
    with pytest.raises(ConfigurationError, match=message):
        ades_text(table.head(3).assign(**change))


def test_tables_without_a_column_or_an_entry_of_the_header_are_refused(table):
    for write in (ades_text, lambda given: tdm_text(given, created=CREATED)):
        with pytest.raises(ConfigurationError, match="columns ra are missing; the table needs"):
            write(table.drop(columns="ra"))
    with pytest.raises(ConfigurationError, match="context: telescope needs aperture"):
        ades_text(table.assign(trkSub="t"), context=CONTEXT | {"telescope": {"design": "R"}})
    with pytest.raises(ConfigurationError, match="row 1: names neither an object nor a tracklet"):
        tdm_text(table.assign(artSat="", trkSub="", obsID=""), created=CREATED)
    with pytest.raises(ConfigurationError, match="row 4: not later than row 2 of the same"):
        tdm_text(table.assign(stn="O001", artSat="A", obsTime=CREATED), created=CREATED)
    with pytest.raises(ConfigurationError, match="must be a printable text of one line"):
        tdm_text(table.assign(artSat="A\nMODE = X"), created=CREATED)


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
    vector = np.array([1.0, -2.0, 0.5])
    turned = Rotation.from_quat(wanted).inv().apply(vector)
    np.testing.assert_allclose(to_body(wanted, vector), turned, atol=1e-14)


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


@pytest.mark.parametrize(
    "old, new, message",
    [
        ("META_START", "", "no META_START; the file is cut short"),
        ("TRAJ_TYPE = CARTPV", "TRAJ_TYPE = KEPLERIAN", "TRAJ_TYPE = KEPLERIAN cannot be used"),
        ("CENTER_NAME = EARTH", "CENTER_NAME = MARS", "CENTER_NAME = MARS cannot be used"),
        ("COV_ORDERING = LTM", "COV_ORDERING = FULL", "COV_ORDERING = FULL cannot be used"),
        ("MAN_REF_FRAME = ICRF", "MAN_REF_FRAME = RTN", "MAN_REF_FRAME = RTN cannot be used"),
        ("DV_X,DV_Y,DV_Z", "ACC_X,ACC_Y,ACC_Z", "MAN_COMPOSITION must be a time, DV_X"),
        ("DC_TYPE = CONTINUOUS\n", "", "the section MAN lacks DC_TYPE"),
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
