"""Messages and tables of states: written, read back, refused in one line."""

import re

import numpy as np
import pandas as pd
import pytest
from halo_message import HALO, written
from message_files import file_of, refused, spoil

from cislunar import exchange, targets
from cislunar.constants import TIME_UNIT_S
from cislunar.dynamics.propagation import propagate
from cislunar.ephemeris.time_scales import clock_text, julian_date, tdb_to_clock
from cislunar.errors import ConfigurationError, InputFileError
from cislunar.exchange.arcs import arc, inertial_arc, rotating_arc
from cislunar.exchange.inertial import epoch_at, inertial_states
from cislunar.exchange.ocm import ocm_text
from cislunar.exchange.oem import Segment, objects_of, oem_text, read_oem, state_at
from cislunar.exchange.state_tables import read_segments, segments_csv
from cislunar.orbits import load_observers
from cislunar.study import read_study


@pytest.mark.parametrize("system", ["UTC", "TDB"])
def test_a_message_reads_back(segment, tmp_path, system):
    text = written(segment, comments=["circular problem"], time_system=system)
    assert "COMMENT circular problem" in text
    (back,) = read_oem(file_of(tmp_path, text))
    assert back[:3] == segment[:3]
    for name in ("state", "covariance"):
        np.testing.assert_array_equal(getattr(back, name), getattr(segment, name))
    np.testing.assert_allclose(back.tdb_s, segment.tdb_s, rtol=0.0, atol=1e-6)
    assert written(back, comments=["circular problem"], time_system=system) == text


def test_another_reader_agrees(segment, tmp_path):
    oem = pytest.importorskip("oem")
    path = file_of(tmp_path, written(segment, time_system="TDB"))
    message = oem.OrbitEphemerisMessage.open(path)
    states = [np.concatenate([each.position, each.velocity]) for each in message.states]
    np.testing.assert_array_equal(states, segment.state)
    np.testing.assert_array_equal([e.matrix for e in message.covariances], segment.covariance)
    message.save_as(tmp_path / "saved.oem", file_format="kvn")
    np.testing.assert_allclose(read_oem(tmp_path / "saved.oem")[0].state, segment.state, rtol=1e-12)


@pytest.mark.parametrize("system", ["UTC", "TAI", "TT", "TDB"])
def test_a_table_reads_back(segment, tmp_path, system):
    path = file_of(tmp_path, segments_csv([segment], time_system=system), "arc.csv")
    (back,) = read_segments(path)
    assert back[:3] == segment[:3]
    np.testing.assert_array_equal(back.state, segment.state)
    np.testing.assert_array_equal(back.covariance, segment.covariance)
    np.testing.assert_allclose(back.tdb_s, segment.tdb_s, rtol=0.0, atol=1e-6)
    assert segments_csv([back], time_system=system) == path.read_text(encoding="utf-8")
    table = pd.read_csv(path)
    assert table["x_km"].to_numpy() == pytest.approx(segment.state[:, 0])
    assert set(table["frame"]) == {"ICRF"} and set(table["center"]) == {"EARTH"}
    first = clock_text(tdb_to_clock(segment.tdb_s[0], system))
    assert table[f"epoch_{system.lower()}"][0] == first


@pytest.mark.parametrize("system", ["UTC", "TDB"])
def test_a_table_keeps_the_useable_spans_of_arcs_of_one_object(segment, tmp_path, system):
    """The second arc begins before the end of the first one."""
    times = segment.tdb_s
    first = segment._replace(useable_tdb_s=(times[1], times[-4]))
    later = segment._replace(tdb_s=times + 3600.0, covariance_tdb_s=np.empty(0))
    second = later._replace(covariance=np.empty((0, 6, 6)), useable_tdb_s=(times[-4], times[-2]))
    whole = segment._replace(name="whole")
    text = segments_csv([first, second, whole], time_system=system)
    back = read_segments(file_of(tmp_path, text, "arc.csv"))
    assert [each.name for each in back] == [segment.name, segment.name, "whole"]
    for found, given in zip(back[:2], (first, second), strict=True):
        assert found.useable_tdb_s == pytest.approx(given.useable_tdb_s, abs=1e-6)
    assert back[2].useable_tdb_s is None
    assert segments_csv(back, time_system=system) == text
    other = text.replace(f"useable_stop_{system.lower()}", "useable_stop_tt")
    message = f"the time scale of useable_stop_tt is not that of epoch_{system.lower()}"
    refused(read_segments, file_of(tmp_path, other, "other.csv"), message)
    wrong = spoil(text, r"EARTH,ICRF,[^,]*", "EARTH,ICRF,2030-01-01T00:00:00")
    refused(
        read_segments, file_of(tmp_path, wrong, "own.csv"), "USEABLE_STOP_TIME must be in order"
    )


