"""Table 2 of Paul & Fan, and the choice of members against enumeration."""

import itertools
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from cislunar.architecture.cost import CostFunction
from cislunar.architecture.published import PUBLISHED, PUBLISHED_COST, choose_members
from cislunar.architecture.tables import ArchitectureTables
from cislunar.errors import ConfigurationError
from cislunar.orbits.families import FAMILIES

LIBRARY = np.repeat(["Halo_L2_S", "Halo_L3_N", "Lyap_L3"], [4, 3, 2])


def make_objective(seed, counts=3):
    """J over random tables of nine orbits in three families."""
    rng = np.random.default_rng(seed)
    tables = ArchitectureTables(
        observations=rng.integers(0, 20, (9, counts, 6)).astype(np.uint16),
        distance=rng.uniform(1.0, 3.0, (9, 1)) * np.arange(1, counts + 1),
        stability_index=1.0 + rng.exponential(2.0, 9),
        family=LIBRARY,
        n_steps=10,
    )
    return CostFunction(tables)


def test_table_2_row_by_row():
    # The three columns of the table as printed.
    letters = {"B": "Butterfly_", "1": "Halo_L1_", "2": "Halo_L2_", "3": "Halo_L3_"}

    def named(row):
        return ["Lyap_L3" if each == "L3" else letters[each[0]] + each[1] for each in row.split()]

    families = {
        "A": named("3N 3S 2S 3N 3S 2S 3S 2N 2S 2S"),
        "B": named("BN 3S 1S 3N 2S 2S 2N BS BS L3"),
        "C": named("1N 2S 3N 2N 2N 2S L3 2S 2S L3"),
    }
    counts = {
        "A": [2, 1, 7, 1, 1, 1, 2, 1, 3, 1],
        "B": [5, 2, 7, 5, 3, 3, 3, 2, 2, 1],
        "C": [5, 2, 7, 1, 10, 8, 2, 4, 1, 3],
    }
    for scenario, slots in PUBLISHED.items():
        assert [family for family, _ in slots] == families[scenario]
        assert [count for _, count in slots] == counts[scenario]


@pytest.mark.parametrize("scenario, total", [("A", 20), ("B", 33), ("C", 43)])
def test_published_architectures_have_ten_slots_and_the_stated_totals(scenario, total):
    slots = PUBLISHED[scenario]
    assert len(slots) == 10
    assert sum(count for _, count in slots) == total == PUBLISHED_COST[scenario]["tpe"][1]
    assert {family for family, _ in slots} <= set(FAMILIES)


def test_tpe_is_published_above_random():
    for value in PUBLISHED_COST.values():
        assert value["tpe"][0] > value["random"][0]


def best_by_enumeration(objective, slots):
    """Largest J over all choices of distinct members."""
    choices = [np.flatnonzero(family == LIBRARY) for family, _ in slots]
    counts = [count for _, count in slots]
    return max(
        objective.value(orbit, counts)
        for orbit in itertools.product(*choices)
        if len(set(orbit)) == len(orbit)
    )


@pytest.mark.parametrize("seed", range(5))
def test_members_are_the_best(seed):
    objective = make_objective(seed)
    slots = (("Halo_L2_S", 3), ("Lyap_L3", 1), ("Halo_L2_S", 1), ("Halo_L3_N", 2))
    found = choose_members(objective, slots, rng=np.random.default_rng(seed), restarts=8)
    assert found.value == pytest.approx(best_by_enumeration(objective, slots), rel=1e-12)
    assert len(set(found.orbit)) == len(slots)
    chosen = tuple(zip(LIBRARY[found.orbit], found.satellites, strict=True))
    assert chosen == slots  # slot by slot
    assert found.n_satellites == 7


def test_a_family_can_be_used_up():
    slots = (("Lyap_L3", 1), ("Lyap_L3", 2), ("Halo_L3_N", 1))
    objective = make_objective(11)
    found = choose_members(objective, slots, rng=np.random.default_rng(0))
    assert set(found.orbit[:2]) == {7, 8}
    assert found.value == pytest.approx(best_by_enumeration(objective, slots), rel=1e-12)


def test_history_ends_with_the_best_and_progress_is_reported():
    calls = []
    slots = (("Halo_L2_S", 3), ("Halo_L3_N", 2))
    found = choose_members(
        make_objective(1), slots, rng=np.random.default_rng(0), restarts=3,
        progress=lambda done, total: calls.append((done, total)),
    )  # fmt: skip
    assert calls == [(1, 3), (2, 3), (3, 3)]
    assert found.history.max() == pytest.approx(found.value, rel=1e-13)
    assert np.all(found.satellites_history == 5)


def test_too_small_a_family_is_refused():
    slots = (("Lyap_L3", 1),) * 3
    with pytest.raises(
        ConfigurationError, match=r"Lyap_L3 has 2 members.*needs 3.*orbits\.members"
    ):
        choose_members(make_objective(0), slots, rng=np.random.default_rng(0))


def test_too_many_satellites_are_refused():
    with pytest.raises(ConfigurationError, match="max_satellites = 3"):
        choose_members(make_objective(0), (("Lyap_L3", 4),), rng=np.random.default_rng(0))
    for slots, restarts, message in (
        ((), 1, "slots is empty"),
        ((("Lyap_L3", 1),), 0, "restarts = 0"),
        ((("Lyap_L3", 0),), 1, "slots: satellites of Lyap_L3 = 0"),
    ):
        with pytest.raises(ConfigurationError, match=message):
            choose_members(
                make_objective(0), slots, rng=np.random.default_rng(0), restarts=restarts
            )


SCRIPT = """
import sys
sys.path.insert(0, {folder!r})
import numpy as np
from cislunar.architecture.published import choose_members
from test_published import make_objective
slots = (("Halo_L2_S", 3), ("Lyap_L3", 1), ("Halo_L2_S", 1), ("Halo_L3_N", 2))
found = choose_members(make_objective(3), slots, rng=np.random.default_rng(0), restarts=2)
print(found.history.tolist())
"""


def test_order_of_sets_does_not_matter():
    histories = set()
    for hash_seed in "012":
        done = subprocess.run(
            [sys.executable, "-c", SCRIPT.format(folder=str(Path(__file__).parent))],
            env={**os.environ, "PYTHONHASHSEED": hash_seed},
            capture_output=True,
            text=True,
            check=True,
        )
        histories.add(done.stdout)
    assert len(histories) == 1
