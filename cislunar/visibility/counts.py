"""Visibility counts of static targets for every orbit and satellite count."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.constants import LENGTH_UNIT_KM, MU, TIME_UNIT_S
from cislunar.dynamics import primary_distances, require_nondimensional
from cislunar.errors import ConfigurationError
from cislunar.observation.sensor import ExclusionAngles
from cislunar.photometry.sphere import faintness_per_squared_range
from cislunar.runtime import Array, array_of, count_of, number_of, require_kind
from cislunar.runtime.settings_fields import Flag, Number, Positive, Section, setting
from cislunar.visibility.kernel import count_observations
from cislunar.visibility.phasing import distinct_phases
from cislunar.visibility.shade import lost_observations, shade_of
from cislunar.visibility.tracks import satellite_tracks

_ORBITS_PER_BATCH = 8


class VisibilitySettings(Section):
    """Conditions under which a static target is observable (Paul & Fan, section 3 and table 1)."""

    # fmt: off

    limiting_magnitude: Number = setting("magnitude of the faintest visible target", "mag", 18)
    target_radius_m: Positive = setting("radius of the spherical targets", "m", 1)
    diffuse_reflection_coefficient: Positive = setting(
        "C_d of the sphere; with 1, J of the paper's families in scenario A is near the paper's, "
        "that in B and C is not (`docs/deviations.md`)", default=1)
    exclusion_deg: ExclusionAngles = setting("")
    eclipse: Flag = setting(
        "true: targets are dimmer in the penumbra of Earth and Moon and invisible in the umbra",
        paper="not in the paper", default=False)

    # fmt: on

    @property
    def faintness(self) -> float:
        """K of `faintness_per_squared_range` per squared nondimensional length."""
        per_square_meter = faintness_per_squared_range(
            self.limiting_magnitude,
            radius_m=self.target_radius_m,
            diffuse_reflection_coefficient=self.diffuse_reflection_coefficient,
        )
        return per_square_meter * (LENGTH_UNIT_KM * 1e3) ** 2

    def faintness_at(self, count: int, length: ArrayLike = 1.0) -> Array:
        """`faintness` at a number of times, per squared unit of length of the frame, shape
        (count,). `length`, shape (count,) or (), is that unit in units of l*."""
        return np.broadcast_to(self.faintness * np.square(length), count).astype(float)


@dataclass(frozen=True)
class VisibilityCounts:
    """Observations and distances for every (orbit, satellite count).

    Attributes
    ----------
    observations : ndarray of uint16 or uint32, shape (orbit, satellites, target)
        Number of times each target is observable, summed over the satellites.
    distance : ndarray, shape (orbit, satellites)
        Distance to the Earth plus distance to the Moon, summed over time and satellites,
        in units of l*.
    """

    observations: NDArray[np.unsignedinteger]
    distance: Array


def observation_times(duration_days: float, step_hours: float) -> Array:
    """Evaluation times 0, step, ..., duration (Paul & Fan: 30 days hourly, 721 times).

    Parameters
    ----------
    duration_days : float
        Horizon, days; a whole number of steps.
    step_hours : float
        Step, hours.

    Returns
    -------
    ndarray, shape (time,)
        Nondimensional time since the epoch.

    Raises
    ------
    ConfigurationError
        If a number is not finite, or the step is not positive or does not divide the horizon.
    """
    number_of("step_hours", step_hours, positive=True)
    steps = number_of("duration_days", duration_days) * 24.0 / step_hours
    if steps < 0.0 or abs(steps - round(steps)) > 1e-9:
        raise ConfigurationError(
            f"duration_days = {duration_days} is not a whole number of steps of "
            f"step_hours = {step_hours}"
        )
    return np.arange(round(steps) + 1) * step_hours * 3600.0 / TIME_UNIT_S


def count_visibility(
    state: ArrayLike,
    period: ArrayLike,
    target: ArrayLike,
    times: ArrayLike,
    sun_position: ArrayLike,
    settings: VisibilitySettings,
    *,
    max_satellites: int = 10,
    tracks: ArrayLike | None = None,
    length: ArrayLike = 1.0,
    propagator: str = "dopri5",
    mu: float = MU,
    progress: Callable[[int, int], None] | None = None,
) -> VisibilityCounts:
    """Count observations of static targets from every orbit and satellite count
    (Paul & Fan, eq. 59).

    In ephemeris dynamics the positions of satellites are given in the pulsating rotating frame
    (`cislunar.dynamics.frames.pulsating_frame`), in which angles are unchanged, together with its
    unit of length.

    Parameters
    ----------
    state : array_like, shape (orbit, 6)
        Epoch states of the orbits, nondimensional, rotating frame.
    period : array_like, shape (orbit,)
        Periods, nondimensional.
    target : array_like, shape (target, 3)
        Static targets, nondimensional, rotating frame.
    times : array_like, shape (time,)
        Evaluation times, nondimensional, since the epoch.
    sun_position : array_like, shape (time, 3)
        Sun at those times, nondimensional, rotating frame.
    settings : VisibilitySettings
        Photometry and exclusion.
    max_satellites : int
        Counts 1 .. `max_satellites` are tabulated.
    tracks : array_like, shape (orbit, phase, time, 3), optional
        Positions of satellites at the phases of `distinct_phases`, nondimensional, rotating frame,
        instead of the periodic orbits of the CR3BP.
    length : array_like, shape (time,) or ()
        Unit of length of the frame in units of l*; it differs from 1 in the pulsating frame.
    propagator : str
        Method for the observers, see `satellite_tracks`.
    mu : float
        Mass ratio.
    progress : callable, optional
        Called with (orbits done, orbits).

    Returns
    -------
    VisibilityCounts

    Raises
    ------
    ConfigurationError
        If an input is impossible, or a state or a target is not finite or evidently in km.
    ConvergenceError
        If a satellite meets the center of a primary.
    """
    state = array_of("state", np.atleast_2d(array_of("state", state)), ("orbit", 6))
    period = array_of("period", np.atleast_1d(array_of("period", period)), (len(state),))
    target = np.ascontiguousarray(array_of("target", target, ("target", 3)))
    require_nondimensional("state", state)
    require_nondimensional("target", target)
    times = array_of("times", times, ("time",))
    sun = np.ascontiguousarray(array_of("sun_position", sun_position, (len(times), 3)))
    require_kind("settings", settings, VisibilitySettings, "give a VisibilitySettings")
    max_satellites = count_of("max_satellites", max_satellites)
    phase, members = distinct_phases(max_satellites)
    largest = max_satellites * len(times)
    dtype = np.uint16 if largest <= np.iinfo(np.uint16).max else np.uint32
    observations = np.empty((len(state), max_satellites, len(target)), dtype=dtype)
    distance = np.empty((len(state), max_satellites))
    length = array_of("length", length)
    unit = np.broadcast_to(length, len(times)) if length.ndim == 0 else length
    array_of("length", unit, (len(times),))
    if tracks is not None:
        tracks = array_of("tracks", tracks, (len(state), len(phase), len(times), 3))
    faintness = settings.faintness_at(len(times), unit)
    shade = shade_of(target, sun, mu, unit) if settings.eclipse else None
    for first in range(0, len(state), _ORBITS_PER_BATCH):
        batch = slice(first, min(first + _ORBITS_PER_BATCH, len(state)))
        if tracks is None:
            track = satellite_tracks(
                state[batch], period[batch], phase, times, propagator=propagator, mu=mu
            )
        else:
            track = np.ascontiguousarray(tracks[batch])
        given = track, target, sun, settings.exclusion_deg.cosines, faintness, mu
        per_phase = count_observations(*given)
        if shade is not None:
            lost = lost_observations(*given, shade)
            np.subtract.at(per_phase, (slice(None), slice(None), shade.target), lost)
        earth, moon = primary_distances(track, mu)
        path_length = np.sum((earth + moon) * unit, axis=-1)
        for count, rows in enumerate(members):
            observations[batch, count] = per_phase[:, rows].sum(axis=1)
            distance[batch, count] = path_length[:, rows].sum(axis=1)
        if progress is not None:
            progress(batch.stop, len(state))
    return VisibilityCounts(observations=observations, distance=distance)
