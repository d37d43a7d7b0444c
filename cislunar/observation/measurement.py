"""Measurements of a target by an observer, and when they are possible (Paul & Fan, sections 2.4 and
5.2).

A measurement is (magnitude, right ascension, declination): the apparent magnitude of the facet
model, and the direction of the target in the body frame of the observer.

Assumptions and limitations
---------------------------
- Observers know their own position and attitude exactly; light time and aberration are neglected.
- Right ascension and declination have the same noise everywhere, as in the paper. Near the pole of
  the observer's frame right ascension is therefore too informative.
- With photon noise, all errors of the brightness are Gaussian in the flux.
- A target in the shadow of the Earth or Moon is fully lit unless its dimming is given.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.compiled import njit_noalloc
from cislunar.errors import ConfigurationError
from cislunar.observation.records import Measurements, Schedule
from cislunar.observation.scene import Scene
from cislunar.observation.sensor import (
    Sensors,
    extinction,
    limits_of,
    noise_variance_at,
    sensor_limits,
)
from cislunar.observation.sightline import (
    BRIGHT,
    CLEAR,
    METERS,
    direction_angles,
    lit_directions,
    obstacle,
    wrap_angle,
)
from cislunar.observation.target_surfaces import TargetSurfaces, body_of
from cislunar.photometry.body_blocks import body_magnitude
from cislunar.runtime import Array
from cislunar.runtime.arguments import array_of, indices_of

# Detection outcomes.
NOT_TASKED, FAINT, EXCLUDED, OCCULTED, DETECTED = range(5)

_PER_SHARE = 2.5 / np.log(10.0)
"""Magnitude loss per missing share of the flux, to first order."""


@njit_noalloc
def target_magnitude(place, observer, sun, to_inertial, quaternion, surfaces, j):
    """Apparent magnitude of target j at `place`; `FLOOR_MAGNITUDE` of `photometry.facets` if no
    facet reflects. Positions are nondimensional, in the propagation frame; `quaternion` is a tuple,
    inertial frame to body frame."""
    light, view, distance, _ = lit_directions(place, observer, sun, to_inertial)
    return body_magnitude(
        quaternion,
        light,
        view,
        distance * METERS,
        body_of(surfaces, j),
        surfaces.irradiance_4pi,
        surfaces.fresnel_sqrt,
    )


@njit_noalloc
def _in_flux(error):
    """Error of a magnitude whose flux has this error to first order; infinite without any flux.
    Photon noise is Gaussian in the flux, so that the error of a source far below the noise stays
    finite."""
    share = 1.0 - error / _PER_SHARE
    return -_PER_SHARE * np.log(share) if share > 0.0 else np.inf


@njit_noalloc
def _arriving(scene, surfaces, own, observer, j, k, state, attitude, dimmed):
    """Obstacle to target j at time k, apparent magnitude, and dimming by air. The magnitude is
    infinite and the dimming zero if there is an obstacle."""
    place = scene.observer_position[observer, k]
    ox, oy, oz = place[0], place[1], place[2]
    dx, dy, dz = state[0] - ox, state[1] - oy, state[2] - oz
    sun, primaries = scene.sun_position[k], scene.primaries[k]
    way = obstacle(ox, oy, oz, dx, dy, dz, sun, own, primaries)
    if way != CLEAR:
        return way, np.inf, 0.0
    air = extinction(ox, oy, oz, dx, dy, dz, primaries[0], own)
    turned = attitude[0], attitude[1], attitude[2], attitude[3]
    given = sun, scene.frame_axes[k], turned, surfaces, j
    return way, (dimmed + air) + target_magnitude(state, place, *given), air


@njit_noalloc
def observe(scene, surfaces, own, true, standard, observer, j, k, motion, noise, dimmed, out):
    """Detection outcome of one observation of target j at time k; `out` receives value and
    variance. `own` are the limits of the observer, `true` those of its true sensor. If `standard`,
    errors are in standard deviations of the true sensor's noise."""
    state, attitude = motion
    value, variance, truly = out
    noise_variance_at(own, own.limiting_magnitude, variance)
    seen_from = scene, surfaces, own, observer
    way, arriving, air = _arriving(*seen_from, j, k, state, attitude, dimmed)
    if way != CLEAR:
        return EXCLUDED if way == BRIGHT else OCCULTED
    error = noise[0], noise[1], noise[2]
    if standard:
        noise_variance_at(true, arriving, truly)
        error = (
            noise[0] * np.sqrt(truly[0]),
            noise[1] * np.sqrt(truly[1]),
            noise[2] * np.sqrt(truly[2]),
        )
    magnitude = error[0] + arriving
    if standard and true.photons[0] > 0.0:
        magnitude = arriving + _in_flux(error[0])
    if not magnitude <= own.limiting_magnitude:
        return FAINT
    noise_variance_at(own, magnitude, variance)
    place = scene.observer_position[observer, k]
    dx, dy, dz = state[0] - place[0], state[1] - place[1], state[2] - place[2]
    ra, dec = direction_angles(dx, dy, dz, scene.observer_axes[k])
    value[0] = magnitude - air
    value[1] = wrap_angle(ra + error[1])
    value[2] = dec + error[2]
    return DETECTED


