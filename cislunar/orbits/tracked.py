"""The moving targets of sensor tasking: 202 orbits (Paul & Fan, section 4).

The classes are the paper's: northern and southern halos about L1 and L2 with two near-rectilinear
ones, distant retrograde orbits, 3:1 resonant orbits, and eight lunar mission trajectories with
perilunes a few hundred kilometers above the south pole. The numbers per class and their ranges are
this library's choice, given by the constants below. The near-rectilinear pair are the 9:2 and 4:1
resonant orbits; the low end of the L2 halos is near-rectilinear too.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from cislunar.constants import LENGTH_UNIT_KM, MOON_RADIUS_KM, MU, SECONDS_PER_DAY, TIME_UNIT_S
from cislunar.dynamics import closest_approaches, jacobi_constant
from cislunar.orbits.branches import opposite, resonant_seed
from cislunar.orbits.continuation import Branch, Point, continue_branch, join
from cislunar.orbits.corrector import X, correct, fix_coordinate
from cislunar.orbits.extent import KEEP_OUT, distances_km, follow_branch, trim
from cislunar.orbits.families import (
    SOUTH,
    OrbitSet,
    concatenate,
    family_branch,
    observer_library,
    orbit_set,
    spaced_members,
)
from cislunar.orbits.selection import select
from cislunar.runtime import Array

HALO_COUNTS = {"Halo_L1_N": 30, "Halo_L1_S": 30, "Halo_L2_N": 30, "Halo_L2_S": 28}
_SYNODIC_MONTH_DAYS = 29.530589
NRHO_RESONANCES = {"NRHO_9:2": 2.0 / 9.0, "NRHO_4:1": 1.0 / 4.0}
"""Period of the near-rectilinear halos (southern, about L2) in synodic months."""

RETROGRADE_COUNT = 37
_RETROGRADE_PERILUNE_KM = (10_000.0, 150_000.0)
RESONANT_COUNTS = {"Resonant_3:1": 18, "Resonant_3:1b": 19}
"""Perigee on the Moon's side (unstable) and on the opposite side (stable, "b")."""
_RESONANT_PERIGEE_KM = (15_000.0, 150_000.0)


class _LunarPolarOrbit(NamedTuple):
    """Osculating ellipse about the Moon with its perilune over the south pole."""

    name: str
    perilune_altitude_km: float
    apolune_altitude_km: float


POLAR_ORBITS: tuple[_LunarPolarOrbit, ...] = (
    _LunarPolarOrbit("Chandrayaan-1_insertion", 504.0, 7502.0),
    _LunarPolarOrbit("Chandrayaan-1_first_maneuver", 200.0, 7502.0),
    _LunarPolarOrbit("Chandrayaan-2_insertion", 114.0, 18072.0),
    _LunarPolarOrbit("Chandrayaan-2_second_maneuver", 118.0, 4412.0),
    _LunarPolarOrbit("Chandrayaan-3_insertion", 164.0, 18074.0),
    _LunarPolarOrbit("Chandrayaan-3_first_maneuver", 170.0, 4313.0),
    _LunarPolarOrbit("KPLO_insertion", 109.0, 8920.0),
    _LunarPolarOrbit("LunaH-Map_like", 315.0, 3150.0),
)
"""Capture orbits of lunar polar missions. Altitudes of the Chandrayaan missions are as announced;
those of KPLO (Danuri) and the LunaH-Map-like orbit are nominal, with the perilune of the latter
raised to a few hundred kilometers. Node headings are spaced by 45 degrees."""


def polar_state(orbit: _LunarPolarOrbit, heading: float, mu: float = MU) -> tuple[Array, float]:
    """State (6,) at a perilune over the lunar south pole, on y = 0, nondimensional, rotating frame,
    and the period of the osculating ellipse (the orbit is not periodic). `heading` is the direction
    of the velocity in the xy-plane from +x, rad."""
    perilune = (MOON_RADIUS_KM + orbit.perilune_altitude_km) / LENGTH_UNIT_KM
    apolune = (MOON_RADIUS_KM + orbit.apolune_altitude_km) / LENGTH_UNIT_KM
    semi_major = 0.5 * (perilune + apolune)
    speed = np.sqrt(mu * (2.0 / perilune - 1.0 / semi_major))
    # On the rotation axis through the Moon the frame's rotation adds no relative velocity.
    velocity = [speed * np.cos(heading), speed * np.sin(heading), 0.0]
    state = np.array([1.0 - mu, 0.0, -perilune, *velocity])
    return state, float(2.0 * np.pi * np.sqrt(semi_major**3 / mu))


