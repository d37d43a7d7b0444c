"""Status of the orbits of a catalog whose objects may maneuver."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.constants import SECONDS_PER_DAY, TIME_UNIT_S
from cislunar.orbit_determination import (
    ORBIT,
    AdmissibleRegion,
    Angles,
    LinkedOrbits,
    LinkingSettings,
    OrbitFits,
    fit_orbits,
)
from cislunar.runtime import Indices
from cislunar.survey.maneuvers.division import divided, overlapping_pairs, replaced
from cislunar.survey.maneuvers.duplicates import duplicate_orbits
from cislunar.survey.maneuvers.line_integrals import moments
from cislunar.survey.maneuvers.lineage import Lineage, OrbitPaths, find_lineage, orbit_paths
from cislunar.survey.maneuvers.misses import Watch, log_missed
from cislunar.survey.maneuvers.neighbors import divided_neighbors
from cislunar.survey.maneuvers.within import maneuvers_within
from cislunar.survey.navigation import RemainingErrors
from cislunar.survey.settings import LineageSettings

CURRENT, LOST, SUPERSEDED = "current", "lost", "superseded"
"""Status of an orbit: where its object is; not there any more, by exposures without a detection;
that of its object before a maneuver, after which another orbit is known, one of several orbits of
one object, or one whose detections belong to others."""


class ManeuveredOrbits(NamedTuple):
    """Orbits of a catalog after a search for maneuvers.

    Attributes
    ----------
    orbits : LinkedOrbits
        In the given order. Superseded and lost orbits are not confirmed. An orbit after a maneuver
        is confirmed if the one before it is; if its detections alone do not confirm it, its state
        is that of both orbits.
    averaged : OrbitFits
        The orbits with states and covariances that allow for undetected maneuvers
        (`cislunar.survey.maneuvers.OrbitsWithManeuvers`). A state of both orbits is averaged with
        that of the later orbit alone.
    status : tuple of str
        CURRENT, LOST or SUPERSEDED.
    lineage : Lineage
        Indices are those of the orbits.
    """

    orbits: LinkedOrbits
    averaged: OrbitFits
    status: tuple[str, ...]
    lineage: Lineage


def maneuvered_orbits(
    linked: LinkedOrbits,
    angles: Angles,
    *,
    forces: tuple,
    region: AdmissibleRegion,
    linking: LinkingSettings,
    settings: LineageSettings,
    radiation_sigma: float = 0.0,
    remaining: RemainingErrors | None = None,
    watch: Watch | None = None,
    fit: Callable[..., OrbitFits] = fit_orbits,
) -> ManeuveredOrbits:
    """Search the orbits of a catalog for maneuvers.

    Parameters
    ----------
    linked : LinkedOrbits
    angles : Angles
        All detections so far, to whose rows the orbits refer.
    forces : NamedTuple
        CR3BP or ephemeris forces.
    region : AdmissibleRegion
    linking : LinkingSettings
    settings : LineageSettings
    radiation_sigma, remaining
        See `cislunar.survey.maneuvers.maneuvers_within`.
    watch : Watch, optional
        Without it no orbit is lost or recognized as a further one of its object.
    fit : callable
        Fits orbits, as `cislunar.orbit_determination.fit_orbits`, which is the default.

    Returns
    -------
    ManeuveredOrbits
    """
    least = linking.confirmation.least_log_ratio
    single = np.array([each == ORBIT for each in linked.verdict], dtype=bool)
    own = np.flatnonzero(single & (linked.confirmed | (linked.log_ratio >= least)))
    status = np.full(linked.log_ratio.size, CURRENT, dtype=object)
    significance, refit = linking.verdict.significance, partial(fit, angles, forces=forces)
    candidates, sure = linked.fits.take(own), linked.confirmed[own].copy()
    near = divided_neighbors(candidates, angles, significance, refit, forces)
    # the orbit that takes most detections of a confirmed one is confirmed in its place
    taker = np.repeat(near.changed, np.diff(near.fits.begin))
    for k in near.empty[sure[near.empty]].tolist():
        heirs = taker[np.isin(near.fits.row, candidates.detections(k))]
        if heirs.size:
            sure[np.bincount(heirs).argmax()] = True
    alone = replaced(candidates, near.changed, near.fits)
    status[own[near.empty]] = SUPERSEDED
    left = np.delete(np.arange(own.size), near.empty)
    own, alone, sure = own[left], alone.take(left), sure[left]
    inside = {"forces": forces, "settings": settings, "radiation_sigma": radiation_sigma,
              "remaining": remaining}  # fmt: skip
    fits, averaged, within = maneuvers_within(alone, angles, **inside)
    last = angles.time[fits.row[fits.begin[1:] - 1]]
    now = float(angles.time[-1]) if angles.time.size else 0.0
    if watch is not None and watch.fields.index.size:
        now = max(now, float(watch.fields.index[-1]) * watch.scene.step)
    first = float(angles.time[fits.row[fits.begin[:-1]]].min(initial=now))
    paths = orbit_paths(fits, first, now, forces=forces)
    everything = np.ones(own.size, dtype=bool)
    given = {"forces": forces, "region": region, "expected_objects": linking.expected_objects,
             "settings": settings, "radiation_sigma": radiation_sigma}  # fmt: skip
    known: dict[tuple[int, int], float] = {}
    found = find_lineage(
        fits, angles, everything, everything, paths=paths, log_integrals=known, **given
    )
    fits, changed = _divided(fits, angles, found, paths, significance, refit, given)
    if changed.size:
        parts = maneuvers_within(fits.take(changed), angles, **inside)
        fits, averaged = (
            replaced(fits, changed, parts.fits),
            replaced(averaged, changed, parts.averaged),
        )
        within = _within_again(within, changed, parts.lineage)
        last = angles.time[fits.row[fits.begin[1:] - 1]]
        moved = orbit_paths(fits.take(changed), first, now, forces=forces)
        paths.state[changed], paths.covariance[changed] = moved.state, moved.covariance
        anew = {*changed.tolist()}
        known = {pair: each for pair, each in known.items() if anew.isdisjoint(pair)}
        found = find_lineage(
            fits, angles, everything, everything, paths=paths, log_integrals=known, **given
        )
    # in order of time, so that a chain of orbits is confirmed from its begin on
    order = np.argsort(last[found.before], kind="stable")
    kept = [pair for pair in order.tolist() if _confirm(sure, found, pair)]
    found = found.take(np.array(sorted(kept), dtype=np.int64))
    before, after = own[found.before], own[found.after]
    found = found._replace(before=before, after=after)
    within = within._replace(before=own[within.before], after=own[within.after])
    pairs = np.flatnonzero(~linked.confirmed[after])
    likeliest, averaged = (replaced(linked.fits, own, each) for each in (fits, averaged))
    averaged = _averaged_joint(averaged, found.take(pairs), settings)
    likeliest = likeliest.updated(after[pairs], found.state[pairs], found.covariance[pairs])
    status[before] = SUPERSEDED
    if watch is not None and own.size:
        rest = np.flatnonzero(sure & (status[own] == CURRENT))
        doubled = duplicate_orbits(fits, angles, rest, paths, watch, settings.least_probability)
        status[own[doubled]] = SUPERSEDED
        rest = np.flatnonzero(sure & (status[own] == CURRENT))
        missed = log_missed(fits, angles, rest, paths, watch)
        gap = (now - last[rest]) * TIME_UNIT_S / SECONDS_PER_DAY
        moved = -np.expm1(-settings.maneuvers_per_day * gap)
        gone = moved / (moved + (1.0 - moved) * np.exp(missed))
        status[own[rest[gone >= settings.least_probability]]] = LOST
    confirmed = linked.confirmed.copy()
    confirmed[own] = sure
    confirmed &= status == CURRENT
    return ManeuveredOrbits(
        linked._replace(fits=likeliest, confirmed=confirmed),
        averaged,
        tuple(status.tolist()),
        Lineage(*map(np.concatenate, zip(found, within, strict=True))),
    )


def _averaged_joint(averaged: OrbitFits, found: Lineage, settings: LineageSettings) -> OrbitFits:
    """Orbits with the states of both orbits of pairs, averaged over this and the state of the later
    orbit alone. The latter is right if the pair is not of one object, or if the object has made a
    further maneuver."""
    since = (averaged.epoch[found.after] - found.time) * TIME_UNIT_S / SECONDS_PER_DAY
    one = found.probability * np.exp(-settings.maneuvers_per_day * np.maximum(since, 0.0))
    mixed = [
        moments(
            np.array([share, 1.0 - share]),
            np.array([found.state[k], averaged.state[b]]),
            np.array([found.covariance[k], averaged.covariance[b]]),
        )
        for k, (b, share) in enumerate(zip(found.after.tolist(), one.tolist(), strict=True))
    ]
    state, covariance = (np.array([each[c] for each in mixed]) for c in range(2))
    return averaged.updated(found.after, state.reshape(-1, 6), covariance.reshape(-1, 6, 6))


def _within_again(within: Lineage, changed: Indices, again: Lineage) -> Lineage:
    """Maneuvers within orbits, with those of the changed ones, `again`, in place of the others'."""
    of = changed[again.before]
    kept = within.take(np.flatnonzero(~np.isin(within.before, changed)))
    both = zip(kept, again._replace(before=of, after=of), strict=True)
    joined = Lineage(*map(np.concatenate, both))
    return joined.take(np.argsort(joined.before, kind="stable"))


