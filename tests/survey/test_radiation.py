"""Orbits whose radiation pressure is not known: consistency for random factors."""

import numpy as np
import pytest

from cislunar.constants import TIME_UNIT_S
from cislunar.dynamics import EARTH_MOON, propagate_many
from cislunar.dynamics.ephemeris_forces import ephemeris_forces
from cislunar.ephemeris import tabulate_bodies, tdb_seconds
from cislunar.orbit_determination import fit_orbits, make_angles
from cislunar.survey import LineageSettings
from cislunar.survey.maneuvers import maneuvers_within

START, SIGMA, DEVIATION, OBJECTS = tdb_seconds("2024-10-01T00:00:00"), np.pi / 648_000.0, 0.3, 24
DAYS = 5
COASTING = LineageSettings(maneuvers_per_day=0)
# states at 0.6 to 0.8 units of length from the Earth, in the propagation frame of J2000 axes
RNG = np.random.default_rng(7)


@pytest.fixture(scope="module")
def found():
    table = tabulate_bodies(START, START + 86_400.0 * (DAYS + 1))
    forces = ephemeris_forces(table, START, area_to_mass=0.02)
    factor = 1.0 + DEVIATION * RNG.standard_normal(OBJECTS)
    angle = RNG.uniform(0.0, 2.0 * np.pi, OBJECTS)
    distance = RNG.uniform(0.6, 0.8, OBJECTS)
    start = np.zeros((OBJECTS, 6))
    start[:, :2] = (distance * [np.cos(angle), np.sin(angle)]).T
    start[:, 3:5] = (distance**-0.5 * [-np.sin(angle), np.cos(angle)]).T
    start[:, 5] = 0.1
    time = np.arange(12 * DAYS) * 7_200.0 / TIME_UNIT_S
    path = np.array([
        propagate_many(
            start[[k]], time, method="dop853",
            forces=ephemeris_forces(table, START, area_to_mass=0.02 * factor[k]),
        )[0]
        for k in range(OBJECTS)
    ])  # fmt: skip
    owner = np.arange(time.size) % 3
    place = np.array([[0.3, 0.0, 0.1], [-0.2, 0.4, 0.0], [0.0, -0.3, -0.2]])[owner]
    parts = path[..., :3] - place
    unit = parts / np.linalg.norm(parts, axis=2)[..., None]
    unit = unit + SIGMA * RNG.standard_normal(unit.shape)
    order = np.argsort(np.tile(time, OBJECTS), kind="stable")
    angles = make_angles(
        np.tile(time, OBJECTS)[order], np.tile(owner, OBJECTS)[order],
        np.tile(place, (OBJECTS, 1))[order], unit.reshape(-1, 3)[order], SIGMA,
    )  # fmt: skip
    of = np.repeat(np.arange(OBJECTS), time.size)[order]
    rows = [np.flatnonzero(of == k) for k in range(OBJECTS)]
    fits = fit_orbits(angles, rows, path[:, -1], time[-1], forces=forces)
    return forces, angles, fits, path[:, -1]


def normalized(fits, truth):
    miss = (truth - fits.state)[..., None]
    return (miss.swapaxes(1, 2) @ np.linalg.solve(fits.covariance, miss))[:, 0, 0]


def test_orbits_with_an_estimated_radiation_pressure_are_consistent(found):
    forces, angles, fits, truth = found
    assert normalized(fits, truth).mean() > 30.0
    given = {"forces": forces, "settings": COASTING}
    better, none = maneuvers_within(fits, angles, **given, radiation_sigma=DEVIATION)
    # the mean of 24 chi-squared variables with six degrees of freedom: 6 +- 0.7
    assert normalized(better, truth).mean() == pytest.approx(6.0, abs=2.1)
    assert none.before.size == 0
    np.testing.assert_allclose(
        better.root.swapaxes(1, 2) @ better.root, better.covariance, rtol=1e-6, atol=1e-24
    )


def test_nothing_changes_if_the_radiation_pressure_is_known_or_there_is_none(found):
    forces, angles, fits, _ = found
    given = {"settings": COASTING}
    same, _ = maneuvers_within(fits, angles, forces=forces, **given)
    np.testing.assert_array_equal(same.state, fits.state)
    one = fits.take([0])
    other, _ = maneuvers_within(one, angles, forces=EARTH_MOON, **given, radiation_sigma=DEVIATION)
    np.testing.assert_array_equal(other.state, one.state)
