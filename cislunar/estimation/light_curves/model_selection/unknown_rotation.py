"""Spin period, amplitude, and area times albedo of an object of which nothing is known.

Amplitude and area times albedo need no model of the body: they are taken from the magnitudes, with
the definitions of `cislunar.estimation.light_curves.model_selection.Characterization`. Their
intervals are those of the noise, with a further error in proportion to it, because noise widens the
distribution of magnitudes and faint measurements are missed (empirical).

The spin period needs a model of the body. The model *small deviations* is fitted with an unknown
variance of the residuals, in several independent searches. With the costs C_j of their distinct
minima, the weights

    w_j ~ exp(-C_j / q)                                                                         (1)

are those of a tempered likelihood, since residuals of a wrong model are correlated. The interval is
that of the mixture, with variances that are larger by q and a further relative error of the period
(empirical), since the model assumes a constant rotation. A period is determined if the interval is
narrow. If it is not, the interval is that of the prior.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq
from scipy.special import ndtr
from scipy.stats import chi

from cislunar.attitude.inertia import rigid_bodies
from cislunar.errors import ConfigurationError
from cislunar.estimation.light_curves.batch_settings import BatchSettings
from cislunar.estimation.light_curves.light_curve import (
    LightCurveModel,
    cost_and_derivatives,
    initial_state,
    prior_anchor,
)
from cislunar.estimation.light_curves.model_selection.body_models import with_body_model
from cislunar.estimation.light_curves.model_selection.characterization import (
    LEVELS,
    EstimateInterval,
    amplitude_of,
    area_albedo_of,
    require_rows,
)
from cislunar.estimation.light_curves.model_selection.correlated import Minimum, distinct_minima
from cislunar.estimation.light_curves.model_selection.mode_search import search_modes
from cislunar.estimation.light_curves.row_blocks import (
    MAGNITUDE,
    RANGE,
    ROTATION,
    ROW_COLUMNS,
    SEEN,
    SUN,
    TIME,
    VIEW,
    WEIGHT,
)
from cislunar.observation.target_surfaces import TargetSurfaces, body_of
from cislunar.runtime import Array, array_of, require_unit
from cislunar.runtime.threads import single_threaded_algebra

_BODY = "small deviations"
_MOST_ROWS = 150
"""Rows of a light curve that are searched; others are left out evenly."""
_ERROR_MAG, _FREEDOM = 0.05, 2.0
"""Assumed error of the model, and degrees of freedom of the prior of the residuals' variance."""
_TEMPERING = 8.0
"""q of equation (1) (empirical)."""
_PERIOD_ERROR = 0.02
"""Relative standard deviation of a period by the assumed constant rotation (empirical)."""
_AMPLITUDE_ERROR, _SIZE_ERROR = 0.6, 0.2
"""Standard deviations of amplitude and mean magnitude, in those of a magnitude (empirical)."""
_WIDE = 1.96
_DRAWS = 100


class SpinPeriod(NamedTuple):
    """A spin period, 2 pi divided by the angular rate at time 0, h, with its 95 % interval, and
    whether it is determined; otherwise the interval is that of the prior."""

    interval: EstimateInterval
    determined: bool


