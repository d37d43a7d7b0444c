"""Reduction of observed directions to the times of the grid, with light time."""

import numpy as np
import pandas as pd
import pytest
from example_study import EPOCH, OBSERVERS, SETTINGS, TARGETS

import cislunar as cs
from cislunar import Sensor
from cislunar.constants import TIME_UNIT_S
from cislunar.ephemeris.time_scales import tdb_seconds
from cislunar.errors import ConfigurationError
from cislunar.exchange.inertial import epoch_at
from cislunar.study.observed import read_observations


def test_motion_is_reduced_in_axes_that_do_not_turn():
    """A turning frame adds the apparent accelerations, to second order in time."""
    from cislunar.study.observed import _moved

    position, rate = np.array([[1.1, 0.2, 0.0]]), np.array([[0.3, -0.1, 0.2]])
    bend, elapsed = np.array([[0.05, 0.0, -0.02]]), np.array([1e-3])
    # in axes that do not turn: p(t) = R(t) (p + v t + a t^2 / 2)
    moved = position + elapsed * rate + 0.5 * elapsed**2 * bend
    cos, sin = np.cos(1e-3), np.sin(1e-3)
    turned = moved @ np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    assert _moved(position, rate, bend, 1.0, elapsed) == pytest.approx(turned, abs=1e-9)
    assert _moved(position, rate, bend, 0.0, elapsed) == pytest.approx(moved, abs=1e-15)


def test_light_time_and_times_off_the_grid_are_reduced():
    """The direction that an observer at t has of a target at t less the light time becomes that of
    the target at the nearest time of the grid, both by propagation and in inertial axes."""
    from types import SimpleNamespace

    from cislunar.exchange.inertial import inertial_states
    from cislunar.study.observed import Observed, reduce_interval

    study = cs.Study(OBSERVERS, TARGETS, EPOCH, **SETTINGS)
    loop, problem = study._loop(study._inputs())
    epoch, scene = epoch_at(study.settings.epoch), problem.scene
    seen_s, grid_s = 17.37 * 60.0, 17.0 * 60.0
    target, observer = problem.epoch_state[1], study.observers[0]

    def place(elapsed_s, state, period=0.0):
        times = [elapsed_s / TIME_UNIT_S]
        path = (
            cs.propagate_periodic(state, period, times, method="dop853")
            if period
            else cs.propagate(state, times, method="dop853")
        )
        return inertial_states(path, [elapsed_s], epoch, "EARTH BARYCENTER")[0, :3]

    def angles(vector):
        x, y, z = vector
        return np.array([np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))])

    here = place(seen_s, observer.state, observer.period)
    light_s = 0.0
    for _ in range(4):
        light_s = np.linalg.norm(place(seen_s - light_s, target) - here) / 299_792.458
    assert light_s > 0.1
    measured = angles(place(seen_s - light_s, target) - here)
    expected = angles(place(grid_s, target) - place(grid_s, observer.state, observer.period))
    given = Observed(
        np.array([seen_s]), np.array([0]), np.array([1]),
        np.array([[15.0, *measured]]), np.full((1, 3), 0.1),
    )  # fmt: skip
    turned = scene._replace(observer_axes=epoch.rotation.T @ scene.frame_axes)
    tracker = SimpleNamespace(orbits=lambda: SimpleNamespace(translation=problem.epoch_state))
    found = reduce_interval(given, turned, 1.0, tracker, loop.inputs.forces, 0, 30)
    arcsec = np.rad2deg(found.measurements.value[0, 1:] - expected) * 3600.0
    assert np.abs(np.rad2deg(measured - expected)).max() * 3600.0 > 5.0
    assert np.abs(arcsec).max() < 1e-4


def test_observers_whose_names_differ_by_case_alone_are_told_apart():
    rows = [
        {"obsTime": f"2027-03-01T06:1{k}:00Z", "stn": name, "artSat": "a", "ra": 1.0, "dec": 2.0}
        for k, name in enumerate(("Eye", "eye", "Other", "OTHER"))
    ]
    given = ["Eye", "eye", "other"], ["a"], [Sensor()] * 3, tdb_seconds("2027-03-01T06:00:00")
    table = pd.DataFrame(rows).assign(mag=15.0)
    found = read_observations(table, "table", ConfigurationError, *given)
    assert found.observer.tolist() == [0, 1, 2, 2]
    table.loc[0, "stn"] = "EYE"
    with pytest.raises(
        ConfigurationError, match=r"row 1: stn .*EYE.* must be one of Eye, eye, other"
    ):
        read_observations(table, "table", ConfigurationError, *given)
