"""Spin period, amplitude, and area times albedo of cataloged objects from their light curves.

A light curve consists of the magnitudes of the detections of a confirmed orbit, with lines of sight
and ranges of the fitted orbit. Nothing is known of attitude and angular velocity but their prior,
which is that of the hand-over (`cislunar.survey.hand_over`).

Amplitude and area times albedo need no model of the body: they are taken from the magnitudes, with
the definitions of `cislunar.estimation.light_curves.model_selection.Characterization`. Their
intervals are those of the noise, with a further error in proportion to it, because noise widens the
distribution of magnitudes and faint measurements are missed (empirical).

The spin period needs a model of the body. The model *small deviations* of
`cislunar.estimation.light_curves.model_selection` is fitted with an unknown variance of the
residuals, in several independent searches. With the costs C_j and the informations H_j of their
distinct minima, the weights

    w_j ~ exp(-C_j / q) / sqrt(det H_j)                                                         (1)

are those of a likelihood tempered by q, since residuals of a wrong model are correlated. The
interval is that of the mixture, with a further relative error of the period (empirical), since the
model assumes a constant rotation. A period is determined if the interval is narrow. If it is not,
the interval is that of the prior.

Only what the catalog knows is used.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import ndtr
from scipy.stats import chi
from threadpoolctl import threadpool_limits

from cislunar.attitude.inertia import rigid_bodies
from cislunar.estimation.light_curves.batch_settings import BatchSettings
from cislunar.estimation.light_curves.light_curve import (
    Anchor,
    LightCurveModel,
    cost_and_derivatives,
    initial_state,
)
from cislunar.estimation.light_curves.model_selection.characterization import (
    Interval,
    amplitude_of,
    area_albedo_of,
)
from cislunar.estimation.light_curves.model_selection.ladder import search_modes
from cislunar.estimation.light_curves.model_selection.rungs import model_of_rung
from cislunar.estimation.light_curves.row_blocks import (
    COLUMNS,
    MAGNITUDE,
    RANGE,
    ROTATION,
    SEEN,
    SUN,
    TIME,
    VIEW,
    WEIGHT,
)
from cislunar.observation import METERS, Scene, TargetSurfaces, body_of, dimming
from cislunar.orbit_determination import Angles, LinkedOrbits
from cislunar.runtime.seeds import generator
from cislunar.survey.hand_over import uniform_attitude_sigma
from cislunar.survey.settings import CharacterizationSettings

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_RUNG = "small deviations"
_MOST_ROWS = 150
"""Rows of a light curve that are searched; others are left out evenly."""
_ERROR_MAG, _FREEDOM = 0.05, 2.0
"""Assumed error of the model, and degrees of freedom of the prior of the residuals' variance."""
_TEMPERING = 4.0
"""q of equation (1) (empirical)."""
_PERIOD_ERROR = 0.015
"""Relative standard deviation of a period by the assumed constant rotation (empirical)."""
_AMPLITUDE_ERROR, _SIZE_ERROR = 0.6, 0.2
"""Standard deviations of amplitude and mean magnitude, in those of a magnitude (empirical)."""
_LEVELS = (0.025, 0.975)
_WIDE = 1.96
_DRAWS = 100
_SAME_MODE = 2.0
"""Squared distance, in variances, below which two minima are one."""


class CharacterizedOrbit(NamedTuple):
    """What the light curve of a confirmed orbit tells of its object.

    Attributes
    ----------
    orbit : int
        Index of the orbit in the catalog.
    row : ndarray of int, shape (n,)
        Detections of the light curve.
    light_curve : ndarray, shape (n, COLUMNS)
        See `cislunar.estimation.light_curves.light_curve.cost`; times in s since the start.
    noise_mag : float
        Median standard deviation of the magnitudes.
    spin_period_h : Interval
        2 pi divided by the angular rate, h, with its 95 % interval.
    determined : bool
        Whether the spin period is determined; otherwise its interval is that of the prior.
    amplitude_mag, area_albedo_m2 : Interval
        See `cislunar.estimation.light_curves.model_selection.Characterization`.
    """

    orbit: int
    row: Indices
    light_curve: Array
    noise_mag: float
    spin_period_h: Interval
    determined: bool
    amplitude_mag: Interval
    area_albedo_m2: Interval


