"""Other tests for maneuvers, to compare with the generalized likelihood ratio.

The normalized innovation squared (NIS) of an observation has the chi-squared distribution with two
degrees of freedom without a maneuver. Page's (1954) cumulative sum (CUSUM) adds up its
log-likelihood ratio for an increase of the innovations' covariance. The control distance
(Holzinger, Scheeres & Alfriend 2012) is the least control effort that joins an orbit before with
one after.
"""

import numpy as np
from numpy.typing import ArrayLike

from cislunar.errors import ConfigurationError
from cislunar.runtime import Array
from cislunar.runtime.arguments import array_of, number_of, vectors_of


def cusum(
    squared: ArrayLike, start: float = 0.0, *, inflation: float = 2.0, size: int = 2
) -> Array:
    """Cumulative sums of the NIS of one target.

    Parameters
    ----------
    squared : array_like, shape (row,)
        Normalized innovations squared in the order of time.
    start : float
        Cumulative sum before the first.
    inflation : float
        Factor, above 1, by which a maneuver multiplies the covariance of the innovations.
    size : int
        Number of components of an innovation.

    Returns
    -------
    ndarray, shape (row,)
        After each observation, ``max(0, previous + NIS (1 - 1 / inflation) / 2 - size ln(inflation)
        / 2)``.

    Raises
    ------
    ConfigurationError
        If a value is not finite, or the inflation is not larger than 1.
    """
    given = array_of("squared", squared, ("row",))
    factor = number_of("inflation", inflation, positive=True)
    if factor <= 1.0:
        raise ConfigurationError(f"inflation = {factor:g} must be larger than 1")
    ratio = 0.5 * (given * (1.0 - 1.0 / factor) - size * np.log(factor))
    # Page's sum is the distance of a random walk from its minimum so far
    walk = start + np.cumsum(ratio)
    return walk - np.minimum(np.minimum.accumulate(walk), 0.0)


def control_gramian(transitions: ArrayLike, step: float) -> Array:
    """Controllability Gramian of an acceleration, by the trapezoidal rule.

    Parameters
    ----------
    transitions : array_like, shape (time, 6, 6)
        Transition matrices from each time of an equidistant grid to the last one.
    step : float
        Nondimensional.

    Returns
    -------
    ndarray, shape (6, 6)
        Integral of ``Phi B B^T Phi^T`` with B = (0, I).

    Raises
    ------
    ConfigurationError
        If the matrices have another shape, or a value is not finite.
    """
    each = array_of("transitions", transitions, ("time", 6, 6))[:, :, 3:]
    weight = np.full(each.shape[0], step)
    weight[[0, -1]] *= 0.5
    return np.einsum("t,tij,tkj->ik", weight, each, each)


def control_distance(difference: ArrayLike, gramian: ArrayLike) -> Array:
    """Least control effort that changes the state at the last time by a difference.

    Parameters
    ----------
    difference : array_like, shape (..., 6)
        State after less the propagated state before, nondimensional.
    gramian : array_like, shape (6, 6)
        See `control_gramian`.

    Returns
    -------
    ndarray, shape (...)
        Square root of the integral of the squared acceleration, for linear motion.

    Raises
    ------
    ConfigurationError
        If an array has another shape, or the Gramian is not finite or singular.
    """
    given, matrix = vectors_of("difference", difference, 6), array_of("gramian", gramian, (6, 6))
    try:
        needed = np.linalg.solve(matrix, given[..., None])[..., 0]
    except np.linalg.LinAlgError:
        raise ConfigurationError("gramian is singular; take a longer span of time") from None
    return np.sqrt(np.sum(given * needed, axis=-1))
