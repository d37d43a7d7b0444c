"""Ends of the families of periodic orbits."""

from collections.abc import Mapping
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from cislunar.constants import EARTH_RADIUS_KM, LENGTH_UNIT_KM, MOON_RADIUS_KM, MU
from cislunar.dynamics import closest_approaches, jacobi_constant
from cislunar.errors import ConfigurationError
from cislunar.orbits import branches
from cislunar.orbits.continuation import Branch, Measure, Point, continue_branch, locate
from cislunar.orbits.corrector import HalfOrbit, X, Z
from cislunar.orbits.stability import stability_index
from cislunar.runtime.arguments import require_choice
from cislunar.runtime.settings_fields import NotNegative, Section, setting

_MEMBERS_BEFORE_CLEARANCE = 100
"""A branch that has not left the keep-out spheres after this many steps is abandoned."""

_BUTTERFLY_LAST_PERIOD = 11.556
"""At longer periods the butterflies leave the Moon for a branch around both primaries."""


class KeepOut(Section):
    """Least altitudes over the Moon and the Earth; lower orbits are excluded."""

    # fmt: off

    perilune_altitude_km: NotNegative = setting(
        "minimum altitude above the Moon (extent `keep_out`)", "km", default=100)
    perigee_altitude_km: NotNegative = setting(
        "minimum altitude above the Earth (extent `keep_out`)", "km", default=200)

    # fmt: on

    @property
    def distances_km(self) -> tuple[float, float]:
        """Least distances from the centers of Moon and Earth, km."""
        return (
            self.perilune_altitude_km + MOON_RADIUS_KM,
            self.perigee_altitude_km + EARTH_RADIUS_KM,
        )


class Extent(NamedTuple):
    """Extent of the continuation of families."""

    keep_out: KeepOut | None = KeepOut()
    """Least altitudes; None: families continue through the bodies."""
    ends: Mapping[str, tuple[str, float]] = {"Butterfly": ("period", _BUTTERFLY_LAST_PERIOD)}
    """Last member of a branch: the quantity ("x" at the crossing or "period") and its value."""


KEEP_OUT = Extent()
"""Default: no candidate orbit intersects the Moon or the Earth."""

CATALOG_EXTENT = Extent(
    keep_out=None,
    ends={
        "Butterfly": ("period", 11.55529),
        "Dragonfly": ("period", 7.170478),
        "Halo_L1": ("x", -0.41456),
        "Halo_L2": ("perilune_km", MOON_RADIUS_KM),
        "Halo_L3": ("x", -0.18233),
        "Lyap_L1": ("perilune_km", MOON_RADIUS_KM),
        "Lyap_L2": ("perilune_km", MOON_RADIUS_KM),
        "Lyap_L3": ("x", -1.94443),
    },
)
"""Families as far as a published catalog lists them, through the primaries if need be.

The ends are those of the JPL three-body periodic orbit catalog for the butterflies, dragonflies, L1
halos and L3 Lyapunov orbits, and three rows short of it for the L3 halos. The other families end at
the surface of the Moon; `cislunar.orbits.catalog` follows more of them. The L1 and L3 halos then
envelop the Moon and the Earth at spacings near 30,000 km (Paul & Fan, section 3).
"""


def branch_seed(root: str, mu: float = MU) -> branches.Seed:
    """Seed of a branch by its name ("Halo_L1", "DRO", ...)."""
    if root.startswith("Lyap"):
        return branches.lyapunov_seed(int(root[-1]), mu)
    if root.startswith("Halo"):
        return branches.halo_seed(int(root[-1]), mu)
    single = {
        "Butterfly": branches.butterfly_seed,
        "Dragonfly": branches.dragonfly_seed,
        "DRO": branches.retrograde_seed,
    }
    return single[root](mu)


