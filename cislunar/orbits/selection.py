"""Members of a branch: those of a given value, so many along it, those clear of Earth and Moon."""

from functools import partial

import numpy as np

from cislunar.constants import MU
from cislunar.errors import ConvergenceError
from cislunar.orbits.continuation import Branch, Point, between, locate, split_at_extrema
from cislunar.orbits.extent import altitude_km, measure_of

CLEAR_KM = 1e-3
"""Altitude over Earth and Moon at which the part of a family that clears them begins and ends."""


def select(branch: Branch, quantity: str, value: float, mu: float = MU) -> Branch:
    """Every member of a branch at which a quantity takes a value.

    Also finds both members either side of a fold of the quantity that lies between neighbours.

    Parameters
    ----------
    branch : list of Point
        Continuation of the family.
    quantity : str
        As for `extent.measure_of`: "x", "z", "period", "jacobi", "perilune_km" or "perigee_km".
    value : float
        Nondimensional, or km.
    mu : float
        Mass ratio.

    Returns
    -------
    list of Point
        In order along the branch, possibly empty.

    Raises
    ------
    ConfigurationError
        If the quantity is unknown.
    ConvergenceError
        If the corrector fails.
    """
    measure = measure_of(quantity, mu)

    def difference(member: Point) -> float:
        return measure(member) - value

    refined = split_at_extrema(branch, difference, mu)
    return [member for _, member in locate(refined, difference, mu)]


def spread_members(branch: Branch, count: int, mu: float = MU) -> Branch:
    """Members equally spaced along a branch by the arc length of continuation, ends included."""
    if len(branch) < 2:
        return branch
    crossings = np.array([member.half.crossing for member in branch])
    travelled = np.concatenate(
        [[0.0], np.cumsum(np.linalg.norm(np.diff(crossings, axis=0), axis=1))]
    )
    wanted = np.linspace(0.0, travelled[-1], count)
    places = np.interp(wanted, travelled, np.arange(travelled.size))
    found = []
    for place in places:
        first = min(int(place), len(branch) - 2)
        fraction = float(place - first)
        found.append(between(branch[first], branch[first + 1], fraction, mu))
    return found


def clear_part(branch: Branch, mu: float = MU) -> Branch:
    """A branch between the first and the last of its orbits that clear Earth and Moon."""
    altitude = partial(altitude_km, mu=mu, above=CLEAR_KM)
    clear = [place for place, member in enumerate(branch) if altitude(member) > 0.0]
    if not clear:
        return []
    first, last = clear[0], clear[-1]

    def grazing(pair: Branch) -> Branch:
        try:
            return [member for _, member in locate(pair, altitude, mu)]
        except ConvergenceError:  # next to a body no orbit closes to the last digits
            return []

    start = grazing(branch[first - 1 : first + 1]) if first else []
    end = grazing(branch[last : last + 2]) if last + 1 < len(branch) else []
    return start + branch[first : last + 1] + end
