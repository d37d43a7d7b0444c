"""Objects outside of families: altitudes by plain propagation, invariants, tables."""

from itertools import pairwise

import numpy as np
import pytest

from cislunar.constants import (
    EARTH_RADIUS_KM,
    LENGTH_UNIT_KM,
    MOON_RADIUS_KM,
    MU,
    SECONDS_PER_DAY,
    TIME_UNIT_S,
)
from cislunar.dynamics import (
    UNITS,
    forces_between,
    jacobi_constant,
    primary_distances,
    propagate,
    propagate_many,
    propagate_periodic,
    pulsating_frame,
    to_inertial,
)
from cislunar.ephemeris.bodies import BODY_COLUMNS, read_table
from cislunar.ephemeris.time_scales import tdb_seconds
from cislunar.errors import ConfigurationError, ConvergenceError
from cislunar.orbits import periodic_orbits
from cislunar.targets import (
    TargetStates,
    load_target_states,
    objects_outside_families,
    replace_targets,
    target_states_csv,
)

DAY = SECONDS_PER_DAY / TIME_UNIT_S
KINDS = ("direct transfer", "free return", "low-energy transfer", "quasi-periodic", "disposal",
         "resonant", "high Earth")  # fmt: skip


@pytest.fixture(scope="module")
def families():
    """Halo, retrograde and Lyapunov orbits."""
    found = [
        periodic_orbits(family, period_days=days)
        for family, days in (("Halo_L2_S", 8.0), ("Halo_L2_S", 13.0), ("Halo_L1_N", 11.5),
                             ("DRO", 10.0), ("DRO", 20.0), ("Lyap_L1", 13.0))
    ]  # fmt: skip
    return (
        np.concatenate([each.state for each in found]),
        np.concatenate([each.period for each in found]),
    )


@pytest.fixture(scope="module")
def objects(families):
    return objects_outside_families(*families, np.random.default_rng(1))


def of_kind(objects, kind):
    return objects.state[[family == kind for family in objects.family]]


