"""Initial orbits from a table of angles in ephemeris dynamics."""

import numpy as np
import pandas as pd
import pytest
from nights import SIGMA

from cislunar.constants import LENGTH_UNIT_KM, TIME_UNIT_S
from cislunar.dynamics import EARTH_MOON, UNITS, forces_between, propagate
from cislunar.ephemeris.bodies import BODY_COLUMNS, read_table
from cislunar.ephemeris.time_scales import clock_text, tdb_seconds, tdb_to_clock
from cislunar.errors import ConfigurationError
from cislunar.orbit_determination import ORBIT, AdmissibleRegion, angles_from_table, initial_orbits


def ades_table(state_km, start, forces, hours, places_km, rng):
    """A table of detections from states in ephemeris dynamics, with light time about the barycenter
    of the solar system."""
    rows, begin = [], tdb_seconds(start)
    for number, (hour, where) in enumerate(zip(hours, places_km, strict=True)):
        tdb = begin + 3600.0 * hour
        position, velocity, _ = read_table(forces.table, tdb)
        drift = -velocity[BODY_COLUMNS["sun"]]
        here = position[BODY_COLUMNS["earth"]] + where
        tau = 0.0
        for _ in range(6):
            there = propagate(
                state_km / UNITS, [(tdb - tau - begin) / TIME_UNIT_S], forces=forces,
                method="dop853",
            )[0, :3] * LENGTH_UNIT_KM  # fmt: skip
            way = there - tau * drift - here
            tau = np.linalg.norm(way) / 299_792.458
        unit = way / np.linalg.norm(way) + SIGMA * rng.normal(size=3)
        x, y, z = unit / np.linalg.norm(unit)
        rows.append(
            {"obsID": f"d{number}", "expID": f"e{number}", "stn": "C51",
             "obsTime": f"{clock_text(float(tdb_to_clock(tdb, 'UTC')))}Z",
             "ra": np.rad2deg(np.arctan2(y, x)) % 360.0, "dec": np.rad2deg(np.arcsin(z)),
             "rmsRA": 1.0, "rmsDec": 1.0, "rmsCorr": 0.0, "mag": 15.0, "rmsMag": 0.1,
             "sys": "ICRF_KM", "ctr": 399, "pos1": where[0], "pos2": where[1], "pos3": where[2]}
        )  # fmt: skip
    return pd.DataFrame(rows)


def test_a_table_of_angles_gives_the_orbit_in_ephemeris_dynamics():
    start, rng = "2025-03-01T00:00:00", np.random.default_rng(13)
    forces = forces_between("2025-02-28T23:00:00", "2025-03-03T00:00:00")
    forces = forces._replace(epoch=tdb_seconds(start))
    state = np.array([310_000.0, 180_000.0, 90_000.0, -0.5, 0.7, 0.3])
    hours = np.array([0.0, 1 / 6, 4.0, 4 + 1 / 6, 11.0, 11 + 1 / 6, 20.0, 20 + 1 / 6])
    angle = 2.0 * np.pi * hours / 23.5
    places_km = 42_164.0 * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    table = ades_table(state, start, forces, hours, places_km, rng)
    region = AdmissibleRegion(largest_size_m2=1e6, least_size_m2=1e-6)
    found = initial_orbits(
        angles_from_table(table, forces), forces=forces, region=region, epoch=0.0
    )
    assert found.verdict == ORBIT
    error = found.fits.state[0] - state / UNITS
    squared = error @ np.linalg.solve(found.fits.covariance[0], error)
    assert squared < 25.0
    geometric = angles_from_table(table, forces, light_time=False)
    late = initial_orbits(geometric, forces=forces, region=region, epoch=0.0)
    shift = late.fits.state[0] - state / UNITS if len(late.fits.state) else np.full(6, np.inf)
    assert not shift @ np.linalg.solve(found.fits.covariance[0], shift) < 25.0
    for change, words in (
        ({"pos1": np.nan}, "not finite"),
        ({"ctr": 10}, "ctr = 10 must be"),
        ({"dec": 95.0}, "dec = 95.0 must be"),
    ):
        with pytest.raises(ConfigurationError, match=words):
            angles_from_table(table.assign(**change), forces)
    with pytest.raises(ConfigurationError, match="columns pos1 are missing"):
        angles_from_table(table.drop(columns="pos1"), forces)
    with pytest.raises(ConfigurationError, match="table of bodies"):
        angles_from_table(table, EARTH_MOON)
    # the pulsating frame approximates ephemeris dynamics
    rough = angles_from_table(table, EARTH_MOON, bodies=forces.table, epoch_tdb=forces.epoch)
    assert np.abs(np.linalg.norm(rough.direction, axis=1) - 1.0).max() < 1e-12
