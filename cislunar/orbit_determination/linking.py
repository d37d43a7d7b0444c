"""Linking of tracklets without identity to orbits.

A hypothesis is an orbit with its detections; `cislunar.orbit_determination.scores` defines its
score. Further tracklets are first attributed to orbits that are already known
(`cislunar.orbit_determination.attribution`). Pairs of tracklets of no determined orbit, first with
short gaps, then with longer ones, are fitted and extended in the same way. Of all hypotheses,
`link` selects the compatible set with the largest sum of scores; HiGHS proves that it is the
largest (`cislunar.association.set_packing`; Poore 1994, Computational Optimization and Applications
3, 27). If two selected orbits may belong to one object, their joint fit becomes a hypothesis, and
the selection is repeated; orbits that the angles show to be of one object are replaced by their
joint fit in any case. The rivals of a selected orbit are the best compatible hypotheses for its
detections without it, if their sum of scores is nearly as large, and further solutions for all its
detections.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.association import gate_threshold
from cislunar.constants import LENGTH_UNIT_KM, SECONDS_PER_DAY, TIME_UNIT_S
from cislunar.dynamics import EARTH_MOON, require_span
from cislunar.errors import ConfigurationError
from cislunar.orbit_determination.admissible_region import AdmissibleRegion
from cislunar.orbit_determination.angles import Angles
from cislunar.orbit_determination.attribution import (
    OrbitHypotheses,
    concatenate_fits,
    tracklet_matches,
)
from cislunar.orbit_determination.common_time import same_states
from cislunar.orbit_determination.hypotheses import LinkHypotheses, same_orbit
from cislunar.orbit_determination.initial_orbits import (
    InitialOrbits,
    initial_orbits,
    is_plausible,
    refit_at,
)
from cislunar.orbit_determination.least_squares import CONVERGED, OrbitFits, fit_orbits
from cislunar.orbit_determination.pairs import pair_starts, pairs_within
from cislunar.orbit_determination.scores import LinkingSettings
from cislunar.orbit_determination.tracklets import Attributables
from cislunar.orbit_determination.verdicts import (
    DIRECTION_ONLY,
    ORBIT,
    SEVERAL_ORBITS,
    agrees,
    determined_by_one,
    log_evidence,
    separation_probability,
    undetermined_directions,
)
from cislunar.runtime import Array, Indices

_CHUNK, _EXTENDED = 500, 100
"""Tracklets whose pairs are scanned at once, and pairs that are extended at once."""

_ABANDON_ABOVE, _ITERATIONS = 1e4, 15
"""Chi squared above which the fit of a pair is abandoned, and most evaluations of a fit."""

_SPLIT_STARTS = 8
"""Most hypotheses of one observer from which fits to all its tracklets of an orbit begin."""


class LinkedOrbits(NamedTuple):
    """Chosen orbits, by decreasing score, each at the time of its last detection, or at that of its
    first fit if no fit converges there.

    Attributes
    ----------
    fits : OrbitFits
        The orbits; the rows of angles of a fit are the detections of the orbit.
    log_ratio : ndarray, shape (orbit,)
        Scores (`log_scores`).
    verdict : tuple of str
        ORBIT, SEVERAL_ORBITS or DIRECTION_ONLY of `cislunar.orbit_determination.verdicts`.
    undetermined_directions : ndarray of int, shape (orbit,)
        See `cislunar.orbit_determination.verdicts.undetermined_directions`.
    confirmed : ndarray of bool, shape (orbit,)
        Whether the orbit satisfies the rule of confirmation; otherwise it is a candidate.
    rivals : tuple of OrbitFits
        Other orbits through some or all of the detections, of nearly the same evidence.
    solutions : dict of bytes to InitialOrbits
        Initial orbits for all detections of an orbit, by their rows, where they were sought; the
        next run begins its search from those of orbits without a new detection.
    """

    fits: OrbitFits
    log_ratio: Array
    verdict: tuple[str, ...]
    undetermined_directions: Indices
    confirmed: NDArray[np.bool_]
    rivals: tuple[OrbitFits, ...]
    solutions: dict[bytes, InitialOrbits]

    def detections(self, k: int) -> Indices:
        """Rows of the angles that orbit k takes."""
        return self.fits.detections(k)


def link(
    angles: Angles,
    tracklets: Attributables,
    *,
    forces: tuple = EARTH_MOON,
    region: AdmissibleRegion | None = None,
    settings: LinkingSettings | None = None,
    log_clutter: ArrayLike = 0.0,
    known: LinkedOrbits | None = None,
) -> LinkedOrbits:
    """Link tracklets to orbits.

    Parameters
    ----------
    angles : Angles
        Detections of unknown origin, in order of time.
    tracklets : Attributables
        Tracklets of these detections; a detection may be in several.
    forces : NamedTuple
        CR3BP or ephemeris forces.
    region : AdmissibleRegion, optional
    settings : LinkingSettings, optional
    log_clutter
        See `log_scores`.
    known : LinkedOrbits, optional
        Result for the first rows of the same angles, which is continued: its orbits take further
        tracklets first, and then the remaining tracklets of the window are linked. Tracklets of an
        orbit that stays confirmed are not attributed to another one if they are before the window.

    Returns
    -------
    LinkedOrbits

    Raises
    ------
    ConfigurationError
        If `log_clutter` is not finite or the force model does not cover the times.
    """
    region = AdmissibleRegion() if region is None else region
    settings = LinkingSettings() if settings is None else settings
    if np.shape(log_clutter) not in ((), (angles.time.size,)) or not np.isfinite(log_clutter).all():
        raise ConfigurationError(
            "log_clutter: give one finite number, or one of each detection; a small density for no "
            "clutter"
        )
    if angles.time.size:
        require_span(forces, angles.time[0], angles.time[-1])
    found = LinkHypotheses(angles, tracklets, forces, region, settings, log_clutter)
    n = tracklets.time.size
    free = np.ones(n, dtype=bool)
    if n:
        recent = tracklets.time >= tracklets.time[-1] - settings.window_h * 3600.0 / TIME_UNIT_S
        if known is not None and known.log_ratio.size:
            _continue(found, known, recent, free)
        free &= recent
    shortest = 0.0
    for gap in settings.gaps_h:
        _link_pairs(found, free, shortest, gap)
        shortest = gap
    _merge(found)
    _split(found)
    solutions = {} if known is None else known.solutions
    return _described(found, _without_duplicates(found, found.selected()), solutions)


def _continue(found: LinkHypotheses, known: LinkedOrbits, recent, free) -> None:
    """Attribute tracklets to known orbits, and mark these tracklets as no longer free. Orbits that
    stay confirmed keep theirs that are not `recent`."""
    angles, tracklets, forces, *_ = found.data
    longest = found.data[4].longest_arc_days * SECONDS_PER_DAY / TIME_UNIT_S
    orbits = [known.detections(k) for k in range(known.log_ratio.size)]
    members = found.tracklets_of(orbits, longest)
    which = [k for k, each in enumerate(members) if len(each) >= 2]
    rows = [np.unique(np.concatenate([tracklets.detections[t] for t in members[k]])) for k in which]
    fits = fit_orbits(angles, rows, known.fits.state[which], known.fits.epoch[which], forces=forces)
    good = np.flatnonzero(agrees(fits, found.data[4].verdict.significance))
    before = OrbitHypotheses(
        fits.take(good), tuple(tuple(members[which[k]]) for k in good.tolist())
    )
    found.add(before)
    keep = zip(before.tracklets, known.confirmed[which][good], strict=True)
    steady = [each for each, confirmed in keep if confirmed and each in found.index]
    usable = found.disjoint(steady) & (tracklets.time >= tracklets.time[-1] - longest)
    # a pair with a tracklet of another observer may determine an orbit that is not determined yet
    determined = [known.verdict[which[k]] == ORBIT for k in good.tolist()]
    _extend(found, before, recent | usable, free, determined)


def _extend(found: LinkHypotheses, orbits: OrbitHypotheses, usable, free, exclusive=None) -> None:
    """Extend orbits, and mark the tracklets of `exclusive` (orbit,) ones as no longer free; of
    those with enough tracklets if it is omitted."""
    extended = found.extended(orbits, usable)
    found.add(extended)
    if exclusive is None:
        least = found.data[4].exclusive_tracklets
        exclusive = [len(each) >= least for each in extended.tracklets]
    pairs = zip(extended.tracklets, exclusive, strict=True)
    taken = [each for each, own in pairs if own and each in found.index]
    if taken:
        free &= found.disjoint(taken)


def _link_pairs(found: LinkHypotheses, free, shortest: float, longest: float) -> None:
    """Hypotheses from pairs of free tracklets whose gap lies between two limits. Orbits take their
    tracklets before later pairs are sought."""
    angles, tracklets, forces, region, settings = found.data
    begin = 0
    while True:
        usable = begin + np.flatnonzero(free[begin:])
        if usable.size == 0:
            return
        own, end = tracklets.take(usable), min(_CHUNK, usable.size)
        pairs = pairs_within(own, longest, shortest, end)
        starts = pair_starts(own, pairs, region, settings.pairs, forces=forces)
        rows = [
            np.union1d(own.detections[i], own.detections[j])
            for i, j in zip(starts.first.tolist(), starts.second.tolist(), strict=True)
        ]
        seeds = fit_orbits(
            angles, rows, starts.state, starts.time, forces=forces, iterations=_ITERATIONS,
            abandon_above=_ABANDON_ABOVE,
        )  # fmt: skip
        good = agrees(seeds, settings.verdict.significance) & is_plausible(seeds, forces, region)
        score = np.full(good.size, -np.inf)
        score[good] = found.score_of(seeds.take(np.flatnonzero(good)))
        order = np.argsort(-score, kind="stable")
        order = order[np.isfinite(score[order])]
        members = {
            k: (int(usable[starts.first[k]]), int(usable[starts.second[k]])) for k in order.tolist()
        }
        found.add(OrbitHypotheses(seeds.take(order), tuple(members[k] for k in order.tolist())))
        while order.size:
            # a seed of tracklets that an orbit has taken would lead to the same orbit
            still = [free[members[k][0]] and free[members[k][1]] for k in order.tolist()]
            order = order[still]
            now, order = order[:_EXTENDED], order[_EXTENDED:]
            orbits = OrbitHypotheses(seeds.take(now), tuple(members[k] for k in now.tolist()))
            _extend(found, orbits, free, free)
        begin = int(usable[end - 1]) + 1


def _merge(found: LinkHypotheses) -> None:
    """Add joint fits of chosen orbits that may be of one object."""
    tried: set[tuple[int, int]] = set()
    while pairs := _likely_pairs(found, found.selected()) - tried:
        tried |= pairs
        _add_joint_fits(found, sorted(pairs))


def _likely_pairs(found: LinkHypotheses, chosen: list[int]) -> set[tuple[int, int]]:
    """Chosen orbits of which one predicts some tracklets of the other, or whose states agree."""
    _, tracklets, forces, _, settings = found.data
    if len(chosen) < 2:
        return set()
    owner = {t: k for k in chosen for t in found.compared(k)}
    these = np.array(sorted(owner))
    fits = concatenate_fits([found.fits[k] for k in chosen], found.empty)
    span = settings.spans_h[-1] * 3600.0 / TIME_UNIT_S
    ends = tracklets.time[np.array([[found.members[k][0], found.members[k][-1]] for k in chosen])]
    which, hit, *_ = tracklet_matches(
        fits, tracklets.take(these), ends[:, 0] - span, ends[:, 1] + span,
        settings.gate_probability, forces=forces,
    )  # fmt: skip
    agreeing = same_states(fits, settings.gate_probability, forces=forces).tolist()
    return {(chosen[a], chosen[b]) for a, b in agreeing} | {
        tuple(sorted((chosen[a], owner[t])))
        for a, t in zip(which.tolist(), these[hit].tolist(), strict=True)
        if owner[t] != chosen[a]
    }


def _add_joint_fits(found: LinkHypotheses, pairs: list[tuple[int, int]]) -> None:
    angles, _, forces, *_ = found.data
    trials = [(k, pair) for pair in pairs for k in pair]
    joint = fit_orbits(
        angles, [np.union1d(found.fits[a].row, found.fits[b].row) for _, (a, b) in trials],
        np.array([found.fits[k].state[0] for k, _ in trials]).reshape(-1, 6),
        np.array([found.fits[k].epoch[0] for k, _ in trials]), forces=forces,
    )  # fmt: skip
    found.add(OrbitHypotheses(joint, tuple(found.joint_members(*pair) for _, pair in trials)))


def _without_duplicates(found: LinkHypotheses, chosen: list[int]) -> list[int]:
    """Chosen orbits, of which two of one object are replaced by their joint fit.

    The scores cannot tell whether two orbits with different magnitudes are of one body that rotates
    or of two bodies. The angles can: if both orbits are of one object, the joint fit increases chi
    squared by a chi-squared variable with six degrees of freedom, which to first order is
    d' (P_1 + P_2)^-1 d of the difference d of the states. It must not be significant, and the
    evidence of the angles alone must be clearly larger for one object.
    """
    angles, _, _, region, settings = found.data
    largest = gate_threshold(settings.gate_probability, 6)
    tried: set[tuple[int, int]] = set()
    while pairs := _likely_pairs(found, chosen) - tried:
        tried |= pairs
        _add_joint_fits(
            found, sorted(p for p in pairs if found.joint_members(*p) not in found.index)
        )
        gone: set[int] = set()
        for pair in sorted(pairs):
            joint = found.index.get(found.joint_members(*pair))
            if joint is None or gone & set(pair):
                continue
            fits = concatenate_fits([found.fits[k] for k in (joint, *pair)], found.empty)
            increase = fits.chi_squared @ [1.0, -1.0, -1.0]
            ratio = log_evidence(fits, angles, region) @ [1.0, -1.0, -1.0]
            ratio -= np.log(settings.expected_objects)
            if increase <= largest and ratio >= settings.verdict.rival_log_ratio:
                gone |= set(pair)
                chosen = [*chosen, joint]
        chosen = sorted(set(chosen) - gone)
    return chosen


def _split(found: LinkHypotheses) -> None:
    """Add fits of the tracklets of each observer alone, for chosen orbits of two observers. Two
    observers of different objects may agree on an orbit where neither object is."""
    angles, tracklets, forces, *_ = found.data
    parts, starts = [], []
    for k in found.selected():
        members = np.array(found.members[k])
        owners = tracklets.observer[members]
        if np.unique(owners).size != 2:
            continue
        for each in np.unique(owners):
            own = tuple(members[owners == each].tolist())
            if len(own) >= 2:
                within = [m for m in found.sharing(k) if set(found.members[m]).issubset(own)]
                within = sorted(within, key=lambda m: -found.scores[m])[:_SPLIT_STARTS]
                starts += [found.fits[m] for m in (k, *within)]
                parts += [own] * (1 + len(within))
    rows = [np.unique(np.concatenate([tracklets.detections[t] for t in own])) for own in parts]
    fits = fit_orbits(
        angles, rows, np.array([each.state[0] for each in starts]).reshape(-1, 6),
        np.array([each.epoch[0] for each in starts]), forces=forces,
    )  # fmt: skip
    found.add(OrbitHypotheses(fits, tuple(parts)))


def _described(
    found: LinkHypotheses, chosen: list[int], before: dict[bytes, InitialOrbits]
) -> LinkedOrbits:
    """Chosen orbits with verdicts, rivals and confirmation; initial orbits of the run before."""
    angles, tracklets, forces, region, settings = found.data
    chosen = sorted(chosen, key=lambda k: (-found.scores[k], found.members[k]))
    parts = [found.fits[k] for k in chosen]
    later = [refit_at(fit, angles, angles.time[fit.row[-1]], forces=forces) for fit in parts]
    # normal matrices of unstable orbits may be singular in double precision at one time only
    parts = [b if b.status[0] == CONVERGED else a for a, b in zip(parts, later, strict=True)]
    fits = concatenate_fits(parts, found.empty)
    free = undetermined_directions(fits, region, settings.verdict)
    separation = separation_probability(fits, angles, forces=forces)
    verdicts, rivals, seen, solutions = [], [], [], {}
    taken = np.zeros(angles.time.size, dtype=bool)
    taken[fits.row] = True
    for position, k in enumerate(chosen):
        value, instead = found.alternative_to(k, taken)
        rival = value >= found.scores[k] - settings.verdict.rival_log_ratio
        others = [found.fits[m] for m in instead] if rival else []
        observers = tracklets.observer[list(found.members[k])]
        few = len(found.members[k]) < settings.several_starts_below
        if few or np.unique(observers).size == 1:
            own = angles.rows(found.fits[k].row)
            key = found.fits[k].row.tobytes()
            again = solutions[key] = initial_orbits(
                own, forces=forces, region=region, settings=settings.starts, known=before.get(key)
            )
            best = again.log_evidence.max(initial=-np.inf) - settings.verdict.rival_log_ratio
            for m in np.flatnonzero(again.log_evidence >= best).tolist():
                one = again.fits.take([m])._replace(row=found.fits[k].row)
                if not same_orbit(one, found.fits[k]):
                    others.append(one)
        verdict = SEVERAL_ORBITS if others else ORBIT
        verdicts.append(DIRECTION_ONLY if free[position] else verdict)
        rivals.append(concatenate_fits(others, found.empty))
        seen.append((observers, verdicts[-1], found.scores[k], float(separation[position])))
    confirmed = np.array([settings.confirmation.confirms(*each) for each in seen], dtype=bool)
    left = np.flatnonzero(~confirmed & (np.array(verdicts, dtype=object) == ORBIT))
    by_one = _by_one(found, fits.take(left))
    confirmed[left] = [
        settings.confirmation.confirms(*seen[k], by_one=one)
        for k, one in zip(left.tolist(), by_one.tolist(), strict=True)
    ]
    return LinkedOrbits(
        fits, np.array([found.scores[k] for k in chosen]), tuple(verdicts), free, confirmed,
        tuple(rivals), solutions,
    )  # fmt: skip


def _by_one(found: LinkHypotheses, fits: OrbitFits) -> NDArray[np.bool_]:
    """Whether the detections of one observer determine orbits as the rule of confirmation asks."""
    angles, _, forces, region, settings = found.data
    rule, given = settings.confirmation, (angles, region, settings.verdict)
    determined, probability = determined_by_one(fits, *given, forces=forces)
    sigma = np.sqrt(np.trace(fits.covariance[:, :3, :3], axis1=1, axis2=2)) * LENGTH_UNIT_KM
    small = sigma <= rule.largest_sigma_km
    return determined & small & (probability >= rule.separation_significance)
