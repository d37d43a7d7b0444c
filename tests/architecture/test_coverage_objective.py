"""Coverage objectives, greedy, search and bound: against enumeration, plain greedy and HiGHS."""

from functools import cache
from itertools import combinations, product

import numpy as np
import pytest
from oracles.visibility import sun_at, visible
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import csr_array

from cislunar.architecture.coordinate_search import coordinate_search
from cislunar.architecture.coverage import certificate
from cislunar.architecture.coverage.certificate import certify_coverage, greedy_coverage
from cislunar.architecture.coverage.gap_objective import GAP_MEASURES, GapObjective, certify_gaps
from cislunar.architecture.coverage.lagrangian import coverage_bound
from cislunar.architecture.coverage.measures import coverage, gaps
from cislunar.architecture.coverage.objective import CoverageObjective
from cislunar.architecture.coverage.tables import CoverageTables, as_words, coverage_tables
from cislunar.architecture.hyperopt_search import hyperopt_search
from cislunar.architecture.objective import Objective
from cislunar.errors import ConfigurationError
from cislunar.orbits.families import observer_library
from cislunar.visibility.counts import VisibilitySettings, observation_times
from cislunar.visibility.tracks import architecture_tracks, satellite_tracks


def objective_of(counts, fold, shape=None):
    """Coverage objective of given satellites per element, shape (slot, satellites, element)."""
    layer = np.arange(1, min(fold, counts.max(initial=1)) + 1)
    bits = np.packbits(counts[:, :, None] >= layer[:, None], axis=-1, bitorder="little")
    slots = len(counts)
    return CoverageObjective(
        CoverageTables(
            layers=as_words(bits),
            orbit=np.arange(slots),
            phase=np.zeros(slots),
            family=np.full(slots, "Halo_L1_N"),
            stability_index=np.ones(slots),
            fold=fold,
            shape=shape or (1, counts.shape[2]),
        )
    )


def random_counts(seed, *, slots=8, most=1, elements=150, share=0.15):
    """Satellites that see each element; the elements differ with the number of satellites."""
    rng = np.random.default_rng(seed)
    satellites = np.arange(1, most + 1)[None, :, None]
    difficulty = rng.uniform(0.2, 1.8, elements) * share
    return rng.binomial(satellites, difficulty, (slots, most, elements))


def direct(counts, fold, orbit, satellites):
    """Coverage from the definition."""
    seen = counts[list(orbit), np.asarray(satellites) - 1].sum(axis=0)
    return np.minimum(seen, fold).mean() / fold


def best_of_all(counts, fold, n_slots, total):
    """Largest coverage over every architecture."""
    slots, most, _ = counts.shape
    sizes = [n for n in product(range(1, most + 1), repeat=n_slots) if sum(n) == total]
    return max(
        direct(counts, fold, orbit, n)
        for orbit in combinations(range(slots), n_slots)
        for n in sizes
    )


@pytest.mark.parametrize("fold", [1, 2, 3])
@pytest.mark.parametrize("most", [1, 4])
def test_value_and_best_replacement_are_those_of_the_definition(fold, most):
    counts = random_counts(fold, most=most)
    objective = objective_of(counts, fold)
    rng = np.random.default_rng(0)
    for _ in range(20):
        orbit, n = rng.choice(8, 3, replace=False), rng.integers(1, most + 1, 3)
        value = objective.value(orbit, n)
        assert value == pytest.approx(direct(counts, fold, orbit, n), rel=1e-14)
        found = objective.best_replacement(orbit, n, 1, 1, most, value)
        plain = Objective.best_replacement(objective, orbit, n, 1, 1, most, value)
        assert found == pytest.approx(plain)
        seen = objective.seen(orbit, n, fold)[0]
        np.testing.assert_array_equal(seen, counts[orbit, n - 1].sum(axis=0) >= fold)
    assert objective.value([2, 2], [1, 1]) == 0.0


