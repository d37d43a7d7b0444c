"""Simple baseline: nearest-neighbor linking with initial orbits from the angles of one observer.

1. Tracklets that share no detection are formed, the longest first.
2. Each tracklet is given to the nearest of the known orbits, that of the greatest density of
   direction and rate, if it is within the gate; the orbit is fitted again.
3. The other tracklets of an observer form chains: a tracklet is followed by the one that is nearest
   to its straight path on the sky, within an allowance for curvature.
4. A chain of three tracklets or more gives an initial orbit, the one of the largest evidence.

Decisions are final: there are no competing hypotheses, no scores and no merging of orbits. An orbit
is in the catalog if two observers have seen it.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.benchmark.files import BenchmarkScenario
from cislunar.constants import TIME_UNIT_S
from cislunar.dynamics import EphemerisForces
from cislunar.observation import ARCSECOND
from cislunar.orbit_determination import (
    AdmissibleRegion,
    Angles,
    Attributables,
    InitialOrbitSettings,
    OrbitFits,
    VerdictSettings,
    agrees,
    attributables,
    concatenate_fits,
    fit_orbits,
    form_tracklets,
    initial_orbits,
    make_angles,
    tracklet_matches,
)
from cislunar.runtime import Array, Indices

_CHAIN_GAP = 4.0 * 3600.0 / TIME_UNIT_S
_CURVATURE = 1e-4 * ARCSECOND * TIME_UNIT_S**2
"""Longest gap in a chain, and the change of a rate on the sky that it allows, 1e-4 arcsec/s^2."""

_LEAST_TRACKLETS, _LEAST_OBSERVERS = 3, 2
_GATE_PROBABILITY = 0.9999


class NearestNeighborCatalog:
    """Catalog of the baseline.

    Parameters
    ----------
    scenario : BenchmarkScenario
    forces : EphemerisForces

    Attributes
    ----------
    angles : Angles
        All detections so far.
    """

    def __init__(self, scenario: BenchmarkScenario, forces: EphemerisForces) -> None:
        self.forces, self.region = forces, AdmissibleRegion()
        self.significance = VerdictSettings().significance
        # as many starts as linking uses
        self.starts = InitialOrbitSettings(n_tracklets=2, n_ranges=16, n_rates=5)
        self.angles = make_angles([0.0], [0], np.zeros((1, 3)), np.ones((1, 3)), 1.0).rows([])
        self._fits: list[OrbitFits] = []

    def add_angles(self, angles: Angles, limiting_magnitude: ArrayLike, area_deg2: float) -> Angles:
        """Take up detections, in order of time. The baseline does not use limiting magnitudes and
        the area of the exposures."""
        columns = zip(self.angles[:-1], angles[:-1], strict=True)
        self.angles = Angles(*map(np.concatenate, columns), angles.light_delay)
        return angles

    def confirmed_fits(self) -> OrbitFits:
        """Link all detections that are in no orbit, and return the orbits of the catalog."""
        left = self._attributed(self._free_tracklets())
        for members in _chains(left):
            self._start(np.unique(np.concatenate([left.detections[t] for t in members])))
        self._attributed(self._free_tracklets())
        empty = fit_orbits(self.angles, [], np.empty((0, 6)), 0.0, forces=self.forces)
        return concatenate_fits(
            [
                each
                for each in self._fits
                if np.unique(self.angles.observer[each.row]).size >= _LEAST_OBSERVERS
            ],
            empty,
        )

    def _free_tracklets(self) -> Attributables:
        """Tracklets of detections that are in no orbit, which share no detection."""
        used = np.zeros(self.angles.time.size, dtype=bool)
        for each in self._fits:
            used[each.row] = True
        formed = form_tracklets(self.angles, rate=0.0)
        kept = []
        for rows in sorted(formed, key=lambda rows: (-rows.size, *rows.tolist())):
            if not used[rows].any():
                used[rows] = True
                kept.append(rows)
        return attributables(self.angles, kept, rate=0.0)

    def _attributed(self, tracklets: Attributables) -> Attributables:
        """Give tracklets to the nearest orbits, and return the others."""
        n = tracklets.time.size
        if not self._fits or n == 0:
            return tracklets
        count = len(self._fits)
        which, found, density = tracklet_matches(
            concatenate_fits(self._fits, self._fits[0]), tracklets, np.full(count, -np.inf),
            np.full(count, np.inf), _GATE_PROBABILITY, forces=self.forces,
        )  # fmt: skip
        free, extended = np.ones(n, dtype=bool), np.zeros(count, dtype=bool)
        for match in np.lexsort((found, -density)).tolist():
            k, t = int(which[match]), int(found[match])
            # an orbit that has changed predicts other directions
            if not free[t] or extended[k]:
                continue
            fit = self._fits[k]
            rows = np.union1d(fit.row, tracklets.detections[t])
            again = fit_orbits(self.angles, [rows], fit.state, fit.epoch, forces=self.forces)
            if agrees(again, self.significance)[0]:
                self._fits[k], free[t], extended[k] = again, False, True
        left = tracklets.take(np.flatnonzero(free))
        return self._attributed(left) if extended.any() else left

    def _start(self, rows: Indices) -> None:
        """An initial orbit from the detections of a chain."""
        found = initial_orbits(
            self.angles.rows(rows), forces=self.forces, region=self.region, settings=self.starts
        ).fits
        if found.epoch.size:
            best = fit_orbits(
                self.angles, [rows], found.state[:1], found.epoch[:1], forces=self.forces
            )
            if agrees(best, self.significance)[0]:
                self._fits.append(best)


def _chains(tracklets: Attributables) -> list[list[int]]:
    """Tracklets of one observer, each the nearest to the path of the one before."""
    free = np.ones(tracklets.time.size, dtype=bool)
    sigma = np.sqrt(np.trace(tracklets.covariance[:, 2:, 2:], axis1=1, axis2=2))
    chains = []
    for first in range(tracklets.time.size):
        if not free[first]:
            continue
        chain = [first]
        while (after := _nearest(tracklets, chain[-1], free, sigma)) >= 0:
            chain.append(after)
        if len(chain) >= _LEAST_TRACKLETS:
            free[chain] = False
            chains.append(chain)
    return chains


def _nearest(tracklets: Attributables, t: int, free: NDArray[np.bool_], sigma: Array) -> int:
    """The tracklet of the same observer that is nearest to the path of tracklet t, -1 if none is
    near."""
    since = tracklets.time - tracklets.time[t]
    near = free & (tracklets.observer == tracklets.observer[t])
    near &= (since > 0.0) & (since <= _CHAIN_GAP)
    rows = np.flatnonzero(near)
    if rows.size == 0:
        return -1
    elapsed = since[rows]
    expected = tracklets.direction[t] + elapsed[:, None] * tracklets.rate[t]
    expected /= np.linalg.norm(expected, axis=1)[:, None]
    apart = np.linalg.norm(tracklets.direction[rows] - expected, axis=1)
    turned = np.linalg.norm(tracklets.rate[rows] - tracklets.rate[t], axis=1)
    allowed = 0.5 * _CURVATURE * elapsed**2 + 3.0 * sigma[t] * elapsed
    allowed_rate = _CURVATURE * elapsed + 3.0 * np.hypot(sigma[t], sigma[rows])
    distance = np.maximum(apart / allowed, turned / allowed_rate)
    best = int(np.argmin(distance))
    return int(rows[best]) if distance[best] <= 1.0 else -1
