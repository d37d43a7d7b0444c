"""Random streams of a realization, the monitored targets, and the estimate at the epoch.

Every random draw belongs to a seed and a target. Cells that share a seed therefore share the
truth and the measurement errors of their common targets, whatever else differs between them.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.dynamics import propagate_many
from cislunar.estimation.estimator import InitialEstimate
from cislunar.runtime import Array, array_of, count_of

_INITIAL_QUATERNION = (0.0, 0.0, 0.0, 1.0)
INITIAL_RATE_DEG_H = (-44.723808, -6.6573, -8.514216)
"""Mean attitude and angular velocity of the targets at the epoch (Paul & Fan, table 3)."""

# Independent streams of random numbers; the first entry of a generator's seed.
_PHASE, _SELECTION, INITIAL_ERROR, MEASUREMENT, TASKING, ESTIMATOR, BODY, ALARM, LOSS = range(9)
TORQUE, PRESSURE, OBSERVER, CHARACTERIZATION, MANEUVER = 9, 10, 11, 12, 13


def stream(*key: int) -> np.random.Generator:
    """Generator of the stream with this key: a purpose, then seed and indices."""
    return np.random.default_rng([int(part) for part in key])


def monitored_targets(n_available: int, n_targets: int, seed: int) -> NDArray[np.int64]:
    """Choose the monitored targets; a larger set has the smaller ones (Paul & Fan, section 5.2).

    Parameters
    ----------
    n_available, n_targets, seed : int
        Number of targets to choose from, number to choose, and seed of the choice.

    Returns
    -------
    ndarray of int, shape (n_targets,)
        Indices into the available targets. Smaller sets are the first entries of larger ones.

    Raises
    ------
    ConfigurationError
        If the number to choose is not between 1 and the number to choose from, or an argument is
        not a whole number or negative.
    """
    count_of("n_targets", n_targets, most=count_of("n_available", n_available))
    count_of("seed", seed, least=0)
    return stream(_SELECTION, seed).permutation(n_available)[:n_targets]


def epoch_states(state: ArrayLike, period: ArrayLike, seed: int) -> Array:
    """Mean states of targets at the epoch: a random fraction of the period past y = 0.

    Parameters
    ----------
    state : array_like, shape (target, 6)
        States on y = 0, nondimensional, rotating frame.
    period : array_like, shape (target,)
        Periods, nondimensional.
    seed : int
        Seed of the fractions, one for each target.

    Returns
    -------
    ndarray, shape (target, 6)
        Nondimensional, rotating frame.

    Raises
    ------
    ConfigurationError
        If a state is not of 6 finite numbers or is evidently in km, the periods are not finite or
        not one of each state, or the seed is not a whole number of at least 0.
    ConvergenceError
        If an orbit meets the center of a primary.
    """
    states = array_of("state", state, ("target", 6))
    periods = array_of("period", period, (len(states),))
    count_of("seed", seed, least=0)
    fractions = [stream(_PHASE, seed, j).random() for j in range(periods.size)]
    return propagate_many(states, (fractions * periods)[:, None], method="dop853")[:, 0]


def initial_estimate(translation: ArrayLike, sigma: ArrayLike) -> InitialEstimate:
    """Initial estimate with the paper's attitude and angular velocity for all targets.

    Parameters
    ----------
    translation : array_like, shape (target, 6)
        Mean states at the start of the run, nondimensional, propagation frame.
    sigma : array_like, shape (12,)
        Standard deviations, see `InitialEstimate`.

    Returns
    -------
    InitialEstimate

    Raises
    ------
    ConfigurationError
        If an array has another shape, or a value is not finite.
    """
    states = array_of("translation", translation, ("target", 6)).copy()
    rate = np.deg2rad(INITIAL_RATE_DEG_H) / 3600.0
    n_targets = states.shape[0]
    return InitialEstimate(
        np.tile(np.array(_INITIAL_QUATERNION), (n_targets, 1)),
        np.tile(rate, (n_targets, 1)),
        states,
        array_of("sigma", sigma, (12,)).copy(),
    )