def light_curve_rows(
    time_s: ArrayLike,
    magnitude: ArrayLike,
    variance: ArrayLike,
    sun: ArrayLike,
    view: ArrayLike,
    range_m: ArrayLike,
) -> Array:
    """Rows of a light curve that consists of detections.

    Parameters
    ----------
    time_s, magnitude, variance, range_m : array_like, shape (n,)
        Times since the epoch, s; magnitudes; their variances, mag^2; ranges, m. The last two may be
        the same number for all rows.
    sun, view : array_like, shape (n, 3)
        Unit vectors from the object to the Sun and to the observer, inertial frame.

    Returns
    -------
    ndarray, shape (n, ROW_COLUMNS)
        See `cislunar.estimation.light_curves.light_curve.cost`. The weight of a row is the inverse
        of its variance.

    Raises
    ------
    ConfigurationError
        If shapes disagree, a value is not finite, a variance or a range is not positive, a vector
        is not of unit norm, or a time is negative or before that of the row above.
    """
    data = np.empty((np.size(time_s), ROW_COLUMNS))
    n = len(data)
    data[:, TIME] = array_of("time_s", time_s, (n,))
    data[:, MAGNITUDE] = array_of("magnitude", magnitude, (n,))
    for name, column, given in (("range_m", RANGE, range_m), ("variance", WEIGHT, variance)):
        found = array_of(name, given)
        data[:, column] = array_of(name, found, (n,) if found.ndim else None)
    for name, column, given in (("sun", SUN, sun), ("view", VIEW, view)):
        data[:, column] = array_of(name, given, (n, 3))
        require_unit(name, data[:, column], "row")
    if np.any(np.diff(data[:, TIME], prepend=0.0) < 0.0):
        raise ConfigurationError("time_s: give times of at least 0 s in increasing order")
    if not np.all(data[:, [WEIGHT, RANGE]] > 0.0):
        raise ConfigurationError("variance and range_m must be positive")
    data[:, WEIGHT], data[:, SEEN] = 1.0 / data[:, WEIGHT], 1.0
    return data


def unknown_rotation_model(
    body: TargetSurfaces, attitude_sigma: float, rate_sigma_deg_h: float
) -> LightCurveModel:
    """Light-curve model of an assumed body without any knowledge of its rotation.

    Parameters
    ----------
    body : TargetSurfaces
        The assumed body, its first.
    attitude_sigma : float
        Standard deviation of each parameter (GRP) of the attitude.
    rate_sigma_deg_h : float
        Standard deviation of each component of the angular velocity, deg/h.

    Returns
    -------
    LightCurveModel
        For rows whose weights are inverse variances.
    """
    bodies, nothing = rigid_bodies(body.inertia[:1]), np.empty(0, dtype=np.int64)
    sigma = np.repeat([attitude_sigma, np.deg2rad(rate_sigma_deg_h) / 3600.0], 3)
    return LightCurveModel(
        np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(3), sigma, nothing, nothing, bodies.inertia[0],
        bodies.inverse[0], bool(bodies.spherical[0]), body_of(body, 0),
        bool(body.irradiance_4pi), bool(body.fresnel_sqrt), 1.0, 0.0,
    )  # fmt: skip


def spin_period(
    data: Array,
    model: LightCurveModel,
    rng: np.random.Generator,
    *,
    searches: int = 4,
    largest_error: float = 0.2,
) -> SpinPeriod:
    """Spin period of a light curve.

    Parameters
    ----------
    data : ndarray, shape (n, ROW_COLUMNS)
        See `light_curve_rows`.
    model : LightCurveModel
        See `unknown_rotation_model`.
    rng : numpy.random.Generator
        Generator of the random starts.
    searches : int
        Number of independent searches.
    largest_error : float
        Largest half width of the interval of the logarithm of a period that is determined.

    Returns
    -------
    SpinPeriod

    Raises
    ------
    ConfigurationError
        If there are no rows.
    """
    require_rows(data)
    evenly = np.linspace(0, len(data) - 1, min(len(data), _MOST_ROWS))
    rows = data[np.rint(evenly).astype(np.int64)]
    variance = 1.0 / rows[:, WEIGHT] + _ERROR_MAG**2
    changed = {"noise_variance": float(np.median(variance)), "noise_freedom": _FREEDOM}
    own = with_body_model(model, _BODY)._replace(**changed)
    rows[:, WEIGHT] = own.noise_variance / variance
    how = BatchSettings().search_settings()._replace(starts=16, first_starts=32, pool=256)
    minima: list[Minimum] = []
    with single_threaded_algebra():
        for _ in range(searches):
            for u in search_modes(rows, own, how, rng):
                found = _minimum(u, rows, own)
                finite = np.isfinite(found.log_evidence)
                if finite and np.linalg.eigvalsh(found.information)[0] > 0.0:
                    minima.append(found)
    modes = [_mode(each, own) for each in distinct_minima(minima)]
    if modes:
        log_period, sigma, weight = (np.array(each) for each in zip(*modes, strict=True))
        value, low, high = _of_mixture(log_period, sigma, np.exp(weight - weight.max()))
        if 0.5 * (high - low) <= largest_error:
            ends = (float(np.exp(each)) for each in (value, low, high))
            return SpinPeriod(EstimateInterval(*ends), True)
    # the length of a normal vector has the chi distribution with three degrees of freedom
    rates = own.sigma[3] * chi(3).ppf([0.5, LEVELS[1], LEVELS[0]])
    return SpinPeriod(EstimateInterval(*(2.0 * np.pi / rates / 3600.0).tolist()), False)