@njit_noalloc
def _measure(
    first, origin, scene, surfaces, limits, true, standard, observations, truth, out, outcome
):
    """All observations over the steps from `first` on; see `measure`."""
    states, attitudes, noise, dimmed = truth
    value, variance, truly = out
    value[:, :] = np.nan
    for j in range(observations.offset.shape[0]):
        for i in range(observations.offset.shape[1] - 1):
            k, start = first + i, observations.offset[j, i]
            for row in range(start, observations.offset[j, i + 1]):
                o = observations.observer[row]
                outcome[row] = observe(
                    scene,
                    surfaces,
                    limits_of(limits, o),
                    limits_of(true, o),
                    standard,
                    o,
                    j,
                    k,
                    (states[j, k - origin], attitudes[j, k - origin]),
                    noise[j, k - origin, row - start],
                    dimmed[j, k - origin],
                    (value[row], variance[row], truly),
                )


def measure(
    first: int,
    observations: Schedule,
    scene: Scene,
    surfaces: TargetSurfaces,
    sensor: Sensors,
    states: Array,
    attitudes: Array,
    noise: Array,
    *,
    origin: int = 0,
    true: Sensors | None = None,
    dimmed: Array | None = None,
) -> tuple[Measurements, NDArray[np.uint8]]:
    """Simulate the measurements of an interval from the true states (Paul & Fan, eqs. 23, 43).

    A target is detected if its noisy apparent magnitude reaches the sensor's limit and the true
    line of sight is clear of the bright bodies (Paul & Fan, section 5.2) and, on the ground, of the
    horizon. The dimming by air is removed from the measured magnitude; that by a shadow remains,
    since it depends on the true position (`cislunar.estimation.eclipses`). The estimator checks the
    field of view, since it knows the expected direction.

    Parameters
    ----------
    first, origin : int
        Indices, among the scene's times, of the schedule's first step, and of the first of the
        states, attitudes and errors.
    observations : Schedule
        Observer and target of every observation.
    scene : Scene
        Observers and Sun.
    surfaces : TargetSurfaces
        True shapes and materials.
    sensor : Sensor or sequence of Sensor
        Limits, and the noise that the records state: of all observers, or of each.
    states : ndarray, shape (target, time, 6)
        True states, nondimensional, propagation frame.
    attitudes : ndarray, shape (target, time, 4)
        True attitudes, inertial frame to body frame.
    noise : ndarray, shape (target, time, observation, 3)
        Errors of the observations of a target at a time: mag, rad, rad; in standard deviations if
        `true` is given.
    true : Sensor or sequence of Sensor, optional
        Sensors with the true standard deviations.
    dimmed : ndarray, shape (target, time), optional
        Dimming by shadows of Earth and Moon, mag; zero if omitted.

    Returns
    -------
    measurements : Measurements
        A record for each observation, with the variance of the sensor at the measured magnitude.
    outcome : ndarray of uint8, shape (row,)
        FAINT, EXCLUDED, OCCULTED or DETECTED.

    Raises
    ------
    ConfigurationError
        If a target has more observations at a step than errors, `sensor` or `true` is neither one
        sensor nor one for each observer, or the shapes, times or observers of schedule, scene,
        surfaces and states disagree.
    """
    n_targets, n_steps = observations.offset.shape[0], observations.offset.shape[1] - 1
    if surfaces.first.size != n_targets + 1:
        raise ConfigurationError(
            f"surfaces of {surfaces.first.size - 1} targets: give those of the {n_targets} "
            "targets of the schedule"
        )
    span = first, first + n_steps, origin
    truth = _checked_truth(scene, surfaces, span, states, attitudes, dimmed)
    noise = array_of("noise", noise, (n_targets, truth[0].shape[1], None, 3), finite=False)
    most = int(np.diff(observations.offset, axis=1).max(initial=0))
    if most > noise.shape[2]:
        raise ConfigurationError(
            f"noise: {most} observations of a target at one step need as many errors; "
            f"{noise.shape[2]} are given"
        )
    n_observers, n_rows = scene.observer_position.shape[0], observations.observer.size
    indices_of("observations.observer", observations.observer, n_observers)
    limits = sensor_limits(sensor, n_observers)
    truly = limits if true is None else sensor_limits(true, n_observers)
    value, variance = np.empty((n_rows, 3)), np.empty((n_rows, 3))
    outcome = np.empty(n_rows, dtype=np.uint8)
    model = scene, surfaces, limits, truly, true is not None, observations
    out = value, variance, np.empty(3)
    _measure(first, origin, *model, (truth[0], truth[1], noise, truth[2]), out, outcome)
    return Measurements(*observations, value, variance), outcome


