"""Exported states are read back; unusable files are refused in one line."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from message_files import file_of, spoil

from cislunar.campaign.data.own_targets import own_tracked_dataset
from cislunar.campaign.settings.scenarios import SECTIONS, shared_dataset
from cislunar.constants import EPOCH_JD, LENGTH_UNIT_KM, MU, TIME_UNIT_S
from cislunar.dynamics.cr3bp import CR3BP
from cislunar.dynamics.propagation import propagate
from cislunar.ephemeris.sampling import sample_ephemeris
from cislunar.ephemeris.time_scales import (
    clock_seconds,
    clock_text,
    clock_to_tdb,
    julian_date,
    tdb_after,
    tdb_since,
    tdb_to_clock,
    utc_to_tdb,
)
from cislunar.errors import ConfigurationError, InputFileError
from cislunar.exchange.arcs import arc, rotating_arc
from cislunar.exchange.catalog import COLUMNS, read_catalog
from cislunar.exchange.inertial import (
    CENTERS,
    epoch_at,
    inertial_covariances,
    inertial_states,
    rotating_states,
)
from cislunar.exchange.oem import Segment, oem_text, read_oem, state_at
from cislunar.exchange.state_tables import read_segments, segments_csv
from cislunar.targets.tables import load_target_states

HALO = np.array([1.14, 0.0, -0.16, 0.0, -0.223, 0.0])
ELAPSED = np.arange(0.0, 86_400.0, 3_600.0)
TRUTH = Path(__file__).parents[1] / "data/orbit_truth"


@pytest.fixture(scope="module")
def epoch():
    return epoch_at(EPOCH_JD)


@pytest.fixture(scope="module")
def path_of_halo():
    return propagate(HALO, ELAPSED / TIME_UNIT_S, method="dop853")


@pytest.fixture(scope="module")
def segment(epoch, path_of_halo):
    factor = np.random.default_rng(1).normal(size=(2, 6, 6)) * 1e-4
    covariance = inertial_covariances(factor @ np.swapaxes(factor, 1, 2), ELAPSED[:2], epoch)
    covariance = (covariance + np.swapaxes(covariance, 1, 2)) / 2.0
    tdb = epoch.tdb_s + ELAPSED
    state = inertial_states(path_of_halo, ELAPSED, epoch)
    return Segment("HALO 1", "2030-001A", "EARTH", tdb, state, tdb[:2], covariance)


def written(segment, **options):
    return oem_text([segment], created="2030-01-01T00:00:00", **options)


# dates


@pytest.mark.parametrize(
    "date", ["2024-10-01", "2024-10-01T00:00", "2024-10-01T00:00:00.000Z", "2024-275T00:00:00"]
)
def test_a_date_may_be_written_in_several_ways(date):
    assert julian_date(date) == EPOCH_JD


@pytest.mark.parametrize(
    "date",
    [
        *("tomorrow", "2024-13-01", "2024-02-30", "2023-366", "2024-000", "2024-10-01T24:00:00"),
        *("2024-10-01T00:00:60", "2024-10-01T00:00:00+02:00", "2024-10-1", "", "9999-12-31T99:00"),
    ],
)
def test_an_invalid_date_is_refused(date):
    with pytest.raises(ConfigurationError, match="is not a date: write it like"):
        clock_seconds(date)


@pytest.mark.parametrize("system", ["UTC", "TAI", "TT", "TDB"])
@pytest.mark.parametrize("date", ["1999-06-30T23:59:59", "2016-12-31T23:59:59", "2024-10-01"])
def test_clocks_are_read_and_written(system, date):
    tdb = clock_to_tdb(clock_seconds(date), system)
    assert tdb_to_clock(tdb, system) == pytest.approx(clock_seconds(date), abs=2e-7)
    if system == "UTC":
        assert tdb == pytest.approx(utc_to_tdb(julian_date(date)), abs=1e-4)


def test_a_julian_date_stands_for_the_calendar_date_it_was_made_from():
    random = np.random.default_rng(3)
    for seconds in random.integers(clock_seconds("1973-01-01"), clock_seconds("2050-01-01"), 200):
        date = clock_text(float(seconds) + 0.0625)
        exact = clock_to_tdb(clock_seconds(date), "UTC")
        assert utc_to_tdb(julian_date(date)) == exact
        assert clock_text(tdb_to_clock(exact, "UTC")) == date


@pytest.mark.parametrize("fraction", ["999999", "999990", "000001"])
def test_a_leap_second_begins_at_midnight_exactly(fraction):
    days = "2016-12-31T23:59:59", "2017-01-01T00:00:00"
    date = f"{days[fraction < '5']}.{fraction}"
    tdb = clock_to_tdb(clock_seconds(date), "UTC")
    assert clock_text(tdb_to_clock(tdb, "UTC")) == date
    late = tdb - clock_to_tdb(clock_seconds("2016-12-31T23:59:59"), "UTC")
    assert late == pytest.approx(float(f"0.{fraction}") + 2.0 * (fraction < "5"), abs=3e-7)


def test_equal_steps_are_equal_steps_of_dates_in_utc():
    epoch = clock_to_tdb(clock_seconds("2025-01-03T06:30:00"), "UTC")
    elapsed = np.arange(0.0, 60.0 * 86_400.0, 21_600.0)
    dates = [clock_text(each) for each in tdb_to_clock(tdb_after(epoch, elapsed), "UTC")]
    assert {date[10:] for date in dates} == {
        f"T{hour}:30:00.000000" for hour in ("00", "06", "12", "18")
    }
    np.testing.assert_allclose(tdb_since(epoch, tdb_after(epoch, elapsed)), elapsed, atol=3e-7)
    drift = tdb_after(epoch, elapsed) - epoch - elapsed
    assert 2e-5 < np.abs(np.diff(drift)).max() * 4 < 3e-5  # per day


def test_a_clock_does_not_change_a_date():
    assert clock_text(clock_seconds("2024-10-01T06:07:08.25")) == "2024-10-01T06:07:08.250000"


# axes


@pytest.mark.parametrize("center", CENTERS)
def test_inertial_states_round_trip(epoch, path_of_halo, center):
    there = inertial_states(path_of_halo, ELAPSED, epoch, center)
    back = rotating_states(there, ELAPSED, epoch, center)
    np.testing.assert_allclose(back, path_of_halo, rtol=0.0, atol=1e-14)


def test_inertial_velocities_are_those_of_the_positions(epoch):
    close = np.arange(-2.0, 3.0) * 10.0
    path = propagate(HALO, close / TIME_UNIT_S, method="dop853")
    there = inertial_states(path, close, epoch)
    slope = (there[0, :3] - 8 * there[1, :3] + 8 * there[3, :3] - there[4, :3]) / 120.0
    np.testing.assert_allclose(there[2, 3:], slope, rtol=0.0, atol=1e-9)


def test_the_moon_is_where_the_ephemeris_has_it_at_the_epoch(epoch):
    moon = inertial_states([[1.0 - MU, 0, 0, 0, 0, 0]], [0.0], epoch)[0]
    ephemeris = sample_ephemeris(EPOCH_JD, 0.0)
    assert moon[:3] @ ephemeris.moon_rotation[0][0] == pytest.approx(LENGTH_UNIT_KM, rel=1e-14)
    assert np.linalg.norm(moon[3:]) == pytest.approx(LENGTH_UNIT_KM / TIME_UNIT_S, rel=1e-14)


def test_covariances_are_those_of_the_states(epoch):
    random = np.random.default_rng(2)
    deviations = random.normal(size=(40, 1, 6)) * 1e-5
    moved = inertial_states(HALO + deviations, [5e4], epoch)[:, 0]
    wanted = inertial_covariances(np.cov(deviations[:, 0].T)[None], [5e4], epoch)[0]
    np.testing.assert_allclose(np.cov(moved.T), wanted, rtol=1e-6, atol=1e-12)


# messages and tables


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
    with pytest.raises(InputFileError, match=message) as caught:
        read_oem(path)
    assert str(path) in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize("columns", [slice(0, 3), slice(3, 6)], ids=["meters", "meters per second"])
def test_mixed_units_are_refused(segment, tmp_path, columns):
    state = segment.state.copy()
    state[:, columns] *= 1000.0
    path = file_of(tmp_path, written(segment._replace(state=state)))
    with pytest.raises(InputFileError, match="times as far as their velocities imply; an OEM has"):
        read_oem(path)


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
    with pytest.raises(InputFileError, match=message):
        read_segments(path)


# catalog


def catalog_rows():
    """Published rows in the form of the catalog's export."""
    truth = pd.concat(map(pd.read_csv, sorted(TRUTH.glob("*.csv"))), ignore_index=True)
    truth = truth[np.isfinite(truth["T"]) & (truth["closure_residual"] < 1e-10)].reset_index()
    table = pd.DataFrame({"Id": truth.index + 1})
    named = ("x0", "y0", "z0", "vx0", "vy0", "vz0", "JC", "T", "stability", "mu")
    for column, name in zip(COLUMNS, named, strict=True):
        table[column] = truth[name].fillna(1.0)
    return table


