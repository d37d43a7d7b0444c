"""Optimality certificate and coordinate search against enumeration of every architecture."""

from itertools import combinations, product

import numpy as np
import pytest

from cislunar.architecture.coordinate_search import coordinate_search
from cislunar.architecture.cost import CostFunction
from cislunar.architecture.optimality.certificate import certify
from cislunar.architecture.optimality.prescribed import certify_total
from cislunar.architecture.tables import ArchitectureTables
from cislunar.errors import ConfigurationError


def random_tables(seed, *, n_orbits=7, counts=3, n_targets=6, sparse=0.4, most=8, unstable=1.0):
    """Tables with unseen targets, targets seen once, and stable and unstable orbits."""
    rng = np.random.default_rng(seed)
    seen = rng.integers(0, most + 1, (n_orbits, counts, n_targets))
    seen *= rng.random((n_orbits, 1, n_targets)) > sparse
    distance = rng.uniform(1.0, 3.0, (n_orbits, 1)) * 10 * np.arange(1, counts + 1)
    stability = 1.0 + unstable * rng.exponential(1.0, n_orbits) ** 2
    return ArchitectureTables(
        seen.astype(np.uint16), distance, stability, np.full(n_orbits, "Halo_L1_N"), 10
    )


def enumerate_all(tables, n_slots):
    """Every architecture and its J, straight from the definition."""
    evaluated = {}
    for orbit in combinations(range(tables.n_orbits), n_slots):
        for satellites in product(range(1, tables.max_satellites + 1), repeat=n_slots):
            rows = list(zip(orbit, satellites, strict=True))
            y = sum(tables.observations[i, n - 1] / n for i, n in rows)
            logs = np.log10(np.where(y > 0, y, 1.0)).sum()
            v = sum(int(tables.observations[i, n - 1].sum()) for i, n in rows)
            stability = sum(n * tables.stability_index[i] for i, n in rows)
            distance = sum(tables.distance[i, n - 1] for i, n in rows)
            denominator = sum(satellites) * stability * distance * y.size * tables.n_steps
            evaluated[orbit + satellites] = (abs(v * logs) / denominator, logs)
    return evaluated


def listed(certificate):
    keys = np.hstack([certificate.near_orbit, certificate.near_satellites])
    return {tuple(key) for key in keys.tolist()}


CASES = [
    # (tables, slots, epsilon, groups)
    *[({"seed": seed}, 3, 0.3, 100) for seed in range(4)],
    *[({"seed": seed}, 3, 0.3, 2) for seed in range(4, 8)],
    # nearly every target seen less than once per satellite: the log-sum is negative
    *[({"seed": seed, "most": 1, "counts": 3, "sparse": 0.6}, 3, 0.5, 3) for seed in range(8, 14)],
    # counts that repay: every orbit alike in stability, few of them
    *[({"seed": s, "unstable": 0.0, "counts": 4, "n_orbits": 5}, 4, 0.4, 4) for s in range(14, 17)],
    ({"seed": 17, "n_orbits": 10, "counts": 2, "n_targets": 40, "most": 200}, 4, 0.2, 8),
    ({"seed": 18, "n_orbits": 9, "counts": 1}, 4, 0.6, 3),
    ({"seed": 19, "n_orbits": 4, "counts": 3}, 4, 0.5, 3),
    ({"seed": 20, "counts": 3}, 1, 0.5, 3),
]


@pytest.mark.parametrize("settings, n_slots, epsilon, n_groups", CASES)
def test_certificate_lists_what_enumeration_finds(settings, n_slots, epsilon, n_groups):
    tables = random_tables(**settings)
    cost = CostFunction(tables, n_groups=n_groups)
    evaluated = enumerate_all(tables, n_slots)
    best = max(cost for cost, _ in evaluated.values())
    # architectures within rounding of the boundary may fall on either side
    inside = {k for k, (cost, _) in evaluated.items() if cost >= (1 - epsilon) * best * (1 + 1e-12)}
    beside = {k for k, (cost, _) in evaluated.items() if cost >= (1 - epsilon) * best * (1 - 1e-12)}
    proof = certify(cost, np.random.default_rng(0), n_slots=n_slots, epsilon=epsilon, restarts=1)
    assert proof.proven and proof.gap == 0.0
    assert proof.value == pytest.approx(best, rel=1e-12)
    assert inside <= listed(proof) <= beside


