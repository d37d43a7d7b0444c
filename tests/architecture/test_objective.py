"""Searches and the certificate with another objective than J: weighted set cover, in plain Python.

It is small enough for brute force, and nothing of it is compiled or known to the library.
"""

from dataclasses import dataclass
from functools import partial
from itertools import combinations, product

import numpy as np
import pytest

from cislunar.architecture.coordinate_search import coordinate_search, satellite_front
from cislunar.architecture.hyperopt_search import hyperopt_search
from cislunar.architecture.objective import Level, Objective
from cislunar.architecture.optimality.certificate import certify
from cislunar.architecture.optimality.knapsack import NO_CHOICE, best_choice
from cislunar.architecture.optimality.node import active_orbits
from cislunar.architecture.published import choose_members

N_SLOTS = 3


class SetCover(Objective):
    """Weight of the targets seen at least once, less a price per satellite."""

    def __init__(self, covers, weight, price=0.0):
        families = np.repeat(["Butterfly_N", "Lyap_L1"], [4, len(covers) - 4])
        super().__init__(families, np.ones(len(covers)), covers.shape[1])
        self.covers, self.weight, self.price = covers, weight, price

    def value(self, orbit, satellites):
        seen = self.covers[orbit, np.asarray(satellites) - 1].any(axis=0)
        return max(float(self.weight[seen].sum() - self.price * np.sum(satellites)), 0.0)

    def levels(self, n_slots):
        return [
            Level(n, "", float(self.weight.sum()) - self.price * n, partial(Cut, self, n_slots, n))
            for n in range(n_slots, n_slots * self.max_satellites + 1)
        ]


@dataclass
class Cut:
    """Tangents of the concave sum of weight x min(1, times seen) for a total of satellites."""

    objective: SetCover
    n_slots: int
    total: int
    interval = (0.0, 0.0)

    def __post_init__(self):
        self.excess = self.total - self.n_slots
        self.n_orbits, self.counts, _ = self.objective.covers.shape
        self.value = self.objective.value

    def relax(self, threshold, stack, top):
        covers, weight = self.objective.covers, self.objective.weight
        low, high, forced = stack.lowest[top], stack.highest[top], stack.forced[top]
        active = active_orbits(low, high)
        sloped = np.ones(len(weight), bool)  # the others are taken as seen
        best = np.inf, 0.0, np.zeros((active.size, self.counts))
        orbit, extra = np.empty((2, self.n_slots), np.int64)
        for _ in range(4):
            score = covers[active] @ np.where(sloped, weight, 0.0)
            offset = weight[~sloped].sum() - self.objective.price * self.total - threshold
            chosen = best_choice(
                score, low[active].astype(np.int64), high[active].astype(np.int64),
                forced[active], self.n_slots, self.excess, orbit, extra,
            )  # fmt: skip
            if chosen <= 0.5 * NO_CHOICE:
                return -np.inf, 0.0, score, 0.0
            best = min(best, (offset + chosen, offset, score), key=lambda cut: cut[0])
            stack.orbits[top, 0], stack.extras[top, 0] = active[orbit], extra
            stack.weight[top, 0], stack.vertices[top] = 1.0, 1
            sloped = covers[active[orbit], extra].sum(axis=0) < 1
        return *best, 0.0


def set_cover(seed, *, n_orbits=7, counts=3, n_targets=12, price=0.0):
    """Orbits that see a few targets each, more of them with more satellites."""
    rng = np.random.default_rng(seed)
    first = rng.random((n_orbits, counts, n_targets)) < 0.15
    return SetCover(np.logical_or.accumulate(first, axis=1), rng.integers(1, 9, n_targets), price)


def enumerate_all(objective, total=None):
    """Value of every architecture of distinct orbits."""
    counts = range(1, objective.max_satellites + 1)
    return {
        orbit + satellites: objective.value(orbit, satellites)
        for orbit in combinations(range(objective.n_orbits), N_SLOTS)
        for satellites in product(counts, repeat=N_SLOTS)
        if total in (None, sum(satellites))
    }


@pytest.mark.parametrize("price", [0.0, 2.0])
@pytest.mark.parametrize("seed", range(3))
def test_certificate_lists_what_enumeration_finds(seed, price):
    objective = set_cover(seed, price=price)
    evaluated = enumerate_all(objective)
    best = max(evaluated.values())
    proof = certify(objective, np.random.default_rng(0), n_slots=N_SLOTS, epsilon=0.1, restarts=1)
    assert proof.proven and proof.value == best
    listed = {tuple(key) for key in np.hstack([proof.near_orbit, proof.near_satellites]).tolist()}
    assert listed == {key for key, value in evaluated.items() if value >= 0.9 * best}
    assert proof.nodes > 0


def test_certificate_out_of_nodes_is_honest():
    objective = set_cover(4)
    proof = certify(objective, np.random.default_rng(0), n_slots=N_SLOTS, most_nodes=1)
    assert not proof.proven
    assert max(enumerate_all(objective).values()) <= proof.bound


@pytest.mark.parametrize("seed", range(3))
def test_coordinate_search_reaches_the_best(seed):
    objective = set_cover(seed, price=1.0)
    found = coordinate_search(objective, np.random.default_rng(0), n_slots=N_SLOTS, restarts=10)
    assert found.value == max(enumerate_all(objective).values())
    assert found.value == objective.value(found.orbit, found.satellites)


def test_front_reaches_the_best_of_each_total():
    objective = set_cover(1)
    totals = range(3, 10)
    rng = np.random.default_rng(0)
    front = satellite_front(objective, totals, rng, n_slots=N_SLOTS, restarts=10)
    for total, found in zip(totals, front, strict=True):
        assert found.n_satellites == total
        assert found.value == max(enumerate_all(objective, total).values())


@pytest.mark.parametrize("method", ["tpe", "random"])
def test_samplers_evaluate_the_objective(method):
    objective = set_cover(2)
    found = hyperopt_search(
        objective, method=method, rng=np.random.default_rng(0), n_slots=N_SLOTS,
        max_evaluations=150, early_stop=None,
    )  # fmt: skip
    tried = zip(found.orbit_trials, found.satellites_trials, strict=True)
    np.testing.assert_array_equal(found.history, [objective.value(*each) for each in tried])
    best = max(enumerate_all(objective).values())
    assert 0.8 * best < found.value == found.history.max() <= best


def test_members_of_given_families_are_the_best():
    objective = set_cover(3)
    slots = (("Butterfly_N", 2), ("Lyap_L1", 1), ("Butterfly_N", 1))
    found = choose_members(objective, slots, rng=np.random.default_rng(0), restarts=10)
    members = [np.flatnonzero(objective.family == family) for family, _ in slots]
    choices = [orbit for orbit in product(*members) if len(set(orbit)) == len(orbit)]
    assert found.value == max(objective.value(orbit, (2, 1, 1)) for orbit in choices)


def test_an_objective_without_bounds_says_so():
    class Count(Objective):
        def value(self, orbit, satellites):
            return float(np.sum(satellites))

    objective = Count(np.full(5, "Lyap_L1"), np.ones(5), 2)
    found = coordinate_search(objective, np.random.default_rng(0), n_slots=2, restarts=1)
    assert found.value == 4.0
    with pytest.raises(NotImplementedError, match="Count has no bounds"):
        certify(objective, np.random.default_rng(0), n_slots=2)
