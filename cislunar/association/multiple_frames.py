"""Assignment over a window of exposures: whole histories of tracks compete for detections.

A hypothesis of a track names its detection, or a missed one, in every exposure that had the track
in the field of view; its score is the logarithm of the likelihood ratio of that history, from the
innovations one after the other. The best compatible set has one hypothesis of each track and no
detection twice: a set packing problem that HiGHS solves to proven optimality over the hypotheses
that were generated (Poore 1994, Computational Optimization and Applications 3, 27).

A track in clutter takes detections of a window only if enough of its exposures have one: a target
is detected in most exposures, false alarms lie in the gate of one.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import csr_array

from cislunar.association.likelihood import gate_threshold
from cislunar.association.window import (
    Association,
    Window,
    association,
    clusters,
    innovation,
    updated,
)


class _Hypothesis(NamedTuple):
    """A history of one track: its score, its pairs, and the track's state after them."""

    score: float
    pairs: tuple[int, ...]
    shift: NDArray
    covariance: NDArray


def associate_frames(
    window: Window, gate_probability: float, confirmations: int, span: int, most: int
) -> Association:
    """Assign the detections of all exposures of a window together.

    Parameters
    ----------
    window : Window
    gate_probability : float
        Probability that the gate keeps the detection of a target.
    confirmations, span : int
        Detections that a track needs of `span` exposures, else it takes none; the same share is
        asked of fewer exposures.
    most : int
        Largest number of hypotheses of a track.

    Returns
    -------
    Association
        The best of all compatible sets of hypotheses.
    """
    gate = gate_threshold(gate_probability, 2)
    hypotheses: list[tuple[int, _Hypothesis]] = []
    for track in np.unique(window.track).tolist():
        own = _histories(window, track, gate, confirmations / span, most)
        hypotheses += [(track, each) for each in own]
    chosen = _packed(window, hypotheses)
    return association(
        [
            (int(window.exposure[p]), track, int(window.detection[p]), 1.0)
            for track, found in chosen
            for p in found.pairs
        ]
    )


def _histories(
    window: Window, track: int, gate: float, share: float, most: int
) -> list[_Hypothesis]:
    """Hypotheses of a track that beat the one without any detection, best first."""
    mine = np.flatnonzero(window.track == track)
    chances = window.seen[:, 1] == track
    exposures = window.seen[chances, 0]
    beam = [_Hypothesis(0.0, (), np.zeros(window.covariance.shape[1]), window.covariance[track])]
    for exposure, miss in zip(exposures, window.log_miss[chances], strict=True):
        pairs = mine[window.exposure[mine] == exposure]
        grown = [each._replace(score=each.score + miss) for each in beam]
        for each in beam:
            for p in pairs.tolist():
                given = window.design[p], window.noise[p], each.shift, each.covariance
                nu, s = innovation(window.residual[p], *given)
                white = np.linalg.solve(np.linalg.cholesky(s), nu)
                squared = float(white @ white)
                if squared > gate:
                    continue
                log_density = -0.5 * (squared + np.log(np.linalg.det(2.0 * np.pi * s)))
                score = each.score + float(window.log_weight[p]) + log_density
                state = updated(nu, s, window.design[p], each.shift, each.covariance)
                grown.append(_Hypothesis(score, (*each.pairs, p), *state))
        beam = sorted(grown, key=lambda one: (-one.score, one.pairs))[:most]
    nothing = float(window.log_miss[chances].sum())
    needed = np.ceil(share * exposures.size - 1e-9)
    return [
        each._replace(score=each.score - nothing)
        for each in beam
        if each.pairs and len(each.pairs) >= needed and each.score > nothing
    ]


def _packed(
    window: Window, hypotheses: list[tuple[int, _Hypothesis]]
) -> list[tuple[int, _Hypothesis]]:
    """The compatible hypotheses of the largest sum of scores; a track may have none."""
    links = [
        (number, track, int(window.detection[p]))
        for number, (track, each) in enumerate(hypotheses)
        for p in each.pairs
    ]
    if not links:
        return []
    number, track, detection = (np.array(column) for column in zip(*links, strict=True))
    found = []
    for rows, tracks in clusters(track, detection):
        own = np.unique(number[rows])
        if len(tracks) == 1:
            # no other track wants these detections, and the best comes first
            found.append(hypotheses[own[0]])
            continue
        found += [hypotheses[own[k]] for k in _set_packing([hypotheses[k] for k in own], window)]
    return found


def _set_packing(hypotheses: list[tuple[int, _Hypothesis]], window: Window) -> NDArray[np.int64]:
    """Indices of the best compatible hypotheses of a cluster, proven by HiGHS."""
    items: dict[tuple[str, int], int] = {}
    entries = []
    for k, (track, each) in enumerate(hypotheses):
        used = [("track", track)]
        used += [("detection", int(window.detection[p])) for p in each.pairs]
        entries += [(items.setdefault(item, len(items)), k) for item in used]
    row, column = np.array(entries).T
    matrix = csr_array((np.ones(row.size), (row, column)), shape=(len(items), len(hypotheses)))
    score = np.array([each.score for _, each in hypotheses])
    found = milp(
        -score,
        constraints=LinearConstraint(matrix, -np.inf, 1.0),
        integrality=np.ones(score.size),
        bounds=Bounds(0.0, 1.0),
        options={"mip_rel_gap": 0.0},
    )
    return np.flatnonzero(found.x > 0.5)