@pytest.mark.parametrize("fold", [1, 2])
def test_gains_only_fall_and_lazy_greedy_is_greedy(fold):
    counts = random_counts(7, slots=40, elements=300)
    counts[20:] = counts[:20]  # every candidate twice: ties
    objective = objective_of(counts, fold)
    orbit, satellites = greedy_coverage(objective, 15)
    chosen, last = [], np.full(40, np.inf)
    base = 0.0
    for _ in range(15):
        gain = np.array(
            [
                direct(counts, fold, [*chosen, i], [1] * (len(chosen) + 1)) - base
                if i not in chosen
                else -1.0
                for i in range(40)
            ]
        )
        assert (gain <= last + 1e-15).all()
        last = gain
        chosen.append(int(np.flatnonzero(gain >= gain.max() - 1e-12)[0]))
        base += gain.max()
    assert orbit.tolist() == chosen and (satellites == 1).all()


CASES = [
    *[(seed, 1, fold, 4, 4) for seed in range(4) for fold in (1, 2)],
    *[(seed, 3, fold, 3, total) for seed in range(4) for fold in (1, 3) for total in (3, 5, 8)],
]


@cache
def certified(seed, most, fold, n_slots, total):
    """Certificate of a case."""
    objective = objective_of(random_counts(seed, most=most), fold)
    return certify_coverage(objective, total, n_slots=n_slots)


@pytest.mark.parametrize("seed, most, fold, n_slots, total", CASES)
def test_bound_and_search_enclose_what_enumeration_finds(seed, most, fold, n_slots, total):
    counts = random_counts(seed, most=most)
    objective = objective_of(counts, fold)
    best = best_of_all(counts, fold, n_slots, total)
    found = certified(seed, most, fold, n_slots, total)
    assert found.n_satellites == total and found.orbit.size == n_slots
    assert found.greedy <= found.value <= best * (1 + 1e-12)
    assert found.bound >= best * (1 - 1e-12)
    assert found.gap == pytest.approx(found.bound / found.value - 1.0) and found.gap < 0.12
    if found.proven:
        assert found.value == pytest.approx(best, rel=1e-12)
    # from a poor architecture: its value decides which candidates are excluded
    poor = coverage_bound(
        objective,
        np.arange(n_slots),
        np.array(next(n for n in product(range(1, most + 1), repeat=n_slots) if sum(n) == total)),
        steps=60,
    )
    assert poor.bound >= best * (1 - 1e-12)


@pytest.mark.parametrize("seed, most, fold, n_slots, total", CASES)
def test_reduced_effort_for_large_tables_still_encloses_the_optimum(
    monkeypatch, seed, most, fold, n_slots, total
):
    monkeypatch.setattr(certificate, "_LARGE", 0)
    counts = random_counts(seed, most=most)
    found = certify_coverage(objective_of(counts, fold), total, n_slots=n_slots)
    best = best_of_all(counts, fold, n_slots, total)
    assert found.greedy <= found.value <= best * (1 + 1e-12) <= found.bound * (1 + 2e-12)
    assert found.steps <= certified(seed, most, fold, n_slots, total).steps


def test_some_cases_are_proven():
    assert sum(certified(*case).proven for case in CASES) >= 3


def test_bound_and_value_enclose_the_optimum_of_highs():
    counts = random_counts(5, slots=40, elements=200, share=0.08)
    objective = objective_of(counts, 1)
    found = certify_coverage(objective, 8)
    sees = counts[:, 0].T.astype(float)
    n_elements, slots = sees.shape
    cost = np.r_[np.zeros(slots), np.full(n_elements, -1.0)]
    coupling = csr_array(np.hstack([sees, -np.eye(n_elements)]))
    result = milp(
        cost,
        constraints=[
            LinearConstraint(coupling, lb=0.0),
            LinearConstraint(np.r_[np.ones(slots), np.zeros(n_elements)][None], 8, 8),
        ],
        bounds=Bounds(0.0, 1.0),
        integrality=np.r_[np.ones(slots), np.zeros(n_elements)],
        options={"mip_rel_gap": 0.02},
    )
    reached, relaxed = -result.fun / n_elements, -result.mip_dual_bound / n_elements
    assert found.bound >= reached * (1 - 1e-9)
    assert found.value <= relaxed * (1 + 1e-9)
    assert found.value >= 0.99 * reached


def test_runs_agree_in_every_bit():
    objective = objective_of(random_counts(9, slots=30, most=2), 2)
    one, two = (certify_coverage(objective, 8, n_slots=5, steps=60) for _ in range(2))
    assert one.orbit.tolist() == two.orbit.tolist()
    assert (one.value, one.bound, one.steps) == (two.value, two.bound, two.steps)


