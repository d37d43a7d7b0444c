"""Exposures of telescopes that are pointed in a direction, and the detections that they return.

An exposure has a field of view about its boresight. Every target in the field whose line of sight
is clear and whose noisy magnitude reaches the limit gives a detection, except for a share that is
lost. False alarms are a Poisson process, uniform over the field, whose number grows with magnitude
as 10^(slope m) up to the limit. A detection does not state what it is of: `expose` returns the
origins apart, and only `cislunar.evaluation` and the simulation read them.

A direction is a right ascension and a declination in the body frame of the observer. The field is a
square about the boresight in its tangent plane, along the directions of right ascension and
declination.

Assumptions and limitations
---------------------------
- Two targets are always resolved; a detection is of one target.
- Boresight and observer's position are as commanded and known.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.compiled import njit, njit_noalloc
from cislunar.detection.process import DetectionProcess
from cislunar.observation.measurement import DETECTED, FAINT, NOT_TASKED, observe
from cislunar.observation.scene import Scene
from cislunar.observation.sensor import Sensors, limits_of, noise_variance_at, sensor_limits
from cislunar.observation.sightline import (
    angles_of_vectors,
    direction_angles,
    unit_vectors,
    wrap_angle,
    wrapped,
)
from cislunar.observation.target_surfaces import TargetSurfaces
from cislunar.runtime import Array, Indices

FALSE_ALARM = -1
"""Origin of a detection that is of no target."""


class Exposures(NamedTuple):
    """Exposures over consecutive steps, sorted by step and observer.

    Attributes
    ----------
    step, observer : ndarray of int, shape (exposure,)
        Steps are counted from the first of the interval.
    boresight : ndarray, shape (exposure, 2)
        Right ascension and declination, observer's body frame, rad.
    half_field : ndarray, shape (exposure,)
        Half the field of view, rad.
    limiting_magnitude : ndarray, shape (exposure,)
        Faintest measured magnitude that is detected.
    """

    step: Indices
    observer: Indices
    boresight: Array
    half_field: Array
    limiting_magnitude: Array

    def between(self, start: int, stop: int) -> slice:
        """Exposures of the steps from `start` to `stop`, the latter not included."""
        return slice(*np.searchsorted(self.step, [start, stop]).tolist())


class Detections(NamedTuple):
    """Detections of exposures, sorted by exposure.

    Attributes
    ----------
    exposure : ndarray of int, shape (row,)
    value, variance : ndarray, shape (row, 3)
        Magnitude, right ascension and declination in the observer's body frame, and the variances
        of their independent errors; mag, rad, mag^2, rad^2.
    """

    exposure: Indices
    value: Array
    variance: Array


def point_at(
    scene: Scene, sensor: Sensors, first: int, command: Indices, position: Array
) -> Exposures:
    """Exposures of observers that are commanded to follow predicted positions.

    Parameters
    ----------
    scene : Scene
    sensor : Sensor or sequence of Sensor
    first : int
        Index of the first step among the scene's times.
    command : ndarray of int, shape (step, observer)
        Row of `position` that an observer follows; negative for an idle observer.
    position : ndarray, shape (track, step, >= 3)
        Predicted positions, nondimensional, propagation frame. There is no exposure where they are
        NaN.

    Returns
    -------
    Exposures

    Raises
    ------
    ConfigurationError
        If `sensor` is neither one sensor nor one for each observer.
    """
    limits = sensor_limits(sensor, scene.observer_position.shape[0])
    step, observer = np.nonzero(command >= 0)
    place = position[command[step, observer], step, :3]
    kept = np.all(np.isfinite(place), axis=1)
    step, observer = step[kept], observer[kept]
    way = place[kept] - scene.observer_position[observer, first + step]
    boresight = angles_of_vectors(np.einsum("nij,nj->ni", scene.observer_axes[first + step], way))
    return Exposures(
        step, observer, boresight, limits.half_field[observer], limits.limiting_magnitude[observer]
    )


def boresight_vectors(exposures: Exposures, scene: Scene, first: int) -> Array:
    """Unit vectors (exposure, 3) of the boresights, propagation frame; `first` is the index of the
    first step among the scene's times."""
    body = unit_vectors(*exposures.boresight.T)
    return np.einsum("nji,nj->ni", scene.observer_axes[first + exposures.step], body)


