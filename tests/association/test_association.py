"""Association against enumeration of every possibility, and simulated truth."""

from itertools import product

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from cislunar.association import (
    Window,
    associate_frames,
    equivalent_direction,
    gate_threshold,
    gaussian_log_likelihood,
    joint_probabilities,
)
from cislunar.association.nearest_neighbor import nearest_neighbor
from cislunar.association.probabilistic import marginals
from cislunar.association.window import batches, updated
from cislunar.errors import ConfigurationError

WIDE = 1.0 - 1e-15


def window_of(rng, exposures, tracks, per_exposure, chance=0.8, near=1.5):
    """Any window: every detection is a candidate of every track."""
    n = 3
    roots = rng.normal(size=(tracks, n, n)) + 2.0 * np.eye(n)
    pairs = [
        (k, t, k * per_exposure + d)
        for k in range(exposures)
        for t in range(tracks)
        for d in range(per_exposure)
    ]
    exposure, track, detection = np.array(pairs).T
    design = rng.normal(size=(exposures * tracks, 2, n))[exposure * tracks + track]
    seen = np.array([(k, t) for k in range(exposures) for t in range(tracks)])
    return Window(
        0.2 * roots @ roots.swapaxes(1, 2),
        exposure,
        track,
        detection,
        near * rng.normal(size=(len(pairs), 2)),
        design,
        np.full((len(pairs), 2), 0.3),
        rng.normal(2.0, 1.0, size=len(pairs)),
        seen,
        np.full(len(seen), np.log(1.0 - chance)),
    )


def innovation(residual, design, noise, shift, covariance):
    return residual - design @ shift, design @ covariance @ design.T + np.diag(noise)


def histories(window, exposures, tracks):
    """Every compatible joint history: rows of pairs, or none, by exposure and track."""
    choices = []
    for k in range(exposures):
        here = [
            [None, *np.flatnonzero((window.exposure == k) & (window.track == t)).tolist()]
            for t in range(tracks)
        ]
        joint = []
        for each in product(*here):
            taken = [int(window.detection[p]) for p in each if p is not None]
            if len(set(taken)) == len(taken):
                joint.append(each)
        choices.append(joint)
    yield from product(*choices)


def score(window, history, t):
    """Log-likelihood ratio of the history of one track, and its number of detections."""
    total, shift, covariance, count = 0.0, np.zeros(3), window.covariance[t], 0
    misses = dict(zip(map(tuple, window.seen.tolist()), window.log_miss, strict=True))
    for k, each in enumerate(history):
        p = each[t]
        if p is None:
            total += misses[k, t]
            continue
        given = window.design[p], window.noise[p], shift, covariance
        nu, s = innovation(window.residual[p], *given)
        total += window.log_weight[p] + multivariate_normal(np.zeros(2), s).logpdf(nu)
        shift, covariance = updated(nu, s, window.design[p], shift, covariance)
        count += 1
    return total, count


def taken(found):
    return sorted(zip(found.track.tolist(), found.detection.tolist(), strict=True))


def test_log_likelihood_has_all_constants():
    rng = np.random.default_rng(1)
    root = rng.normal(size=(5, 3, 3))
    s, nu = root @ root.swapaxes(1, 2) + np.eye(3), rng.normal(size=(5, 3))
    squared, log_likelihood = gaussian_log_likelihood(nu, s)
    for k in range(5):
        peer = multivariate_normal(np.zeros(3), s[k])
        assert log_likelihood[k] == pytest.approx(peer.logpdf(nu[k]), rel=1e-12)
        assert squared[k] == pytest.approx(nu[k] @ np.linalg.inv(s[k]) @ nu[k], rel=1e-10)
    assert gate_threshold(0.9, 2) == pytest.approx(-2.0 * np.log(0.1), rel=1e-12)


@pytest.mark.parametrize("seed", range(6))
def test_nearest_neighbor_is_the_best_assignment_of_one_exposure(seed):
    window = window_of(np.random.default_rng(seed), 1, 3, 3)
    best = max(
        histories(window, 1, 3), key=lambda one: sum(score(window, one, t)[0] for t in range(3))
    )
    expected = sorted((t, int(window.detection[p])) for t, p in enumerate(best[0]) if p is not None)
    assert taken(nearest_neighbor(window, WIDE)) == expected