def longest_mean_and_wait(seen):
    """Mean over the targets of the three measures, in samples, from runs of a text."""
    found = []
    for column in seen.T:
        gaps = [len(run) for run in "".join("x" if s else "." for s in column).split("x") if run]
        wait = sum(n * n for n in gaps) / (2 * len(column))
        found.append((max(gaps, default=0), sum(gaps) / max(len(gaps), 1), wait))
    return np.mean(found, axis=0)


@pytest.mark.parametrize("most", [1, 3])
def test_gap_objectives_are_those_of_the_definition_and_of_enumeration(most):
    counts = random_counts(6, most=most, elements=17 * 11, share=0.3)
    objective = objective_of(counts, 1, (17, 11))
    for number, measure in enumerate(GAP_MEASURES):
        gap = GapObjective(objective.tables, measure)

        def direct_gap(orbit, n, number=number):
            seen = counts[list(orbit), np.asarray(n) - 1].sum(axis=0) > 0
            return 1.0 - longest_mean_and_wait(seen.reshape(17, 11))[number] / 17.0

        orbit, n = np.array([5, 1, 3]), np.full(3, most)
        value = gap.value(orbit, n)
        assert value == pytest.approx(direct_gap(orbit, n), rel=1e-14)
        h = gaps(objective.seen(orbit, n), 0.5)
        of_gaps = {"longest": h.longest_h, "mean": h.mean_h, "wait": h.wait_h}[measure]
        assert (1.0 - value) * 8.5 == pytest.approx(np.mean(of_gaps))
        assert gap.value([2, 2], [1, 1]) == 0.0
        replaced = gap.best_replacement(orbit, n, 1, 1, most, value)
        assert replaced == pytest.approx(
            Objective.best_replacement(gap, orbit, n, 1, 1, most, value)
        )
        found = certify_gaps(gap, 3 * most, n_slots=3, restarts=4)
        sizes = [k for k in product(range(1, most + 1), repeat=3) if sum(k) == 3 * most]
        best = max(direct_gap(c, k) for c in combinations(range(8), 3) for k in sizes)
        assert found.greedy <= found.value <= best * (1.0 + 1e-12) and best <= found.bound
        assert found.value >= 0.99 * best
    with pytest.raises(ConfigurationError, match="measure = 'least'"):
        GapObjective(objective.tables, "least")
    with pytest.raises(ConfigurationError, match="fold = 2"):
        GapObjective(objective_of(counts, 2, (17, 11)).tables, "wait")


def test_all_orbit_slots_are_proven_to_be_best():
    objective = objective_of(random_counts(3, slots=5), 1)
    found = certify_coverage(objective, 5)
    assert found.proven and found.gap == 0.0


@pytest.mark.parametrize("method", ["random", "tpe"])
def test_black_box_searches_take_coverage_and_stay_below_its_bound(method):
    objective = objective_of(random_counts(2, slots=12, most=3), 2)
    tried = hyperopt_search(
        objective, method=method, rng=np.random.default_rng(0), n_slots=3, max_evaluations=30
    )
    most = certify_coverage(objective, tried.n_satellites, n_slots=3)
    assert 0.0 < tried.value <= most.bound


SETTINGS = VisibilitySettings(limiting_magnitude=17.0)
MEMBERS = {"Halo_L2_S": 3, "Lyap_L3": 2}


@cache
def scene():
    """Orbits, targets, times and Sun."""
    times = observation_times(3.0, 3.0)
    target = np.random.default_rng(4).uniform(-1.2, 1.2, (13, 3))
    return observer_library(MEMBERS), target, times, sun_at(times)