def characterize_orbits(
    orbits: LinkedOrbits,
    angles: Angles,
    scene: Scene,
    body: TargetSurfaces,
    settings: CharacterizationSettings,
    seed: int,
) -> tuple[CharacterizedOrbit, ...]:
    """Characterize the objects of the confirmed orbits that are bright enough.

    Parameters
    ----------
    orbits : LinkedOrbits
        Orbits of a catalog.
    angles : Angles
        Detections of the catalog with their magnitudes, to whose rows the orbits refer.
    scene : Scene
        Times, axes, and centers of Earth and Moon.
    body : TargetSurfaces
        Assumed body of all objects, its first.
    settings : CharacterizationSettings
    seed : int
        Of the random starts of the searches.

    Returns
    -------
    tuple of CharacterizedOrbit
        In the order of the orbits. Orbits with fewer detections or larger noise than the settings
        state are left out.
    """
    found = []
    if settings.least_detections == 0:
        return ()
    model = _model(body, settings)
    for k in np.flatnonzero(orbits.confirmed).tolist():
        row, data = light_curve(orbits, k, angles, scene)
        if row.size < settings.least_detections:
            continue
        variance = angles.magnitude_variance[row]
        noise = float(np.sqrt(np.median(variance)))
        if noise > settings.largest_noise_mag:
            continue
        rng = generator(seed, "characterization", k)
        period, determined = spin_period(data, variance, model, settings, rng)
        brightness = _brightness(data, np.sqrt(variance), noise, model.irradiance_4pi, rng)
        found.append(CharacterizedOrbit(k, row, data, noise, period, determined, *brightness))
    return tuple(found)


def light_curve(
    orbits: LinkedOrbits, k: int, angles: Angles, scene: Scene
) -> tuple[Indices, Array]:
    """Detections of an orbit with a magnitude, and their light curve.

    Parameters
    ----------
    orbits : LinkedOrbits
    k : int
        Index of the orbit.
    angles : Angles
    scene : Scene

    Returns
    -------
    row : ndarray of int, shape (n,)
        Rows of the angles in order of time, without those in a shadow of Earth or Moon.
    data : ndarray, shape (n, COLUMNS)
        Directions in the inertial frame. The weight of a row is the inverse of its variance,
        mag^-2.
    """
    own, position = orbits.detections(k), orbits.fits.position
    away = position[orbits.fits.begin[k] : orbits.fits.begin[k + 1]]
    order = np.argsort(angles.time[own], kind="stable")
    own, away = own[order], away[order]
    place, sun = angles.observer_position[own] + away, angles.sun[own]
    index = np.rint(angles.time[own] / scene.step).astype(np.int64)
    known = np.isfinite(angles.magnitude[own]) & (angles.magnitude_variance[own] > 0.0)
    known &= dimming(place[None], sun, scene.primaries[index])[0] == 0.0
    own, away, place, sun, index = (each[known] for each in (own, away, place, sun, index))
    distance, turn = np.linalg.norm(away, axis=1), scene.frame_axes[index]
    lit = sun - place
    data = np.empty((own.size, COLUMNS))
    data[:, TIME] = angles.time[own] * (scene.step_s / scene.step)
    data[:, MAGNITUDE], data[:, SEEN] = angles.magnitude[own], 1.0
    lit /= np.linalg.norm(lit, axis=1)[:, None]
    data[:, SUN] = np.einsum("nij,nj->ni", turn, lit)
    data[:, VIEW] = np.einsum("nij,nj->ni", turn, -away / distance[:, None])
    data[:, RANGE], data[:, WEIGHT] = distance * METERS, 1.0 / angles.magnitude_variance[own]
    return own, data


def _model(body: TargetSurfaces, settings: CharacterizationSettings) -> LightCurveModel:
    """The assumed body with the prior of its rotation."""
    bodies, nothing = rigid_bodies(body.inertia[:1]), np.empty(0, dtype=np.int64)
    rate = np.deg2rad(settings.angular_velocity_sigma_deg_h) / 3600.0
    sigma = np.repeat([uniform_attitude_sigma(), rate], 3)
    return LightCurveModel(
        np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(3), sigma, nothing, nothing, bodies.inertia[0],
        bodies.inverse[0], bool(bodies.spherical[0]), body_of(body, 0),
        bool(body.irradiance_4pi), bool(body.fresnel_sqrt), 1.0, _FREEDOM,
    )  # fmt: skip