def test_there_are_200_distinct_objects_of_every_kind(objects, families):
    assert len(objects) == len(set(objects.name)) >= 200 and set(objects.family) == set(KINDS)
    assert all(objects.family.count(kind) == len(objects) // len(KINDS) for kind in KINDS)
    assert not objects.period.any()
    scaled = objects.state * np.repeat([LENGTH_UNIT_KM, LENGTH_UNIT_KM / TIME_UNIT_S * 1e3], 3)
    gaps = np.abs(scaled[:, None] - scaled).max(axis=2) + 1e9 * np.eye(len(objects))
    assert gaps.min() > 100.0
    # every object differs from every state of the families by 1000 km or 20 m/s
    for state, period in zip(*families, strict=True):
        path = propagate_periodic(state, period, np.linspace(0.0, period, 400))
        apart = np.abs(objects.state[:, None] - path) * np.repeat(
            [LENGTH_UNIT_KM / 1000.0, LENGTH_UNIT_KM / TIME_UNIT_S * 1e3 / 20.0], 3
        )
        assert apart.max(axis=2).min() > 0.9


def test_none_impacts_or_escapes_within_a_week(objects):
    times = np.arange(0.0, 7.0, 1.0 / 1440.0) * DAY
    path = propagate_many(objects.state, times, method="dop853")
    earth, moon = (each * LENGTH_UNIT_KM for each in primary_distances(path, MU))
    assert earth.min() > EARTH_RADIUS_KM + 80.0 and moon.min() > MOON_RADIUS_KM + 95.0
    assert np.linalg.norm(path[..., :3], axis=2).max() * LENGTH_UNIT_KM < 710_000.0


def test_free_returns_pass_the_moon_and_have_a_low_perigee_before_and_after(objects):
    for state in of_kind(objects, "free return"):
        times = np.arange(-7.5, 7.5, 1.0 / 2880.0) * DAY
        path = propagate(state, times, method="dop853")
        earth, moon = (each * LENGTH_UNIT_KM for each in primary_distances(path, MU))
        near = int(np.argmin(moon))
        assert moon[near] < MOON_RADIUS_KM + 12_100.0 and path[near, 0] > 1.0 - MU - 1e-3
        flight = round(4.5 * 2880)
        perigees = [earth[max(near - flight, 0) : near].min(), earth[near : near + flight].min()]
        assert max(perigees) < EARTH_RADIUS_KM + 5100.0
        assert perigees[0] == pytest.approx(perigees[1], rel=0.02)


def test_quasi_periodic_orbits_stay_near_an_orbit_and_are_not_on_it(objects, families):
    samples = [
        propagate_periodic(state, period, np.linspace(0.0, period, 2000))[:, :3]
        for state, period in zip(*families, strict=True)
    ]
    for state in of_kind(objects, "quasi-periodic"):
        path = propagate(state, np.linspace(0.0, 7.0 * DAY, 100), method="dop853")[:, None, :3]
        gaps = [
            np.linalg.norm(path - each, axis=2).min(axis=1) * LENGTH_UNIT_KM for each in samples
        ]
        best = min(gaps, key=lambda gap: gap[0])
        assert 300.0 < best.max() < 30_500.0


def test_ellipses_have_their_periods_and_transfers_their_perigees(objects):
    """Osculating elements by the energy and the angular momentum about the Earth."""

    def elements(states):
        position = states[:, :3] + [MU, 0.0, 0.0]
        velocity = states[:, 3:] + np.cross([0.0, 0.0, 1.0], position)
        energy = 0.5 * np.sum(velocity**2, axis=1) - (1.0 - MU) / np.linalg.norm(position, axis=1)
        momentum2 = np.sum(np.cross(position, velocity) ** 2, axis=1)
        major = -0.5 * (1.0 - MU) / energy
        eccentricity = np.sqrt(1.0 - momentum2 / (major * (1.0 - MU)))
        return major * LENGTH_UNIT_KM, major * (1.0 - eccentricity) * LENGTH_UNIT_KM

    major, perigee = elements(of_kind(objects, "direct transfer"))
    assert np.median(perigee) < EARTH_RADIUS_KM + 15_000.0
    assert 170_000.0 < np.median(major) < 280_000.0
    major, perigee = elements(of_kind(objects, "resonant"))
    ratios = (major / 384_400.0) ** -1.5
    ideal = np.array([2.0, 2.5, 3.5, 4.0, 5.0, 1.5, 8.0 / 3.0])
    # the Moon changes the osculating period during the motion from perigee
    assert np.median(np.abs(ratios[:, None] / ideal - 1.0).min(axis=1)) < 0.05
    assert np.all(jacobi_constant(of_kind(objects, "low-energy transfer")) > 2.5)


def test_objects_depend_on_the_generator_alone_and_on_their_own_kind(families, objects):
    again = objects_outside_families(*families, np.random.default_rng(1), count=21)
    assert again.name == objects.name[:21]
    np.testing.assert_array_equal(again.state, objects.state[:21])
    other = objects_outside_families(*families, np.random.default_rng(2), count=7)
    assert not np.any(other.state == objects.state[:7])


def test_objects_can_be_used_in_ephemeris_dynamics(families):
    start = "2025-03-01T00:00:00"
    forces = forces_between("2025-02-28T23:00:00", "2025-03-08T01:00:00")
    forces = forces._replace(epoch=tdb_seconds(start))
    found = objects_outside_families(*families, np.random.default_rng(3), count=14, forces=forces)
    states = to_inertial(found.state, pulsating_frame(forces.table, forces.epoch)) / UNITS
    times = np.arange(0.0, 7.0, 1.0 / 1440.0) * DAY
    path = propagate_many(states, times, forces=forces, method="dop853")[..., :3] * LENGTH_UNIT_KM
    bodies, *_ = read_table(forces.table, forces.epoch + times * TIME_UNIT_S)
    for body, radius in (("earth", EARTH_RADIUS_KM), ("moon", MOON_RADIUS_KM)):
        distance = np.linalg.norm(path - bodies[:, BODY_COLUMNS[body]], axis=2)
        assert distance.min() > radius + 50.0


def test_tables_and_replacement(objects, tmp_path):
    path = tmp_path / "targets.csv"
    path.write_text(target_states_csv(objects), encoding="utf-8")
    again = load_target_states(path)
    assert again.name == objects.name and again.family == objects.family
    np.testing.assert_array_equal(again.state, objects.state)
    np.testing.assert_array_equal(again.period, objects.period)
    inside = TargetStates(
        [str(k) for k in range(20)], ["halo"] * 20, np.zeros((20, 6)), np.ones(20)
    )
    sets = []
    for share in (0.0, 0.25, 0.5, 1.0):
        mixed = replace_targets(inside, objects, share, np.random.default_rng(4))
        assert len(mixed) == 20 and len(set(mixed.name)) == 20
        rows = [k for k, family in enumerate(mixed.family) if family != "halo"]
        assert len(rows) == round(20 * share)
        taken = [objects.name.index(mixed.name[k]) for k in rows]
        assert sorted(taken) == list(range(len(rows)))
        np.testing.assert_array_equal(mixed.state[rows], objects.state[taken])
        assert all((mixed.period[k] == 0.0) == (k in rows) for k in range(20))
        sets.append(set(rows))
    assert all(small <= large for small, large in pairwise(sets))


def test_bad_input_is_refused_in_one_line(families, objects):
    rng = np.random.default_rng(5)
    state, period = families
    wrong, failed = ConfigurationError, ConvergenceError
    make = objects_outside_families
    for call, error, words in (
        (lambda: make(state, period[:-1], rng), wrong, "period"),
        (lambda: make(state, -period, rng), wrong, "positive"),
        (lambda: make(state, period, rng, count=0), wrong, "count"),
        (lambda: make(state, period, rng, days=-1.0), wrong, "days"),
        (lambda: make(state * np.nan, period, rng), wrong, "finite"),
        # a stable orbit alone has no manifolds
        (lambda: make(state[3:4], period[3:4], rng), failed, "low-energy transfer"),
        (lambda: replace_targets(objects, objects, 1.5, rng), wrong, "between 0 and 1"),
        (lambda: replace_targets(objects, objects, 0.5, rng), wrong, "twice"),
    ):
        with pytest.raises(error, match=words) as caught:
            call()
        assert "\n" not in str(caught.value)
