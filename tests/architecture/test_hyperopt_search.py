"""Hyperopt searches: repeatability, early stop, and labels that reach every architecture."""

import importlib.util
import itertools

import numpy as np
import pytest
from hyperopt import Trials, rand
from hyperopt.base import Domain
from scipy.stats import chi2_contingency, chisquare

from cislunar.architecture.cost import CostFunction
from cislunar.architecture.hyperopt_search import hyperopt_search, stopping_evaluation
from cislunar.architecture.search_space import LABELS, build_space, hyperopt_space
from cislunar.architecture.tables import ArchitectureTables
from cislunar.errors import ConfigurationError

FAMILIES = np.repeat(["Butterfly_N", "Halo_L2_S", "Lyap_L1"], [2, 5, 3])


def make_objective(family=FAMILIES, *, counts=3, n_targets=8, seed=0, stability=None):
    """J over random tables of the given families."""
    rng = np.random.default_rng(seed)
    n = len(family)
    stability = 1.0 + rng.exponential(2.0, n) if stability is None else stability
    tables = ArchitectureTables(
        observations=rng.integers(0, 30, (n, counts, n_targets)).astype(np.uint16),
        distance=rng.uniform(1.0, 3.0, (n, 1)) * np.arange(1, counts + 1),
        stability_index=stability,
        family=np.asarray(family),
        n_steps=10,
    )
    return CostFunction(tables)


def draw(space, n, seed=0):
    """Samples of a search space by Hyperopt."""
    from hyperopt.pyll.stochastic import sample

    rng, expressions = np.random.default_rng(seed), hyperopt_space(space)
    return [sample(expressions, rng) for _ in range(n)]


@pytest.mark.parametrize("labels", LABELS)
def test_labels_reach_every_orbit_and_count(labels):
    objective = make_objective()
    space, decode = build_space(objective, n_slots=2, labels=labels)
    decoded = [decode(each) for each in draw(space, 800)]
    for slot in range(2):
        assert {int(orbit[slot]) for orbit, _ in decoded} == set(range(10))
        assert {int(count[slot]) for _, count in decoded} == {1, 2, 3}


@pytest.mark.parametrize("labels", ["index", "stability_rank", "categorical"])
def test_orbits_are_drawn_uniformly(labels):
    space, decode = build_space(make_objective(), n_slots=1, labels=labels)
    decoded = [decode(each) for each in draw(space, 3000)]
    orbits = np.bincount([orbit[0] for orbit, _ in decoded], minlength=10)
    counts = np.bincount([count[0] for _, count in decoded], minlength=4)[1:]
    assert chisquare(orbits).pvalue > 1e-4
    assert chisquare(counts).pvalue > 1e-4


def test_family_positions_are_uniform_over_families_and_within_each():
    space, decode = build_space(make_objective(), n_slots=1, labels="family_position")
    orbits = np.bincount([decode(s)[0][0] for s in draw(space, 3000)], minlength=10)
    sizes = np.array([2, 5, 3])
    assert chisquare(orbits, np.repeat(1000 / sizes, sizes)).pvalue > 1e-4


def test_ends_of_a_family_position():
    _, decode = build_space(make_objective(), n_slots=1, labels="family_position")
    for family, (first, last) in enumerate([(0, 1), (2, 6), (7, 9)]):
        sample = {"family_0": family, "satellites_0": 1}
        assert decode(sample | {"position_0": 0.0})[0][0] == first
        assert decode(sample | {"position_0": 1.0})[0][0] == last
        assert decode(sample | {"position_0": np.nextafter(1.0, 0.0)})[0][0] == last


def test_stability_rank_puts_the_steadiest_orbit_first():
    objective = make_objective()
    _, decode = build_space(objective, n_slots=1, labels="stability_rank")
    ranked = [decode({"orbit_0": rank, "satellites_0": 1})[0][0] for rank in range(10)]
    assert sorted(ranked) == list(range(10))
    assert np.all(np.diff(objective.stability_index[ranked]) >= 0.0)


@pytest.mark.parametrize("n_slots", [0, 11])
def test_more_slots_than_orbits_are_refused(n_slots):
    with pytest.raises(ConfigurationError, match=rf"slots = {n_slots} must lie in 1 \.\. 10"):
        build_space(make_objective(), n_slots=n_slots)


def test_unknown_labels_are_refused():
    with pytest.raises(ConfigurationError, match=r"labels = 'color'.*family_position"):
        build_space(make_objective(), n_slots=2, labels="color")


def search(method="random", seed=1, **options):
    """A small search."""
    setting = {"n_slots": 3, "max_evaluations": 40, "early_stop": None} | options
    rng = np.random.default_rng(seed)
    return hyperopt_search(make_objective(), method=method, rng=rng, **setting)


@pytest.mark.parametrize("method", ["tpe", "tpe-compiled", "random"])
def test_same_seed_same_search(method):
    first, again, other = search(method), search(method), search(method, seed=2)
    np.testing.assert_array_equal(first.history, again.history)
    np.testing.assert_array_equal(first.orbit_trials, again.orbit_trials)
    np.testing.assert_array_equal(first.orbit, again.orbit)
    assert not np.array_equal(first.history, other.history)