@pytest.mark.parametrize("fold", [1, 2])
@pytest.mark.parametrize("window", ["sample", "day"])
def test_tables_of_slots_agree_with_plain_visibility(fold, window):
    orbits, target, times, sun = scene()
    tables = coverage_tables(
        orbits, target, times, sun, SETTINGS, max_satellites=3, fold=fold, window=window
    )
    objective = CoverageObjective(tables)
    day = np.minimum(np.arange(len(times)) // 8, 2)
    for orbit in range(len(orbits.state)):
        for n in (1, 2, 3):
            state, period = orbits.state[[orbit]], orbits.period[[orbit]]
            track = satellite_tracks(state, period, np.arange(n) / n, times)[0]
            seen = np.array([visible(path, target, sun, SETTINGS) for path in track])
            if window == "day":
                seen = np.stack([seen[:, day == d].any(axis=1) for d in range(3)], axis=1)
            observers = seen.sum(axis=0)
            expected = np.minimum(observers, fold).mean() / fold
            assert objective.value([orbit], [n]) == pytest.approx(expected, rel=1e-14)
            np.testing.assert_array_equal(objective.seen([orbit], [n], fold), observers >= fold)


def test_free_phases_cover_as_much_as_their_tracks():
    orbits, target, times, sun = scene()
    made = {"phases": 5, "max_stability_index": np.sort(orbits.stability_index)[3]}
    hours = CoverageObjective(coverage_tables(orbits, target, times, sun, SETTINGS, **made))
    days = CoverageObjective(
        coverage_tables(orbits, target, times, sun, SETTINGS, window="day", **made)
    )
    tables = hours.tables
    assert hours.n_orbits == 20
    assert tables.stability_index.max() <= made["max_stability_index"]
    found = certify_coverage(hours, 4, steps=50)
    orbit, phase = tables.orbit[found.orbit], tables.phase[found.orbit]
    track = architecture_tracks(
        orbits.state[orbit], orbits.period[orbit], found.satellites, times, phase=phase
    )
    measured = coverage(track, target, times, sun, SETTINGS)
    assert found.value == measured.union_coverage
    assert days.value(found.orbit, found.satellites) == pytest.approx(measured.target_days)
    assert measured.never_seen == np.sum(~hours.seen(found.orbit, found.satellites).any(axis=0))


def test_search_of_free_phases_moves_one_satellite_at_a_time():
    objective = objective_of(random_counts(11, slots=12), 1)
    found = coordinate_search(
        objective, np.random.default_rng(0), n_slots=4, total=4, restarts=0,
        starts=[greedy_coverage(objective, 4)],
    )  # fmt: skip
    for slot in range(4):
        rest = np.delete(found.orbit, slot)
        for other in range(12):
            if other not in rest:
                assert objective.value([*rest, other], np.ones(4, dtype=int)) <= found.value


@pytest.mark.parametrize(
    "change, message",
    [
        ({"phases": 0}, "phases"),
        ({"fold": 0}, "fold"),
        ({"window": "week"}, "window"),
        ({"max_stability_index": 0.5}, "max_stability_index"),
        ({"phases": 1.5}, "phases = 1.5"),
        ({"target": np.zeros((2, 2))}, "target has shape"),
        ({"target": [[4e5, 0.0, 0.0]]}, "target"),
        ({"times": [0.0, 1.0, 3.0]}, "equal steps"),
        ({"sun_position": np.ones((1, 3))}, "sun_position has shape"),
    ],
)
def test_impossible_tables_are_refused(change, message):
    names = "orbits", "target", "times", "sun_position"
    with pytest.raises(ConfigurationError, match=message):
        coverage_tables(**(dict(zip(names, scene(), strict=True)) | change), settings=SETTINGS)


@pytest.mark.parametrize("name", ["track", "target", "times", "sun_position"])
def test_arrays_that_do_not_belong_together_are_refused(name):
    _, target, times, sun = scene()
    given = {"track": np.zeros((1, times.size, 3)), "target": target, "times": times,
             "sun_position": sun, "settings": SETTINGS}  # fmt: skip
    assert coverage(**given).never_seen >= 0
    for wrong in (given[name][..., None], np.full(np.shape(given[name]), np.nan)):
        with pytest.raises(ConfigurationError, match=name):
            coverage(**(given | {name: wrong}))


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"n_satellites": 9}, "n_satellites = 9"),
        ({"n_satellites": 3, "n_slots": 4}, "n_satellites = 3"),
        ({"n_satellites": 3, "steps": 0}, "steps = 0"),
    ],
)
def test_impossible_numbers_of_satellites_or_steps_are_refused(changes, message):
    with pytest.raises(ConfigurationError, match=message):
        certify_coverage(objective_of(random_counts(0), 1), **changes)
