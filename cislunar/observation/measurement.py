"""What an observer measures of a target, and when it can (Paul & Fan, sections 2.4 and 5.2).

A measurement is (magnitude, right ascension, declination): the facet model's apparent magnitude
and the direction of the target in the body frame of the observer.

Assumptions and limitations
---------------------------
- Observers know their own position and attitude exactly; light time and aberration are neglected.
- Right ascension and declination have the same constant noise everywhere, as in the paper, also
  near the pole of the observer's frame, where right ascension is then too informative.
- A target in the shadow of the Earth or Moon is taken as lit.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cislunar.errors import ConfigurationError
from cislunar.observation.records import Measurements, Schedule
from cislunar.observation.scene import Scene, TargetSurfaces, body_of
from cislunar.observation.sensor import Sensor
from cislunar.observation.sightline import (
    METRES,
    direction_angles,
    lit_directions,
    occulted,
    outside_exclusion,
    wrap_angle,
)
from cislunar.photometry.body_blocks import body_magnitude

Array = NDArray[np.float64]

# What became of a look.
NOT_TASKED, FAINT, EXCLUDED, OCCULTED, DETECTED = range(5)


@njit(cache=True, error_model="numpy")
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


@njit(cache=True, error_model="numpy")
def _look(scene, surfaces, limits, observer, j, k, state, attitude, noise, out):
    """Fate of one look at target j at time k; what is measured goes into `out` (3,)."""
    ox = scene.observer_position[observer, k, 0]
    oy = scene.observer_position[observer, k, 1]
    oz = scene.observer_position[observer, k, 2]
    x, y, z = state[0], state[1], state[2]
    dx, dy, dz = x - ox, y - oy, z - oz
    sun, primaries = scene.sun_position[k], scene.primaries[k]
    if not outside_exclusion(ox, oy, oz, dx, dy, dz, sun, limits.cosines, primaries):
        return EXCLUDED
    if limits.occultation and occulted(ox, oy, oz, dx, dy, dz, primaries):
        return OCCULTED
    magnitude = noise[0] + target_magnitude(
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
    if not magnitude <= limits.limiting_magnitude:
        return FAINT
    ra, dec = direction_angles(dx, dy, dz, scene.observer_axes[k])
    out[0] = magnitude
    out[1] = wrap_angle(ra + noise[1])
    out[2] = dec + noise[2]
    return DETECTED


@njit(cache=True, error_model="numpy")
def _measure(first, begins, scene, surfaces, limits, looks, states, attitudes, noise, out, fate):
    """All looks over the steps first, first + 1 and so on; see `measure`."""
    out[:, :] = np.nan
    for j in range(looks.offset.shape[0]):
        for i in range(looks.offset.shape[1] - 1):
            k, start = first + i, looks.offset[j, i]
            for row in range(start, looks.offset[j, i + 1]):
                fate[row] = _look(
                    scene,
                    surfaces,
                    limits,
                    looks.observer[row],
                    j,
                    k,
                    states[j, k - begins],
                    attitudes[j, k - begins],
                    noise[j, k - begins, row - start],
                    out[row],
                )


def measure(
    first: int,
    looks: Schedule,
    scene: Scene,
    surfaces: TargetSurfaces,
    sensor: Sensor,
    states: Array,
    attitudes: Array,
    noise: Array,
    *,
    begins: int = 0,
) -> tuple[Measurements, NDArray[np.uint8]]:
    """Simulate the measurements of an interval from the true states (Paul & Fan, eqs. 23, 43).

    An observation exists when the noisy magnitude reaches the sensor's limit and the true line of
    sight keeps clear of the bright bodies (Paul & Fan, section 5.2). The field of view is the
    estimator's to check, since it compares with the expected direction.

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
    sensor : Sensor
        Limits, and the noise that the records state.
    states : ndarray, shape (target, time, 6)
        True states, nondimensional, rotating frame.
    attitudes : ndarray, shape (target, time, 4)
        True attitudes, inertial to body.
    noise : ndarray, shape (target, time, look, 3)
        Errors of the first, second ... look at a target at a time: mag, rad, rad.
    begins : int
        Index, among the scene's times, of the first of the states, attitudes and errors.

    Returns
    -------
    measurements : Measurements
        A record for each look.
    fate : ndarray of uint8, shape (row,)
        FAINT, EXCLUDED, OCCULTED or DETECTED.

    Raises
    ------
    ConfigurationError
        If the schedule has more looks at a target at a step than there are errors for.
    """
    most = int(np.diff(looks.offset, axis=1).max(initial=0))
    if most > noise.shape[2]:
        raise ConfigurationError(
            f"noise: {most} looks at a target at one step need as many errors, not {noise.shape[2]}"
        )
    limits = sensor.limits()
    value = np.empty((looks.observer.size, 3))
    fate = np.empty(looks.observer.size, dtype=np.uint8)
    world, truth = (scene, surfaces, limits, looks), (states, attitudes, noise)
    _measure(first, begins, *world, *truth, value, fate)
    return Measurements(*looks, value, np.tile(limits.noise_variance, (fate.size, 1))), fate