@pytest.mark.parametrize(
    "method, labels", [*itertools.product(["tpe"], LABELS), ("random", "index")]
)
def test_result_is_the_best_of_the_evaluations(method, labels):
    found = search(method, labels=labels)
    objective = make_objective()
    assert found.history.shape == (40,)
    values = [
        objective.value(orbit, count)
        for orbit, count in zip(found.orbit_trials, found.satellites_trials, strict=True)
    ]
    np.testing.assert_array_equal(found.history, values)
    assert found.value == pytest.approx(max(values), rel=1e-13)
    assert np.all(np.diff(found.orbit) > 0)
    assert objective.value(found.orbit, found.satellites) == found.value
    best = int(np.argmax(values))
    assert found.n_satellites == found.satellites_history[best]


@pytest.mark.parametrize("labels", LABELS)
def test_random_draws_are_as_likely_as_hyperopts(labels):
    """Members of each family and satellites per orbit, against draws by Hyperopt itself."""
    objective = make_objective()
    found = search(labels=labels, n_slots=1, max_evaluations=4000)
    space, decode = build_space(objective, n_slots=1, labels=labels)
    trials = rand.suggest(range(4000), Domain(lambda _: 0.0, hyperopt_space(space)), Trials(), 3)
    drawn = [{name: value[0] for name, value in t["misc"]["vals"].items()} for t in trials]
    reference = [np.concatenate(each) for each in zip(*map(decode, drawn), strict=True)]
    for own, other in zip((found.orbit_trials, found.satellites_trials), reference, strict=True):
        table = [np.bincount(v.ravel(), minlength=objective.n_orbits) for v in (own, other)]
        seen = np.sum(table, axis=0) > 0
        assert chi2_contingency(np.array(table)[:, seen]).pvalue > 1e-4


def test_tpe_learns_where_random_search_does_not():
    # 60 orbits in six families, one family far better: over three seeds TPE must come out ahead.
    family = np.repeat([f"family {k}" for k in range(6)], 10)
    stability = np.where(family == "family 4", 1.0, 200.0)
    objective = make_objective(family, seed=5, stability=stability)
    reached = {
        method: [
            hyperopt_search(
                objective, method=method, rng=np.random.default_rng(seed), n_slots=3,
                max_evaluations=120, early_stop=None,
            ).value
            for seed in range(3)
        ]
        for method in ("tpe", "random")
    }  # fmt: skip
    assert np.median(reached["tpe"]) > np.median(reached["random"])


def stop_by_definition(history, patience):
    """Evaluations until `patience` in a row have not improved by 1e-9, one at a time."""
    best, since = -np.inf, 0
    for evaluation, value in enumerate(history):
        if value > best * (1.0 + 1e-9):
            best, since = value, 0
        else:
            since += 1
        if since >= patience:
            return evaluation + 1
    return len(history)


@pytest.mark.parametrize("patience", [1, 2, 3, 7, 40])
def test_stopping_evaluation_by_definition(patience):
    rng = np.random.default_rng(patience)
    for length in (1, 2, 5, 30):
        for _ in range(40):
            history = rng.integers(0, 6, length) * rng.random()
            assert stopping_evaluation(history, patience) == stop_by_definition(history, patience)


def test_gains_within_rounding_do_not_reset_patience():
    history = np.array([1.0, 2.0, *(2.0 + 1e-15 * np.arange(1, 40)), 3.0])
    assert np.all(np.diff(history) > 0.0)
    assert stopping_evaluation(history, 10) == 12
    assert stopping_evaluation(history, 39) == 41 and stopping_evaluation(history, 40) == 42


@pytest.mark.parametrize("method", ["tpe", "random"])
@pytest.mark.parametrize("patience", [1, 5, 11])
def test_early_stop_counts_evaluations_without_improvement(method, patience):
    stopped = search(method, early_stop=patience, max_evaluations=60)
    full = search(method, max_evaluations=60)
    count = len(stopped.history)
    assert count == stop_by_definition(full.history, patience) < 60
    np.testing.assert_array_equal(stopped.history, full.history[:count])
    assert stopped.value == pytest.approx(full.history[:count].max(), rel=1e-13)


def test_random_search_over_several_batches_makes_every_evaluation():
    assert len(search(max_evaluations=1203).history) == 1203


def test_progress_counts_evaluations():
    calls = []
    search(max_evaluations=12, progress=lambda done, total: calls.append((done, total)))
    assert calls == [(k, 12) for k in range(1, 13)]


def test_atpe_without_its_package_says_what_to_install(monkeypatch):
    find_spec = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util,
        "find_spec",
        lambda name, *rest: None if name == "lightgbm" else find_spec(name, *rest),
    )
    with pytest.raises(ConfigurationError, match="pip install lightgbm"):
        search("atpe")


def test_unknown_optimizer_is_refused():
    with pytest.raises(ConfigurationError, match=r"'anneal' must be one of .*tpe"):
        search("anneal")