@pytest.mark.parametrize("seed", range(6))
def test_joint_probabilities_are_the_sum_over_all_assignments(seed):
    window = window_of(np.random.default_rng(seed), 1, 3, 3)
    expected, whole = {}, 0.0
    for history in histories(window, 1, 3):
        weight = np.exp(sum(score(window, history, t)[0] for t in range(3)))
        whole += weight
        for t, p in enumerate(history[0]):
            if p is not None:
                key = t, int(window.detection[p])
                expected[key] = expected.get(key, 0.0) + weight
    gain = [
        score(window, [tuple(p if t == track else None for t in range(3))], track)[0]
        - score(window, [(None,) * 3], track)[0]
        for p, track in enumerate(window.track.tolist())
    ]
    found = marginals(window.track, window.detection, np.array(gain))
    for t, d, w in zip(window.track.tolist(), window.detection.tolist(), found, strict=True):
        assert w == pytest.approx(expected[t, d] / whole, rel=1e-9)
    rows = joint_probabilities(window, WIDE)
    for t, d, w in zip(rows.track.tolist(), rows.detection.tolist(), rows.weight, strict=True):
        own = {key: each / whole for key, each in expected.items() if key[0] == t}
        assert w == pytest.approx(sum(own.values()), rel=1e-5)
        assert own[t, d] == max(own.values())


@pytest.mark.parametrize("seed", range(6))
def test_an_equivalent_direction_does_what_the_weighted_update_does(seed):
    """The mean exactly; the covariance is never smaller."""
    rng = np.random.default_rng(seed)
    n, weight = 3, np.array([0.5, 0.3])
    root = rng.normal(size=(n, n))
    covariance, design, noise = root @ root.T + np.eye(n), rng.normal(size=(2, n)), np.full(2, 0.3)
    s = design @ covariance @ design.T + np.diag(noise)
    nu = 0.5 * rng.normal(size=(2, 2))
    mean = weight @ nu
    spread = sum(w * np.outer(v, v) for w, v in zip(weight, nu, strict=True)) - np.outer(mean, mean)
    gain = covariance @ design.T @ np.linalg.inv(s)
    wanted = covariance - gain @ (weight.sum() * s - spread) @ gain.T
    effective = weight.sum() * s - spread
    innovation_, variance = equivalent_direction(mean[None], effective[None], s[None], noise[None])
    assert np.all(np.isfinite(variance)) and np.all(variance >= noise)
    full = s @ np.linalg.inv(effective) @ s  # covariance of the innovation before it is diagonal
    shift = covariance @ design.T @ np.linalg.inv(full) @ innovation_[0]
    np.testing.assert_allclose(shift, gain @ mean, rtol=1e-10)
    np.testing.assert_allclose(
        covariance - covariance @ design.T @ np.linalg.inv(full) @ design @ covariance, wanted,
        rtol=1e-9, atol=1e-12,
    )  # fmt: skip
    total = design @ covariance @ design.T + np.diag(variance[0])
    cautious = covariance - covariance @ design.T @ np.linalg.inv(total) @ design @ covariance
    assert np.linalg.eigvalsh(cautious - wanted).min() > -1e-10


def test_exposures_of_a_batch_have_no_track_in_common():
    window = window_of(np.random.default_rng(1), 4, 3, 2)
    apart = window._replace(track=3 * window.exposure + window.track,
                            covariance=np.tile(np.eye(3), (12, 1, 1)))  # fmt: skip
    assert [rows.size for rows in batches(window)] == [6] * 4
    assert [rows.size for rows in batches(apart)] == [24]


def test_marginals_of_large_ratios_stay_finite():
    found = marginals([0, 0, 1], [0, 1, 1], np.array([800.0, 780.0, 790.0]))
    assert found == pytest.approx([1.0, 0.0, 1.0], abs=1e-6)


