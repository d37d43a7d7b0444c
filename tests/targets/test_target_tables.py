"""Tables of user-defined targets: units, starts, and what is refused."""

import os
import re

import numpy as np
import pytest
from campaign_folder import with_change
from message_files import refused, table

from cislunar.campaign.data.own_targets import own_static_dataset, own_tracked_dataset
from cislunar.campaign.settings.preflight import check_orbits
from cislunar.campaign.settings.scenarios import (
    in_study,
)
from cislunar.constants import LENGTH_UNIT_KM, TIME_UNIT_S
from cislunar.errors import InputFileError
from cislunar.targets.tables import load_target_positions, load_target_states
from cislunar.tasking.initial_conditions import epoch_states

HEADER = "id,x,y,z,vx,vy,vz"
KM = "id,x_km,y_km,z_km,vx_km_s,vy_km_s,vz_km_s"
GOOD = "one,0.5,0.1,0,0.1,0.2,0"
NEAR_RECTILINEAR = "1.02869104,0,-0.18633781,0,-0.11733440,0"


def test_both_units_give_the_same_states(tmp_path):
    plain = load_target_states(table(tmp_path, HEADER + ",period,family", GOOD + ",2.5,halo"))
    speed = LENGTH_UNIT_KM / TIME_UNIT_S
    scaled = [0.5 * LENGTH_UNIT_KM, 0.1 * LENGTH_UNIT_KM, 0.0, 0.1 * speed, 0.2 * speed, 0.0]
    row = ",".join(map(repr, [*scaled, 2.5 * TIME_UNIT_S / 86400.0]))
    header = "x_km,y_km,z_km,vx_km_s,vy_km_s,vz_km_s,period_days,id,note"
    practical = load_target_states(table(tmp_path, header, f'{row},one,"a, note"'))
    np.testing.assert_allclose(practical.state, plain.state, rtol=1e-15)
    np.testing.assert_allclose(plain.state, [[0.5, 0.1, 0.0, 0.1, 0.2, 0.0]])
    assert practical.period[0] == pytest.approx(2.5, rel=1e-15)
    assert plain.period[0] == 2.5
    assert (plain.name, plain.family) == (["one"], ["halo"])
    assert (practical.name, practical.family) == (["one"], ["own"])


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([], "row 1: no column id"),
        ([HEADER], "contains no target"),
        (["x,y,z,vx,vy,vz", "0.5,0,0,0,0,0"], "row 1: no column id"),
        (["id,x,y,z,vx,vy", "one,0.5,0,0,0,0"], "needs the columns vx, vy, vz (nondimensional)"),
        (["id,x,y,z_km,vx,vy,vz", "one,0.5,0,0,0,0,0"], "needs the columns x, y, z (nondim"),
        (["id,x,y,z,x_km,y_km,z_km,vx,vy,vz", "one,.5,0,0,2,0,0,0,0,0"], "both x, y, z and x_km"),
        ([HEADER + ",x", GOOD + ",1"], "row 1: column x occurs twice"),
        ([HEADER, GOOD, GOOD], "row 3, target 'one': the id is taken already in row 2"),
        ([HEADER, ",0.5,0.1,0,0.1,0.2,0"], "row 2: the target has no id"),
        ([HEADER, "one,0.5,nan,0,0.1,0.2,0"], "row 2, target 'one': y = 'nan' must be a finite"),
        ([HEADER, "one,0.5,0.1,0,0.1,fast,0"], "row 2, target 'one': vy = 'fast' must be a fin"),
        ([HEADER, "one,0.5,0.1,0,0.1,,0"], "vy = '' must be a finite number"),
        ([HEADER, "one,0.5,0.1"], "row 2: 3 fields where the header has 7"),
        ([HEADER, GOOD, "", "two,0.99,0.001,0,0,0,0"], "row 4, target 'two': lies inside the Moon"),
        ([HEADER, "one,-0.01,0,0.01,0,0,0"], "lies inside the Earth"),
        ([HEADER + ",period", GOOD + ",-1"], "period = -1, taken in units of 4.34248 days, must"),
        ([HEADER, "one,388000,1,0,0.1,0.2,0"], "'one': x = 388000 is taken in units of 384400 km"),
        ([HEADER, "one,0.8,0,0.1,100,0,0"], "vx = 100 is taken in units of 1.02455 km/s, which"),
        ([KM, "one,331602,-21210,0,-29,-120,89"], "'one': vy_km_s = -120 is taken in km/s"),
        ([KM, "one,331602056,0,0,0,.1,0"], "x_km = 3.31602e+08 is taken in km, which puts"),
        ([KM + ",period_days", "one,331602,0,0,0,.1,0,1e6"], "period_days = 1e+06, taken in days"),
    ],
)
def test_faults_of_target_tables_are_one_line_that_names_the_field(tmp_path, rows, message):
    refused(load_target_states, table(tmp_path, *rows), re.escape(message))


