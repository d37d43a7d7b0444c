"""Properties of an object that its light curve determines, also where the attitude is unknown.

These are spin period, spin axis, amplitude, and area times albedo. Each has a 95 % interval from
the mixture over models of the body and over modes.
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dtrtrs

from cislunar.attitude.quaternion import to_inertial
from cislunar.constants import SUN_APPARENT_MAGNITUDE
from cislunar.errors import ConfigurationError
from cislunar.estimation.light_curves.light_curve import LightCurveModel, initial_state
from cislunar.estimation.light_curves.model_selection.body_models import (
    BODY_MODELS,
    SelectedModel,
    with_body_model,
)
from cislunar.estimation.light_curves.model_selection.rows import expected_rows
from cislunar.estimation.light_curves.row_blocks import RANGE, SUN, VIEW, WEIGHT
from cislunar.photometry.facets import FLOOR_MAGNITUDE
from cislunar.photometry.sphere import phase_function
from cislunar.runtime import Array

UNIQUE, AMBIGUOUS, UNKNOWN_BODY = range(3)
"""Status of an attitude: the modes agree; the modes disagree; the shape probably differs from the
assumed one, or no model explains the light curve."""

ATTITUDE_STATUS_NAMES = ("unique", "ambiguous", "unknown")
"""Names of the status, in the order of its numbers."""

_SAME_ATTITUDE_DEG = 5.0
_UNIQUE_SHARE = 0.95
_ROTATIONS, _BRIGHTNESSES = 1000, 40
"""Samples of the posterior for the rotation and for the brightness, which costs more."""
LEVELS = (0.025, 0.975)
"""Quantiles at the ends of a 95 % interval."""
UNKNOWN_FACTOR, _PERIOD_FACTOR = 1.8, 2.7
"""Factors, for an unknown body, on the deviations of attitude and angular velocity and on the
radius of the spin axis, and on the interval of the period. The posterior has further local maxima
that the search does not find (empirical, docs/attitude.md)."""
_PERCENTILES = (5.0, 95.0)
"""Of the magnitudes, between which the amplitude is taken."""


class EstimateInterval(NamedTuple):
    """An estimate, and the ends of its 95 % interval."""

    value: float
    low: float
    high: float

    def contains(self, value: float) -> bool:
        """Whether a value is within the interval."""
        return self.low <= value <= self.high


class Characterization(NamedTuple):
    """Properties of an object from its light curve.

    Attributes
    ----------
    spin_period_h : EstimateInterval
        2 pi divided by the angular rate at the epoch, h.
    spin_axis : ndarray, shape (3,)
        Mean direction of the angular velocity at the epoch, inertial frame.
    spin_axis_radius_deg : float
        Angle from `spin_axis` within which the axis lies with a probability of 95 %, deg.
    amplitude_mag : EstimateInterval
        Difference between the 95th and the 5th percentile of the magnitudes of the rows, mag, which
        are reduced to one range and by the phase function of a diffuse sphere.
    area_albedo_m2 : EstimateInterval
        Cross-section times albedo, m^2, of the diffuse sphere that reflects as much light, summed
        over the rows.
    status : int
        `UNIQUE`, `AMBIGUOUS` or `UNKNOWN_BODY`, see `attitude_status`.
    """

    spin_period_h: EstimateInterval
    spin_axis: Array
    spin_axis_radius_deg: float
    amplitude_mag: EstimateInterval
    area_albedo_m2: EstimateInterval
    status: int


def attitude_status(selected: SelectedModel, model: LightCurveModel) -> int:
    """Whether a light curve determines an attitude.

    Parameters
    ----------
    selected : SelectedModel
    model : LightCurveModel
        Model given to `select_model`.

    Returns
    -------
    int
        `UNKNOWN_BODY` if `selected.unknown_body`; else `AMBIGUOUS` if modes that differ from the
        best one by more than 5 deg at the epoch have more than 5 % of the weight; else `UNIQUE`.
    """
    if selected.unknown_body:
        return UNKNOWN_BODY
    quaternion, omega = np.empty(4), np.empty(3)
    attitudes = []
    for candidate in selected.candidates:
        initial_state(
            candidate.minimum.u, with_body_model(model, candidate.body), quaternion, omega
        )
        attitudes.append(quaternion.copy())
    return agreement(np.array(attitudes), selected.weight)


def agreement(quaternion: Array, weight: Array) -> int:
    """`UNIQUE` if modes with attitudes (mode, 4) within 5 deg of the first one, the best, have at
    least 95 % of the weight (mode,); else `AMBIGUOUS`."""
    near = np.abs(quaternion @ quaternion[0]) >= np.cos(0.5 * np.deg2rad(_SAME_ATTITUDE_DEG))
    return UNIQUE if weight[near].sum() >= _UNIQUE_SHARE else AMBIGUOUS


def reduced_brightness(magnitude: Array, data: Array, irradiance_4pi: bool) -> tuple[Array, Array]:
    """Facet sums (n,), m^2, that correspond to magnitudes in the geometry of the rows `data`, and
    those of a diffuse sphere whose cross-section times albedo is 1 m^2: it reflects 2 / (3 pi)
    Phi(alpha) of that (Paul & Fan, eqs. 18, 19)."""
    spread = np.pi * data[:, RANGE] ** 2 * (4.0 * np.pi if irradiance_4pi else 1.0)
    total = 10.0 ** (-0.4 * (magnitude - SUN_APPARENT_MAGNITUDE)) * spread
    total = np.where(magnitude < FLOOR_MAGNITUDE, total, 0.0)
    cosine = np.clip(np.sum(data[:, SUN] * data[:, VIEW], axis=1), -1.0, 1.0)
    return total, 2.0 / (3.0 * np.pi) * phase_function(np.arccos(cosine))


def amplitude_of(magnitude: Array, data: Array, irradiance_4pi: bool) -> float:
    """Amplitude of magnitudes (n,), see `Characterization.amplitude_mag`; NaN if all rows are dark,
    and without the dark rows otherwise. For the arguments see `reduced_brightness`."""
    total, sphere = reduced_brightness(magnitude, data, irradiance_4pi)
    lit = total > 0.0
    if not lit.any():
        return np.nan
    low, high = np.percentile(-2.5 * np.log10(total[lit] / sphere[lit]), _PERCENTILES)
    return float(high - low)


def area_albedo_of(magnitude: Array, data: Array, irradiance_4pi: bool) -> float:
    """Area times albedo of magnitudes (n,), m^2, see `Characterization.area_albedo_m2`. For the
    arguments see `reduced_brightness`."""
    total, sphere = reduced_brightness(magnitude, data, irradiance_4pi)
    return float(total.sum() / sphere.sum())


def require_rows(data: Array) -> None:
    """Refuse a light curve without rows by a `ConfigurationError`."""
    if len(data) == 0:
        raise ConfigurationError("light curve: it has no rows; leave out targets never seen")


def characterize(
    selected: SelectedModel, data: Array, model: LightCurveModel, rng: np.random.Generator
) -> Characterization:
    """Properties of an object from its light curve, with intervals.

    Parameters
    ----------
    selected : SelectedModel
        Result of `select_model`.
    data : ndarray, shape (n, ROW_COLUMNS)
        Light curve given to `select_model`.
    model : LightCurveModel
        Model given to `select_model`.
    rng : numpy.random.Generator
        Generator of the samples of the posterior.

    Returns
    -------
    Characterization

    Raises
    ------
    ConfigurationError
        If there are no rows.
    """
    require_rows(data)
    sampled = _samples(selected, rng, _ROTATIONS)
    models = {body: with_body_model(model, body) for body in BODY_MODELS}
    quaternion, omega = np.empty((_ROTATIONS, 4)), np.empty((_ROTATIONS, 3))
    for number, (body, u) in enumerate(sampled):
        initial_state(u, models[body], quaternion[number], omega[number])
    brightness = [expected_rows(u, data, models[body])[0] for body, u in sampled[:_BRIGHTNESSES]]
    rates = np.linalg.norm(omega, axis=1)
    axes = to_inertial(quaternion, omega) / rates[:, None]
    status = attitude_status(selected, model)
    unknown = status == UNKNOWN_BODY
    of_axis, of_period = (UNKNOWN_FACTOR, _PERIOD_FACTOR) if unknown else (1.0, 1.0)
    logs = np.log(2.0 * np.pi / rates / 3600.0)
    period = np.median(logs)
    low, high = period + of_period * (np.quantile(logs, LEVELS) - period)
    mean = axes.mean(axis=0)
    mean /= np.linalg.norm(mean)
    angles = np.arccos(np.clip(axes @ mean, -1.0, 1.0))
    mean_noise = np.sqrt(selected.noise_factor * model.noise_variance / data[:, WEIGHT].sum())
    error = float(np.hypot(selected.model_error_mag, mean_noise))
    reading = model.irradiance_4pi
    with np.errstate(divide="ignore"):
        spans = np.array([amplitude_of(each, data, reading) for each in brightness])
        sizes = np.log([area_albedo_of(each, data, reading) for each in brightness])
    size = _normal_interval(sizes, 0.4 * np.log(10.0) * error)
    span = _normal_interval(spans, error)
    return Characterization(
        EstimateInterval(*(float(np.exp(each)) for each in (period, low, high))),
        mean,
        float(min(of_axis * np.rad2deg(np.quantile(angles, 0.95)), 180.0)),
        span._replace(low=max(span.low, 0.0)),
        EstimateInterval(*(float(np.exp(each)) for each in size)),
        status,
    )


def _normal_interval(samples: Array, error: float) -> EstimateInterval:
    """Mean and 95 % interval of samples and an independent error; NaN if fewer than two samples are
    finite. A sample is not if no row is lit."""
    finite = samples[np.isfinite(samples)]
    if finite.size < 2:
        return EstimateInterval(np.nan, np.nan, np.nan)
    mean, wide = float(finite.mean()), 1.96 * float(np.hypot(finite.std(ddof=1), error))
    return EstimateInterval(mean, mean - wide, mean + wide)


def _samples(
    selected: SelectedModel, rng: np.random.Generator, count: int
) -> list[tuple[str, Array]]:
    """Body model and parameters of random samples of the mixture."""
    numbers = rng.choice(len(selected.candidates), size=count, p=selected.weight)
    roots = [np.linalg.cholesky(each.minimum.information) for each in selected.candidates]
    found = []
    for number in numbers:
        candidate = selected.candidates[number]
        normal = rng.standard_normal(candidate.minimum.u.size)
        step, _ = dtrtrs(roots[number], normal, lower=True, trans=True)
        found.append((candidate.body, candidate.minimum.u + step))
    return found
