from itertools import permutations

import numpy as np
import pytest

from cislunar.errors import ConfigurationError
from cislunar.tasking.planning.assignment import IDLE, METHODS, assign, total_information

BUDGET = {"max_evaluations": 40, "early_stop": 40}


@pytest.fixture
def information():
    rng = np.random.default_rng(5)
    matrix = rng.exponential(2.0, size=(6, 9))
    matrix[rng.random(matrix.shape) < 0.3] = 0.0
    return matrix


def _run(matrix, method, seed=0):
    return assign(matrix, method, rng=np.random.default_rng(seed), **BUDGET)


@pytest.mark.parametrize("shape", [(3, 5), (5, 3), (4, 4)])
def test_exact_is_the_best_of_all_permutations(shape):
    matrix = np.random.default_rng(1).exponential(size=shape)
    small = matrix if shape[0] <= shape[1] else matrix.T
    rows = np.arange(small.shape[0])
    best = max(small[rows, list(p)].sum() for p in permutations(range(small.shape[1]), rows.size))
    assert assign(matrix).information == pytest.approx(best)


@pytest.mark.parametrize("method", METHODS)
def test_every_method_is_one_to_one_and_none_beats_exact(information, method):
    result = _run(information, method)
    busy = result.target[result.target != IDLE]
    assert np.unique(busy).size == busy.size
    assert result.target.shape == (6,)
    assert result.information == pytest.approx(total_information(information, result.target))
    assert result.information <= assign(information).information + 1e-12
    assert result.history[-1] == pytest.approx(result.information)
    assert np.all(np.diff(result.history) >= 0.0)


@pytest.mark.parametrize("method", METHODS)
def test_surplus_observers_and_pairs_without_information_are_idle(method):
    matrix = np.zeros((4, 2))
    matrix[1, 0] = 3.0
    result = _run(matrix, method)
    assert (result.target != IDLE).sum() <= 1
    assert set(result.target[result.target != IDLE]) <= {0}
    crowded = _run(np.ones((5, 2)), method)
    assert sorted(crowded.target)[:3] == [IDLE] * 3
    assert sorted(crowded.target)[3:] == [0, 1]


@pytest.mark.parametrize("method", METHODS)
def test_same_generator_same_tasking(information, method):
    first, second = (_run(information, method, seed=7) for _ in range(2))
    np.testing.assert_array_equal(first.target, second.target)
    np.testing.assert_array_equal(first.history, second.history)


def test_greedy_takes_the_best_pair_first():
    matrix = np.array([[10.0, 9.0], [9.0, 1.0]])
    greedy = assign(matrix, "greedy")
    assert greedy.target.tolist() == [0, 1]
    assert greedy.information == 11.0
    assert assign(matrix).information == 18.0


@pytest.mark.parametrize("method", ["exact", "greedy", "tpe", "tpe-compiled", "random"])
def test_negative_information_is_no_information(method):
    """By the sum, 0.9 and 0 would be better than 1 and -5."""
    matrix = np.array([[1.0, 0.9], [0.0, -5.0]])
    found = assign(matrix, method, rng=np.random.default_rng(0))
    assert (found.target.tolist(), found.information) == ([0, IDLE], 1.0)
    none = assign(-np.ones((2, 3)), method, rng=np.random.default_rng(0))
    assert (none.target.tolist(), none.information) == ([IDLE, IDLE], 0.0)


def test_searches_spend_their_budget_and_stop_early():
    flat = np.ones((2, 6))  # every tasking is as good as the first: no progress at all
    for method, tried in (("tpe", {10, 11}), ("random", {11})):
        result = assign(
            flat, method, rng=np.random.default_rng(0), max_evaluations=60, early_stop=10
        )
        assert result.history.size in tried, method
    matrix = np.random.default_rng(2).exponential(size=(2, 6))
    result = assign(matrix, "tpe", rng=np.random.default_rng(0), max_evaluations=25, early_stop=100)
    assert result.history.size == 25


def test_a_weight_per_target_reaches_the_optimum_of_one_observer():
    """With one observer the top weight is all that counts; both searches must find it."""
    matrix = np.array([[0.1, 0.4, 5.0, 0.2]])
    for method in ("tpe", "random"):
        assert _run(matrix, method).target.tolist() == [2]


def test_bad_arguments_name_the_key(information):
    with pytest.raises(ConfigurationError, match="method"):
        assign(information, "best")
    with pytest.raises(ConfigurationError, match="rng"):
        assign(information, "tpe")
    with pytest.raises(ConfigurationError, match="max_evaluations"):
        assign(information, "random", rng=np.random.default_rng(0), max_evaluations=0)
    with pytest.raises(ConfigurationError, match="finite"):
        assign(np.full((2, 2), np.nan))


@pytest.mark.parametrize("target", [[0], [0, 5], [0, -2], [[0, 1]]])
def test_targets_that_do_not_exist_are_refused(target):
    with pytest.raises(ConfigurationError, match="target must be 2 whole numbers"):
        total_information(np.ones((2, 3)), target)
