"""Selection of members of a branch: by value, evenly spaced, or clear of Earth and Moon."""

from functools import partial

import numpy as np

from cislunar.constants import MU, SECONDS_PER_DAY, TIME_UNIT_S
from cislunar.errors import ConvergenceError
from cislunar.orbits.continuation import Branch, Point, between, locate, split_at_extrema
from cislunar.orbits.extent import altitude_km, measure_of

DAY = SECONDS_PER_DAY / TIME_UNIT_S
"""Nondimensional."""

_CLEAR_KM = 1e-3
"""Altitude over Earth and Moon at which the clear part of a family begins and ends, km."""


def select(branch: Branch, quantity: str, value: float, mu: float = MU) -> Branch:
    """All members of a branch at which a quantity (`extent.measure_of`) has a value, nondimensional
    or km, in order along the branch. Both members on either side of a fold of the quantity between
    neighbors are found as well."""
    measure = measure_of(quantity, mu)

    def difference(member: Point) -> float:
        return measure(member) - value

    refined = split_at_extrema(branch, difference, mu)
    return [member for _, member in locate(refined, difference, mu)]


def spread_members(branch: Branch, count: int, mu: float = MU) -> Branch:
    """Members equally spaced along a branch by arc length of continuation, including its ends."""
    if len(branch) < 2:
        return branch
    crossings = np.array([member.half.crossing for member in branch])
    traveled = np.concatenate(
        [[0.0], np.cumsum(np.linalg.norm(np.diff(crossings, axis=0), axis=1))]
    )
    distances = np.linspace(0.0, traveled[-1], count)
    positions = np.interp(distances, traveled, np.arange(traveled.size))
    found = []
    for position in positions:
        first = min(int(position), len(branch) - 2)
        fraction = float(position - first)
        found.append(between(branch[first], branch[first + 1], fraction, mu))
    return found


def clear_part(branch: Branch, mu: float = MU) -> Branch:
    """Part of a branch between the first and the last orbit that clear Earth and Moon."""
    altitude = partial(altitude_km, mu=mu, above=_CLEAR_KM)
    clear = [index for index, member in enumerate(branch) if altitude(member) > 0.0]
    if not clear:
        return []
    first, last = clear[0], clear[-1]

    def grazing(pair: Branch) -> Branch:
        try:
            return [member for _, member in locate(pair, altitude, mu)]
        except ConvergenceError:  # near a body orbits do not close to the last digits
            return []

    start = grazing(branch[first - 1 : first + 1]) if first else []
    end = grazing(branch[last : last + 2]) if last + 1 < len(branch) else []
    return start + branch[first : last + 1] + end


def value_and_extent(quantity: str, value: float, branch: Branch, mu: float, *, days: bool) -> str:
    """A value that no member has, and the range of the family, for a message."""
    name = "stability" if quantity == "stability_index" else quantity
    if not branch:
        return f"{name} = {value:g}, since none is clear; give clear=False"
    reached = [measure_of(quantity, mu)(member) for member in branch]
    low, high = min(reached), max(reached)
    in_days = f"{value / DAY:g} days; the family has about {low / DAY:.3f} to {high / DAY:.3f} days"
    if days:
        return f"period = {in_days}"
    found = f"{name} = {value:g}; the family has about {low:.3f} to {high:.3f}"
    if quantity != "period":
        return found
    remedy = "; a period in days is period_days" if low <= DAY * value <= high else ""
    return f"{found}, nondimensional ({in_days}){remedy}"
