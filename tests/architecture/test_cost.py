"""The cost J from tables against the paper's sums, taken term by term without any table."""

import dataclasses
import math

import numpy as np
import pytest
from oracles.visibility import visible

from cislunar.architecture.cost import CostFunction
from cislunar.architecture.cost_kernels import log_sum, seen_per_satellite
from cislunar.architecture.tables import ArchitectureTables
from cislunar.constants import MU
from cislunar.dynamics.propagation import propagate_periodic
from cislunar.errors import ConfigurationError
from cislunar.observation.sensor import ExclusionAngles
from cislunar.orbits.catalog import periodic_orbits
from cislunar.orbits.families import concatenate
from cislunar.visibility.counts import VisibilitySettings, count_visibility, observation_times

MOON = np.array([1.0 - MU, 0.0, 0.0])
EARTH = np.array([-MU, 0.0, 0.0])
PAPER = VisibilitySettings(18.0, 1.0, 1.0, ExclusionAngles(35.0, 5.0, 15.0))


def paper_factors(orbits, times, target, sun, orbit, satellites):
    """lambda_1 .. lambda_6 of Paul & Fan, section 3: loops over the sums as printed."""
    observations = np.zeros((len(orbit), len(target)))
    distance = 0.0
    for i, (index, n) in enumerate(zip(orbit, satellites, strict=True)):
        period = orbits.period[index]
        for j in range(n):
            for t, here_sun in zip(times, sun, strict=True):
                here = propagate_periodic(orbits.state[index], period, [t + j * period / n])[:, :3]
                seen = visible(here, target, here_sun[None], PAPER)[0]
                for target_index in range(len(target)):
                    observations[i, target_index] += seen[target_index]
                distance += math.dist(here[0], MOON) + math.dist(here[0], EARTH)
    scale = len(target) * len(times)
    logarithms = 0.0
    for target_index in range(len(target)):
        argument = sum(observations[i, target_index] / n for i, n in enumerate(satellites))
        logarithms += math.log10(argument if argument > 0.0 else 1.0)
    stability = [orbits.stability_index[index] for index in orbit]
    return [
        1.0 / sum(satellites),
        1.0 / sum(n * xi for n, xi in zip(satellites, stability, strict=True)),
        observations.sum() / scale,
        logarithms / scale,
        1.0 / (distance / scale),
        1.0 if len(set(orbit)) == len(orbit) else 0.0,
    ]


@pytest.fixture(scope="module")
def scene():
    """A few orbits of different families, and targets of which some are never seen."""
    orbits = concatenate(
        [
            periodic_orbits("Halo_L2_S", jacobi=3.05),
            periodic_orbits("Halo_L1_N", jacobi=3.0),
            periodic_orbits("Lyap_L3", jacobi=2.9),
        ]
    )
    times = observation_times(2.0, 3.0)
    angle = 1.0 - times
    sun = 389.0 * np.stack([np.cos(angle), np.sin(angle), np.full(len(times), 0.02)], axis=1)
    rng = np.random.default_rng(9)
    target = np.vstack(
        [rng.uniform([0.7, -0.3, -0.3], [1.3, 0.3, 0.3], (25, 3)), [[20.0, 0.0, 0.0], MOON]]
    )
    counts = count_visibility(
        orbits.state, orbits.period, target, times, sun, VisibilitySettings(), max_satellites=10
    )
    tables = ArchitectureTables(
        counts.observations, counts.distance, orbits.stability_index, orbits.family, len(times)
    )
    return tables, (orbits, times, target, sun)


@pytest.mark.parametrize(
    "orbit, satellites",
    [
        ((0, 1, 2, 3, 4, 5), (1, 1, 1, 1, 1, 1)),
        ((0, 1, 2, 3, 4, 5), (3, 2, 4, 1, 5, 2)),
        ((5, 3, 1), (1, 7, 10)),
        ((2,), (6,)),
        ((4, 1, 4), (2, 2, 3)),
    ],
)
def test_factors_are_the_papers_sums(scene, orbit, satellites):
    tables, arguments = scene
    expected = paper_factors(*arguments, orbit, satellites)
    cost = CostFunction(tables)
    value = cost.value(orbit, satellites)
    assert expected[3] != 0.0
    np.testing.assert_allclose(cost.factors(orbit, satellites), expected, rtol=1e-10)
    assert value == pytest.approx(abs(math.prod(expected)), rel=1e-10)
    assert (value == 0.0) == (len(set(orbit)) < len(orbit))


def test_scene_has_targets_never_seen(scene):
    tables, _ = scene
    assert not tables.observations[:, :, -2].any()
    assert tables.observations[:, :, :25].any(axis=(0, 1)).all()


def tables_of(observations, n_steps=10):
    """Tables of given observations; distances and stability indices are one."""
    n_orbits, counts, _ = observations.shape
    distance = np.ones((n_orbits, counts))
    return ArchitectureTables(
        observations, distance, np.ones(n_orbits), np.full(n_orbits, "Lyap_L1"), n_steps
    )