def _polar_set(mu: float) -> OrbitSet:
    names, states, rows = [], [], []
    for k, orbit in enumerate(POLAR_ORBITS):
        state, period = polar_state(orbit, k * np.pi / 4.0, mu)
        perigee, perilune = closest_approaches(state, period, mu=mu)
        names.append(f"Polar_{orbit.name}")
        states.append(state)
        jacobi = float(jacobi_constant(state, mu))
        rows.append((period, jacobi, np.nan, perilune * LENGTH_UNIT_KM, perigee * LENGTH_UNIT_KM))
    return OrbitSet(np.array(names), np.array(states), *np.array(rows).T)


def _retrograde_members(mu: float) -> Branch:
    nearest, farthest = _RETROGRADE_PERILUNE_KM
    branch = follow_branch("DRO", mu, nearest, 0.0, ("perilune_km", farthest))
    return spaced_members(branch, RETROGRADE_COUNT, by_arc=False, mu=mu)


def _resonant_members(family: str, mu: float) -> Branch:
    nearest, farthest = _RESONANT_PERIGEE_KM
    seed = resonant_seed(mu, moonward=not family.endswith("b"))

    def above(member: Point) -> float:
        return distances_km(member.half, mu)[0] - nearest

    def below(member: Point) -> float:
        return farthest - distances_km(member.half, mu)[0]

    inward = continue_branch(seed.half, -seed.direction, lambda m: above(m) <= 0.0, mu=mu)
    outward = continue_branch(seed.half, seed.direction, lambda m: below(m) <= 0.0, mu=mu)
    branch = trim(trim(join(inward, outward), above, mu), below, mu)
    members = spaced_members(branch, RESONANT_COUNTS[family], by_arc=False, mu=mu)
    # The epoch is at apogee, because at a low perigee the same roundoff leaves a far larger gap.
    apogees = [opposite(member).half.crossing for member in members]
    halves = [correct(apogee, fix_coordinate(X, apogee[X]), mu) for apogee in apogees]
    return [Point(half, seed.direction) for half in halves]


def tracked_targets(
    mu: float = MU, *, progress: Callable[[int, int], None] | None = None
) -> OrbitSet:
    """Initial states of the 202 moving targets.

    Parameters
    ----------
    mu : float
        Mass ratio.
    progress : callable, optional
        Called with (orbits done, orbits in all).

    Returns
    -------
    OrbitSet
        Class by class: halos, NRHOs, distant retrograde, 3:1 resonant, polar. All states lie on
        y = 0. The polar orbits are not periodic: their period is that of the osculating ellipse
        and their stability index is NaN.
    """
    halos = sum(HALO_COUNTS.values())
    parts = len(NRHO_RESONANCES) + RETROGRADE_COUNT + sum(RESONANT_COUNTS.values())
    total = halos + parts + len(POLAR_ORBITS)
    done = 0

    def advance(*_: int, count: int = 1) -> None:
        nonlocal done
        done += count
        if progress is not None:
            progress(done, total)

    sets = [observer_library(HALO_COUNTS, KEEP_OUT, mu=mu, progress=advance)]
    near_rectilinear = family_branch("Halo_L2_S", mu=mu)
    for name, months in NRHO_RESONANCES.items():
        period = months * _SYNODIC_MONTH_DAYS * SECONDS_PER_DAY / TIME_UNIT_S
        members = select(near_rectilinear, "period", period, mu)
        sets.append(orbit_set(name, members, mu=mu, mirror=SOUTH, progress=advance))
    planar = {"DRO": lambda: _retrograde_members(mu)}
    for family in RESONANT_COUNTS:
        planar[family] = lambda family=family: _resonant_members(family, mu)
    for name, generate in planar.items():
        sets.append(orbit_set(name, generate(), mu=mu, progress=advance))
    sets.append(_polar_set(mu))
    advance(count=len(POLAR_ORBITS))
    return concatenate(sets)