def test_a_row_of_the_catalog_closes_after_its_period(tmp_path):
    path = tmp_path / "rows.csv"
    catalog_rows().to_csv(path, index=False)
    rows = read_catalog(path)
    assert len(rows.name) > 20
    for state, period, mu in zip(rows.state, rows.period, rows.mu, strict=True):
        end = propagate(state, [period], forces=CR3BP(mu), method="dop853")[0]
        assert np.linalg.norm(end - state) < 1e-9


@pytest.mark.parametrize(
    "old, new, message",
    [
        (r"x0 \(LU\)", "x0 (km)", r"row 1: no column x0 \(LU\); export .* units LU and TU"),
        (r"Period \(TU\)", "Period (days)", r"no column Period \(TU\)"),
        ("0.0121505856", "0.0000030035", "Mass ratio = 3.00.* is not that of Earth and Moon"),
        (r"\n2,", r"\n1,", "row 3, orbit '1': the Id is taken already in row 2"),
        (r"\n1,[^,]*", r"\n1,far", "row 2, .* x0 .* = 'far' must be a finite number"),
        (r"\n1,[^,]*,", r"\n1,", "row 2: 10 fields where the header has 11"),
        (r"(?s)\n.*", "\n", "contains no orbit"),
    ],
)
def test_a_faulty_row_is_refused_in_a_line(tmp_path, old, new, message):
    path = file_of(tmp_path, spoil(catalog_rows().to_csv(index=False), old, new), "rows.csv")
    with pytest.raises(InputFileError, match=message) as caught:
        read_catalog(path)
    assert len(str(caught.value).splitlines()) == 1