@njit_noalloc
def tangent_offset(ra, dec, ra0, dec0):
    """Offsets of a direction along right ascension and declination in the tangent plane of another;
    infinite at 90 deg and beyond."""
    turn = wrap_angle(ra - ra0)
    s, c, s0, c0 = np.sin(dec), np.cos(dec), np.sin(dec0), np.cos(dec0)
    along = s0 * s + c0 * c * np.cos(turn)
    if along <= 0.0:
        return np.inf, np.inf
    return c * np.sin(turn) / along, (c0 * s - s0 * c * np.cos(turn)) / along


@njit(cache=True, error_model="numpy")
def _expose(first, origin, model, truth, command, out):
    """Detections of targets, into `out`; returns their number. See `expose`."""
    scene, surfaces, limits, true, standard, exposures, toward = model
    states, attitudes, noise, dimmed, kept = truth
    row_exposure, row_origin, value, variance, outcome = out
    count, truly = 0, np.empty(3)
    for e in range(exposures.step.size):
        i, o = exposures.step[e], exposures.observer[e]
        k = first + i
        own, exact = limits_of(limits, o), limits_of(true, o)
        ra0, dec0 = exposures.boresight[e, 0], exposures.boresight[e, 1]
        edge = np.tan(exposures.half_field[e])
        place = scene.observer_position[o, k]
        for j in range(states.shape[0]):
            state = states[j, k - origin]
            dx, dy, dz = state[0] - place[0], state[1] - place[1], state[2] - place[2]
            along = dx * toward[e, 0] + dy * toward[e, 1] + dz * toward[e, 2]
            squared = dx * dx + dy * dy + dz * dz
            # outside the circle about the field, whose corners are nearer than 1.5 of its edge
            if along <= 0.0 or squared > (1.0 + (1.5 * edge) ** 2) * along * along:
                continue
            ra, dec = direction_angles(dx, dy, dz, scene.observer_axes[k])
            x, y = tangent_offset(ra, dec, ra0, dec0)
            if not (abs(x) <= edge and abs(y) <= edge):
                continue
            if count == value.shape[0]:
                return -1
            found = observe(
                scene, surfaces, own, exact, standard, o, j, k,
                (state, attitudes[j, k - origin]), noise[j, k - origin, o], dimmed[j, k - origin],
                (value[count], variance[count], truly),
            )  # fmt: skip
            if found == DETECTED and not kept[j, i, o]:
                found = FAINT
            if command[i, o] == j:
                outcome[e] = found
            if found == DETECTED:
                row_exposure[count], row_origin[count] = e, j
                count += 1
    return count


