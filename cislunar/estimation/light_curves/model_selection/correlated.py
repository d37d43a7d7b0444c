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
process, Rasmussen & Williams 2006, section 4.2). This is exact for an error that is constant within
a bin, and with tau = 0 it is the cost of `cislunar.estimation.light_curves.light_curve`. The
exponent beta below 1 tempers the likelihood (Gruenwald & van Ommen 2017). K depends on the unknown
rotation; it is kept while steps are taken and computed anew after every fourth.

If R is known as from nu measurements only, nu R / R_true is chi squared with nu degrees of freedom.
Then the factor f = R_true / R is estimated with the cost's further terms

    n ln f / 2 + nu (ln f + 1 / f) / 2,

where n is the number of rows, and R f in the place of R: for tau = 0 in closed form, f = (nu + sum
of w r^2 / R) / (nu + n), which is the misfit of `light_curve`, and otherwise by Fisher scoring in
ln f whenever C is computed anew. Laplace's approximation of the evidence has ln f as a further
parameter. The standard deviation tau can be estimated in the same way, with ln tau uniform between
limits. With m bins, S = C^-1 R f W^-1 and A = 1 - S = C^-1 tau^2 K, the Fisher information of
(ln f, ln tau) is

    (n - m + tr(S^2) + nu / f) / 2,   tr(S A),   2 tr(A^2),

and that with the other parameters is zero (Magnus & Neudecker 1988, section 15.5). Since the
parameters u take up a part of a model error, tau is the one of the greatest evidence, which has the
determinant of the Gauss-Newton matrix (restricted maximum likelihood, Harville 1977). A tempered
likelihood keeps a given f and tau, since it would estimate the tempering.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpotrf, dpotri, dpotrs, dtrtrs

from cislunar.compiled import njit_alloc
from cislunar.estimation.light_curves.levenberg_marquardt import refine
from cislunar.estimation.light_curves.light_curve import LightCurveModel, prior_anchor
from cislunar.estimation.light_curves.model_selection.rows import expected_rows
from cislunar.estimation.light_curves.row_blocks import MAGNITUDE, SUN, TIME, VIEW, WEIGHT
from cislunar.runtime import Array

_LONGEST_BIN_S = 900.0
_WIDEST_BIN = 0.05
"""Longest span of a bin, and largest distance of the directions within it (inertial frame, rad).
The directions of two observers of a target differ by more."""

_STEPS_PER_REFRESH = 4
_SCORING_STEPS, _SETTLED = 10, 0.02
"""Most steps of Fisher scoring when C is computed anew, and the change of ln f and of ln tau below
which they have settled."""
_DAMPING, _AFTER_SUCCESS, _AFTER_FAILURE, _FAILURES = 1e-3, 0.2, 6.0, 5
_SMALLEST_DECREASE = 0.02
"""As in `cislunar.estimation.light_curves.levenberg_marquardt`."""


class Bins(NamedTuple):
    """Groups of rows: `order` (n,), rows in the order of their bins; `first` (bin,), index in
    `order` of the first row of each bin; `weight` (bin,), sum of the weights of its rows."""

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


MERGE_DISTANCE = 2.0
"""Squared distance of two minima, in variances, below which they are one."""


class Minimum(NamedTuple):
    """A minimum of a cost: parameters `u` (p,) in prior standard deviations, Gauss-Newton matrix,
    Laplace's approximation of the logarithm of the evidence up to a constant, factor on the noise
    variance, and standard deviation `tau` of the model error, mag."""

    u: Array
    information: Array
    log_evidence: float
    noise_factor: float = 1.0
    tau: float = 0.0


def distinct_minima(minima: Iterable[Minimum]) -> list[Minimum]:
    """Minima of finite evidence, best first, without those that are one with a better one."""
    kept: list[Minimum] = []
    for each in sorted(minima, key=lambda one: -one.log_evidence):
        apart = all(
            (each.u - other.u) @ other.information @ (each.u - other.u) >= MERGE_DISTANCE
            for other in kept
        )
        if np.isfinite(each.log_evidence) and apart:
            kept.append(each)
    return kept


