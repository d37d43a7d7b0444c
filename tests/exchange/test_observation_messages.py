"""Tracking data messages and ADES files: they are read back unchanged, agree with independent
readers, and are refused in one line."""

import subprocess
import sys

import ccsds_ndm
import numpy as np
import pandas as pd
import pytest
from message_files import file_of, refused, spoil

from cislunar.detection import read_detections
from cislunar.ephemeris.time_scales import tdb_seconds
from cislunar.errors import ConfigurationError
from cislunar.exchange import (
    ades_text,
    observation_dates,
    observation_table,
    observer_codes,
    read_ades,
    read_tdm,
    tdm_text,
)

CREATED = "2030-01-01T00:00:00"
N = 40
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
        ("PATH = 2,1\n", "PATH = 2,1\nRECEIVE_DELAY_1 = 2.0\n", "RECEIVE_DELAY_1 is not applied"),
        ("DATA_START\n", "DATA_START\nCLOCK_BIAS = 2016-12-31T00:00:00 -2.0\n", "line 18: CLOCK_B"),
        ("PATH = 2,1\n", "PATH = 2,1\nCORRECTION_ANGLE_1 = 1\n", "without CORRECTIONS_APPLIED"),
        (r"(?s)ANGLE_1.*MAG[^\n]*", "RANGE = 2016-12-31T00:00:00 1.0", "neither angles nor"),
    ],
)
def test_a_faulty_tracking_data_message_is_refused_in_a_line(table, tmp_path, old, new, message):
    few = table[table["mag"].notna()].head(1)
    text = spoil(tdm_text(few, created=CREATED, comments=["one"]), old, new)
    refused(read_tdm, file_of(tmp_path, text, "a.tdm"), message)


def test_names_in_a_comma_separated_table_are_text(table, tmp_path):
    """Names of tracklets that are equal as numbers differ, and observers may be in space or not."""
    few = table.drop(columns="artSat").head(3).assign(trkSub=["12", "012", "1E1"])
    few.loc[2, ["sys", "ctr"]] = ""
    few.loc[2, ["pos1", "pos2", "pos3"]] = np.nan
    few.to_csv(tmp_path / "a.csv", index=False)
    back, *_ = observation_table(tmp_path / "a.csv")
    assert back["trkSub"].tolist() == ["12", "012", "1E1"]
    assert back["ctr"].tolist()[:2] == ["399", "399"]
    text = ades_text(back.assign(stn=["247", "270", "F51"]))
    for name in ("12", "012", "1E1"):
        assert f"|{name} " in text or f"|{name}|" in text or f"\n{name} " in text


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


def test_codes_of_observers_are_their_names_where_they_can_be():
    found = observer_codes(["eye", "my eye", "O001", "x", "GÖD"])
    assert found == {"eye": "eye", "my eye": "O002", "O001": "O001", "x": "O003", "GÖD": "O004"}


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
        with pytest.raises(ConfigurationError, match="observations = None: give a table"):
            write(None)
    with pytest.raises(ConfigurationError, match="observations: the table has no row"):
        tdm_text(table.head(0), created=CREATED)
    with pytest.raises(ConfigurationError, match="context: telescope needs aperture"):
        ades_text(table.assign(trkSub="t"), context=CONTEXT | {"telescope": {"design": "R"}})
    with pytest.raises(ConfigurationError, match="row 1: names neither an object nor a tracklet"):
        tdm_text(table.assign(artSat="", trkSub="", obsID=""), created=CREATED)
    with pytest.raises(ConfigurationError, match="row 4: not later than row 2 of the same"):
        tdm_text(table.assign(stn="O001", artSat="A", obsTime=CREATED), created=CREATED)
    with pytest.raises(ConfigurationError, match="must be a printable text of one line"):
        tdm_text(table.assign(artSat="A\nMODE = X"), created=CREATED)
