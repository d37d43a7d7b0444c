"""Power of the test for an impulse, and the Cramér-Rao bound of the impulse.

With an impulse v the statistic at its time has the noncentral chi-squared distribution with three
degrees of freedom and the noncentrality v^T C v, where C^-1 is the bound.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq
from scipy.stats import ncx2

from cislunar.errors import ConfigurationError
from cislunar.observation.records import Schedule, rows_of
from cislunar.runtime import Array
from cislunar.runtime.arguments import array_of, number_of, vectors_of


def impulse_bound(whitened: ArrayLike) -> Array:
    """Cramér-Rao bound of an impulse at each hypothesized time, given the time.

    Parameters
    ----------
    whitened : array_like, shape (row, hypothesis, 2, 3)
        See `cislunar.estimation.maneuvers.likelihood_ratio.planned_information`; of one target, and
        of the observations that count.

    Returns
    -------
    ndarray, shape (hypothesis, 3, 3)
        m^2/s^2; infinite where the observations do not determine the impulse.

    Raises
    ------
    ConfigurationError
        If the derivatives have another shape, or one is not finite.
    """
    rows = array_of("whitened", whitened, ("row", "hypothesis", 2, 3))
    information = np.einsum("nhai,nhaj->hij", rows, rows)
    out = np.full(information.shape, np.inf)
    for each, matrix in zip(out, information, strict=True):
        # two rows of an observation determine two components at most
        if np.linalg.matrix_rank(matrix, hermitian=True) == 3:
            each[:] = np.linalg.inv(matrix)
    return out


def planned_bound(
    planned: tuple[ArrayLike, ArrayLike],
    schedule: Schedule,
    step_s: float,
    within_hours: ArrayLike = (1.0, 3.0, 6.0, 12.0),
) -> Array:
    """Cramér-Rao bounds of impulses given their times, some time after them, before a run.

    Parameters
    ----------
    planned : tuple
        Times of the impulses and derivatives, as
        `cislunar.estimation.maneuvers.likelihood_ratio.planned_information` returns them.
    schedule : Schedule
        The observations for which they were computed.
    step_s : float
        Step of the schedule, s.
    within_hours : array_like, shape (span,)
        Times after an impulse until which observations count, h.

    Returns
    -------
    ndarray, shape (target, hypothesis, span, 3, 3)
        m^2/s^2; infinite where the observations do not determine the impulse.

    Raises
    ------
    ConfigurationError
        If shapes disagree, or a value is not finite.
    """
    times_s = array_of("planned times", planned[0], ("hypothesis",))
    shape = schedule.observer.size, times_s.size, 2, 3
    whitened = array_of("planned whitened", planned[1], shape)
    spans = array_of("within_hours", within_hours, ("span",))
    target, step = rows_of(schedule)
    late_s = step_s * (step + 1.0)[:, None] - times_s
    out = np.full((schedule.offset.shape[0], times_s.size, spans.size, 3, 3), np.inf)
    for j in np.unique(target):
        rows, since = whitened[target == j], late_s[target == j]
        for number, span in enumerate(spans):
            counted = since <= 3600.0 * span + 1e-6 * step_s
            out[j, :, number] = impulse_bound(np.where(counted[..., None, None], rows, 0.0))
    return out


def impulse_detection_probability(
    impulse_m_s: ArrayLike, bound: ArrayLike, threshold: float
) -> NDArray[np.float64]:
    """Probability that an impulse is detected by the test at its time.

    Parameters
    ----------
    impulse_m_s : array_like, shape (..., 3)
        Change of velocity.
    bound : array_like, shape (..., 3, 3)
        Covariance of its estimate, m^2/s^2; see `impulse_bound`. Where it is infinite, the
        probability is that of a false alarm.
    threshold : float
        Of the statistic.

    Returns
    -------
    ndarray, shape (...)
        The largest statistic of several times and observations exceeds the threshold at least as
        often.

    Raises
    ------
    ConfigurationError
        If the threshold is not positive, an impulse is not finite, a bound is NaN or singular, or
        the shapes are impossible.
    """
    level = number_of("threshold", threshold, positive=True)
    given = array_of("impulse_m_s", vectors_of("impulse_m_s", impulse_m_s, 3))
    matrices, known = _bounds(bound)
    regular = np.where(known[..., None, None], matrices, np.eye(3))
    try:
        moved = np.linalg.solve(regular, given[..., None])[..., 0]
    except np.linalg.LinAlgError:
        raise ConfigurationError("bound is singular; give covariances of full rank") from None
    except ValueError:
        raise ConfigurationError(
            f"bound has shape {matrices.shape} and impulse_m_s {given.shape}; give one for each"
        ) from None
    return ncx2.sf(level, 3, np.where(known, np.sum(given * moved, axis=-1), 0.0))


def _bounds(bound: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
    """Covariances (..., 3, 3) without NaN, and which are finite; a `ConfigurationError` if the
    argument is impossible."""
    given = array_of("bound", bound, finite=False)
    if given.shape[-2:] != (3, 3):
        raise ConfigurationError(f"bound has shape {given.shape}; its last axes must be (3, 3)")
    if np.any(np.isnan(given)):
        raise ConfigurationError("bound must not be NaN; it is infinite where it is not known")
    known = np.all(np.isfinite(given), axis=(-2, -1))
    if np.any(np.linalg.eigvalsh(given[known]) < 0.0):
        raise ConfigurationError("bound is not positive definite; give covariances")
    return given, known


def detectable_impulse(bound: ArrayLike, threshold: float, probability: float = 0.9) -> Array:
    """Smallest impulses that are detected with a probability, in the best and the worst direction.

    Parameters
    ----------
    bound : array_like, shape (..., 3, 3)
        Covariance of the estimated impulse, m^2/s^2.
    threshold : float
        Of the statistic.
    probability : float
        Between 0 and 1.

    Returns
    -------
    ndarray, shape (..., 2)
        m/s; infinite where the bound is.

    Raises
    ------
    ConfigurationError
        If the threshold is not positive, the probability is not between that of a false alarm and
        1, or the covariances have another shape or are NaN.
    """
    level = number_of("threshold", threshold, positive=True)
    wanted = number_of("probability", probability, positive=True)
    if wanted >= 1.0 or wanted <= ncx2.sf(level, 3, 0.0):
        raise ConfigurationError(
            f"probability = {wanted:g} must be less than 1 and more than that of a false alarm"
        )
    given, known = _bounds(bound)
    out = np.full((*known.shape, 2), np.inf)
    highest = 4.0 * (level + 10.0) / (1.0 - wanted)
    needed = brentq(lambda each: ncx2.sf(level, 3, each) - wanted, 0.0, highest)
    out[known] = np.sqrt(needed * np.linalg.eigvalsh(given[known])[:, [0, -1]])
    return out