def test_messages_and_tables_have_the_same_dates_by_default(tmp_path):
    epoch = epoch_at(julian_date("2025-01-03T06:30:00"))
    elapsed = np.arange(0.0, 20.0 * 86_400.0, 3_600.0)
    states = np.tile(HALO, (elapsed.size, 1))
    given = arc("HALO", states, elapsed, epoch, covariance=np.tile(np.eye(6), (elapsed.size, 1, 1)))
    text = written(given)
    table = file_of(tmp_path, segments_csv([given]), "arc.csv")
    dates = pd.read_csv(table)["epoch_utc"].tolist()
    wanted = np.datetime64("2025-01-03T06:30:00.000000") + elapsed.astype("timedelta64[s]")
    assert dates == wanted.astype(str).tolist()
    assert re.findall(r"^(2025\S+) ", text, flags=re.MULTILINE) == dates
    assert re.findall(r"^EPOCH = (\S+)", text, flags=re.MULTILINE) == dates
    for (back,) in (read_oem(file_of(tmp_path, text)), read_segments(table)):
        np.testing.assert_allclose(back.tdb_s, given.tdb_s, rtol=0.0, atol=3e-7)
        np.testing.assert_allclose(rotating_arc(back, epoch)[0], elapsed, rtol=0.0, atol=3e-7)


def test_a_table_of_version_0_1_has_dates_in_tdb(segment, tmp_path):
    text = segments_csv([segment], time_system="TDB")
    old = text.replace("frame,epoch_tdb", "epoch").replace(",ICRF,", ",")
    assert old.startswith("object,object_id,center,epoch,x_km")
    (back,) = read_segments(file_of(tmp_path, old, "old.csv"))
    np.testing.assert_allclose(back.tdb_s, segment.tdb_s, rtol=0.0, atol=1e-6)
    np.testing.assert_array_equal(back.covariance, segment.covariance)


@pytest.mark.parametrize("at", [0.0, 1_800.0, 43_000.0, 82_799.0])
def test_states_between_those_of_a_message(epoch, segment, at):
    wanted = inertial_states(propagate(HALO, [at / TIME_UNIT_S], method="dop853"), [at], epoch)[0]
    found, center = state_at([segment], epoch.tdb_s + at)
    assert center == "EARTH"
    assert np.linalg.norm(found[:3] - wanted[:3]) < 1e-3
    assert np.linalg.norm(found[3:] - wanted[3:]) < 1e-6


def test_arcs_are_used_within_their_useable_spans(epoch, tmp_path):
    """Both arcs of a maneuver have states beyond it, for interpolation (CCSDS 502.0-B-3,
    5.2.4.4)."""
    times = epoch.tdb_s + 3_600.0 * np.arange(-2.0, 3.0)
    still = np.tile([4e5, 0.0, 0.0, 0.0, 1.0, 0.0], (5, 1))
    still[:, 1] += (times - epoch.tdb_s) * 1.0
    moved = still.copy()
    moved[:, 0], moved[:, 3] = moved[:, 0] + 0.5 * (times - epoch.tdb_s), 0.5
    before, after = (
        Segment("one", "1", "EARTH", times, state, useable_tdb_s=span)
        for state, span in ((still, (times[0], times[2])), (moved, (times[2], times[4])))
    )
    path = file_of(tmp_path, oem_text([before, after], created="2030-01-01T00:00:00"))
    segments = read_oem(path)
    for found, wanted in zip(segments, (before, after), strict=True):
        np.testing.assert_allclose(found.span, wanted.span, rtol=0.0, atol=1e-6)
    for at, speed in ((-1_800.0, 0.0), (-3_600.0, 0.0), (0.0, 0.5), (1_800.0, 0.5), (3_600.0, 0.5)):
        state, _ = state_at(segments, epoch.tdb_s + at)
        assert state[3] == pytest.approx(speed, abs=1e-9)
        assert state[0] == pytest.approx(4e5 + speed * at, abs=1e-5)
    one = [segments[0]]
    with pytest.raises(InputFileError, match=r"object one: .* is not within"):
        state_at(one, epoch.tdb_s + 1_800.0)
    late = spoil(path.read_text(), r"USEABLE_START_TIME = \S+", "USEABLE_START_TIME = 2030-01-01")
    refused(read_oem, file_of(tmp_path, late, "late.oem"), "must be in order and within the states")


