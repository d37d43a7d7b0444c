"""Coordinate local search: costs, local optimality, prescribed totals, reproducibility."""

import numpy as np
import pytest

from cislunar.architecture.coordinate_search import coordinate_search, random_start, satellite_front
from cislunar.architecture.cost import CostFunction
from cislunar.architecture.cost_kernels import log_sum
from cislunar.architecture.tables import ArchitectureTables
from cislunar.errors import ConfigurationError


@pytest.fixture(scope="module")
def objective():
    rng = np.random.default_rng(5)
    n_orbits, counts, n_targets = 20, 4, 30
    reach = rng.lognormal(1.0, 2.0, (n_orbits, 1, n_targets))
    reach[rng.random(reach.shape) < 0.4] = 0.0
    seen = np.minimum(rng.poisson(reach * np.arange(1, counts + 1)[:, None]), 500)
    distance = rng.uniform(1.0, 3.0, (n_orbits, 1)) * 100 * np.arange(1, counts + 1)
    stability = 1.0 + rng.exponential(1.0, n_orbits) ** 2
    tables = ArchitectureTables(
        seen.astype(np.uint16), distance, stability, np.full(n_orbits, "Lyap_L1"), 100
    )
    return CostFunction(tables)


def test_log_sum_is_the_sum_of_logarithms():
    rng = np.random.default_rng(0)
    for size in (1, 31, 128, 517):  # blocks of 128 and a remainder
        row = rng.integers(0, 65_536, size).astype(np.uint16)
        base = rng.integers(0, 2, size) * rng.uniform(0.1, 1e5, size)
        row[rng.random(size) < 0.3] = 0
        y = base + row / 7
        expected = np.log10(np.where(y > 0, y, 1.0)).sum()
        assert log_sum(base, row, 1 / 7) == pytest.approx(expected, rel=1e-12, abs=1e-9)


def test_no_single_replacement_improves_the_result(objective):
    result = coordinate_search(objective, np.random.default_rng(1), n_slots=4, restarts=1)
    assert result.value == pytest.approx(result.history[0][-1, 1], rel=1e-12)
    for slot in range(4):
        for i in range(objective.n_orbits):
            for n in range(1, objective.max_satellites + 1):
                orbit, satellites = result.orbit.copy(), result.satellites.copy()
                orbit[slot], satellites[slot] = i, n
                assert objective.value(orbit, satellites) <= result.value * (1 + 1e-9)


def test_prescribed_total_is_kept_and_no_transfer_improves(objective):
    total = 11
    result = coordinate_search(
        objective, np.random.default_rng(2), n_slots=4, restarts=2, total=total
    )
    assert result.n_satellites == total
    for a in range(4):
        for b in range(4):
            for i in range(objective.n_orbits):
                orbit, satellites = result.orbit.copy(), result.satellites.copy()
                if a != b and satellites[a] < objective.max_satellites and satellites[b] > 1:
                    satellites[a] += 1
                    satellites[b] -= 1
                orbit[a] = i
                assert objective.value(orbit, satellites) <= result.value * (1 + 1e-9)


def test_history_rises_and_counts_evaluations(objective):
    result = coordinate_search(objective, np.random.default_rng(3), n_slots=3, restarts=3)
    for history, reached in zip(result.history, result.restart_value, strict=True):
        assert np.all(np.diff(history[:, 0]) > 0) and np.all(np.diff(history[:, 1]) > 0)
        assert history[-1, 1] == reached
    assert result.value == pytest.approx(result.restart_value.max(), rel=1e-12)


def test_same_seed_same_result_and_progress(objective):
    seen = []
    first, second = (
        coordinate_search(
            objective,
            np.random.default_rng(4),
            n_slots=3,
            restarts=2,
            progress=lambda done, total: seen.append((done, total)),
        )
        for _ in range(2)
    )
    assert np.array_equal(first.orbit, second.orbit)
    assert all(np.array_equal(a, b) for a, b in zip(first.history, second.history, strict=True))
    assert seen == [(1, 2), (2, 2)] * 2


def test_front_has_every_total_and_the_free_optimum(objective):
    free = coordinate_search(objective, np.random.default_rng(6), n_slots=3, restarts=10)
    totals = list(range(3, 13))
    front = satellite_front(objective, totals, np.random.default_rng(6), n_slots=3)
    assert [result.n_satellites for result in front] == totals
    best = max(result.value for result in front)
    assert best == pytest.approx(free.value, rel=1e-12)


def test_impossible_settings_are_named(objective):
    rng = np.random.default_rng(0)
    with pytest.raises(ConfigurationError, match="n_slots = 21"):
        coordinate_search(objective, rng, n_slots=21)
    with pytest.raises(ConfigurationError, match="total = 2"):
        coordinate_search(objective, rng, n_slots=3, total=2)
    with pytest.raises(ConfigurationError, match="distinct"):
        coordinate_search(objective, rng, n_slots=2, starts=[([1, 1], [1, 1])])
    with pytest.raises(ConfigurationError, match="restart"):
        coordinate_search(objective, rng, n_slots=2, restarts=0)
    with pytest.raises(ConfigurationError, match="total = 9: 2 slots"):
        satellite_front(objective, [2, 9], rng, n_slots=2)
    for given, message in (
        ((3, 2, 4, rng), "n_slots = 4"),
        ((3, 2, 2, rng, 1), "total = 1"),
        ((3, 2, 2, rng, 5), "total = 5"),
        ((3, 0, 2, rng), "max_satellites = 0"),
    ):
        with pytest.raises(ConfigurationError, match=message):
            random_start(*given)