@pytest.mark.parametrize(
    ("columns", "values", "message"),
    [
        (
            "frame,center",
            "ICRF,EARTH",
            "row 2, target 'one': frame = 'ICRF' must be rotating; give",
        ),
        ("Frame", "ICRF", "frame = 'ICRF' must be rotating; give"),
        ("frame,center", "rotating,EARTH", "center = 'EARTH' must be EARTH BARYCENTER; give"),
        ("epoch_utc", "2027-01-01", "row 1: column epoch_utc: a table has states at the epoch"),
        ("EPOCH_UTC", "2027-01-01", "row 1: column EPOCH_UTC: a table has states at the epoch"),
        ("time_scale", "UTC", "row 1: column time_scale: a table has states at the epoch"),
    ],
)
def test_tables_of_states_in_another_frame_are_refused(tmp_path, columns, values, message):
    path = table(tmp_path, f"{HEADER},{columns}", f"{GOOD},{values}")
    for reader in (load_target_states, load_target_positions):
        refused(reader, path, re.escape(message) + ".*icrf_km of a study")


def test_a_table_may_state_the_rotating_frame(tmp_path):
    path = table(tmp_path, HEADER + ",frame,center", GOOD + ",Rotating,EMB")
    assert load_target_states(path).state.tolist() == [[0.5, 0.1, 0.0, 0.1, 0.2, 0.0]]


def test_unreadable_tables_are_refused(tmp_path):
    with pytest.raises(InputFileError, match=r"nowhere\.csv: no such file"):
        load_target_positions(tmp_path / "nowhere.csv")
    with pytest.raises(InputFileError, match="cannot be read as a table in UTF-8"):
        load_target_positions(tmp_path)
    binary = tmp_path / "binary.csv"
    binary.write_bytes(b"\xff\xfe\x00id")
    with pytest.raises(InputFileError, match="cannot be read as a table in UTF-8"):
        load_target_positions(binary)


def test_targets_without_a_period_start_at_their_states(tmp_path):
    rows = ["one,0.5,0.1,0,0.1,0.2,0,", f"two,{NEAR_RECTILINEAR},1.59919"]
    tracked = own_tracked_dataset(table(tmp_path, HEADER + ",period", *rows))
    start = epoch_states(tracked["state"].values, tracked["period"].values, seed=4)
    np.testing.assert_array_equal(start[0], tracked["state"].values[0])
    assert np.abs(start[1] - tracked["state"].values[1]).max() > 1e-3


def test_targets_with_a_period_must_be_on_closed_orbits(study, tmp_path):
    row = f"two,{NEAR_RECTILINEAR},1.4"
    path = table(tmp_path, HEADER + ",period", "one,0.5,0.1,0,0.1,0.2,0,", row)
    changed = with_change(in_study(study), "scenarios.D.tracked", str(path))
    changed = with_change(changed, "results", str(tmp_path)) | {"observers": {}}
    with pytest.raises(InputFileError, match=r"csv, target 'two': not closed: half a period ahead"):
        check_orbits(changed)
    made = tmp_path / "orbits/tracked_D.nc"
    made.parent.mkdir()
    made.touch()
    os.utime(path, (1e9, 1e9))
    check_orbits(changed)


def test_static_targets_need_no_velocities(tmp_path):
    static = own_static_dataset(table(tmp_path, "id,x,y,z", "one,0.5,0.1,0", "two,1.2,0,0.3"), "D")
    np.testing.assert_array_equal(static["position"], [[0.5, 0.1, 0.0], [1.2, 0.0, 0.3]])
    assert list(static["name"].values) == ["one", "two"]