def log_observations(observations, orbit, satellites):
    """The sum of logarithms in lambda_4."""
    seen = seen_per_satellite(observations, orbit, satellites, -1)
    return log_sum(seen, observations[0, 0], 0.0)


def test_hand_example():
    # Two orbits, up to two satellites, two targets, ten steps; by hand:
    # arguments of the logarithm (8 / 2 + 6, 0 / 2 + 1) = (10, 1), so the sum is 1.
    observations = np.array([[[3, 1], [8, 0]], [[6, 1], [9, 9]]], dtype=np.uint16)
    cost = CostFunction(tables_of(observations))
    expected = [1 / 3, 1 / 3, 15 / 20, 1 / 20, 20 / 2, 1.0]
    np.testing.assert_allclose(cost.factors([0, 1], [2, 1]), expected, rtol=1e-15)
    assert cost.value([0, 1], [2, 1]) == pytest.approx(1 / 9 * 0.75 * 0.05 * 10.0, rel=1e-15)


def test_duplicate_orbits_give_zero():
    observations = np.full((3, 2, 4), 5, dtype=np.uint16)
    cost = CostFunction(tables_of(observations))
    assert cost.value([0, 1, 2], [1, 1, 1]) > 0.0
    assert cost.value([0, 2, 0], [1, 2, 1]) == 0.0
    factors = cost.factors([0, 2, 0], [1, 2, 1])
    assert factors[5] == 0.0
    assert np.all(factors[:5] > 0.0)


def test_unseen_targets_leave_the_logarithm_alone():
    some = np.array([[[7, 3]]], dtype=np.uint16)
    with_unseen = np.array([[[7, 0, 3, 0]]], dtype=np.uint16)
    one, alone = np.array([0]), np.array([1])
    assert log_observations(with_unseen, one, alone) == pytest.approx(
        log_observations(some, one, alone), rel=1e-15
    )
    nothing = CostFunction(tables_of(np.zeros((2, 1, 5), dtype=np.uint16)))
    assert nothing.value([0, 1], [1, 1]) == 0.0


def test_negative_sum_of_logarithms_counts_by_its_size():
    # Once in ten satellites: every argument is 1/10, lambda_4 is negative, J is not.
    observations = np.ones((1, 10, 6), dtype=np.uint16)
    cost = CostFunction(tables_of(observations))
    assert cost.factors([0], [10])[3] == pytest.approx(-6 / 60)
    assert cost.value([0], [10]) > 0.0


@pytest.mark.parametrize("low, high, satellites", [(65_000, 65_536, 1), (1, 2, 10), (0, 7211, 10)])
@pytest.mark.parametrize("n_targets", [1, 31, 127, 128, 129, 10_000])
def test_product_of_counts_neither_overflows_nor_underflows(low, high, satellites, n_targets):
    rng = np.random.default_rng(n_targets)
    observations = rng.integers(low, high, (10, 10, n_targets)).astype(np.uint16)
    orbit, count = np.arange(10), np.full(10, satellites)
    sums = observations[:, satellites - 1].sum(axis=0) / satellites
    expected = math.fsum(math.log10(value) for value in sums if value > 0)
    assert log_observations(observations, orbit, count) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("dtype", [np.uint16, np.uint32])
def test_table_types_agree(dtype):
    observations = np.random.default_rng(1).integers(0, 700, (4, 3, 50))
    expected = CostFunction(tables_of(observations.astype(np.uint32)))
    found = CostFunction(tables_of(observations.astype(dtype)))
    assert found.value([0, 3], [2, 3]) == expected.value([0, 3], [2, 3])


@pytest.mark.parametrize(
    "orbit, satellites, message",
    [
        ([0, 1], [1], "equally long"),
        ([], [], "non-empty"),
        ([[0]], [[1]], "equally long"),
        ([-1], [1], r"orbit indices must lie in 0 \.\. 2"),
        ([3], [1], r"orbit indices must lie in 0 \.\. 2"),
        ([0], [0], r"satellites must lie in 1 \.\. 2"),
        ([0], [3], r"satellites must lie in 1 \.\. 2"),
        ([0.9], [1.5], "must be whole numbers"),
    ],
)
def test_impossible_architectures_are_refused(orbit, satellites, message):
    cost = CostFunction(tables_of(np.ones((3, 2, 4), dtype=np.uint16)))
    with pytest.raises(ConfigurationError, match=message):
        cost.value(orbit, satellites)


def test_tables_that_do_not_belong_together_are_refused():
    right = tables_of(np.ones((3, 2, 4), dtype=np.uint16))
    for name, wrong in (
        ("distance", right.distance[:1]),
        ("stability_index", np.full(3, np.nan)),
        ("n_steps", 0),
        ("family", np.array(["a"] * 4)),
    ):
        with pytest.raises(ConfigurationError, match=name):
            CostFunction(dataclasses.replace(right, **{name: wrong}))
    with pytest.raises(ConfigurationError, match="give ArchitectureTables"):
        CostFunction("tables")
