"""What an observer measures of a target, and when it can (Paul & Fan, sections 2.4 and 5.2).

A measurement is (magnitude, right ascension, declination): the facet model's apparent magnitude
and the direction of the target in the body frame of the observer.

Assumptions and limitations
---------------------------
- Observers know their own position and attitude exactly; light time and aberration are neglected.
- Right ascension and declination have the same noise everywhere, as in the paper, also
  near the pole of the observer's frame, where right ascension is then too informative.
- Where there is noise of photons, all errors of the brightness are Gaussian in the flux.
- A target in the shadow of the Earth or Moon is taken as lit unless its dimming is given.
"""

import numpy as np
from numpy.typing import NDArray

from cislunar.compiled import borrowing
from cislunar.errors import ConfigurationError
from cislunar.observation.records import Measurements, Schedule
from cislunar.observation.scene import Scene, TargetSurfaces, body_of
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
    METRES,
    direction_angles,
    lit_directions,
    obstacle,
    wrap_angle,
)
from cislunar.photometry.body_blocks import body_magnitude

Array = NDArray[np.float64]

# What became of a look.
NOT_TASKED, FAINT, EXCLUDED, OCCULTED, DETECTED = range(5)

_PER_SHARE = 2.5 / np.log(10.0)
"""Magnitudes by which a source is fainter per share of its flux that is missing, to first order."""


@borrowing
def target_magnitude(dx, dy, dz, sx, sy, sz, to_inertial, quaternion, surfaces, j):
    """Apparent magnitude of target j; `FLOOR_MAGNITUDE` of `photometry.facets` if it is dark.

    d leads from the observer to the target, s from there to the Sun (nondimensional, rotating
    frame); `quaternion` is a tuple, inertial to body.
    """
    light, view, distance, _ = lit_directions(dx, dy, dz, sx, sy, sz, to_inertial)
    return body_magnitude(
        quaternion,
        light,
        view,
        distance * METRES,
        body_of(surfaces, j),
        surfaces.irradiance_4pi,
        surfaces.fresnel_sqrt,
    )


@borrowing
def _in_flux(error):
    """Error of a magnitude whose flux errs by as much to first order; infinite without any flux.

    The noise of photons is Gaussian in the flux: a source far below the noise, whose magnitude
    would err by hundreds, is not found at a hundred magnitudes above its own.
    """
    share = 1.0 - error / _PER_SHARE
    return -_PER_SHARE * np.log(share) if share > 0.0 else np.inf


@borrowing
def _arriving(scene, surfaces, own, observer, j, k, state, attitude, dimmed):
    """What is in the way to target j at time k, magnitude that arrives, and what air and shadow
    took of it; without them if something is."""
    ox = scene.observer_position[observer, k, 0]
    oy = scene.observer_position[observer, k, 1]
    oz = scene.observer_position[observer, k, 2]
    x, y, z = state[0], state[1], state[2]
    dx, dy, dz = x - ox, y - oy, z - oz
    sun, primaries = scene.sun_position[k], scene.primaries[k]
    way = obstacle(ox, oy, oz, dx, dy, dz, sun, own, primaries)
    if way != CLEAR:
        return way, np.inf, 0.0
    lost = dimmed + extinction(ox, oy, oz, dx, dy, dz, primaries[0], own)
    arriving = lost + target_magnitude(
        dx,
        dy,
        dz,
        sun[0] - x,
        sun[1] - y,
        sun[2] - z,
        scene.frame_axes[k],
        (attitude[0], attitude[1], attitude[2], attitude[3]),
        surfaces,
        j,
    )
    return way, arriving, lost


@borrowing
def _look(scene, surfaces, own, true, standard, observer, j, k, motion, noise, dimmed, out):
    """Fate of one look at target j at time k; value and variance go into `out`, with scratch.

    `own` are the observer's limits, `true` those of its true sensor, of whose noise errors are
    counted in standard deviations if they are `standard`.
    """
    state, attitude = motion
    value, variance, truly = out
    noise_variance_at(own, own.limiting_magnitude, variance)
    seen_from = scene, surfaces, own, observer
    way, arriving, lost = _arriving(*seen_from, j, k, state, attitude, dimmed)
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
    value[0] = magnitude - lost
    value[1] = wrap_angle(ra + error[1])
    value[2] = dec + error[2]
    return DETECTED


@borrowing
def _measure(first, begins, scene, surfaces, limits, true, standard, looks, truth, out, fate):
    """All looks over the steps first, first + 1 and so on; see `measure`."""
    states, attitudes, noise, dimmed = truth
    value, variance, truly = out
    value[:, :] = np.nan
    for j in range(looks.offset.shape[0]):
        for i in range(looks.offset.shape[1] - 1):
            k, start = first + i, looks.offset[j, i]
            for row in range(start, looks.offset[j, i + 1]):
                o = looks.observer[row]
                fate[row] = _look(
                    scene,
                    surfaces,
                    limits_of(limits, o),
                    limits_of(true, o),
                    standard,
                    o,
                    j,
                    k,
                    (states[j, k - begins], attitudes[j, k - begins]),
                    noise[j, k - begins, row - start],
                    dimmed[j, k - begins],
                    (value[row], variance[row], truly),
                )