def bins_of_rows(data: Array, most: int) -> Bins:
    """Bins of the detections of a light curve in the order of time, about `most` for one without
    gaps. A bin has rows of one observer, recognized by its direction, within 15 minutes. Rows of
    several observers have different directions, and so different model errors."""
    directions = np.hstack([data[:, SUN], data[:, VIEW]])
    number, count = _numbers(data[:, TIME].copy(), directions, -(-len(data) // most))
    order = np.argsort(number, kind="stable")
    first = np.searchsorted(number[order], np.arange(count))
    return Bins(order, first, np.add.reduceat(data[order, WEIGHT], first))


@njit_alloc
def _numbers(time, directions, capacity):
    """Number of the bin of each row, and the number of bins; see `bins_of_rows`."""
    n = time.shape[0]
    number, first, size = np.empty(n, np.int64), np.empty(n, np.int64), np.zeros(n, np.int64)
    still_open, count, live = np.empty(n, np.int64), 0, 0
    for row in range(n):
        kept, found = 0, -1
        for k in range(live):
            bin_ = still_open[k]
            begin = first[bin_]
            if size[bin_] == capacity or time[row] - time[begin] > _LONGEST_BIN_S:
                continue
            still_open[kept] = bin_
            kept += 1
            if found < 0 and np.abs(directions[row] - directions[begin]).max() <= _WIDEST_BIN:
                found = bin_
        live = kept
        if found < 0:
            found, first[count] = count, row
            still_open[live] = count
            live, count = live + 1, count + 1
        number[row] = found
        size[found] += 1
    return number, count


class CorrelatedFit:
    """Cost of the detections of a light curve with a correlated model error, for one model of the
    body. An estimated factor on the noise variance begins with `noise_factor`. The standard
    deviation of the model error is known, or estimated between `limits`, beginning with that of
    `error`; the evidence is then averaged over its logarithm."""

    def __init__(
        self,
        data: Array,
        bins: Bins,
        model: LightCurveModel,
        error: ModelError,
        noise_factor: float = 1.0,
        limits: tuple[float, float] | None = None,
    ) -> None:
        self._data, self._bins, self._model, self._error = data, bins, model, error
        self._factor, self._log_det = np.empty((0, 0)), 0.0
        self._first_noise = self._noise = noise_factor
        self._freedom = model.noise_freedom if error.beta == 1.0 else 0.0
        self._tau, self._limits = error.tau, limits if error.beta == 1.0 else None
        estimated = [self._freedom > 0.0, self._limits is not None]
        self._estimated = np.flatnonzero(estimated if error.tau > 0.0 else [False, False])
        self._information = np.diag([0.5 * (self._freedom + len(data)), 1.0])  # ln f, ln tau

    def refresh(self, rows: tuple[Array, Array, Array]) -> None:
        """Compute C, and the factor on the noise, for rows as of `expected_rows`."""
        if self._error.tau == 0.0:
            return
        kernel = self._correlation(rows[1])
        self._factorize(kernel)
        if self._estimated.size:
            weight = self._data[:, WEIGHT]
            columns = np.column_stack([self._data[:, MAGNITUDE] - rows[0], rows[2]])
            mean = self._bins.mean(columns, weight)
            within = (columns.T * weight) @ columns - (mean.T * self._bins.weight) @ mean
            within /= self._model.noise_variance
            for _ in range(_SCORING_STEPS):
                last = self._scales()
                self._improve_scales(mean, within, kernel)
                self._factorize(kernel)
                if np.abs(self._scales() - last).max() < 0.1 * _SETTLED:
                    break

    def _scales(self) -> Array:
        """The values of ln f and ln tau."""
        return np.log([self._noise, self._tau or 1.0])

    def _factorize(self, kernel: Array) -> None:
        """Cholesky factor and determinant of C for the correlation K of the model error."""
        whole = self._tau**2 * kernel
        noise = self._model.noise_variance * self._noise / self._bins.weight
        whole[np.diag_indices_from(whole)] += noise
        self._factor, failed = dpotrf(whole, lower=True, clean=True)
        if failed:
            raise np.linalg.LinAlgError(
                "the covariance of the model error is not positive definite"
            )
        self._log_det = float(np.sum(2.0 * np.log(np.diag(self._factor)) - np.log(noise)))

    def _improve_scales(self, mean: Array, within: Array, kernel: Array) -> None:
        """A step of Fisher scoring in ln f and ln tau, given the means in the bins of the residuals
        and of the derivatives (bin, 1 + p), the sums of products about them over the variance, and
        the correlation K."""
        f, free = self._noise, len(self._data) - len(mean)
        noise = self._model.noise_variance * f / self._bins.weight
        inverse, _ = dpotri(self._factor, lower=True)  # the lower triangle of the inverse
        inverse += np.tril(inverse, -1).T
        pulled = inverse @ mean
        share, noisy = inverse * noise, float(np.sum(noise * pulled[:, 0] ** 2))
        once, twice = float(np.trace(share)), float(np.sum(share * share.T))
        slope = self._freedom * (1.0 - 1.0 / f) + free - within[0, 0] / f + once - noisy
        both = once - twice
        # the determinant of the Gauss-Newton matrix, a part of the evidence, depends on tau as well
        information = np.eye(mean.shape[1] - 1) + within[1:, 1:] / f + mean[:, 1:].T @ pulled[:, 1:]
        products = self._tau**2 * (pulled.T @ (kernel @ pulled))
        lost = float(np.trace(np.linalg.solve(information, products[1:, 1:])))
        slopes = np.array([0.5 * slope, len(mean) - once - float(products[0, 0]) - lost])
        self._information = np.array([
            [0.5 * (self._freedom / f + free + twice), both],
            [both, 2.0 * (len(mean) - once - both)],
        ])  # fmt: skip
        step, at = np.zeros(2), self._estimated
        step[at] = -np.linalg.solve(self._information[np.ix_(at, at)], slopes[at])
        f_step, tau_step = np.exp(np.clip(step, -1.0, 1.0))
        self._noise = f * float(f_step)
        if self._limits is not None:
            self._tau = float(np.clip(self._tau * tau_step, *self._limits))

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
        variance = self._model.noise_variance * self._first_noise
        return variance + self._error.tau**2 * float(shared.mean())

    def rows(self, u: Array) -> tuple[Array, Array, Array]:
        """See `expected_rows`."""
        return expected_rows(u, self._data, self._model)

    def cost(self, u: Array, rows: tuple[Array, Array, Array]) -> tuple[float, Array, Array]:
        """Cost, gradient (p,) and Gauss-Newton matrix (p, p), with C as it was last computed."""
        magnitude, _, derivative = rows
        weight, known = self._data[:, WEIGHT], self._model.noise_variance
        residual, beta = self._data[:, MAGNITUDE] - magnitude, self._error.beta
        total, count = float(np.sum(weight * residual**2)), len(residual)
        if self._freedom > 0.0 and self._error.tau == 0.0:
            self._noise = (self._freedom + total / known) / (self._freedom + count)
        variance = known * self._noise
        weighted = (derivative.T * (weight / variance)).T
        squares = total / variance
        slope, curvature = weighted.T @ residual, weighted.T @ derivative
        if self._error.tau > 0.0:
            both = self._bins.mean(np.column_stack([residual, derivative]), weight)
            by_noise = (both.T * (self._bins.weight / variance)).T
            whitened, _ = dtrtrs(self._factor, both, lower=True)
            change = whitened.T @ whitened - by_noise.T @ both
            squares += change[0, 0]
            slope = slope + change[1:, 0]
            curvature = curvature + change[1:, 1:]
        value = 0.5 * (u @ u + beta * squares + self._log_det)
        if self._noise != 1.0:
            f, freedom = self._noise, self._model.noise_freedom
            value += 0.5 * (count * np.log(f) + freedom * (np.log(f) + 1.0 / f - 1.0))
        return value, u - beta * slope, np.eye(u.size) + beta * curvature

    def refined(self, start: Array, iterations: int) -> Minimum:
        """The minimum reached from a start by damped Gauss-Newton steps (Levenberg 1944, Marquardt
        1963)."""
        self._noise, self._tau = self._first_noise, self._error.tau
        without_error = self._error.tau == 0.0 and self._error.beta == 1.0
        descent = self.descent_without_error if without_error else self.descent
        u, rows = descent(start, iterations)
        self.refresh(rows)
        value, _, information = self.cost(u, rows)
        log_det = np.linalg.slogdet(information)[1]
        evidence = -value - 0.5 * log_det if np.isfinite(value + log_det) else -np.inf
        return Minimum(
            u, information, float(evidence + self._scale_evidence()), self._noise, self._tau
        )

    def descent_without_error(self, start: Array, iterations: int) -> tuple[Array, tuple]:
        """`descent` without a model error, compiled."""
        u, size = start.copy(), start.size
        nothing = np.empty((size, size)), np.empty((0, size)), np.empty((0, size, size)), 0.0
        given = prior_anchor(size), self._model, _DAMPING, iterations
        refine(u, self._data, *given, *nothing)
        return u, self.rows(u)

    def descent(self, start: Array, iterations: int) -> tuple[Array, tuple]:
        """The parameters of the minimum that is reached from a start, and their rows."""
        u, damping, since = start.copy(), _DAMPING, 0
        rows = self.rows(u)
        self.refresh(rows)
        best, gradient, information = self.cost(u, rows)
        for _ in range(iterations):
            decrease = 0.0
            for _ in range(_FAILURES):
                damped = information + damping * np.diag(np.diag(information))
                factor, failed = dpotrf(damped, lower=True)
                if failed:
                    damping *= _AFTER_FAILURE
                    continue
                step, _ = dpotrs(factor, -gradient, lower=True)
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
            small = decrease < _SMALLEST_DECREASE
            scored = small and self._estimated.size > 0
            if since == _STEPS_PER_REFRESH or scored:
                since, last = 0, self._scales()
                self.refresh(rows)
                best, gradient, information = self.cost(u, rows)
                if scored and np.abs(self._scales() - last).max() < _SETTLED:
                    break
            elif small:
                break
        return u, rows

    def _scale_evidence(self) -> float:
        """What the estimation of ln f and of ln tau adds to the logarithm of the evidence. The
        posterior of ln tau is at most as wide as its prior."""
        of_noise, of_tau = np.diag(self._information)
        if self._error.tau == 0.0 or self._limits is None:
            return -0.5 * float(np.log(of_noise)) if self._freedom > 0.0 else 0.0
        found = 0.0
        if self._freedom > 0.0:
            found = -0.5 * float(np.log(of_noise))
            of_tau = of_tau - self._information[0, 1] ** 2 / of_noise
        wide = np.log(self._limits[1] / self._limits[0])
        return found + float(min(0.5 * np.log(2.0 * np.pi / of_tau) - np.log(wide), 0.0))
