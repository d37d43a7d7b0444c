"""The compiled TPE against Hyperopt's own functions, and its suggestions in distribution."""

import numpy as np
import pytest
from scipy.stats import chi2_contingency, chisquare, ks_2samp, kstest

from cislunar.parzen import (
    STARTUP,
    ParzenSearch,
    forgetting_weights,
    mixture,
    mixture_density,
    parzen_window,
)

LABELS, CATEGORIES = 3, 4


def history(trials, seed=0):
    """Trials of some intervals and one category, and their losses.

    None are equal: which of equal trials are among the good ones hangs on the machine in Hyperopt.
    """
    rng = np.random.default_rng(seed)
    values = rng.uniform(0.0, [2.0] * LABELS + [CATEGORIES], (trials, LABELS + 1))
    values[:, -1] = np.floor(values[:, -1])
    loss = ((values[:, :LABELS] - [0.3, 1.0, 1.9]) ** 2).sum(axis=1)
    return values, loss + 0.3 * values[:, -1]


def ours(values, losses, draws, seed=0):
    search = ParzenSearch(
        [0.0] * (LABELS + 1),
        [2.0] * LABELS + [CATEGORIES],
        [0] * LABELS + [CATEGORIES],
        np.random.default_rng(seed),
    )
    for each, loss in zip(values, losses, strict=True):
        search.tell(each, loss)
    return np.array([search.suggest() for _ in range(draws)])


def theirs(values, losses, draws):
    from hyperopt import STATUS_OK, Trials, hp, tpe
    from hyperopt.base import Domain

    names = [f"x{j}" for j in range(LABELS)] + ["y"]
    space = {name: hp.uniform(name, 0.0, 2.0) for name in names[:-1]}
    domain = Domain(lambda sample: 0.0, space | {"y": hp.randint("y", CATEGORIES)})
    ids = list(range(len(values)))
    misc = [
        {
            "tid": i,
            "cmd": domain.cmd,
            "workdir": None,
            "idxs": {name: [i] for name in names},
            "vals": {name: [row[j] if j < LABELS else int(row[j])] for j, name in enumerate(names)},
        }
        for i, row in zip(ids, values, strict=True)
    ]
    results = [{"status": STATUS_OK, "loss": float(loss)} for loss in losses]
    trials = Trials()
    docs = trials.new_trial_docs(ids, [None] * len(ids), results, misc)
    for doc in docs:
        doc["state"] = 2
    trials.insert_trial_docs(docs)
    trials.refresh()
    found = []
    for seed in range(draws):
        vals = tpe.suggest([len(ids)], domain, trials, seed, verbose=False)[0]["misc"]["vals"]
        found.append([vals[name][0] for name in names])
    return np.array(found, dtype=float)


@pytest.mark.parametrize("number", [0, 1, 2, 3, 24, 25, 26, 27, 400])
def test_mixtures_are_those_of_hyperopt(number):
    from hyperopt.tpe import GMM1_lpdf, adaptive_parzen_normal, linear_forgetting_weights

    rng = np.random.default_rng(number)
    values = rng.uniform(-1.0, 3.0, number)
    np.testing.assert_allclose(
        forgetting_weights(number), linear_forgetting_weights(number, 25), rtol=1e-14
    )
    expected = adaptive_parzen_normal(values, 1.0, 1.0, 4.0)
    order = np.argsort(values)
    window = parzen_window(values[order], forgetting_weights(number)[order], -1.0, 3.0)
    for found, known in zip(window, expected, strict=True):
        np.testing.assert_allclose(found, known, rtol=1e-13)
    x = rng.uniform(-1.0, 3.0, 50)
    ratio = np.log([mixture_density(each, *mixture(*window)) for each in x]) - GMM1_lpdf(
        x, *expected
    )
    np.testing.assert_allclose(ratio, ratio[0], rtol=0.0, atol=1e-11)


@pytest.mark.parametrize("trials, draws", [(30, 150), (500, 60)])
def test_suggestions_are_distributed_as_hyperopts(trials, draws):
    stored = history(trials)
    here, there = ours(*stored, 2000), theirs(*stored, draws)
    for j in range(LABELS):
        assert ks_2samp(here[:, j], there[:, j]).pvalue > 1e-3
    counts = [np.bincount(each[:, -1].astype(int), minlength=CATEGORIES) for each in (here, there)]
    counts = np.array(counts)[:, np.sum(counts, axis=0) > 0]
    assert counts.shape[1] == 1 or chi2_contingency(counts).pvalue > 1e-3
    # the test can tell: without the last trials the suggestions are others
    other = ours(stored[0][:STARTUP], stored[1][:STARTUP], 2000)
    assert min(ks_2samp(here[:, j], other[:, j]).pvalue for j in range(LABELS)) < 1e-6


def test_startup_is_uniform():
    drawn = ours(*history(STARTUP - 1), 2000)
    assert kstest(drawn[:, 0], "uniform", args=(0.0, 2.0)).pvalue > 1e-3
    assert chisquare(np.bincount(drawn[:, -1].astype(int))).pvalue > 1e-3


def test_ties_go_to_the_older_trials():
    values, losses = history(300)
    tied = np.where(np.argsort(np.argsort(losses)) < 10, 0.0, 1.0 + losses)
    older = tied + 1e-9 * np.arange(300)
    np.testing.assert_array_equal(ours(values, tied, 5), ours(values, older, 5))
