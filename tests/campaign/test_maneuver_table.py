"""The table and figure of a study of maneuvers, from a data set made by hand."""

import json

import numpy as np
import pytest
import xarray as xr

from cislunar.campaign.settings.cells import Cell
from cislunar.campaign.tracking.maneuvers.table import MANEUVER_COLUMNS, maneuver_rows
from cislunar.constants import LENGTH_UNIT_KM
from cislunar.figures.maneuvers import maneuver_figure

N = 40
HOURS = np.arange(1.0, 37.0)
START_S = 8.5 * 3600.0


def data(response):
    """Ten coasting targets, one of them with an alarm; the i-th of the others maneuvers by 1.1^i
    cm/s times 10^(i / 10), is detected 2 h later if that exceeds 1 m/s, and is in custody again
    4 h after that if the orbit is estimated anew."""
    size = 0.02 * 10.0 ** (np.arange(N) / 10.0)
    shape = 2, HOURS.size, N + 10
    error = np.zeros((*shape, 12))
    error[..., 6] = 1.0 / LENGTH_UNIT_KM
    lost = np.zeros(shape[1:], dtype=bool)
    after = START_S / 3600.0
    again = 6.0 if response else 100.0
    lost[:, :N] = (HOURS[:, None] > after) & (HOURS[:, None] < after + again) & (size > 1.0)
    error[:, lost, 6] = 100.0 / LENGTH_UNIT_KM
    alarm, tested = np.zeros(shape, dtype=bool), np.full(shape, START_S + 7200.0)
    alarm[:, 10, :N] = size > 1.0
    alarm[0, 3, N] = True
    target = np.tile(np.arange(N), 2)
    velocity = np.zeros((2 * N, 3))
    velocity[:, 1] = np.tile(size, 2)
    maneuvers = {
        "seed": np.repeat([0, 1], N), "target": target, "start": np.full(2 * N, START_S),
    }  # fmt: skip
    values = {f"maneuver_{name}": ("maneuver", each) for name, each in maneuvers.items()}
    values["maneuver_velocity"] = ("maneuver", "axis"), velocity
    if response:
        rows = np.flatnonzero(velocity[:, 1] > 1.0)
        number = rows.size
        values |= {
            f"recovered_{name}": ("recovered_maneuver", each)
            for name, each in {
                "seed": maneuvers["seed"][rows], "target": target[rows],
                "alarm": np.full(number, START_S + 7200.0),
                "time": np.full(number, START_S - 360.0),
            }.items()
        }  # fmt: skip
        off = velocity[rows] + [0.0301, 0.0, 0.0]
        values["recovered_velocity"] = ("recovered_maneuver", "axis"), off
        spread = np.tile(1e-4 * np.eye(3), (number, 1, 1))
        values["recovered_covariance"] = ("recovered_maneuver", "axis", "axis_2"), spread
    along = ("seed", "time", "target")
    settings = {
        "maneuver_detection": {"false_alarms_per_target_day": 1e-3, "recover": response},
        "sensor": {"field_of_view_deg": 3.0}, "tasking": {"slot_minutes": 20},
    }  # fmt: skip
    values |= {
        "error": ((*along, "component"), error),
        "sigma": ((*along, "component"), np.full(error.shape, 1.0 / LENGTH_UNIT_KM)),
        "outcome": (("seed", "step", "target"), np.full(shape, 5, dtype=np.uint8)),
        "maneuver_alarm": (("seed", "epoch", "target"), alarm),
        "maneuver_tested_time": (("seed", "epoch", "target"), tested),
        "observer_slot": ("observer", np.zeros(20)),
    }
    coords = {"time": 3600.0 * HOURS, "step": 3600.0 * HOURS}
    return xr.Dataset(values, coords, {"settings": json.dumps(settings)})


@pytest.fixture(scope="module")
def table():
    cells = [
        (Cell("A", "published", "mukf", 100, 60)._replace(variant=name), data(response))
        for name, response in (("tested", False), ("recovered", True))
    ]
    return maneuver_rows(cells, 10.0)


def value(table, quantity, low=np.nan, response="recovery", of="value"):
    rows = table[(table["quantity"] == quantity) & (table["response"] == response)]
    same = np.isclose(rows["smallest_m_s"], low, equal_nan=True)
    (found,) = rows[same][of]
    return found


def test_detection(table):
    assert tuple(table.columns) == MANEUVER_COLUMNS
    assert value(table, "detected", 0.1) == 0.0 and value(table, "detected", 10.0) == 1.0
    assert value(table, "detected", 10.0, of="low") == pytest.approx(0.025 ** (1.0 / 20.0))
    assert value(table, "detected", 10.0, of="number") == 20
    assert value(table, "latency_h", 1.0) == pytest.approx(2.0)
    assert 0.9 < value(table, "detectable_m_s") < 1.5
    # one alarm in 20 targets of 36 hours
    assert value(table, "false_alarms_per_day") == pytest.approx(1.0 / 30.0)
    assert value(table, "false_alarms_per_day", of="number") == 30


def test_custody_and_estimates(table):
    for response, late in (("none", 0.0), ("recovery", 1.0)):
        assert value(table, "custody_3_h", 10.0, response) == 0.0
        assert value(table, "custody_12_h_observed", 10.0, response) == late
        assert value(table, "custody_24_h", 0.1, response) == 1.0
        share = value(table, "custody_end", response=response)
        lost = 0.0 if response == "recovery" else np.mean(0.02 * 10 ** (np.arange(N) / 10.0) > 1.0)
        assert share == pytest.approx(1.0 - lost * N / (N + 10))
    assert value(table, "error_24_h_km", 10.0) == pytest.approx(1.0)
    assert value(table, "anees_24_h", 10.0) == pytest.approx(1.0 / 6.0)
    assert value(table, "time_error_h", 10.0) == pytest.approx(0.1)
    assert value(table, "velocity_error_m_s", 10.0) == pytest.approx(0.0301)
    assert value(table, "velocity_anees", 10.0) == pytest.approx(3.0, rel=0.01)
    assert value(table, "velocity_coverage", 10.0) == pytest.approx(2.0 / 3.0)
    assert not (table[table["response"] == "none"]["quantity"] == "time_error_h").any()


def test_figure(table):
    figure = maneuver_figure(table)
    assert len(figure.axes) == 3
    assert all(axes.lines for axes in figure.axes)
