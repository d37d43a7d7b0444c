"""The thirteen families of candidate observer orbits (Paul & Fan, section 3)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.constants import MU
from cislunar.dynamics.cr3bp import jacobi_constant
from cislunar.errors import ConfigurationError, did_you_mean
from cislunar.orbits.continuation import Branch, Point, between, interpolate
from cislunar.orbits.corrector import X, Z, correct, fix_coordinate
from cislunar.orbits.extent import KEEP_OUT, Extent, distances_km, follow_branch
from cislunar.orbits.stability import stability_index
from cislunar.runtime import Array, count_of, counted, number_of, require_kind

FAMILIES: tuple[str, ...] = (
    "Butterfly_N",
    "Butterfly_S",
    "Dragonfly_N",
    "Dragonfly_S",
    "Halo_L1_N",
    "Halo_L1_S",
    "Halo_L2_N",
    "Halo_L2_S",
    "Halo_L3_N",
    "Halo_L3_S",
    "Lyap_L1",
    "Lyap_L2",
    "Lyap_L3",
)
"""Names of the families, in library order."""

DEFAULT_MEMBERS: Mapping[str, int] = {
    name: 24 if name.startswith("Lyap") else 23 for name in FAMILIES
}
"""Members per family: 302 in all, about 23 each (Paul & Fan, section 3)."""


class OrbitSet(NamedTuple):
    """Orbits, one row each; periodic unless their stability index is NaN."""

    family: NDArray[np.str_]
    """Family name, shape (n,)."""
    state: Array
    """State at the epoch, nondimensional, rotating frame, shape (n, 6); on y = 0 for the families
    that are symmetric about the xz-plane or the x axis."""
    period: Array
    """Period, nondimensional, shape (n,); 0 for an open trajectory."""
    jacobi: Array
    """Jacobi constant, shape (n,)."""
    stability_index: Array
    """Stability index, at least 1, shape (n,); NaN for an orbit that is not periodic."""
    perilune_km: Array
    """Least distance from the center of the Moon, km, shape (n,)."""
    perigee_km: Array
    """Least distance from the center of the Earth, km, shape (n,)."""


SOUTH = np.array([1.0, 1.0, -1.0, 1.0, 1.0, -1.0])
"""Factors on a state that mirror it at the plane of the primaries."""

_SPACING_BY_ARC = ("Butterfly", "Halo_L1")
_HERMITE_SAMPLES = 16


def root_of(family: str) -> str:
    """Branch of a family: its name without the hemisphere."""
    require_kind("family", family, str, "give the name of an orbit family, such as 'Halo_L2_S'")
    if family not in FAMILIES:
        near = did_you_mean(family, FAMILIES, 0.8)
        every = f"the families are {', '.join(FAMILIES)}"
        raise ConfigurationError(f"unknown orbit family {family!r}; {near or every}")
    return family.removesuffix("_N").removesuffix("_S")


def family_branch(family: str, *, mu: float = MU, extent: Extent = KEEP_OUT) -> Branch:
    """Continuation of one of `FAMILIES` between its ends: closely spaced members in order, northern
    for both hemispheres."""
    root = root_of(family)
    return follow_branch(
        root,
        float(mu),
        *(extent.keep_out.distances_km if extent.keep_out else (0.0, 0.0)),
        extent.ends.get(root),
    )


def spaced_members(branch: Branch, count: int, *, by_arc: bool, mu: float = MU) -> Branch:
    """Members equally spaced along a branch, including both ends.

    Parameters
    ----------
    branch : list of Point
        Continuation of the family.
    count : int
        Number of members; a single one is the first end.
    by_arc : bool
        Space by arc length in (x, z) of the crossing, for families whose x folds; otherwise by x.
    mu : float
        Mass ratio.

    Returns
    -------
    list of Point
        In order along the branch.

    Raises
    ------
    ConvergenceError
        If the correction of a member does not converge.
    """
    fractions = np.linspace(0.0, 1.0, _HERMITE_SAMPLES + 1)
    track = [branch[0].half.crossing]
    for first, second in pairwise(branch):
        track += [interpolate(first, second, fraction)[0] for fraction in fractions[1:]]
    track = np.array(track)
    steps = np.abs(np.diff(track[:, X]))
    if by_arc:
        steps = np.hypot(steps, np.diff(track[:, Z]))
    traveled = np.concatenate([[0.0], np.cumsum(steps)])
    distances = np.linspace(0.0, traveled[-1], count)
    positions = np.interp(distances, traveled, np.arange(traveled.size)) / _HERMITE_SAMPLES
    xs = np.linspace(track[0, X], track[-1, X], count)
    members = [branch[0]]
    for position, x in zip(positions[1:-1], xs[1:-1], strict=True):
        i = min(int(position), len(branch) - 2)
        if by_arc:
            members.append(between(branch[i], branch[i + 1], position - i, mu))
        else:
            guess, tangent = interpolate(branch[i], branch[i + 1], position - i)
            half = correct(guess, fix_coordinate(X, x), mu, section=branch[i].half.section)
            members.append(Point(half, tangent))
    return members if count == 1 else [*members, branch[-1]]


def orbit_set(
    family: str,
    members: Branch,
    *,
    mu: float = MU,
    mirror: Array | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> OrbitSet:
    """Table of corrected members with their stability and closest approaches; their states are
    multiplied by `mirror` (6,). `progress` is called with (members done, members)."""
    rows = []
    for member in counted(members, progress):
        state, period = member.half.state, member.half.period
        perigee, perilune = distances_km(member.half, mu)
        index = stability_index(state, period, mu)
        rows.append((period, float(jacobi_constant(state, mu)), index, perilune, perigee))
    columns = np.array(rows).reshape(-1, 5).T
    states = np.array([member.half.state for member in members]).reshape(-1, 6)
    if mirror is not None:
        states = states * mirror + 0.0
    return OrbitSet(np.full(len(members), family), states, *columns)


def concatenate(sets: list[OrbitSet]) -> OrbitSet:
    """Concatenate tables of orbits."""
    return OrbitSet(*(np.concatenate(columns) for columns in zip(*sets, strict=True)))


def observer_library(
    members: Mapping[str, int] | None = None,
    keep_out: Extent = KEEP_OUT,
    *,
    mu: float = MU,
    progress: Callable[[int, int], None] | None = None,
) -> OrbitSet:
    """Candidate observer orbits: thirteen families, 302 orbits (Paul & Fan, section 3).

    Parameters
    ----------
    members : mapping of str to int, optional
        Orbits per family, at least 1; families that are not named are not generated. By default
        `DEFAULT_MEMBERS`, 24 per Lyapunov family and 23 of each other family.
    keep_out : Extent
        Ends of the families: by default 100 km above the Moon and 200 km above the Earth;
        `cislunar.orbits.extent.CATALOG_EXTENT` continues through the primaries instead.
    mu : float
        Mass ratio.
    progress : callable, optional
        Called with (orbits done, orbits in all).

    Returns
    -------
    OrbitSet
        In the order of `FAMILIES` and along each family. All states are perpendicular crossings of
        y = 0.

    Raises
    ------
    ConfigurationError
        If a family is unknown, a number of orbits is less than 1, none is requested, an argument is
        of another kind, or no orbit of a family clears both bodies.
    ConvergenceError
        If a family cannot be followed.
    """
    given = DEFAULT_MEMBERS if members is None else members
    require_kind("members", given, Mapping, "give a number for each family, {'Halo_L2_S': 23}")
    require_kind("keep_out", keep_out, Extent, "give an Extent of cislunar.orbits.extent")
    counts, mu = dict(given), number_of("mu", mu)
    for family, count in counts.items():
        root_of(family)
        count_of(f"members of {family}", count)
    if not counts:
        raise ConfigurationError("members: name at least one orbit family")
    total, done = sum(counts.values()), 0

    def advance(*_: int) -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress(done, total)

    sets = []
    for family in FAMILIES:
        if family not in counts:
            continue
        branch = family_branch(family, mu=mu, extent=keep_out)
        by_arc = root_of(family) in _SPACING_BY_ARC
        chosen = spaced_members(branch, int(counts[family]), by_arc=by_arc, mu=mu)
        mirror = SOUTH if family.endswith("_S") else None
        sets.append(orbit_set(family, chosen, mu=mu, mirror=mirror, progress=advance))
    return concatenate(sets)