def measure(
    first: int,
    looks: Schedule,
    scene: Scene,
    surfaces: TargetSurfaces,
    sensor: Sensors,
    states: Array,
    attitudes: Array,
    noise: Array,
    *,
    begins: int = 0,
    true: Sensors | None = None,
    dimmed: Array | None = None,
) -> tuple[Measurements, NDArray[np.uint8]]:
    """Simulate the measurements of an interval from the true states (Paul & Fan, eqs. 23, 43).

    An observation exists when the noisy magnitude that arrives reaches the sensor's limit and the
    true line of sight keeps clear of the bright bodies (Paul & Fan, section 5.2), and of the
    horizon on the ground. By what air and shadow have dimmed is taken off again. The field of view
    is the estimator's to check, since it compares with the expected direction.

    Parameters
    ----------
    first : int
        Index, among the scene's times, of the schedule's first step.
    looks : Schedule
        Who looks at what, and when.
    scene : Scene
        Observers and Sun.
    surfaces : TargetSurfaces
        Shapes and materials.
    sensor : Sensor or sequence of Sensor
        Limits, and the noise that the records state: of all observers, or of each.
    states : ndarray, shape (target, time, 6)
        True states, nondimensional, rotating frame.
    attitudes : ndarray, shape (target, time, 4)
        True attitudes, inertial to body.
    noise : ndarray, shape (target, time, look, 3)
        Errors of the first, second ... look at a target at a time: mag, rad, rad; in standard
        deviations, if `true` is given.
    begins : int
        Index, among the scene's times, of the first of the states, attitudes and errors.
    true : Sensor or sequence of Sensor, optional
        Whose standard deviations the errors truly have.
    dimmed : ndarray, shape (target, time), optional
        By what a shadow dims, mag; by nothing, if omitted.

    Returns
    -------
    measurements : Measurements
        A record for each look, with the variance of the sensor at the measured magnitude.
    fate : ndarray of uint8, shape (row,)
        FAINT, EXCLUDED, OCCULTED or DETECTED.

    Raises
    ------
    ConfigurationError
        If the schedule has more looks at a target at a step than there are errors for, or an
        observer has no sensor.
    """
    most = int(np.diff(looks.offset, axis=1).max(initial=0))
    if most > noise.shape[2]:
        raise ConfigurationError(
            f"noise: {most} looks at a target at one step need as many errors, not {noise.shape[2]}"
        )
    n_observers, n_rows = scene.observer_position.shape[0], looks.observer.size
    limits = sensor_limits(sensor, n_observers)
    truly = limits if true is None else sensor_limits(true, n_observers)
    dimmed = np.zeros(states.shape[:2]) if dimmed is None else dimmed
    value, variance = np.empty((n_rows, 3)), np.empty((n_rows, 3))
    fate = np.empty(n_rows, dtype=np.uint8)
    world = scene, surfaces, limits, truly, true is not None, looks
    out = value, variance, np.empty(3)
    _measure(first, begins, *world, (states, attitudes, noise, dimmed), out, fate)
    return Measurements(*looks, value, variance), fate


@borrowing
def _within_reach(first, begins, scene, surfaces, limits, truth, found):
    """Which targets some observer could find; see `within_reach`."""
    states, attitudes, dimmed = truth
    for j in range(found.size):
        for k in range(first, begins + states.shape[1]):
            i = k - begins
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


def within_reach(
    first: int,
    scene: Scene,
    surfaces: TargetSurfaces,
    sensor: Sensors,
    states: Array,
    attitudes: Array,
    *,
    begins: int = 0,
    dimmed: Array | None = None,
) -> NDArray[np.bool_]:
    """Which targets any observer could find without noise, were it to look at the right time.

    Parameters
    ----------
    first : int
        Index, among the scene's times, of the first that counts; the last is that of the states.
    scene, surfaces, sensor, states, attitudes, begins, dimmed
        As of `measure`.

    Returns
    -------
    ndarray of bool, shape (target,)

    Raises
    ------
    ConfigurationError
        If an observer has no sensor.
    """
    dimmed = np.zeros(states.shape[:2]) if dimmed is None else dimmed
    limits = sensor_limits(sensor, scene.observer_position.shape[0])
    found = np.zeros(states.shape[0], dtype=np.bool_)
    _within_reach(first, begins, scene, surfaces, limits, (states, attitudes, dimmed), found)
    return found
