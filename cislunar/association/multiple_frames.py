"""Assignment over a window of exposures: whole histories of tracks compete for detections.

A hypothesis of a track names its detection, or a missed one, in every exposure that had the track
in the field of view; its score is the logarithm of the likelihood ratio of that history, from the
innovations one after the other. The best compatible set has one hypothesis of each track and no
detection twice: a set packing problem that HiGHS solves to proven optimality over the hypotheses
that were generated (Poore 1994, Computational Optimization and Applications 3, 27).

A track in clutter takes detections of a window only if enough of its exposures have one: a target
is detected in most exposures, false alarms lie in the gate of one. Detections that are far more
likely of the track than false alarms need no such confirmation.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import csr_array

from cislunar.association.likelihood import gate_threshold
from cislunar.association.window import Association, Window, clusters, decided
from cislunar.compiled import njit, njit_noalloc
from cislunar.runtime import Indices

_DROP = 20.0
"""Logarithm of the likelihood ratio to the best history of a track from which one is dropped."""


def associate_frames(
    window: Window,
    gate_probability: float,
    confirmations: int,
    span: int,
    most: int,
    certain: float = np.inf,
) -> Association:
    """Assign the detections of all exposures of a window together.

    Parameters
    ----------
    window : Window
    gate_probability : float
        Probability that the gate keeps the detection of a target.
    confirmations, span : int
        Detections that a track needs of `span` exposures, else it takes none: the same share of
        more exposures, and as many of fewer.
    most : int
        Largest number of hypotheses of a track.
    certain : float
        Logarithm of the likelihood ratio of a history's detections from which it needs no
        confirmation. Missed detections do not count, since a target may be darker than expected.

    Returns
    -------
    Association
        The best of all compatible sets of hypotheses.

    Raises
    ------
    ConfigurationError
        If `gate_probability` does not lie between 0 and 1.
    """
    n_tracks, n = window.covariance.shape[:2]
    rows = np.lexsort((window.exposure, window.track))
    chances = np.lexsort((window.seen[:, 0], window.seen[:, 1]))
    edges = np.arange(n_tracks + 1)
    begins = np.searchsorted(window.track[rows], edges)
    chance_begins = np.searchsorted(window.seen[chances, 1], edges)
    length = int(np.diff(chance_begins).max(initial=0))
    room = most * np.count_nonzero(np.diff(begins))
    track, score = np.empty(room, dtype=np.int64), np.empty(room)
    pairs = np.full((room, length), -1)
    beam = [
        (np.empty(most), np.empty((most, length), dtype=np.int64), np.empty((most, n)),
         np.empty((most, n, n)))
        for _ in range(2)
    ]  # fmt: skip
    model = gate_threshold(gate_probability, 2), confirmations, confirmations / span, certain
    data = window.exposure, window.residual, window.design, window.noise, window.log_weight
    place = rows, begins, chances, chance_begins
    count = _find_histories(window.covariance, data, window.seen, window.log_miss, place, model,
                            tuple(beam), (track, score, pairs))  # fmt: skip
    chosen = _packed(window, track[:count], score[:count], pairs[:count])
    taken = pairs[chosen]
    return decided(window, taken[taken >= 0])


@njit_noalloc
def _likelihood(data, p, shift, covariance, nu, s):
    """Squared distance and log-likelihood ratio of pair p; innovation and its covariance (a, b, c)
    go into `nu` and `s`."""
    _, residual, design, noise, log_weight = data
    for i in range(2):
        nu[i] = residual[p, i]
        for c in range(shift.size):
            nu[i] -= design[p, i, c] * shift[c]
    s[0], s[1], s[2] = noise[p, 0], 0.0, noise[p, 1]
    for c in range(shift.size):
        for d in range(shift.size):
            left = covariance[c, d]
            s[0] += design[p, 0, c] * left * design[p, 0, d]
            s[1] += design[p, 0, c] * left * design[p, 1, d]
            s[2] += design[p, 1, c] * left * design[p, 1, d]
    determinant = s[0] * s[2] - s[1] * s[1]
    squared = s[2] * nu[0] ** 2 - 2.0 * s[1] * nu[0] * nu[1] + s[0] * nu[1] ** 2
    squared /= determinant
    return squared, log_weight[p] - 0.5 * (squared + np.log(determinant)) - np.log(2.0 * np.pi)


@njit_noalloc
def _update(design, nu, s, shift, covariance, gain):
    """Kalman update of a shift and a covariance, in place; `gain` (2, n, 2) is scratch."""
    determinant, n = s[0] * s[2] - s[1] * s[1], shift.size
    for c in range(n):
        u = v = 0.0
        for d in range(n):
            u += covariance[c, d] * design[0, d]
            v += covariance[c, d] * design[1, d]
        gain[0, c, 0], gain[0, c, 1] = u, v
        gain[1, c, 0] = (u * s[2] - v * s[1]) / determinant
        gain[1, c, 1] = (v * s[0] - u * s[1]) / determinant
    for c in range(n):
        shift[c] += gain[1, c, 0] * nu[0] + gain[1, c, 1] * nu[1]
        for d in range(c + 1):
            less = gain[1, c, 0] * gain[0, d, 0] + gain[1, c, 1] * gain[0, d, 1]
            covariance[c, d] -= less
            covariance[d, c] = covariance[c, d]


@njit(cache=True, error_model="numpy")
def _find_histories(start, data, seen, log_miss, place, model, beams, out):
    """Hypotheses of all tracks that beat the one without any detection, best first; returns their
    number."""
    rows, begins, chances, chance_begins = place
    gate, fewest, share, certain = model
    track, score, pairs = out
    most, n = beams[0][0].size, start.shape[1]
    nu, s, gain, count = np.empty(2), np.empty(3), np.empty((2, n, 2)), 0
    room = most * (1 + rows.size)
    grown = np.empty(room), np.empty((room, 2), dtype=np.int64)
    for j in range(start.shape[0]):
        if begins[j] == begins[j + 1]:
            continue
        old, new, live, at, nothing = 0, 1, 1, begins[j], 0.0
        beams[0][0][0] = 0.0
        beams[0][2][0, :] = 0.0
        beams[0][3][0, :, :] = start[j]
        first, last = chance_begins[j], chance_begins[j + 1]
        for i in range(first, last):
            exposure, miss = seen[chances[i], 0], log_miss[chances[i]]
            nothing += miss
            end = at
            while end < begins[j + 1] and data[0][rows[end]] == exposure:
                end += 1
            scores, taken, shift, covariance = beams[old]
            options = 0
            for h in range(live):
                grown[0][options] = scores[h] + miss
                grown[1][options, 0], grown[1][options, 1] = h, -1
                options += 1
                for q in range(at, end):
                    squared, ratio = _likelihood(data, rows[q], shift[h], covariance[h], nu, s)
                    if squared <= gate:
                        grown[0][options] = scores[h] + ratio
                        grown[1][options, 0], grown[1][options, 1] = h, rows[q]
                        options += 1
            at = end
            later_scores, later_taken, later_shift, later_covariance = beams[new]
            best, live = np.max(grown[0][:options]), 0
            while live < min(most, options):
                top = np.argmax(grown[0][:options])
                if not grown[0][top] > best - _DROP:
                    break
                h, p = grown[1][top]
                later_scores[live] = grown[0][top]
                later_taken[live, : i - first] = taken[h, : i - first]
                later_taken[live, i - first] = p
                later_shift[live] = shift[h]
                later_covariance[live] = covariance[h]
                if p >= 0:
                    _likelihood(data, p, shift[h], covariance[h], nu, s)
                    own = later_shift[live], later_covariance[live]
                    _update(data[2][p], nu, s, *own, gain)
                grown[0][top] = -np.inf
                live += 1
            old, new = new, old
        needed = max(fewest, np.ceil(share * (last - first) - 1e-9))
        for h in range(live):
            taken = beams[old][1][h, : last - first]
            found = np.sum(taken >= 0)
            ratio = beams[old][0][h] - nothing
            if not (found > 0 and ratio > 0.0):
                continue
            alone = beams[old][0][h]  # the likelihood ratio without that of the misses
            for i in range(last - first):
                if taken[i] < 0:
                    alone -= log_miss[chances[first + i]]
            if found >= needed or alone >= certain:
                track[count], score[count] = j, ratio
                pairs[count, : last - first] = taken
                count += 1
    return count


def _packed(window: Window, track: Indices, score: NDArray, pairs: Indices) -> list[int] | Indices:
    """The compatible hypotheses of the largest sum of scores; a track may have none."""
    number, column = np.nonzero(pairs >= 0)
    detection = window.detection[pairs[number, column]]
    n_tracks = window.covariance.shape[0]
    wanted, of = np.divmod(np.unique(detection * n_tracks + track[number]), n_tracks)
    same = wanted[1:] == wanted[:-1]
    rivals = np.union1d(of[1:][same], of[:-1][same])
    # without rivals the best history of a track, its first one, is in the best set
    names, first = np.unique(track, return_index=True)
    chosen = first[~np.isin(names, rivals)].tolist()
    if not rivals.size:
        return chosen
    among = np.flatnonzero(np.isin(track[number], rivals))
    for rows, _ in clusters(track[number[among]], detection[among]):
        own = np.unique(number[among[rows]])
        sets = [window.detection[pairs[k][pairs[k] >= 0]] for k in own]
        chosen += own[set_packing(track[own], sets, score[own])].tolist()
    return chosen


def set_packing(track: Indices, sets: list[Indices], score: NDArray) -> Indices:
    """Compatible hypotheses of the largest sum of scores, proven by HiGHS.

    Parameters
    ----------
    track : ndarray of int, shape (hypothesis,)
        Tracks, of which each may have one hypothesis.
    sets : list of ndarray of int
        Detections of each hypothesis, of which each may be in one.
    score : ndarray, shape (hypothesis,)

    Returns
    -------
    ndarray of int
        Indices of the chosen hypotheses.
    """
    if score.size == 0:
        return np.empty(0, dtype=np.int64)
    number = np.repeat(np.arange(score.size), [each.size for each in sets])
    rows = [
        _conflicts(pairs, items, score.size)
        for pairs, items in ((np.arange(score.size), track), (number, np.concatenate(sets)))
    ]
    constraints = _distinct(np.concatenate(rows))
    if len(constraints) == 1 and constraints.all():
        best = int(np.argmax(score))
        return np.flatnonzero((np.arange(score.size) == best) & (score > 0.0))
    found = milp(
        -score,
        constraints=LinearConstraint(csr_array(constraints.astype(float)), -np.inf, 1.0),
        integrality=np.ones(score.size),
        bounds=Bounds(0.0, 1.0),
        options={"mip_rel_gap": 0.0},
    )
    return np.flatnonzero(found.x > 0.5)


def _conflicts(number: Indices, item: Indices, size: int) -> NDArray[np.bool_]:
    """Which of `size` hypotheses have an item, for each item of several: (item, hypothesis), from
    the hypothesis and the item of each pair."""
    names, of = np.unique(item, return_inverse=True)
    has = np.zeros((names.size, size), dtype=bool)
    has[of, number] = True
    return has[has.sum(axis=1) > 1]


def _distinct(constraints: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Different rows in lexicographic order: detections of the same hypotheses give the same row.
    Rows are compared as strings of bits, which takes a fraction of the time of `np.unique`."""
    if constraints.shape[0] == 0:
        return constraints
    packed = np.packbits(constraints, axis=1)
    text = packed.view(np.dtype((np.void, packed.shape[1])))[:, 0]
    return constraints[np.unique(text, return_index=True)[1]]