def _checked_truth(
    scene: Scene,
    surfaces: TargetSurfaces,
    span: tuple[int, int, int],
    states: ArrayLike,
    attitudes: ArrayLike,
    dimmed: ArrayLike | None,
) -> tuple[Array, Array, Array]:
    """True states, attitudes and dimming, of which the times from the first to before the second of
    a span are needed; the third is that of the first state."""
    n_targets, n_times = surfaces.first.size - 1, scene.observer_position.shape[1]
    states = array_of("states", states, (n_targets, "time", 6), finite=False)
    times = states.shape[1]
    attitudes = array_of("attitudes", attitudes, (n_targets, times, 4), finite=False)
    dimmed = np.zeros((n_targets, times)) if dimmed is None else dimmed
    first, stop, origin = span
    if not 0 <= origin <= first or stop > min(origin + times, n_times):
        raise ConfigurationError(
            f"first = {first}: the times from {first} to before {stop} must be among the {n_times} "
            f"times of the scene and the {times} times of the states from {origin} on"
        )
    return states, attitudes, array_of("dimmed", dimmed, (n_targets, times), finite=False)


@njit_noalloc
def _mark_detectable(first, origin, scene, surfaces, limits, truth, found):
    """Mark the targets that any observer could detect; see `detectable_targets`."""
    states, attitudes, dimmed = truth
    for j in range(found.size):
        for k in range(first, origin + states.shape[1]):
            i = k - origin
            for o in range(scene.observer_position.shape[0]):
                own = limits_of(limits, o)
                seen_from = scene, surfaces, own, o
                arriving = _arriving(*seen_from, j, k, states[j, i], attitudes[j, i], dimmed[j, i])[
                    1
                ]
                if arriving <= own.limiting_magnitude:
                    found[j] = True
                    break
            if found[j]:
                break


def detectable_targets(
    first: int,
    scene: Scene,
    surfaces: TargetSurfaces,
    sensor: Sensors,
    states: Array,
    attitudes: Array,
    *,
    origin: int = 0,
    dimmed: Array | None = None,
) -> NDArray[np.bool_]:
    """Which targets any observer could detect without noise at any time from index `first` of the
    scene on to the last of the states; ndarray of bool, shape (target,). See `measure` for the
    arguments and the error raised."""
    span = first, origin + np.shape(states)[1], origin
    truth = _checked_truth(scene, surfaces, span, states, attitudes, dimmed)
    limits = sensor_limits(sensor, scene.observer_position.shape[0])
    found = np.zeros(surfaces.first.size - 1, dtype=np.bool_)
    _mark_detectable(first, origin, scene, surfaces, limits, truth, found)
    return found
