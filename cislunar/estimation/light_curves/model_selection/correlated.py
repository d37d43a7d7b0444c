"""Least squares on a light curve with a correlated model error.

A wrong reflection law or shape causes errors of the magnitude that are similar for similar
directions of Sun and observer in the body frame. Rows are grouped into bins. With the residuals r,
the noise variance R and the weight w_k of row k, the negative logarithm of the posterior is

    cost(u) = |u|^2 / 2 + beta / 2 (sum_k w_k (r_k - r_b(k))^2 / R + r_b^T C^-1 r_b)
              + ln det(C W / R) / 2,      C = R W^-1 + tau^2 K,

where r_b are the weighted means of the bins, b(k) is the bin of row k, W is the diagonal matrix of
the bins' sums of weights, and

    K_ij = exp(-(|L_i - L_j|^2 + |V_i - V_j|^2) / (2 l^2))

has the mean directions of Sun (L) and observer (V) of bins i and j in the body frame (a Gaussian
process, Rasmussen & Williams 2006, section 4.2). With beta = 1 this is exact for an error that is
constant within a bin, and with tau = 0 it is the cost of
`cislunar.estimation.light_curves.light_curve`. An exponent beta below 1 tempers the likelihood
(Gruenwald & van Ommen 2017). K depends on the rotation; it is computed anew after every fourth step
and constant in between.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_solve, cholesky, solve_triangular

from cislunar.estimation.light_curves.light_curve import LightCurveModel
from cislunar.estimation.light_curves.model_selection.rows import expected_rows
from cislunar.estimation.light_curves.row_blocks import MAGNITUDE, SUN, TIME, VIEW, WEIGHT

Array = NDArray[np.float64]

_LONGEST_BIN_S = 900.0
_WIDEST_BIN = 0.05
"""Longest span of a bin, and largest distance of the directions within it (inertial frame, rad).
The directions of two observers of a target differ by more."""

_STEPS_PER_REFRESH = 4
_DAMPING, _AFTER_SUCCESS, _AFTER_FAILURE, _FAILURES = 1e-3, 0.2, 6.0, 5
_SMALLEST_DECREASE = 0.02
"""As in `cislunar.estimation.light_curves.levenberg_marquardt`."""


class Bins(NamedTuple):
    """Groups of rows.

    Attributes
    ----------
    order : ndarray of int, shape (n,)
        Rows in the order of their bins.
    first : ndarray of int, shape (bin,)
        Index in `order` of the first row of each bin.
    weight : ndarray, shape (bin,)
        Sum of the weights of the rows of each bin.
    """

    order: NDArray[np.int64]
    first: NDArray[np.int64]
    weight: Array

    def mean(self, values: Array, weight: Array) -> Array:
        """Weighted means of the bins of values (n, ...)."""
        products = (values.T * weight).T[self.order]
        return (np.add.reduceat(products, self.first, axis=0).T / self.weight).T


class ModelError(NamedTuple):
    """Correlated error of a model.

    Attributes
    ----------
    tau : float
        Standard deviation, mag.
    length : float
        Correlation length of the directions, rad.
    beta : float
        Exponent of the likelihood.
    """

    tau: float
    length: float
    beta: float = 1.0


class Minimum(NamedTuple):
    """A minimum of a cost.

    Attributes
    ----------
    u : ndarray, shape (p,)
        Parameters in prior standard deviations.
    information : ndarray, shape (p, p)
        Gauss-Newton matrix.
    log_evidence : float
        Laplace's approximation of the logarithm of the evidence, up to a constant.
    """

    u: Array
    information: Array
    log_evidence: float


def bins_of_rows(data: Array, most: int) -> Bins:
    """Bins of a light curve, about `most` for a light curve without gaps.

    A bin has rows of one observer, recognized by its direction, within 15 minutes. Rows of several
    observers have different directions, and so different model errors.

    Parameters
    ----------
    data : ndarray, shape (n, COLUMNS)
        Detections of a light curve in the order of time.
    most : int
        Desired number of bins.

    Returns
    -------
    Bins
    """
    capacity = -(-len(data) // most)
    number = np.empty(len(data), dtype=np.int64)
    open_bins: list[list[int]] = []  # number, first row, rows so far
    count = 0
    directions = np.hstack([data[:, SUN], data[:, VIEW]])
    for row, time in enumerate(data[:, TIME]):
        open_bins = [each for each in open_bins if time - data[each[1], TIME] <= _LONGEST_BIN_S]
        for each in open_bins:
            if np.abs(directions[row] - directions[each[1]]).max() <= _WIDEST_BIN:
                break
        else:
            each = [count, row, 0]
            open_bins.append(each)
            count += 1
        number[row] = each[0]
        each[2] += 1
        if each[2] == capacity:
            open_bins.remove(each)
    order = np.argsort(number, kind="stable")
    first = np.searchsorted(number[order], np.arange(count))
    return Bins(order, first, np.add.reduceat(data[order, WEIGHT], first))


class CorrelatedFit:
    """Cost of a light curve with a correlated model error, for one model of the body.

    Parameters
    ----------
    data : ndarray, shape (n, COLUMNS)
        Detections of a light curve.
    bins : Bins
    model : LightCurveModel
    error : ModelError
    """

    def __init__(self, data: Array, bins: Bins, model: LightCurveModel, error: ModelError) -> None:
        self._data, self._bins, self._model, self._error = data, bins, model, error
        self._factor, self._log_det = np.empty((0, 0)), 0.0

    def refresh(self, directions: Array) -> None:
        """Compute C for the directions of the rows in the body frame, (n, 6)."""
        error, bins = self._error, self._bins
        if error.tau == 0.0:
            return
        covariance = error.tau**2 * self._correlation(directions)
        noise = self._model.noise_variance / bins.weight
        covariance[np.diag_indices_from(covariance)] += noise
        self._factor = cholesky(covariance, lower=True)
        self._log_det = float(np.sum(2.0 * np.log(np.diag(self._factor)) - np.log(noise)))

    def _correlation(self, directions: Array) -> Array:
        """K of the bins, for the directions of the rows."""
        mean = self._bins.mean(directions, self._data[:, WEIGHT])
        squares = np.sum(mean**2, axis=1)
        distance2 = squares[:, None] + squares - 2.0 * mean @ mean.T
        return np.exp(-np.maximum(distance2, 0.0) / (2.0 * self._error.length**2))

    def equal_white_noise(self, u: Array) -> float:
        """Variance of white noise, mag^2, that is equivalent to the noise and the model error of
        the rows: the variance of the model error is multiplied by the mean number of rows that are
        correlated with a row."""
        shared = self._correlation(self.rows(u)[1]) @ self._bins.weight
        return self._model.noise_variance + self._error.tau**2 * float(shared.mean())

    def rows(self, u: Array) -> tuple[Array, Array, Array]:
        """See `expected_rows`."""
        return expected_rows(u, self._data, self._model)

    def cost(self, u: Array, rows: tuple[Array, Array, Array]) -> tuple[float, Array, Array]:
        """Cost, gradient (p,) and Gauss-Newton matrix (p, p), with C as it was last computed."""
        magnitude, _, derivative = rows
        weight, variance = self._data[:, WEIGHT], self._model.noise_variance
        residual, beta = self._data[:, MAGNITUDE] - magnitude, self._error.beta
        weighted = (derivative.T * (weight / variance)).T
        squares = float(np.sum(weight * residual**2)) / variance
        slope, curvature = weighted.T @ residual, weighted.T @ derivative
        if self._error.tau > 0.0:
            both = self._bins.mean(np.column_stack([residual, derivative]), weight)
            by_noise = (both.T * (self._bins.weight / variance)).T
            whitened = solve_triangular(self._factor, both, lower=True, check_finite=False)
            change = whitened.T @ whitened - by_noise.T @ both
            squares += change[0, 0]
            slope = slope + change[1:, 0]
            curvature = curvature + change[1:, 1:]
        value = 0.5 * (u @ u + beta * squares + self._log_det)
        return value, u - beta * slope, np.eye(u.size) + beta * curvature

    def refined(self, start: Array, iterations: int) -> Minimum:
        """The minimum reached from a start by damped Gauss-Newton steps (Levenberg 1944, Marquardt
        1963)."""
        u, damping, since = start.copy(), _DAMPING, 0
        rows = self.rows(u)
        self.refresh(rows[1])
        best, gradient, information = self.cost(u, rows)
        for _ in range(iterations):
            decrease = 0.0
            for _ in range(_FAILURES):
                damped = information + damping * np.diag(np.diag(information))
                try:
                    step = cho_solve((cholesky(damped, lower=True), True), -gradient)
                except (LinAlgError, ValueError):
                    damping *= _AFTER_FAILURE
                    continue
                trial = self.rows(u + step)
                value, *derivatives = self.cost(u + step, trial)
                if value < best:
                    decrease, best, u, rows = best - value, value, u + step, trial
                    gradient, information = derivatives
                    break
                damping *= _AFTER_FAILURE
            if decrease == 0.0:
                break
            damping *= _AFTER_SUCCESS
            since += 1
            if since == _STEPS_PER_REFRESH:
                since = 0
                self.refresh(rows[1])
                best, gradient, information = self.cost(u, rows)
            elif decrease < _SMALLEST_DECREASE:
                break
        self.refresh(rows[1])
        value, _, information = self.cost(u, rows)
        log_det = np.linalg.slogdet(information)[1]
        evidence = -value - 0.5 * log_det if np.isfinite(value + log_det) else -np.inf
        return Minimum(u, information, float(evidence))
