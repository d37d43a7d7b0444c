"""Hypotheses of linking: orbits with their detections, and the best compatible set of them."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.association import clusters, set_packing
from cislunar.orbit_determination.admissible_region import AdmissibleRegion
from cislunar.orbit_determination.angles import Angles, exposure_numbers
from cislunar.orbit_determination.attribution import OrbitHypotheses, extend_orbits
from cislunar.orbit_determination.initial_orbits import is_plausible
from cislunar.orbit_determination.least_squares import OrbitFits, fit_orbits
from cislunar.orbit_determination.scores import LinkingSettings, log_scores
from cislunar.orbit_determination.tracklets import Attributables
from cislunar.orbit_determination.verdicts import agrees

_SAME = 1e-2
"""Largest difference of positions, relative to the range, of two hypotheses of one orbit."""

_COMPARED = 8
"""Tracklets at each end of a hypothesis, and spread over it, that are compared with others."""


def same_orbit(one: OrbitFits, other: OrbitFits) -> bool:
    """Whether two fits have the same positions at the detections that they share."""
    _, a, b = np.intersect1d(one.row, other.row, return_indices=True)
    apart = np.linalg.norm(one.position[a] - other.position[b], axis=1)
    return bool(np.all(apart <= _SAME * np.linalg.norm(other.position[b], axis=1)))


class LinkHypotheses:
    """Generated hypotheses, one for each set of tracklets."""

    def __init__(
        self,
        angles: Angles,
        tracklets: Attributables,
        forces: tuple,
        region: AdmissibleRegion,
        settings: LinkingSettings,
        log_clutter: ArrayLike,
    ) -> None:
        self.data = angles, tracklets, forces, region, settings
        self.score_of = lambda fits: log_scores(fits, angles, region, settings, log_clutter)
        self._exposure = exposure_numbers(angles)
        self.fits: list[OrbitFits] = []
        self.members: list[tuple[int, ...]] = []
        self.scores: list[float] = []
        self.index: dict[tuple[int, ...], int] = {}
        self.by_row: dict[int, list[int]] = {}
        self._best: dict[tuple[tuple[int, ...], tuple[float, ...]], ArrayLike] = {}
        self._begin = np.cumsum([0, *(each.size for each in tracklets.detections)])[:-1]
        self._rows = np.concatenate([np.empty(0, dtype=np.int64), *tracklets.detections])
        self.empty = fit_orbits(angles, [], np.empty((0, 6)), 0.0, forces=forces)

    def add(self, orbits: OrbitHypotheses) -> None:
        """Add hypotheses that agree with the angles, are plausible and have a positive score."""
        _, _, forces, region, settings = self.data
        good = agrees(orbits.fits, settings.verdict.significance)
        good &= is_plausible(orbits.fits, forces, region)
        score = self.score_of(orbits.fits)
        for k in np.flatnonzero(good & (score > 0.0)).tolist():
            members = orbits.tracklets[k]
            at = self.index.get(members)
            if at is None:
                self.index[members] = len(self.members)
                self.fits.append(orbits.fits.take([k]))
                self.members.append(members)
                self.scores.append(float(score[k]))
                for row in self.fits[-1].row.tolist():
                    self.by_row.setdefault(row, []).append(self.index[members])
            elif score[k] > self.scores[at]:
                self.fits[at], self.scores[at] = orbits.fits.take([k]), float(score[k])

    def extended(self, orbits: OrbitHypotheses, usable: NDArray[np.bool_]) -> OrbitHypotheses:
        """The orbits with all tracklets that they can take of the usable ones."""
        angles, tracklets, forces, _, settings = self.data
        return extend_orbits(
            angles, tracklets, orbits, usable, self._exposure, forces=forces,
            spans_h=settings.spans_h,
            gate_probability=settings.gate_probability,
            significance=settings.verdict.significance,
        )  # fmt: skip

    def selected(self) -> list[int]:
        """The compatible hypotheses of the largest sum of scores."""
        _, tracklets, *_ = self.data
        sets = [np.concatenate([tracklets.detections[t] for t in each]) for each in self.members]
        if not sets:
            return []
        number = np.repeat(np.arange(len(sets)), [each.size for each in sets])
        found: list[int] = []
        for _, together in clusters(number, np.concatenate(sets)):
            own = np.array(together)
            score = [self.scores[k] for k in own]
            key = tuple(own.tolist()), tuple(score)
            if key not in self._best:
                alone = own.size == 1
                self._best[key] = (
                    [0] if alone else set_packing(own, [sets[k] for k in own], np.array(score))
                )
            found += own[self._best[key]].tolist()
        return sorted(found)

    def tracklets_of(self, orbits: list[NDArray[np.int64]], longest: float) -> list[list[int]]:
        """For orbits with these detections, the largest tracklets of detections of the orbit alone
        that share none, in order of time, within a time `longest` before the last of them."""
        angles, tracklets, *_ = self.data
        owner = np.full(angles.time.size, -1)
        for k, rows in enumerate(orbits):
            owner[rows] = k
        members: list[list[int]] = [[] for _ in orbits]
        for t, rows in enumerate(tracklets.detections):
            if owner[rows[0]] >= 0 and np.all(owner[rows] == owner[rows[0]]):
                members[owner[rows[0]]].append(t)
        for k, each in enumerate(members):
            used: set[int] = set()
            kept = []
            for t in sorted(each, key=lambda t: (-tracklets.detections[t].size, t)):
                if not used & set(tracklets.detections[t].tolist()):
                    kept.append(t)
                    used.update(tracklets.detections[t].tolist())
            first = tracklets.time[max(kept, default=0)] - longest
            members[k] = sorted(t for t in kept if tracklets.time[t] >= first)
        return members

    def disjoint(self, orbits: list[tuple[int, ...]]) -> NDArray[np.bool_]:
        """Which tracklets share no detection with orbits that have these tracklets."""
        used = np.zeros(self.data[0].time.size, dtype=bool)
        for members in orbits:
            for t in members:
                used[self.data[1].detections[t]] = True
        return ~np.logical_or.reduceat(used[self._rows], self._begin)

    def compared(self, k: int) -> list[int]:
        """Tracklets of a hypothesis that are compared with the predictions of others: the first,
        the last, and some in between."""
        members = self.members[k]
        ends, last = np.arange(_COMPARED), len(members) - 1
        between = np.linspace(0, last, _COMPARED).round().astype(int)
        return [members[i] for i in np.unique(np.clip([ends, between, last - ends], 0, last))]

    def joint_members(self, a: int, b: int) -> tuple[int, ...]:
        """Tracklets of two hypotheses, as a key of `index`."""
        return tuple(sorted({*self.members[a], *self.members[b]}))

    def sharing(self, k: int) -> list[int]:
        """Other hypotheses that share detections with one."""
        found = {m for row in self.fits[k].row.tolist() for m in self.by_row[row]}
        return sorted(found - {k})

    def alternative_to(self, k: int, taken: NDArray[np.bool_]) -> tuple[float, list[int]]:
        """Best sum of scores of other orbits that use detections of a selected one, and none of
        those of the others that are selected; and these hypotheses. `taken`: detections of all
        that are selected, which share none."""
        others = [
            m
            for m in self.sharing(k)
            if np.isin(self.fits[m].row[taken[self.fits[m].row]], self.fits[k].row).all()
            and not same_orbit(self.fits[m], self.fits[k])
        ]
        if not others:
            return 0.0, []
        score = np.array([self.scores[m] for m in others])
        best = set_packing(np.array(others), [self.fits[m].row for m in others], score)
        return float(score[best].sum()), [others[m] for m in best.tolist()]