@pytest.mark.parametrize("seed", range(6))
def test_windows_take_the_best_of_all_joint_histories(seed):
    window = window_of(np.random.default_rng(seed), 2, 2, 2)
    best = max(
        histories(window, 2, 2), key=lambda one: sum(score(window, one, t)[0] for t in range(2))
    )
    expected = sorted(
        (t, int(window.detection[p])) for each in best for t, p in enumerate(each) if p is not None
    )
    assert taken(associate_frames(window, WIDE, 1, 2, 1000)) == expected


@pytest.mark.parametrize("seed", range(4))
def test_confirmation_leaves_out_histories_of_few_detections(seed):
    window = window_of(np.random.default_rng(seed), 3, 2, 1)

    def worth(one):
        of_track = [score(window, one, t) for t in range(2)]
        if any(0 < count < 2 for _, count in of_track):
            return -np.inf
        return sum(each for each, _ in of_track)

    best = max(histories(window, 3, 2), key=worth)
    expected = sorted(
        (t, int(window.detection[p])) for each in best for t, p in enumerate(each) if p is not None
    )
    assert taken(associate_frames(window, WIDE, 2, 3, 1000)) == expected


def clutter_window(rng, exposures, present, density=0.05):
    """One track of known covariance, false alarms in its gate, and perhaps its detections."""
    sigma, chance = 0.1, 0.9
    rows, truth, number = [], [], 0
    shift = rng.normal(size=2)
    for k in range(exposures):
        if present and rng.random() < chance:
            rows.append((k, 0, number, *(shift + sigma * rng.normal(size=2))))
            truth.append(number)
            number += 1
        for _ in range(rng.poisson(density * 100.0)):
            rows.append((k, 0, number, *rng.uniform(-5.0, 5.0, size=2)))
            number += 1
    exposure, track, detection = np.array([each[:3] for each in rows]).T.astype(np.int64)
    residual = np.array([each[3:] for each in rows])
    n = len(rows)
    seen = np.array([(k, 0) for k in range(exposures)])
    weight = np.full(n, np.log(chance / density))
    design, noise = np.tile(np.eye(2), (n, 1, 1)), np.full((n, 2), sigma**2)
    miss = np.full(exposures, np.log(1.0 - chance))
    return Window(np.eye(2)[None], exposure, track, detection, residual, design, noise, weight,
                  seen, miss), set(truth)  # fmt: skip


def test_a_faint_target_in_clutter_needs_more_than_one_exposure():
    """What nearest neighbors take of an absent target, a window of exposures refuses."""
    wrong = {"nearest": 0, "frames": 0}
    found_of_present = total = 0
    for seed in range(40):
        rng = np.random.default_rng([7, seed])
        absent, _ = clutter_window(rng, 5, False)
        wrong["nearest"] += nearest_neighbor(absent, 0.9999).track.size > 0
        wrong["frames"] += associate_frames(absent, 0.9999, 3, 5, 100).track.size > 0
        present, truth = clutter_window(rng, 5, True)
        found = set(associate_frames(present, 0.9999, 3, 5, 100).detection.tolist())
        found_of_present += len(found & truth)
        total += len(truth)
    assert wrong["nearest"] >= 35
    assert wrong["frames"] <= 4
    assert found_of_present > 0.9 * total


def test_methods_agree_where_nothing_is_in_doubt():
    window, truth = clutter_window(np.random.default_rng(3), 5, True, density=1e-4)
    clean = np.isin(window.detection, list(truth))
    columns = ("exposure", "track", "detection", "residual", "design", "noise", "log_weight")
    window = window._replace(**{key: getattr(window, key)[clean] for key in columns})
    expected = sorted((0, d) for d in truth)
    assert taken(nearest_neighbor(window, 0.9999)) == expected
    assert taken(associate_frames(window, 0.9999, 3, 5, 50)) == expected
    weights = joint_probabilities(window, 0.9999)
    assert taken(weights) == expected and np.all(weights.weight > 0.95)


def test_an_impossible_gate_is_one_line():
    with pytest.raises(ConfigurationError, match=r"gate_probability = 1\.0"):
        gate_threshold(1.0, 2)
