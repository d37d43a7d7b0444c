"""Spin period, amplitude, and area times albedo of cataloged objects from their light curves.

A light curve consists of the magnitudes of the detections of a confirmed orbit, with lines of sight
and ranges of the fitted orbit. Nothing is known of attitude and angular velocity but their prior,
which is that of the hand-over (`cislunar.survey.hand_over`). The method is that of
`cislunar.estimation.light_curves.model_selection.unknown_rotation`. Only what the catalog knows is
used.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from cislunar.estimation.light_curves.model_selection import (
    EstimateInterval,
    light_curve_rows,
    measured_brightness,
    spin_period,
    unknown_rotation_model,
)
from cislunar.observation import METERS, Scene, TargetSurfaces, dimming
from cislunar.orbit_determination import Angles, LinkedOrbits
from cislunar.runtime import Array, Indices, counted
from cislunar.runtime.seeds import generator
from cislunar.survey.hand_over import uniform_attitude_sigma
from cislunar.survey.settings import CharacterizationSettings


class CharacterizedOrbit(NamedTuple):
    """What the light curve of a confirmed orbit tells of its object.

    Attributes
    ----------
    orbit : int
        Index of the orbit in the catalog.
    row : ndarray of int, shape (n,)
        Detections of the light curve.
    light_curve : ndarray, shape (n, ROW_COLUMNS)
        See `cislunar.estimation.light_curves.light_curve.cost`; times in s since the start.
    noise_mag : float
        Median standard deviation of the magnitudes.
    spin_period_h : EstimateInterval
        2 pi divided by the angular rate at the start, h, with its 95 % interval.
    determined : bool
        Whether the spin period is determined; otherwise its interval is that of the prior.
    amplitude_mag, area_albedo_m2 : EstimateInterval
        See `cislunar.estimation.light_curves.model_selection.Characterization`.
    """

    orbit: int
    row: Indices
    light_curve: Array
    noise_mag: float
    spin_period_h: EstimateInterval
    determined: bool
    amplitude_mag: EstimateInterval
    area_albedo_m2: EstimateInterval


def characterize_orbits(
    orbits: LinkedOrbits,
    angles: Angles,
    scene: Scene,
    body: TargetSurfaces,
    settings: CharacterizationSettings,
    seed: int,
    progress: Callable[[int, int], None] | None = None,
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
    progress : callable, optional
        Called with (orbits done, all confirmed orbits).

    Returns
    -------
    tuple of CharacterizedOrbit
        In the order of the orbits. Orbits with fewer detections or larger noise than the settings
        state are left out.
    """
    if settings.least_detections == 0:
        return ()
    rate = settings.angular_velocity_sigma_deg_h
    model, found = unknown_rotation_model(body, uniform_attitude_sigma(), rate), []
    confirmed = np.flatnonzero(orbits.confirmed).tolist()
    for k in counted(confirmed, progress):
        row, data = light_curve(orbits, k, angles, scene)
        noise = float(np.sqrt(np.median(angles.magnitude_variance[row]))) if row.size else np.inf
        if row.size >= settings.least_detections and noise <= settings.largest_noise_mag:
            rng = generator(seed, "characterization", k)
            period = spin_period(
                data, model, rng, searches=settings.searches,
                largest_error=settings.largest_period_error,
            )  # fmt: skip
            brightness = measured_brightness(data, model.irradiance_4pi, rng)
            found.append(CharacterizedOrbit(k, row, data, noise, *period, *brightness))
    return tuple(found)


def light_curve(
    orbits: LinkedOrbits, k: int, angles: Angles, scene: Scene
) -> tuple[Indices, Array]:
    """Detections of an orbit with a magnitude, and their light curve.

    Parameters
    ----------
    orbits : LinkedOrbits
        Orbits of a catalog.
    k : int
        Index of the orbit.
    angles : Angles
        Detections of the catalog, to whose rows the orbits refer.
    scene : Scene
        Times, axes, and centers of Earth and Moon.

    Returns
    -------
    row : ndarray of int, shape (n,)
        Rows of the angles in order of time, without those in a shadow of Earth or Moon.
    data : ndarray, shape (n, ROW_COLUMNS)
        See `cislunar.estimation.light_curves.model_selection.light_curve_rows`; times in s since
        the start.
    """
    own, fits = orbits.detections(k), orbits.fits
    order = np.argsort(angles.time[own], kind="stable")
    own, away = own[order], fits.position[fits.begin[k] : fits.begin[k + 1]][order]
    place, sun = angles.observer_position[own] + away, angles.sun[own]
    index = np.rint(angles.time[own] / scene.step).astype(np.int64)
    # a magnitude or a variance may be NaN
    known = np.isfinite(angles.magnitude[own]) & (angles.magnitude_variance[own] > 0.0)
    known &= dimming(place[None], sun, scene.primaries[index])[0] == 0.0
    own, away, lit, index = own[known], away[known], (sun - place)[known], index[known]
    distance, turn = np.linalg.norm(away, axis=1), scene.frame_axes[index]
    lit /= np.linalg.norm(lit, axis=1)[:, None]
    data = light_curve_rows(
        angles.time[own] * (scene.step_s / scene.step),
        angles.magnitude[own],
        angles.magnitude_variance[own],
        np.einsum("nij,nj->ni", turn, lit),
        np.einsum("nij,nj->ni", turn, -away / distance[:, None]),
        distance * METERS,
    )
    return own, data
