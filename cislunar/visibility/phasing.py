"""Satellites along one orbit: equal temporal offsets and the distinct phases that they need.

The counts 1..10 place satellites at fractions j/n of the period. Only 32 of the 55 fractions are
distinct, so that visibility is computed once for each of these.
"""

from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from cislunar.runtime import count_of


def distinct_phases(max_satellites: int) -> tuple[NDArray[np.float64], list[NDArray[np.intp]]]:
    """Distinct fractions j/n of the period for all counts n up to a maximum.

    Parameters
    ----------
    max_satellites : int
        Largest number of satellites on one orbit, at least 1.

    Returns
    -------
    phase : ndarray, shape (n_phases,)
        Sorted fractions of the period in [0, 1); 32 of them for ten satellites.
    members : list of ndarray
        ``members[n - 1]`` indexes the phases of n satellites at 0, T/n, ..., (n - 1) T/n
        (Paul & Fan, section 3).

    Raises
    ------
    ConfigurationError
        If `max_satellites` is not a whole number of at least 1.
    """
    count_of("max_satellites", max_satellites)
    per_count = [[Fraction(j, n) for j in range(n)] for n in range(1, max_satellites + 1)]
    ordered = sorted(set().union(*per_count))
    position = {fraction: index for index, fraction in enumerate(ordered)}
    members = [np.array([position[fraction] for fraction in row]) for row in per_count]
    return np.array([float(fraction) for fraction in ordered]), members
