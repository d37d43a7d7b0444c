"""Periodic orbits of the Earth-Moon system by family, with filters.

Families extend as far as JPL's catalog of three-body periodic orbits lists them, where that is
known, through the Earth and the Moon if need be. Continued branches are cached in memory.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from cislunar.constants import EARTH_RADIUS_KM, MOON_RADIUS_KM, MU
from cislunar.errors import ConfigurationError, ConvergenceError, did_you_mean
from cislunar.orbits import catalog_seeds as seeds
from cislunar.orbits.branches import Seed
from cislunar.orbits.continuation import Branch, Measure, Point, continue_branch, join, locate
from cislunar.orbits.corrector import Z
from cislunar.orbits.extent import CATALOG_EXTENT, altitude_km, branch_seed, measure_of
from cislunar.orbits.families import FAMILIES, SOUTH, OrbitSet, orbit_set, root_of
from cislunar.orbits.selection import DAY, clear_part, select, spread_members, value_and_extent
from cislunar.quantities import in_unit, nondimensional
from cislunar.runtime import Array, count_of, number_of, number_or_range, require_kind

ValueOrRange = float | tuple[float, float]

_MOST_MEMBERS = 1000
"""Largest number of members of a branch, which ends there if it has not met its end."""
_MOST_SPREAD = 10_000
"""Largest number of members that are spread along a family."""

_FLATTEST = 1e-4
"""Speed out of the plane of the last orbit before a planar one, where branches meet."""

EASY_ITERATIONS = 6
"""Unstable orbits need more corrector iterations for their last digits."""

_OFF_RESONANCE = 0.1
"""Resonant orbits end where their period deviates by more than this share from the resonance."""

_DEFAULT_COUNT = 40


_ACROSS = np.array([1.0, -1.0, 1.0, -1.0, 1.0, 1.0])


class Family(NamedTuple):
    """Seed, ends and symmetry of a family."""

    meaning: str
    seed: Callable[[float], Seed]
    ends: tuple[str, ...]
    """"flat", "turn" (of the Jacobi constant), "bodies", "turns" of the Moon near the period, or a
    quantity and its value."""
    mirror: Array | None = None


_ENDS = {root: f"{key} {value}" for root, (key, value) in CATALOG_EXTENT.ends.items()} | {
    "Halo_L1": "x -0.414562",
    "Halo_L2": "period 0.7191706",
    "Halo_L3": "x -0.1786714",
    "Lyap_L1": "bodies",
    "Lyap_L2": "period 8.2139134",
    "Lyap_L3": "bodies",
}
"""Ends of the observers' families: those of JPL's catalog, unless the catalog stops before the
surface of a body."""


def _catalog() -> dict[str, Family]:
    found = {}
    kinds = {"Butterfly": "butterfly about L2", "Dragonfly": "dragonfly about L2"}
    for name in FAMILIES:
        kind, *rest = name.split("_")
        about = {"Halo": "halo about", "Lyap": "planar Lyapunov about"}.get(kind)
        meaning = f"{about} {rest[0]}" if about else kinds[kind]
        half = {"N": ", northern", "S": ", southern"}.get(rest[-1], "")
        root = root_of(name)
        found[name] = Family(
            meaning + half,
            partial(branch_seed, root),
            (_ENDS[root],),
            SOUTH if half == ", southern" else None,
        )
    for point in (1, 2, 3):
        found[f"Vertical_L{point}"] = Family(
            f"vertical about L{point}", partial(seeds.vertical_seed, point), ("flat",)
        )
        found[f"Axial_L{point}"] = Family(
            f"axial about L{point}", partial(seeds.axial_seed, point), ("turn",)
        )
    for name, long, end in (("Short", False, "2.0181025"), ("Long", True, "2.7116867")):
        for point, mirror in ((4, None), (5, _ACROSS)):
            found[f"{name}_L{point}"] = Family(
                f"{name.lower()} period about L{point}",
                partial(seeds.triangular_seed, long),
                (f"jacobi {end}",),
                mirror,
            )
    found["DRO"] = Family("distant retrograde", partial(branch_seed, "DRO"), ("bodies",))
    found["DPO"] = Family("distant prograde", seeds.distant_prograde_seed, ("period 9.6400373",))
    found["LPO_E"] = Family("low prograde, eastern", seeds.eastern_seed, ("jacobi 3.1566979",))
    found["LPO_W"] = Family("low prograde, western", seeds.low_prograde_seed, ("jacobi 3.1794087",))
    for name in ("4:1", "3:1", "3:1b", "2:1", "3:2", "3:2b", "4:3", "2:3b", "1:2b"):
        found[f"Resonant_{name}"] = _resonant(*_RESONANT.fullmatch(f"Resonant_{name}").groups())
    return found


_RESONANT = re.compile(r"Resonant_([1-9]):([1-9])(b?)")


def _resonant(p: str, q: str, mark: str) -> Family:
    return Family(
        f"{p}:{q} resonant, a perigee {'opposite the Moon' if mark else 'on the side of the Moon'}",
        partial(seeds.resonant_seed, int(p), int(q), moonward=not mark),
        ("turn", "bodies", f"turns {q}"),
    )


CATALOG: dict[str, Family] = _catalog()
"""Families by name."""


def family_named(name: str) -> Family:
    """Family of a name in `CATALOG`, or any other resonance such as "Resonant_5:2".

    Raises
    ------
    ConfigurationError
        If the family is unknown, or a resonance is not in lowest terms.
    """
    require_kind("family", name, str, "give the name of an orbit family, such as 'Halo_L2_S'")
    if name not in CATALOG and (resonance := _RESONANT.fullmatch(name)):
        if math.gcd(int(resonance[1]), int(resonance[2])) > 1:
            raise ConfigurationError(f"family = {name!r} must be in lowest terms, as Resonant_3:2")
        return _resonant(*resonance.groups())
    if name not in CATALOG:
        near = did_you_mean(name, CATALOG, 0.8)  # at a lower cutoff all names are similar
        every = f"the families are {', '.join(CATALOG)}, and any other Resonant_p:q"
        raise ConfigurationError(f"unknown orbit family {name!r}; {near or every}")
    return CATALOG[name]


def end_in_words(family: Family) -> str:
    """Description of the ends of a family."""
    words = {
        "flat": "where it is flat",
        "turn": "where the Jacobi constant turns",
        "bodies": "at the surface of the Earth or the Moon",
    }
    found = []
    for end in family.ends:
        quantity, _, value = end.partition(" ")
        if quantity == "turns":
            found.append(f"{_OFF_RESONANCE:.0%} off {value} sidereal months")
        else:
            found.append(words.get(quantity, f"at {quantity} = {value}"))
    return ", ".join(found)


def _conditions(family: Family, seed: Seed, mu: float) -> list[Measure]:
    """Functions of a member that are positive up to the ends of a family."""
    first = Point(seed.half, seed.direction)
    found: list[Measure] = []
    for end in family.ends:
        quantity, _, value = end.partition(" ")
        if quantity == "flat":
            found.append(partial(_height, upward=np.sign(seed.half.crossing[Z])))
        elif quantity == "turn":
            # the seed itself may lie at a fold, where the slope has no sign
            found.append(_turn(mu))
        elif quantity == "bodies":
            found.append(partial(altitude_km, mu=mu))
        elif quantity == "turns":
            found.append(partial(_near_resonance, period=2.0 * np.pi * float(value)))
        else:
            found.append(_before(quantity, float(value), first, mu))
    return found


def _before(quantity: str, last: float, first: Point, mu: float) -> Measure:
    """Function that is positive while a quantity has not passed a value."""
    measure = measure_of(quantity, mu)
    sign = float(np.sign(last - measure(first)))
    return lambda member: sign * (last - measure(member))


def _height(member: Point, upward: float) -> float:
    return float(upward * member.half.crossing[Z]) - _FLATTEST


def _near_resonance(member: Point, period: float) -> float:
    return _OFF_RESONANCE - abs(member.half.period / period - 1.0)


def _turn(mu: float) -> Measure:
    """Function that is positive until the Jacobi constant reverses its trend."""
    signs: list[float] = []

    def ahead(member: Point) -> float:
        slope = seeds.jacobi_slope(member, mu)
        if not signs:
            signs.append(float(np.sign(slope)))
        return signs[0] * slope

    return ahead


_BRANCHES: dict[tuple[str, float], Branch] = {}
"""Cache of continued branches."""


def catalog_branch(
    name: str, mu: float = MU, *, progress: Callable[[int, int], None] | None = None
) -> Branch:
    """Continuation of a family between its ends; the northern or L4 branch for mirrored families.

    Parameters
    ----------
    name : str
        Name of the family.
    mu : float
        Mass ratio.
    progress : callable, optional
        Called with (members followed, largest number of members).

    Returns
    -------
    list of Point
        Shared between callers: not to be modified.

    Raises
    ------
    ConfigurationError
        If the family is unknown.
    ConvergenceError
        If the family cannot be followed.
    """
    family_named(name)
    if name.startswith(("Short_L5", "Long_L5")):
        name = name.replace("L5", "L4")
    if name.endswith("_S"):
        name = name.removesuffix("S") + "N"
    key = name, float(mu)
    if key not in _BRANCHES:
        _BRANCHES[key] = _between_ends(*key, progress)
    return _BRANCHES[key]


def _between_ends(name: str, mu: float, progress: Callable[[int, int], None] | None) -> Branch:
    """Continue a family from its seed to its ends."""
    family = family_named(name)
    seed = family.seed(mu)
    forward = _followed(family, seed, mu, progress)
    if not name.startswith("Resonant"):
        return forward
    backward = _followed(family, Seed(seed.half, -seed.direction), mu, progress)
    return join(backward, forward)


def _followed(
    family: Family, seed: Seed, mu: float, progress: Callable[[int, int], None] | None
) -> Branch:
    """A branch from its seed to the first of its ends."""
    conditions, done = _conditions(family, seed, mu), 0

    def stop(member: Point) -> bool:
        nonlocal done
        done += 1
        if progress is not None:
            progress(done, _MOST_MEMBERS)
        return min(condition(member) for condition in conditions) <= 0.0

    branch = continue_branch(
        seed.half,
        seed.direction,
        stop,
        mu=mu,
        max_points=_MOST_MEMBERS,
        partial=True,
        easy_iterations=EASY_ITERATIONS,
    )
    for condition in conditions:
        if condition(branch[-1]) < 0.0 < condition(branch[-2]):
            try:
                branch = [*branch[:-1], locate(branch[-2:], condition, mu)[-1][1]]
            except ConvergenceError:  # near a body orbits do not close to the last digits
                branch = branch[:-1]
    return branch


def periodic_orbits(
    family: str,
    *,
    jacobi: ValueOrRange | None = None,
    period: ValueOrRange | None = None,
    period_days: ValueOrRange | None = None,
    stability: ValueOrRange | None = None,
    count: int | None = None,
    clear: bool = True,
    mu: float = MU,
    progress: Callable[[int, int], None] | None = None,
    following: Callable[[int, int], None] | None = None,
) -> OrbitSet:
    """Members of a family of periodic orbits with given values, or within ranges.

    Parameters
    ----------
    family : str
        Name in `CATALOG`, such as "Halo_L2_S", "Vertical_L1", "DPO" or "Resonant_3:2".
    jacobi, period, stability : float or (float, float)
        Jacobi constant and period, nondimensional, and stability index: a value, for at most one of
        the three, or a range. The period may be a quantity of `astropy.units`.
    period_days : float or (float, float)
        Period in days, instead of `period`.
    count : int, optional
        Without a value: number of members evenly along the family, before the ranges are applied;
        40 if omitted.
    clear : bool
        Exclude orbits that pass through the Earth or the Moon.
    mu : float
        Mass ratio.
    progress : callable, optional
        Called with (members done, members in all).
    following : callable, optional
        Called with (members followed, largest number of members) during the continuation.

    Returns
    -------
    OrbitSet
        In order along the family; there may be several members of one value. It is empty if no
        member lies within the ranges.

    Raises
    ------
    ConfigurationError
        If the conditions are impossible, or no member of the family has the value; the message
        gives the range of the family.
    ConvergenceError
        If the family cannot be followed.
    """
    entry, mu = family_named(family), number_of("mu", mu)
    given = {
        "jacobi": number_or_range("jacobi", jacobi),
        "period": number_or_range("period", nondimensional("period", period, "time")),
        "stability_index": number_or_range("stability", stability),
    }
    if period_days is not None:
        if period is not None:
            raise ConfigurationError(f"members of {family}: give period or period_days, not both")
        days = number_or_range("period_days", in_unit("period_days", period_days, "d"))
        given["period"] = DAY * days if isinstance(days, float) else tuple(DAY * d for d in days)
    ranges = {key: each for key, each in given.items() if isinstance(each, tuple)}
    values = {key: each for key, each in given.items() if isinstance(each, float)}
    if len(values) > 1 or (values and count is not None):
        raise ConfigurationError(
            f"members of {family}: give one value of jacobi, period or stability, or count; the "
            "others as ranges (lowest, highest)"
        )
    for key, (low, high) in ranges.items():
        if not low <= high:
            raise ConfigurationError(f"members of {family}: {key} from {low} to {high} is no range")
    if count is not None:
        count = count_of(f"members of {family}: count", count, most=_MOST_SPREAD)
    branch = catalog_branch(family, mu, progress=following)
    if clear:
        branch = clear_part(branch, mu)
    if values:
        ((quantity, value),) = values.items()
        members = select(branch, quantity, value, mu) if branch else []
    else:
        members = spread_members(branch, _DEFAULT_COUNT if count is None else count, mu)
    found = orbit_set(family, members, mu=mu, mirror=entry.mirror, progress=progress)
    kept = np.ones(len(members), dtype=bool)
    if clear:
        kept &= (found.perigee_km > EARTH_RADIUS_KM) & (found.perilune_km > MOON_RADIUS_KM)
    if values and not kept.any():
        which = f"{family}{' clear of Earth and Moon' * clear}"
        raise ConfigurationError(
            f"no member of {which} has "
            + value_and_extent(quantity, value, branch, mu, days=period_days is not None)
        )
    for key, (low, high) in ranges.items():
        kept &= (getattr(found, key) >= low) & (getattr(found, key) <= high)
    return OrbitSet(*(column[kept] for column in found))