def spin_period(
    data: Array,
    variance: Array,
    model: LightCurveModel,
    settings: CharacterizationSettings,
    rng: np.random.Generator,
) -> tuple[Interval, bool]:
    """Spin period of a light curve.

    Parameters
    ----------
    data : ndarray, shape (n, COLUMNS)
    variance : ndarray, shape (n,)
        Of the magnitudes, mag^2.
    model : LightCurveModel
        Assumed body, and prior of its rotation.
    settings : CharacterizationSettings
    rng : numpy.random.Generator
        Of the random starts.

    Returns
    -------
    Interval
        Period and its 95 % interval, h.
    bool
        Whether the period is determined.
    """
    chosen = np.unique(np.rint(np.linspace(0, len(data) - 1, min(len(data), _MOST_ROWS))))
    chosen = chosen.astype(np.int64)
    rows, wide = data[chosen], variance[chosen] + _ERROR_MAG**2
    own = model_of_rung(model, _RUNG)._replace(noise_variance=float(np.median(wide)))
    rows[:, WEIGHT] = own.noise_variance / wide
    how = BatchSettings().search_settings()._replace(starts=16, first_starts=32, pool=256)
    minima: list[tuple[Array, Array, float]] = []
    with threadpool_limits(limits=1):
        for _ in range(settings.searches):
            for u in search_modes(rows, own, how, rng):
                cost, information = _minimum(u, rows, own)
                if np.isfinite(cost) and np.all(np.linalg.eigvalsh(information) > 0.0):
                    minima.append((u, information, cost))
    modes = [_mode(*each, own) for each in _distinct(minima)]
    # a rate that is not known has components with the prior standard deviation
    longest, shortest = 2.0 * np.pi / (own.sigma[3] * chi(3).ppf(_LEVELS)) / 3600.0
    if modes:
        log_period, sigma, weight = (np.array(each) for each in zip(*modes, strict=True))
        value, low, high = _of_mixture(log_period, sigma, np.exp(weight - weight.max()))
        if 0.5 * (high - low) <= settings.largest_period_error:
            return Interval(*(float(np.exp(each)) for each in (value, low, high))), True
    middle = 2.0 * np.pi / (own.sigma[3] * chi(3).median()) / 3600.0
    return Interval(float(middle), float(shortest), float(longest)), False


def _minimum(u: Array, data: Array, model: LightCurveModel) -> tuple[float, Array]:
    """Cost and information at a minimum."""
    size = u.size
    gradient, information = np.empty(size), np.empty((size, size))
    anchor = Anchor(np.zeros(size), np.eye(size), np.zeros(1))
    return float(cost_and_derivatives(u, data, anchor, model, gradient, information)), information


def _distinct(minima: list[tuple[Array, Array, float]]) -> list[tuple[Array, Array, float]]:
    """Distinct minima of several searches, best first."""
    kept: list[tuple[Array, Array, float]] = []
    for each in sorted(minima, key=lambda one: one[2]):
        if all((each[0] - u) @ h @ (each[0] - u) >= _SAME_MODE for u, h, _ in kept):
            kept.append(each)
    return kept


def _mode(
    u: Array, information: Array, cost: float, model: LightCurveModel
) -> tuple[float, float, float]:
    """Logarithm of the period (h) of a minimum, its standard deviation, and its log weight."""
    quaternion, omega = np.empty(4), np.empty(3)
    initial_state(u, model, quaternion, omega)
    rate = np.linalg.norm(omega)
    slope = np.zeros(u.size)
    slope[3:ROTATION] = omega * model.sigma[3:ROTATION] / rate**2
    variance = slope @ np.linalg.solve(information, slope)
    sigma = np.sqrt(_TEMPERING * variance + _PERIOD_ERROR**2)
    weight = -cost / _TEMPERING - 0.5 * np.linalg.slogdet(information)[1]
    return float(np.log(2.0 * np.pi / rate / 3600.0)), float(sigma), float(weight)


def _of_mixture(mean: Array, sigma: Array, weight: Array) -> tuple[float, float, float]:
    """Value of the likeliest component of a mixture of normals, and the mixture's interval."""
    share = weight / weight.sum()

    def quantile(level: float) -> float:
        ends = np.min(mean - 9.0 * sigma), np.max(mean + 9.0 * sigma)
        return float(brentq(lambda x: share @ ndtr((x - mean) / sigma) - level, *ends))

    low, high = (quantile(level) for level in _LEVELS)
    return float(np.clip(mean[np.argmax(share)], low, high)), low, high


def _brightness(
    data: Array, sigma: Array, noise: float, irradiance_4pi: bool, rng: np.random.Generator
) -> tuple[Interval, Interval]:
    """Amplitude and area times albedo of a light curve whose magnitudes have the standard
    deviations `sigma` (n,), `noise` on the median; their variances are those of further noise."""
    magnitude = data[:, MAGNITUDE]
    drawn = magnitude + sigma * rng.standard_normal((_DRAWS, sigma.size))
    spans = [amplitude_of(each, data, irradiance_4pi) for each in drawn]
    sizes = np.log([area_albedo_of(each, data, irradiance_4pi) for each in drawn])
    span = amplitude_of(magnitude, data, irradiance_4pi)
    size = np.log(area_albedo_of(magnitude, data, irradiance_4pi))
    wide = _WIDE * np.hypot(np.std(spans), _AMPLITUDE_ERROR * noise)
    about = _WIDE * np.hypot(np.std(sizes), _SIZE_ERROR * noise)
    return (
        Interval(float(span), float(max(span - wide, 0.0)), float(span + wide)),
        Interval(*(float(np.exp(each)) for each in (size, size - about, size + about))),
    )