def _divided(
    fits: OrbitFits,
    angles: Angles,
    found: Lineage,
    paths: OrbitPaths,
    significance: float,
    refit: Callable[..., OrbitFits],
    given: dict[str, Any],
) -> tuple[OrbitFits, Indices]:
    """Orbits with the detections of some pairs divided anew, and which of them have changed. Each
    orbit changes once at most, and those of a pair that is found already do not."""
    used = {*found.before.tolist(), *found.after.tolist()}
    changed: list[int] = []
    one, other = np.array([True, False]), np.array([False, True])
    for pair in overlapping_pairs(fits, angles, paths, max(given["settings"].scales_m_s)):
        if used & set(pair):
            continue
        parts = divided(fits, angles, pair, significance, refit, given["forces"])
        if parts is None:
            continue
        ends = angles.time[parts.row[parts.begin[1] - 1]], angles.time[parts.row[parts.begin[1]]]
        own = orbit_paths(parts, *map(float, ends), forces=given["forces"])
        if find_lineage(parts, angles, one, other, paths=own, **given).before.size:
            fits = replaced(fits, pair, parts)
            used |= set(pair)
            changed += pair
    return fits, np.array(changed, dtype=np.int64)


def _confirm(sure: NDArray[np.bool_], found: Lineage, pair: int) -> bool:
    """Whether the orbit before a maneuver is confirmed; if so, the one after it is, too."""
    if sure[found.before[pair]]:
        sure[found.after[pair]] = True
    return bool(sure[found.before[pair]])