def test_cases_reach_negative_log_sums_and_several_satellites():
    optima = []
    for settings, n_slots, _, _ in CASES:
        evaluated = enumerate_all(random_tables(**settings), n_slots)
        key = max(evaluated, key=lambda k: evaluated[k][0])
        optima.append((evaluated[key][1], sum(key[n_slots:]) - n_slots))
    assert sum(logs < 0 for logs, _ in optima) >= 2
    assert sum(excess > 0 for _, excess in optima) >= 2


def test_threads_do_not_change_nodes_or_list():
    tables = random_tables(30, n_orbits=30, counts=2, n_targets=30, most=50, unstable=0.05)
    cost = CostFunction(tables, n_groups=2)
    one, two = (
        certify(cost, np.random.default_rng(0), n_slots=6, epsilon=0.15, threads=threads)
        for threads in (1, 2)
    )
    assert one.proven and one.nodes == two.nodes > 200
    assert len(one.near_value) > 50
    assert np.array_equal(one.near_orbit, two.near_orbit)
    assert np.array_equal(one.near_satellites, two.near_satellites)
    assert np.array_equal(one.near_value, two.near_value)


def test_node_limit_gives_a_valid_bound():
    tables = random_tables(17, n_orbits=10, counts=2, n_targets=40, most=200)
    best = max(value for value, _ in enumerate_all(tables, 4).values())
    cost = CostFunction(tables)
    proof = certify(cost, np.random.default_rng(0), n_slots=4, restarts=1, most_nodes=1)
    assert not proof.proven
    assert best <= proof.bound and proof.gap == proof.bound / proof.value - 1.0


@pytest.mark.parametrize("settings", [CASES[0][0], CASES[8][0], CASES[-4][0]])
def test_best_of_a_number_of_satellites_is_that_of_enumeration(settings):
    tables = random_tables(**settings)
    evaluated, cost = enumerate_all(tables, 3), CostFunction(tables)
    for number in (3, 5):
        best = max(value for key, (value, _) in evaluated.items() if sum(key[3:]) == number)
        found = certify_total(cost, number, n_slots=3, restarts=1)
        assert found.proven and found.n_satellites == number
        assert found.value == pytest.approx(best, rel=1e-12)
        hasty = certify_total(cost, number, n_slots=3, restarts=0, nodes=1)
        assert hasty.value <= found.value * (1 + 1e-12) <= hasty.bound * (1 + 2e-12)
    with pytest.raises(ConfigurationError, match="n_satellites = 10: 3 slots"):
        certify_total(cost, 10, n_slots=3)


def test_poor_incumbent_does_not_change_the_result():
    tables = random_tables(31, n_orbits=9, counts=2, n_targets=20, most=50)
    cost = CostFunction(tables, n_groups=4)
    poor = (np.array([0, 1, 2]), np.array([2, 2, 2]))
    climbed = coordinate_search(cost, np.random.default_rng(0), n_slots=3, starts=[poor])
    settings = {"n_slots": 3, "epsilon": 0.1, "restarts": 0}
    first = certify(cost, np.random.default_rng(0), incumbent=poor, **settings)
    again = certify(cost, np.random.default_rng(1), n_slots=3, epsilon=0.1)
    assert first.value == again.value == pytest.approx(climbed.value, rel=1e-12)
    assert np.array_equal(first.near_orbit, again.near_orbit)


def test_no_observation_is_proven_to_have_value_zero():
    tables = random_tables(0, most=0)
    proof = certify(CostFunction(tables), np.random.default_rng(0), n_slots=3)
    assert proof.proven and proof.value == 0.0 and proof.gap == 0.0


def test_settings_out_of_range_are_named():
    cost = CostFunction(random_tables(0))
    with pytest.raises(ConfigurationError, match="epsilon"):
        certify(cost, np.random.default_rng(0), n_slots=3, epsilon=1.0)
    with pytest.raises(ConfigurationError, match="n_slots"):
        certify(cost, np.random.default_rng(0), n_slots=8)