@pytest.mark.parametrize("hours", [1.0, 12.0, 23.9345, 24.0, 47.9])
def test_steps_of_whole_revolutions_say_nothing_about_units(epoch, tmp_path, hours):
    """A geosynchronous orbit returns after 23.93 h."""
    times = 3_600.0 * hours * np.arange(6.0)
    angle, r, v = times * 2.0 * np.pi / 86_164.1, 42_164.17, 3.07466
    c, s, zero = np.cos(angle), np.sin(angle), np.zeros(6)
    state = np.stack([r * c, r * s, zero, -v * s, v * c, zero], axis=1)
    arc = Segment("geo", "1", "EARTH", epoch.tdb_s + times, state)
    (back,) = read_oem(file_of(tmp_path, written(arc)))
    np.testing.assert_array_equal(back.state, state)


def test_objects_without_a_name_have_their_identifiers(segment, tmp_path):
    given = [segment._replace(name="UNKNOWN", object_id=each) for each in ("A", "B")]
    path = file_of(tmp_path, oem_text(given, created="2030-01-01T00:00:00"))
    assert [*objects_of(path)] == ["A", "B"]


def test_a_time_beyond_a_message_is_refused(epoch, segment):
    with pytest.raises(InputFileError, match=r"object HALO 1: 2024-10-03.* is not within"):
        state_at([segment], epoch.tdb_s + 2e5)


@pytest.mark.parametrize(
    "old, new, message",
    [
        ("CCSDS_OEM_VERS = 2.0", "<?xml version='1.0'?>", "line 1: not an OEM in keyword-value"),
        ("REF_FRAME = ICRF", "REF_FRAME = ITRF2000", "line 9: REF_FRAME = ITRF2000 cannot be used"),
        ("REF_FRAME = ICRF", "REF_FRAME = ", "the segment lacks REF_FRAME"),
        ("CENTER_NAME = EARTH", "CENTER_NAME = MARS", "CENTER_NAME = MARS cannot be used"),
        ("TIME_SYSTEM = UTC", "TIME_SYSTEM = GPS", "TIME_SYSTEM = GPS cannot be used"),
        ("(?s)META_STOP.*", "", "line 5: no META_STOP; the file is cut short"),
        ("(?s)META_START.*", "", "no META_START; the file is cut short"),
        (r"(?s)2024-10-01T20:00:00.*", "", "end before STOP_TIME"),
        (r"(?s)(2024-10-01T20:00:00\S* \S+ \S+).*", r"\1", "line 35: 2 numbers after the date"),
        ("COVARIANCE_STOP\n", "", "no COVARIANCE_STOP; the file is cut short"),
        (r"(EPOCH = .*\n.*\n).*\n", r"\1", "3 numbers in row 2 of a lower triangle"),
        (r"2024-10-01T03:00:00", "2024-10-01T25:00:00", "line 18: .* is not a date"),
        (r"2024-10-01T03:00:00", "2024-09-30T03:00:00", "line 18: not later than the line"),
        (r"(2024-10-01T03:00:00\S*) \S+", r"\1 nan", "line 18: 'nan' must be a finite number"),
    ],
)
def test_a_faulty_message_is_refused_in_a_line(segment, tmp_path, old, new, message):
    path = file_of(tmp_path, spoil(written(segment), old, new))
    refused(read_oem, path, message)


