"""Threshold of the test for an impulse, from the rate of false alarms.

Each statistic has the chi-squared distribution with three degrees of freedom, but the statistics of
successive observations and hypothesized times are correlated. The probability that the largest of
them exceeds a threshold h is that of a union of events A_i (Naiman & Wynn 1997; importance sampling
of Naiman & Priebe 2001):

    P = sum_i P(A_i) E[1 / M | A_i],    M the number of statistics above h,

in which the innovations given A_i are normal with a conditioned component. The variance of the
estimate is small at any level, so that no tail is extrapolated.
"""

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq
from scipy.stats import chi2

from cislunar.errors import ConfigurationError
from cislunar.estimation.maneuvers.detection_settings import ManeuverDetection
from cislunar.runtime import Array
from cislunar.runtime.arguments import array_of, count_of, number_of


def false_alarm_threshold(
    false_alarms_per_target_day: float,
    independent_tests: float = ManeuverDetection.model_fields["independent_tests_per_day"].default,
) -> float:
    """Threshold of a statistic of three degrees of freedom for a rate of false alarms.

    Parameters
    ----------
    false_alarms_per_target_day : float
        Between 0 and 1.
    independent_tests : float
        Number of independent tests a day. With the number of all tests, the rate is an upper bound
        whatever their correlation; `threshold_of_schedule` has the threshold of a schedule.

    Returns
    -------
    float
        h with ``independent_tests * P(chi-squared > h)`` equal to the rate.

    Raises
    ------
    ConfigurationError
        If the rate or the number of tests is not positive, or the rate is not less than both 1 and
        the number of tests.
    """
    rate = number_of("false_alarms_per_target_day", false_alarms_per_target_day, positive=True)
    tests = number_of("independent_tests", independent_tests, positive=True)
    if rate >= min(1.0, tests):
        raise ConfigurationError(
            f"false_alarms_per_target_day = {rate:g} must be less than 1, and than the tests"
        )
    return float(chi2.isf(rate / tests, 3))


def whitened_tests(whitened: ArrayLike) -> Array:
    """Linear maps from the whitened innovations to the whitened impulse of every test: after each
    observation, that of every hypothesis.

    Parameters
    ----------
    whitened : array_like, shape (row, hypothesis, 2, 3)
        See `cislunar.estimation.maneuvers.likelihood_ratio.planned_information`; of one target.
        Observations of a hypothesis that are beyond the window are set to zero.

    Returns
    -------
    ndarray, shape (test, 3, row * 2)
        B with orthonormal rows; the statistic is ``|B w|^2``. Tests of hypotheses whose impulse is
        not determined are left out.

    Raises
    ------
    ConfigurationError
        If the derivatives have another shape, or one is not finite.
    """
    given = array_of("whitened", whitened, ("row", "hypothesis", 2, 3))
    n_rows, n_hypotheses = given.shape[:2]
    found = []
    for last in range(n_rows):
        for h in range(n_hypotheses):
            seen = np.zeros((n_rows, 2, 3))
            seen[: last + 1] = given[: last + 1, h]
            # a hypothesis beyond the window, or after the observation, is not tested
            if np.any(given[last, h]):
                flat = seen.reshape(-1, 3)
                scale = np.linalg.norm(flat, axis=0)
                if np.all(scale > 0.0):
                    left, size, _ = np.linalg.svd(flat / scale, full_matrices=False)
                    if size[-1] > _DETERMINED * size[0]:
                        found.append(left.T)
    return np.array(found).reshape(-1, 3, 2 * n_rows)


_DETERMINED = 1e-6
"""Least ratio of singular values with which an impulse counts as determined."""


def exceedance_probability(
    tests: ArrayLike, threshold: float, rng: np.random.Generator, *, samples: int = 400
) -> tuple[float, float]:
    """Probability that the largest of correlated statistics exceeds a threshold without a maneuver.

    Parameters
    ----------
    tests : array_like, shape (test, 3, innovation)
        See `whitened_tests`.
    threshold : float
    rng : numpy.random.Generator
    samples : int
        Number of random samples.

    Returns
    -------
    probability, standard_error : float
        For a small threshold the estimate may be larger than 1 by its error.

    Raises
    ------
    ConfigurationError
        If the maps have another shape, a value is not finite, the threshold is not positive, or
        there are fewer than two samples.
    """
    maps = array_of("tests", tests, ("test", 3, "innovation"))
    level = number_of("threshold", threshold, positive=True)
    count = count_of("samples", samples, least=2)
    single = chi2.sf(level, 3)
    shares = np.empty(count)
    for number in range(count):
        chosen = maps[rng.integers(maps.shape[0])]
        noise, way = rng.standard_normal(maps.shape[2]), rng.standard_normal(3)
        size = np.sqrt(chi2.isf(single * rng.random(), 3))
        noise += chosen.T @ (size * way / np.linalg.norm(way) - chosen @ noise)
        exceeding = np.sum((maps @ noise) ** 2, axis=1) >= level * (1.0 - 1e-12)
        shares[number] = 1.0 / max(1, exceeding.sum())
    scale = maps.shape[0] * single
    return float(scale * shares.mean()), float(scale * shares.std(ddof=1) / np.sqrt(count))


def threshold_of_schedule(tests: ArrayLike, probability: float, *, samples: int = 400) -> float:
    """Threshold that the largest of correlated statistics exceeds with a probability.

    Parameters
    ----------
    tests : array_like, shape (test, 3, innovation)
        See `whitened_tests`; those of a day for a rate per target-day.
    probability : float
        Between 0 and 1.
    samples : int
        Number of random samples.

    Returns
    -------
    float
        Dimensionless, as the statistic ``|B w|^2`` of `whitened_tests`.

    Raises
    ------
    ConfigurationError
        If the maps have another shape, a value is not finite, the probability is not between 0 and
        1, or there are fewer than two samples.
    """
    maps = array_of("tests", tests, ("test", 3, "innovation"))
    upper = false_alarm_threshold(probability, max(1.0, float(maps.shape[0])))
    lower = float(chi2.isf(probability, 3))

    def excess(level: float) -> float:
        rng = np.random.default_rng([0])
        return np.log(exceedance_probability(maps, level, rng, samples=samples)[0] / probability)

    if maps.shape[0] == 1:
        return lower
    return float(brentq(excess, 0.99 * lower, upper + 1e-3, xtol=1e-3))