def distances_km(half: HalfOrbit, mu: float = MU) -> tuple[float, float]:
    """Least distances of a symmetric orbit to the centers of Earth and Moon, km."""
    # The other half of a symmetric orbit is the mirror image of this one.
    perigee, perilune = closest_approaches(half.state, half.crossing[-1], mu=mu)
    return perigee * LENGTH_UNIT_KM, perilune * LENGTH_UNIT_KM


def altitude_km(member: Point, mu: float = MU, above: float = 0.0) -> float:
    """Least altitude over the Earth and the Moon, minus the altitude `above`, km."""
    radii = EARTH_RADIUS_KM, MOON_RADIUS_KM
    return float(np.min(np.subtract(distances_km(member.half, mu), radii))) - above


def measure_of(quantity: str, mu: float = MU) -> Measure:
    """Function of a member by its name: "x", "z", "period", "jacobi", "stability_index", ..."""
    measures: dict[str, Measure] = {
        "x": lambda member: float(member.half.crossing[X]),
        "z": lambda member: float(member.half.crossing[Z]),
        "period": lambda member: member.half.period,
        "jacobi": lambda member: float(jacobi_constant(member.half.state, mu)),
        "stability_index": lambda member: stability_index(
            member.half.state, member.half.period, mu
        ),
        "perilune_km": lambda member: distances_km(member.half, mu)[1],
        "perigee_km": lambda member: distances_km(member.half, mu)[0],
    }
    require_choice("quantity", quantity, measures)
    return measures[quantity]


@lru_cache(maxsize=64)
def follow_branch(
    root: str,
    mu: float,
    perilune_km: float,
    perigee_km: float,
    end: tuple[str, float] | None,
) -> Branch:
    """Members of a branch (`branch_seed`) that clear both primaries by the distances from their
    centers, km, up to its `end`, a quantity and its value at the last member. The list is shared
    between callers: not to be modified. Raises a `ConfigurationError` if no member clears the
    primaries."""
    seed = branch_seed(root, mu)
    quantity, last_value = end or ("x", np.inf)
    reached = measure_of(quantity, mu)
    before_end = np.sign(last_value - reached(Point(seed.half, seed.direction)))
    planar = seed.half.planar

    def clearance(member: Point) -> float:
        perigee, perilune = distances_km(member.half, mu)
        return min(perilune - perilune_km, perigee - perigee_km)

    def remaining(member: Point) -> float:
        return float(before_end * (last_value - reached(member)))

    has_cleared = clearance(Point(seed.half, seed.direction)) >= 0.0
    patience = _MEMBERS_BEFORE_CLEARANCE

    def stop(member: Point) -> bool:
        nonlocal has_cleared, patience
        patience -= 1
        clear = clearance(member) >= 0.0
        violated = has_cleared and not clear
        has_cleared = has_cleared or clear
        # A branch that crosses the plane would continue as its own mirror image.
        flipped = not planar and member.half.crossing[Z] * seed.half.crossing[Z] < 0.0
        hopeless = patience <= 0 and not has_cleared
        return violated or hopeless or flipped or remaining(member) <= 0.0

    branch = continue_branch(seed.half, seed.direction, stop, mu=mu)
    if not has_cleared:
        raise ConfigurationError(
            f"no orbit of {root} keeps {perilune_km:.0f} km from the Moon's center and "
            f"{perigee_km:.0f} km from the Earth's: lower the keep-out altitudes"
        )
    for condition in (clearance, remaining):
        branch = trim(branch, condition, mu)
    return branch


def trim(branch: Branch, condition: Measure, mu: float) -> Branch:
    """Part of a branch where a condition is positive, with ends corrected to where it is zero; the
    condition changes sign at most once near either end."""
    if condition(branch[-1]) < 0.0:
        index, root = locate(branch[-2:], condition, mu)[-1]
        branch = [*branch[: len(branch) - 1 + index], root]
    if condition(branch[0]) < 0.0:
        index, root = locate(branch, condition, mu, limit=1)[0]
        branch = [root, *branch[index + 1 :]]
    return branch
