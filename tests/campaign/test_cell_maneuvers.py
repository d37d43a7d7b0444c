"""Cells whose targets maneuver: table, data set, export and faults, in both kinds of dynamics."""

import numpy as np
import pytest
from campaign_folder import read_campaign
from click.testing import CliRunner
from small_cells import cell_inputs, settings_of_cell

from cislunar.campaign.settings.cell_settings import cell_files
from cislunar.campaign.settings.cells import Cell
from cislunar.campaign.settings.preflight import check_inputs
from cislunar.campaign.tracking.dataset import cell_dataset, write_cell
from cislunar.campaign.tracking.maneuvers import cell_maneuvers
from cislunar.campaign.tracking.records import cell_arcs
from cislunar.command.main import cislunar
from cislunar.errors import ConfigurationError, InputFileError
from cislunar.exchange import read_ocm
from cislunar.runtime.netcdf import read_dataset, write_dataset

CELL = Cell("A", "tpe", "mukf", 3, 60)
HEADER = "target,time_hours,dv_1_m_s,dv_2_m_s,dv_3_m_s,axes\n"


@pytest.fixture(scope="module")
def inputs():
    return cell_inputs(duration_days=1, bodies=True)


def settings(maneuvers, dynamics="cr3bp", **changes):
    both = {"dynamics": {"truth": "ephemeris", "filter": "ephemeris"}}
    few = {"seeds": 1, "record": ["truth"], "truth": {"maneuvers": maneuvers}} | changes
    return settings_of_cell(few, **(both if dynamics == "ephemeris" else {}))


def run(inputs, given):
    return cell_dataset(CELL, inputs, given, propagator="dop853", seed=3)


@pytest.mark.parametrize("dynamics", ["cr3bp", "ephemeris"])
def test_exported_maneuvers_are_those_of_the_table(inputs, tmp_path, dynamics):
    """Components about the Moon and the Earth, from the exported vector and the exported states in
    the ICRF."""
    table = tmp_path / "maneuvers.csv"
    rows = "0,0.6666666666666666,1,20,-3,rtn-moon\n1,1,2,-30,4,rtn-earth\n"
    table.write_text(HEADER + rows + "2,1.5,5,6,7,propagation\n")
    given = settings({"table": str(table)}, dynamics)
    assert str(table) in cell_files(given)
    cell = run(inputs, given)
    assert cell["maneuver_target"].dims == ("maneuver",)
    names = cell["target_name"].values
    ids = cell["target_id"].values.tolist()
    found = cell_maneuvers(cell, inputs.sun)
    for row, center, hours, wanted in (
        (0, "MOON", 40 / 60, (1.0, 20.0, -3.0)),
        (1, "EARTH", 1.0, (2.0, -30.0, 4.0)),
    ):
        name = names[ids.index(row)]
        (one,) = found[name]
        assert one.basis == "SIMULATED" and one.duration_s == 0.0
        arc = next(a for a in cell_arcs(cell, inputs.sun, "true", center=center) if a.name == name)
        at = np.argmin(np.abs(arc.tdb_s - one.tdb_s))
        # a state at the time of an impulse is the one before it
        assert abs(arc.tdb_s[at] - one.tdb_s) < 1e-4
        assert one.tdb_s - arc.tdb_s[0] == pytest.approx(3600.0 * hours - 1200.0, abs=1e-4)
        place, velocity = np.split(arc.state[at], 2)
        normal = np.cross(place, velocity)
        axes = np.array([place, np.cross(normal, place), normal])
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        # the Moon of an ephemeris moves along a straight line within a step
        np.testing.assert_allclose(1e3 * axes @ one.delta_v_km_s, wanted, atol=2e-4)
    (last,) = found[names[ids.index(2)]]
    assert 1e3 * np.linalg.norm(last.delta_v_km_s) == pytest.approx(np.sqrt(110.0))
    if dynamics == "ephemeris":
        np.testing.assert_allclose(1e3 * last.delta_v_km_s, [5.0, 6.0, 7.0], rtol=1e-9)
    # by the command
    write_dataset(cell, tmp_path / "cell.nc")
    write_dataset(inputs.sun, tmp_path / "sun.nc")
    words = ["--data", "truth", "--ephemeris", str(tmp_path / "sun.nc")]
    output = ["--output", str(tmp_path / "a.ocm")]
    done = CliRunner().invoke(cislunar, ["export", str(tmp_path / "cell.nc"), *output, *words])
    assert done.exit_code == 0, done.output
    read = [read_ocm(path) for path in sorted(tmp_path.glob("a_*.ocm"))]
    for record in read:
        (one,) = record.maneuvers
        (wanted,) = found[record.arc.name]
        np.testing.assert_array_equal(one.delta_v_km_s, wanted.delta_v_km_s)
        assert one.tdb_s == pytest.approx(wanted.tdb_s, abs=2e-6) and one.basis == "SIMULATED"