def expose(
    first: int,
    exposures: Exposures,
    process: DetectionProcess,
    scene: Scene,
    surfaces: TargetSurfaces,
    sensor: Sensors,
    states: Array,
    attitudes: Array,
    noise: Array,
    rng: np.random.Generator,
    *,
    n_steps: int,
    command: Indices,
    kept: NDArray[np.bool_],
    origin: int = 0,
    true: Sensors | None = None,
    dimmed: Array | None = None,
) -> tuple[Detections, Indices, NDArray[np.uint8]]:
    """Simulate the detections of exposures from the true states (Paul & Fan, eqs. 23, 43).

    Parameters
    ----------
    first, scene, surfaces, sensor, states, attitudes, origin, true, dimmed
        See `cislunar.observation.measurement.measure`.
    exposures : Exposures
    process : DetectionProcess
        False alarms and losses.
    noise : ndarray, shape (target, time, observer, 3)
        Errors of the detection of a target by an observer at a time.
    rng : numpy.random.Generator
        For false alarms. Their number in each exposure does not depend on where it points.
    n_steps : int
        Steps of the interval.
    command : ndarray of int, shape (step, observer)
        Target at which each observer was meant to point, for the outcome alone.
    kept : ndarray of bool, shape (target, step, observer)
        Whether a detectable target is not lost.

    Returns
    -------
    detections : Detections
    origin : ndarray of int, shape (row,)
        Target of each detection, or `FALSE_ALARM`.
    outcome : ndarray of uint8, shape (exposure,)
        FAINT, EXCLUDED, OCCULTED or DETECTED of the commanded target; NOT_TASKED if it was outside
        the field.

    Raises
    ------
    ConfigurationError
        If `sensor` or `true` is neither one sensor nor one for each observer.
    """
    n_observers = scene.observer_position.shape[0]
    limits = sensor_limits(sensor, n_observers)
    truly = limits if true is None else sensor_limits(true, n_observers)
    dimmed = np.zeros(states.shape[:2]) if dimmed is None else dimmed
    outcome = np.full(exposures.step.size, NOT_TASKED, dtype=np.uint8)
    toward = boresight_vectors(exposures, scene, first)
    model = scene, surfaces, limits, truly, true is not None, exposures, toward
    truth = states, attitudes, noise, dimmed, kept
    room = 4 * exposures.step.size + 64
    while True:
        values = np.empty((room, 3)), np.empty((room, 3))
        out = np.empty(room, dtype=np.int64), np.empty(room, dtype=np.int64), *values, outcome
        count = _expose(first, origin, model, truth, command, out)
        if count >= 0:
            break
        room *= 4
    targets = [column[:count] for column in out[:4]]
    alarms = _false_alarms(exposures, process, limits, n_steps, n_observers, rng)
    exposure, source, value, variance = (
        np.concatenate(pair) for pair in zip(targets, alarms, strict=True)
    )
    # by right ascension within an exposure, so that the order does not tell the origin
    order = np.lexsort((value[:, 1], exposure))
    return Detections(exposure[order], value[order], variance[order]), source[order], outcome


def _false_alarms(exposures, process, limits, n_steps, n_observers, rng):
    """Exposure, origin, value and variance of false alarms."""
    width = np.rad2deg(2.0 * np.tan(limits.half_field))
    mean = process.false_alarms_deg2 * np.broadcast_to(width**2, (n_steps, n_observers))
    numbers = rng.poisson(mean)
    # drawn for all steps and observers, so that alarms do not depend on who is idle
    x, y, depth = rng.random((3, int(numbers.sum())))
    begin = (np.cumsum(numbers) - numbers.ravel()).reshape(numbers.shape)
    here = numbers[exposures.step, exposures.observer]
    exposure = np.repeat(np.arange(here.size), here)
    within = np.arange(exposure.size) - np.repeat(np.cumsum(here) - here, here)
    rows = begin[exposures.step, exposures.observer][exposure] + within
    edge = np.tan(exposures.half_field[exposure])
    value, variance = np.empty((exposure.size, 3)), np.empty((exposure.size, 3))
    rate = np.log(10.0) * process.false_alarm_slope
    value[:, 0] = exposures.limiting_magnitude[exposure] + np.log1p(-depth[rows]) / rate
    offset = (2.0 * x[rows] - 1.0) * edge, (2.0 * y[rows] - 1.0) * edge
    value[:, 1], value[:, 2] = _direction(*offset, *exposures.boresight[exposure].T)
    _set_variances(limits, exposures.observer[exposure], value, variance)
    return exposure, np.full(exposure.size, FALSE_ALARM), value, variance


@njit(cache=True, error_model="numpy")
def _set_variances(limits, observer, value, variance):
    """Variances of detections by the measured magnitudes, into `variance`."""
    for row in range(observer.size):
        noise_variance_at(limits_of(limits, observer[row]), value[row, 0], variance[row])


def _direction(x: Array, y: Array, ra0: Array, dec0: Array) -> tuple[Array, Array]:
    """Right ascension and declination of offsets in the tangent plane; inverse of
    `tangent_offset`."""
    s, c = np.sin(dec0), np.cos(dec0)
    forward, up = c - y * s, s + y * c
    ra = ra0 + np.arctan2(x, forward)
    return wrapped(ra), np.arctan2(up, np.hypot(x, forward))
