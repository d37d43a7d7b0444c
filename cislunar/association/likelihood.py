"""Likelihoods of detections under tracks, with all constants, and gates.

A track predicts a detection with probability P_D; the detection then has the innovation nu with
covariance S, and a magnitude of its own density. A detection that is no target is a false alarm of
a Poisson process with the intensity kappa, per unit of the measurement. Against the hypothesis that
all detections are false alarms and nothing was detected, a pair has the log-likelihood ratio

    ln P_D + ln N(nu; 0, S) + ln p(magnitude) - ln kappa,                                       (1)

and a missed detection ln(1 - P_D P_G) with the probability P_G that a gate keeps the detection of
a target (Blackman & Popoli 1999, Design and Analysis of Modern Tracking Systems, section 6.2).
"""

from functools import cache

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import chi2

from cislunar.errors import ConfigurationError
from cislunar.runtime import Array
from cislunar.runtime.arguments import count_of


def gaussian_log_likelihood(residual: ArrayLike, covariance: ArrayLike) -> tuple[Array, Array]:
    """Squared Mahalanobis distance and log-density of Gaussian residuals.

    Parameters
    ----------
    residual : array_like, shape (..., n)
    covariance : array_like, shape (..., n, n)
        Positive definite, in the squared unit of the residual.

    Returns
    -------
    distance_squared, log_likelihood : ndarray, shape (...)
        The log-density per unit of the residual, with the factor (2 pi)^(-n/2).

    Raises
    ------
    ConfigurationError
        If a covariance is not positive definite.
    """
    nu, s = np.asarray(residual, dtype=float), np.asarray(covariance, dtype=float)
    try:
        root = np.linalg.cholesky(s)
        if np.isnan(root).any():
            raise np.linalg.LinAlgError
    except np.linalg.LinAlgError:
        raise ConfigurationError("covariance must be positive definite") from None
    white = np.linalg.solve(root, nu[..., None])[..., 0]
    squared = np.einsum("...i,...i", white, white)
    log_det = 2.0 * np.log(np.diagonal(root, axis1=-2, axis2=-1)).sum(axis=-1)
    return squared, -0.5 * (squared + log_det + nu.shape[-1] * np.log(2.0 * np.pi))


@cache
def gate_threshold(probability: float, dimension: int) -> float:
    """Squared Mahalanobis distance that keeps a target's detection with a probability.

    Parameters
    ----------
    probability : float
        P_G, in (0, 1).
    dimension : int
        Of the innovation.

    Returns
    -------
    float

    Raises
    ------
    ConfigurationError
        If the probability lies outside (0, 1), or the dimension is less than 1.
    """
    count_of("dimension", dimension)
    if not 0.0 < probability < 1.0:
        raise ConfigurationError(f"gate_probability = {probability} must lie between 0 and 1")
    return float(chi2.ppf(probability, dimension))