def _minimum(u: Array, data: Array, model: LightCurveModel) -> Minimum:
    """A minimum of the cost, which counts as the negative logarithm of its evidence."""
    size = u.size
    gradient, information = np.empty(size), np.empty((size, size))
    given = prior_anchor(size), model, gradient, information
    cost = float(cost_and_derivatives(u, data, *given))
    return Minimum(u, information, -cost)


def _mode(minimum: Minimum, model: LightCurveModel) -> tuple[float, float, float]:
    """Logarithm of the period (h) of a minimum, its standard deviation, and its log weight."""
    quaternion, omega = np.empty(4), np.empty(3)
    initial_state(minimum.u, model, quaternion, omega)
    rate = np.linalg.norm(omega)
    slope = np.zeros(minimum.u.size)
    slope[3:ROTATION] = omega * model.sigma[3:ROTATION] / rate**2
    variance = slope @ np.linalg.solve(minimum.information, slope)
    sigma = np.sqrt(_TEMPERING * variance + _PERIOD_ERROR**2)
    log_period = float(np.log(2.0 * np.pi / rate / 3600.0))
    return log_period, float(sigma), minimum.log_evidence / _TEMPERING


def _of_mixture(mean: Array, sigma: Array, weight: Array) -> tuple[float, float, float]:
    """Value of the likeliest component of a mixture of normals, and the mixture's interval."""
    share = weight / weight.sum()

    def quantile(level: float) -> float:
        ends = np.min(mean - 9.0 * sigma), np.max(mean + 9.0 * sigma)
        return float(brentq(lambda x: share @ ndtr((x - mean) / sigma) - level, *ends))

    low, high = (quantile(level) for level in LEVELS)
    return float(np.clip(mean[np.argmax(share)], low, high)), low, high


def measured_brightness(
    data: Array, irradiance_4pi: bool, rng: np.random.Generator
) -> tuple[EstimateInterval, EstimateInterval]:
    """Amplitude and area times albedo of a light curve, from its magnitudes alone.

    Parameters
    ----------
    data : ndarray, shape (n, ROW_COLUMNS)
        See `light_curve_rows`.
    irradiance_4pi : bool
        Law of irradiance, see `cislunar.photometry.PhotometryModel`.
    rng : numpy.random.Generator
        Generator of further noise, whose effect is that of the measured noise.

    Returns
    -------
    amplitude_mag, area_albedo_m2 : EstimateInterval
        See `Characterization`.
    """
    magnitude, sigma = data[:, MAGNITUDE], np.sqrt(1.0 / data[:, WEIGHT])
    noise = float(np.median(sigma))
    drawn = magnitude + sigma * rng.standard_normal((_DRAWS, sigma.size))
    spans = [amplitude_of(each, data, irradiance_4pi) for each in drawn]
    sizes = np.log([area_albedo_of(each, data, irradiance_4pi) for each in drawn])
    span = amplitude_of(magnitude, data, irradiance_4pi)
    size = np.log(area_albedo_of(magnitude, data, irradiance_4pi))
    wide = _WIDE * np.hypot(np.std(spans), _AMPLITUDE_ERROR * noise)
    about = _WIDE * np.hypot(np.std(sizes), _SIZE_ERROR * noise)
    return (
        EstimateInterval(float(span), float(max(span - wide, 0.0)), float(span + wide)),
        EstimateInterval(*(float(np.exp(each)) for each in (size, size - about, size + about))),
    )