@pytest.mark.parametrize("columns", [slice(0, 3), slice(3, 6)], ids=["meters", "meters per second"])
def test_mixed_units_are_refused(segment, tmp_path, columns):
    state = segment.state.copy()
    state[:, columns] *= 1000.0
    path = file_of(tmp_path, written(segment._replace(state=state)))
    refused(read_oem, path, "times as far as their velocities imply; an OEM has")


@pytest.mark.parametrize(
    "old, new, message",
    [
        ("x_km", "x_m", "row 1: no column x_km"),
        ("2024-10-01T02", "2024-31-01T02", "row 4, .* is not a date"),
        ("EARTH", "PLUTO", "row 2, .* center 'PLUTO' is none of"),
        ("ICRF", "ITRF", "row 2, .* frame 'ITRF' is none of ICRF"),
        ("epoch_utc", "epoch", "row 1: the time scale or the frame is not stated; give"),
        ("epoch_utc", "epoch_gps", "row 1: the time scale or the frame is not stated; give"),
        ("frame", "axes", "row 1: the time scale or the frame is not stated; give"),
        (
            r"2024-10-01T03:\S+?,\S+?,",
            "2024-10-01T03:00,x,",
            "row 5, .* x_km = 'x' must be a finite number",
        ),
        (r",[^,]*\n$", "\n", "row 25: 31 fields where the header has 32"),
    ],
)
def test_a_faulty_table_is_refused_in_a_line(segment, tmp_path, old, new, message):
    path = file_of(tmp_path, spoil(segments_csv([segment]), old, new), "arc.csv")
    refused(read_segments, path, message)


@pytest.mark.parametrize(
    "change, message",
    [
        (lambda each: {"state": each.state * np.nan}, "state of HALO 1 of time 0 is not finite"),
        (lambda each: {"state": each.state[:, :3]}, r"state of HALO 1 has shape \(24, 3\)"),
        (lambda each: {"state": each.state[1:]}, r"tdb_s of HALO 1 has shape \(24,\)"),
        (lambda each: {"tdb_s": each.tdb_s[::-1]}, "tdb_s of HALO 1 does not increase"),
        (lambda each: {"covariance": each.covariance[1:]}, "covariance_tdb_s of HALO 1 has shape"),
        (lambda each: {"covariance": each.covariance * np.inf}, "covariance of HALO 1 of time 0"),
    ],
)
def test_segments_that_cannot_be_read_are_not_written(segment, change, message):
    wrong = segment._replace(**change(segment))
    created = "2030-01-01T00:00:00"
    for write in (
        written,
        lambda each: segments_csv([each]),
        lambda e: ocm_text(e, created=created),
    ):
        with pytest.raises(ConfigurationError, match=message):
            write(wrong)
    with pytest.raises(ConfigurationError, match="segments is empty"):
        oem_text([], created=created)


def test_impossible_arcs_are_refused(epoch):
    times, states = np.arange(3.0), np.tile(HALO, (3, 1))
    for given, message in (
        ((states[:2], times), r"state has shape \(2, 6\)"),
        ((states * np.nan, times), "state is not finite"),
        ((states, times[:, None]), r"has shape \(3, 1\)"),
        ((states, times, np.eye(6)), r"covariance has shape \(6, 6\)"),
    ):
        matrices = {"covariance": given[2]} if len(given) > 2 else {}
        with pytest.raises(ConfigurationError, match=message):
            arc("HALO", *given[:2], epoch, **matrices)
        with pytest.raises(ConfigurationError, match=message):
            inertial_arc("HALO", *given[:2], center="EARTH BARYCENTER", **matrices)
    with pytest.raises(ConfigurationError, match=r"state: .* divide km by LENGTH_UNIT_KM"):
        arc("HALO", states * 4e5, times, epoch)


@pytest.mark.parametrize("path", [None, 3])
def test_paths_that_are_none_are_refused(path):
    readers = (
        *(read_oem, exchange.read_ocm, exchange.read_aem, exchange.read_tdm, exchange.read_ades),
        *(read_segments, exchange.read_catalog, targets.load_missions, targets.load_target_states),
        *(lambda given: targets.load_maneuvers(given, 1.0), load_observers, read_study),
    )
    for read in readers:
        with pytest.raises(ConfigurationError, match=f"path = {path}: give the path of a file"):
            read(path)