def test_a_written_cell_and_one_without_maneuvers(inputs, tmp_path):
    drawn = {"drawn": [{"smallest_m_s": 1, "largest_m_s": 10, "duration_minutes": 5}]}
    moving = run(inputs, settings(drawn))
    assert sorted(moving["maneuver_target"].values) == [0, 1, 2]
    size = np.linalg.norm(moving["maneuver_velocity"].values, axis=1)
    assert np.all((size > 0.99) & (size < 10.0))
    path = tmp_path / "cell.nc"
    write_cell(CELL, inputs, settings(drawn), path, propagator="dop853", seed=3)
    written = read_dataset(path)
    for name in ("maneuver_start", "maneuver_velocity", "maneuver_seed", "maneuver_duration"):
        np.testing.assert_array_equal(written[name].values, moving[name].values)
    # without a record, or without maneuvers, the data set has no more than before
    assert "maneuver_start" not in run(inputs, settings(drawn, record=[]))
    coasting = run(inputs, settings({}))
    assert "maneuver_start" not in coasting
    none = run(inputs, settings({"drawn": [drawn["drawn"][0] | {"share": 0}]}))
    assert none.sizes["maneuver"] == 0
    np.testing.assert_array_equal(none["true_translation"], coasting["true_translation"])


def test_faults_are_found_before_the_run(inputs, tmp_path):
    table = tmp_path / "maneuvers.csv"
    for row, words in (
        ("7,1,1,0,0,", "row 2, maneuver '7': there is no such target"),
        ("0,1,2e4,0,0,", "exceeds the escape speed"),
        ("0,2,1,0,0,", "not within the run of 2 h"),
    ):
        table.write_text(HEADER + row + "\n")
        with pytest.raises(InputFileError, match=words):
            run(inputs, settings({"table": str(table)}))


def test_faults_are_found_before_any_job(tmp_path):
    config = read_campaign()
    table = tmp_path / "maneuvers.csv"
    config["task2"]["truth"] = {"maneuvers": {"table": str(table)}}
    for row, words in (
        ("999,1,1,0,0,", "no such target of scenario"),
        ("0,25,1,0,0,", "not within the run"),
    ):
        table.write_text(HEADER + row + "\n")
        with pytest.raises(InputFileError, match=words):
            check_inputs(config)
    late = {"smallest_m_s": 1, "largest_m_s": 1, "first_hour": 30}
    config["task2"]["truth"] = {"maneuvers": {"drawn": [late]}}
    with pytest.raises(ConfigurationError, match=r"task2.truth.maneuvers.drawn', entry 0: .* not"):
        check_inputs(config)


def test_a_cell_that_tests_for_maneuvers(inputs):
    """Variables by interval, and everything else as without the test."""
    plain = run(inputs, settings({}))
    tested = run(inputs, settings({}, maneuver_detection={"false_alarms_per_target_day": 1e-3}))
    names = {name for name in tested.data_vars if name not in plain.data_vars}
    assert names == {
        *("maneuver_alarm", "maneuver_statistic", "maneuver_estimated_time"),
        *("maneuver_tested_time", "maneuver_estimate", "maneuver_estimate_covariance"),
    }
    assert tested["maneuver_estimate_covariance"].dims == (
        "seed", "epoch", "target", "axis", "axis_2"
    )  # fmt: skip
    for name in plain.data_vars:
        np.testing.assert_array_equal(tested[name].values, plain[name].values, err_msg=name)
    assert (tested["maneuver_statistic"].values > 0.0).any()


def test_estimated_maneuvers_are_exported(inputs, tmp_path):
    """In the same axes as true ones, with the deviations of magnitude and direction; improbable
    ones are left out."""
    table = tmp_path / "maneuvers.csv"
    table.write_text(HEADER + "0,0.5,3,4,0,propagation\n1,1,1,2,2,propagation\n")
    cell = run(inputs, settings({"table": str(table)}))
    true = cell_maneuvers(cell, inputs.sun)
    same = {"seed": "seed", "target": "target", "time": "start", "velocity": "velocity"}
    estimated = {
        f"recovered_{name}": (("recovered_maneuver", *cell[f"maneuver_{other}"].dims[1:]),
                              cell[f"maneuver_{other}"].values)
        for name, other in same.items()
    }  # fmt: skip
    velocity = cell["maneuver_velocity"].values
    size = np.linalg.norm(velocity, axis=1)
    way = velocity / size[:, None]
    along = np.einsum("mi,mj->mij", way, way)
    # 1 % along, and a degree across
    spread = (0.01 * size[:, None, None]) ** 2 * along
    spread += (np.deg2rad(1.0) * size[:, None, None]) ** 2 * (np.eye(3) - along)
    estimated["recovered_covariance"] = ("recovered_maneuver", "axis", "axis_2"), spread
    five = np.isclose(size, 5.0)
    estimated["recovered_probability"] = "recovered_maneuver", np.where(five, 0.9, 0.4)
    assert cell_maneuvers(cell, inputs.sun, "estimated") == {}
    found = cell_maneuvers(cell.assign(estimated), inputs.sun, "estimated")
    ((name, (one,)),) = found.items()
    (wanted,) = true[name]
    assert (one.tdb_s, one.basis) == (wanted.tdb_s, "DETERMINED")
    np.testing.assert_allclose(one.delta_v_km_s, wanted.delta_v_km_s, rtol=1e-12)
    deviations = one.magnitude_sigma_percent, one.direction_sigma_deg
    np.testing.assert_allclose(deviations, [1.0, 1.0], rtol=1e-9)