# moving targets of a study


@pytest.mark.parametrize("center", CENTERS)
def test_targets_are_read_from_a_message(epoch, segment, tmp_path, center):
    state = inertial_states(
        propagate(HALO, [0.0, 0.01, 0.02]), np.arange(3) * 0.01 * TIME_UNIT_S, epoch, center
    )
    tdb = epoch.tdb_s + np.arange(3) * 0.01 * TIME_UNIT_S
    other = Segment("HALO 2", "2030-002A", center, tdb, state)
    path = file_of(tmp_path, oem_text([segment, other], created="2030-01-01"), "two.oem")
    found = load_target_states(path, epoch)
    assert found.name == ["HALO 1", "HALO 2"]
    np.testing.assert_allclose(found.state, [HALO, HALO], rtol=0.0, atol=1e-13)
    np.testing.assert_array_equal(found.period, 0.0)
    made = own_tracked_dataset(path, (EPOCH_JD, "de421"))
    np.testing.assert_allclose(made["state"], found.state, rtol=0.0, atol=1e-13)


def test_targets_of_a_message_need_its_epoch(epoch, segment, tmp_path):
    path = file_of(tmp_path, written(segment))
    with pytest.raises(InputFileError, match="give the epoch"):
        load_target_states(path)
    late = epoch_at(EPOCH_JD + 2.0)
    with pytest.raises(
        InputFileError, match=r"arc\.oem: object HALO 1: 2024-10-03.* is not within"
    ):
        load_target_states(path, late)
    inside = segment.state * np.where(np.arange(6) < 3, 1e-3, 1.0)
    moved = segment._replace(state=inside[:1], tdb_s=segment.tdb_s[:1], covariance=np.empty(0))
    path = file_of(tmp_path, written(moved))
    with pytest.raises(InputFileError, match="object 'HALO 1': lies inside the Earth"):
        load_target_states(path, epoch)


def test_targets_are_read_from_the_catalog(tmp_path):
    path = tmp_path / "rows.csv"
    catalog_rows().to_csv(path, index=False)
    found, rows = load_target_states(path), read_catalog(path)
    np.testing.assert_array_equal(found.state, rows.state)
    np.testing.assert_array_equal(found.period, rows.period)
    assert found.name == rows.name


def test_a_message_is_shared_by_scenarios_of_the_same_epoch():
    entry = {"targets": 3, "tracked": "their.oem"}
    later = entry | {"settings": {"epoch_jd": EPOCH_JD + 1.0}}
    tables = entry | {"tracked": "their.csv"}
    config = {key: {} for key in SECTIONS}
    config |= {"epoch_jd": EPOCH_JD, "ephemeris": {"kernel": "de421"}}
    config["task2"] = {"photometry": {"irradiance": "4pi"}}
    config["task2"]["tasking"] = {"diffuse_reflection_coefficient": 0.5}
    config["scenarios"] = {"D": entry, "E": entry, "F": later, "G": tables, "H": later | tables}
    shared = [shared_dataset(config, name, "orbits/tracked") for name in config["scenarios"]]
    assert [name[-4] for name in shared] == ["D", "D", "F", "G", "G"]
