"""Members of a branch at which a quantity takes a given value."""

from cislunar.constants import MU
from cislunar.orbits.continuation import Branch, Point, locate, split_at_extrema
from cislunar.orbits.extent import measure_of


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
