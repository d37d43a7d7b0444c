"""Tables of the information objectives: information about every moving target from each orbit slot.

An item is a target in a window of some hours, for the attitude with one of its attitudes. The
initial uncertainty of the state at the start of each window is that at the epoch of a run. A matrix
of the tables is the Fisher information of the window's observations about that state, in units of
its initial uncertainty (whitened).
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.architecture.information.observation_kernels import (
    PACKED,
    add_directions,
    add_magnitudes,
)
from cislunar.architecture.orbit_slots import OrbitSlots
from cislunar.attitude import normalize, propagate_spherical, spherical_transition
from cislunar.constants import MU, TIME_UNIT_S
from cislunar.dynamics import advance_orbits, primary_positions, propagate_stm
from cislunar.errors import ConfigurationError
from cislunar.estimation.initial_sigma import PAPER_INITIAL_SIGMA, InitialSigma
from cislunar.observation import METERS, Sensor, TargetSurfaces
from cislunar.orbits.families import OrbitSet
from cislunar.photometry.sphere import faintness_per_squared_range
from cislunar.runtime import Array, counted
from cislunar.runtime.arguments import array_of, count_of, indices_of, number_of
from cislunar.visibility.tracks import satellite_tracks

HOUR = 3600.0 / TIME_UNIT_S
"""One hour, nondimensional."""


@dataclass(frozen=True)
class ObservationSettings:
    """Sensor, observation rate and initial uncertainty of the information objectives.

    Attributes
    ----------
    sensor : Sensor
        Noise and limits of the observers.
    radius_m, diffuse_reflection_coefficient : float
        Radius (m) and C_d of the sphere by which it is decided whether a target is seen, as in
        tasking.
    per_hour : float
        Observations of an observer per hour, shared evenly among the targets that it sees.
    initial : InitialSigma
        Standard deviations at the start of a window.

    Raises
    ------
    ConfigurationError
        If `per_hour` is not positive and finite.
    """

    sensor: Sensor = field(default_factory=Sensor)
    radius_m: float = 1.0
    diffuse_reflection_coefficient: float = 0.5
    per_hour: float = 60.0
    initial: InitialSigma = PAPER_INITIAL_SIGMA

    def __post_init__(self) -> None:
        number_of("per_hour", self.per_hour, positive=True)

    def view(self) -> tuple:
        """Limits, faintness and positions of Earth and Moon, for the compiled kernels."""
        faintness = faintness_per_squared_range(
            self.sensor.limiting_magnitude,
            radius_m=self.radius_m,
            diffuse_reflection_coefficient=self.diffuse_reflection_coefficient,
        )
        return self.sensor.limits(), faintness * METERS**2, primary_positions(MU)


class Windows(NamedTuple):
    """Windows of equal length: `start` (window,) and middles of steps (window, sample),
    nondimensional, since the epoch; length of a step, h."""

    start: Array
    times: Array
    step_hours: float


def windows_of(
    horizon_days: float, count: int, *, hours: float = 24.0, step_hours: float = 1.0
) -> Windows:
    """Windows evenly distributed over a horizon, the first at its beginning, the last at its end.

    Parameters
    ----------
    horizon_days : float
        Horizon, days.
    count : int
        Number of windows.
    hours : float
        Length of each window, h.
    step_hours : float
        Step between samples, h; it divides `hours`.

    Returns
    -------
    Windows

    Raises
    ------
    ConfigurationError
        If there is no window, a window is not within the horizon, or the step does not divide it.
    """
    count_of("count", count)
    if not 0.0 < hours <= 24.0 * horizon_days:
        raise ConfigurationError(
            f"hours = {hours} must be positive and within the horizon of {horizon_days} days"
        )
    samples = hours / step_hours if step_hours > 0.0 else 0.0
    if round(samples) < 1 or abs(samples - round(samples)) > 1e-9:
        raise ConfigurationError(
            f"step_hours = {step_hours} must divide hours = {hours} into whole steps"
        )
    start = np.linspace(0.0, 24.0 * horizon_days - hours, count) * HOUR
    middle = (np.arange(round(samples)) + 0.5) * step_hours * HOUR
    return Windows(start, start[:, None] + middle, float(step_hours))


@dataclass(frozen=True)
class InformationTables:
    """Information about every item from a satellite in every orbit slot.

    Attributes
    ----------
    matrix : ndarray, shape (slot, item, 21)
        Whitened Fisher information, dimensionless, the lower triangle row by row. The attitude
        index of an item varies fastest, then the target, then the window.
    nuisance : int
        Number of the first of the six states that have to be estimated but do not count.
    shape : tuple of int
        Windows, targets and attitudes; their product is the number of items.
    orbit, phase, family, stability_index : ndarray, shape (slot,)
        The orbit slots, see `cislunar.architecture.orbit_slots.OrbitSlots`.
    """

    matrix: Array
    nuisance: int
    shape: tuple[int, int, int]
    orbit: NDArray[np.int64]
    phase: Array
    family: NDArray[np.str_]
    stability_index: Array


class MovingTargets(NamedTuple):
    """Positions (window, sample, target, 3), nondimensional, rotating frame, and their derivatives
    (window, sample, target, 3, 6) with respect to the state at the start of the window."""

    position: Array
    motion: Array


def moving_targets(state: ArrayLike, period: ArrayLike, windows: Windows) -> MovingTargets:
    """Propagate targets through every window.

    Parameters
    ----------
    state : array_like, shape (target, 6)
        At the epoch, nondimensional, rotating frame.
    period : array_like, shape (target,)
        Nondimensional; 0 for a target on an open trajectory.
    windows : Windows
        Windows and sample times.

    Returns
    -------
    MovingTargets

    Raises
    ------
    ConfigurationError
        If a state is not of 6 finite numbers or is evidently in km, or a period is negative or not
        one of each target.
    ConvergenceError
        If a target meets the center of a primary.
    """
    states = array_of("state", state, ("target", 6))
    shape = (*windows.times.shape, len(states))
    position, motion = np.empty((*shape, 3)), np.empty((*shape, 3, 6))
    for w, (start, times) in enumerate(zip(windows.start, windows.times, strict=True)):
        for j, at_start in enumerate(advance_orbits(states, period, float(start))):
            later, matrix = propagate_stm(at_start, times - start)
            position[w, :, j], motion[w, :, j] = later[:, :3], matrix[:, :3]
    return MovingTargets(position, motion)


def _tables(
    orbits: OrbitSet,
    slots: OrbitSlots,
    windows: Windows,
    shape: tuple[int, int, int],
    nuisance: int,
    add: Callable[[int, Array, Array], None],
    propagator: str,
    progress: Callable[[int, int], None] | None,
) -> InformationTables:
    """Tables of all orbit slots; `add` takes window, track and matrices (target, attitude, 21)."""
    matrix = np.zeros((slots.orbit.size, *shape, PACKED))
    for orbit in counted(np.unique(slots.orbit), progress):
        own = np.flatnonzero(slots.orbit == orbit)
        tracks = satellite_tracks(
            orbits.state[[orbit]], orbits.period[[orbit]], slots.phase[own], windows.times.ravel(),
            propagator=propagator,
        )[0].reshape(own.size, *windows.times.shape, 3)  # fmt: skip
        for slot, track in zip(own, tracks, strict=True):
            for w in range(shape[0]):
                add(w, track[w], matrix[slot, w])
    items = matrix.reshape(len(matrix), -1, PACKED)
    return InformationTables(items, nuisance, shape, **slots._asdict())


def _sun_of(
    orbits: OrbitSet, slots: OrbitSlots, targets: MovingTargets, windows: Windows, sun: ArrayLike
) -> Array:
    """Positions of the Sun (window, sample, 3); raises a `ConfigurationError` if they, the targets
    or the orbits of the slots do not belong to the other arguments."""
    shape = windows.times.shape
    if targets.position.shape[:2] != shape:
        raise ConfigurationError("targets have other windows; make them with these windows")
    indices_of("slots.orbit", slots.orbit, len(orbits.period))
    return np.ascontiguousarray(array_of("sun_position", sun, (*shape, 3)))


def orbit_information(
    orbits: OrbitSet,
    slots: OrbitSlots,
    targets: MovingTargets,
    windows: Windows,
    sun_position: ArrayLike,
    observations: ObservationSettings,
    *,
    squared_ranges: ArrayLike | None = None,
    propagator: str = "dopri5",
    progress: Callable[[int, int], None] | None = None,
) -> InformationTables:
    """Tabulate the information of directions about position and velocity of moving targets.

    A table has 168 bytes for each orbit slot, target and window: 168 MB for 1000 orbit slots, 100
    targets and 10 windows.

    Parameters
    ----------
    orbits : OrbitSet
        Orbits of the observers.
    slots : OrbitSlots
        Orbit slots, see `cislunar.architecture.orbit_slots`.
    targets : MovingTargets
        From `moving_targets`, for the same windows.
    windows : Windows
        Windows and sample times.
    sun_position : array_like, shape (window, sample, 3)
        Sun at those times, nondimensional, rotating frame.
    observations : ObservationSettings
        Sensor, observations per hour, initial uncertainty.
    squared_ranges : array_like, shape (target, angle, attitude), optional
        From `squared_detection_ranges`: an observation is then weighted by the share of attitudes
        in which the target is bright enough. If omitted, an observation counts fully wherever the
        sphere of `observations` is bright enough, as in tasking.
    propagator : str
        Method for the observers, see `cislunar.visibility.tracks.satellite_tracks`.
    progress : callable, optional
        Called with (orbits done, orbits).

    Returns
    -------
    InformationTables

    Raises
    ------
    ConfigurationError
        If the propagator is unknown, or shapes or orbits of the arguments disagree.
    ConvergenceError
        If a satellite meets the center of a primary.
    """
    view, sun = observations.view(), _sun_of(orbits, slots, targets, windows, sun_position)
    motion = np.ascontiguousarray(targets.motion * observations.initial.components()[6:])
    weight = observations.per_hour * windows.step_hours / view[0].noise_variance[1]
    known = np.empty((0, 1, 1)) if squared_ranges is None else squared_ranges
    bright = np.ascontiguousarray(known, dtype=float)

    def add(window: int, track: Array, out: Array) -> None:
        own = targets.position[window], motion[window], sun[window]
        add_directions(track, *own, view, bright, weight, out[:, 0])

    shape = (len(windows.start), targets.position.shape[2], 1)
    return _tables(orbits, slots, windows, shape, 0, add, propagator, progress)


def attitude_information(
    orbits: OrbitSet,
    slots: OrbitSlots,
    targets: MovingTargets,
    windows: Windows,
    sun_position: ArrayLike,
    observations: ObservationSettings,
    surfaces: TargetSurfaces,
    angular_velocity: ArrayLike,
    rng: np.random.Generator,
    *,
    attitudes: int = 1,
    propagator: str = "dopri5",
    progress: Callable[[int, int], None] | None = None,
) -> InformationTables:
    """Tabulate the information of light curves about the attitude of moving targets.

    The six states are angular velocity, which has to be estimated from the same light curve but
    does not count, and attitude. Each target has random attitudes in every window, uniform over all
    rotations. Memory is that of `orbit_information`, times `attitudes`.

    Parameters
    ----------
    orbits, slots, targets, windows, sun_position, observations, propagator, progress
        See `orbit_information`. All observations of a step have the brightness and slope of its
        middle.
    surfaces : TargetSurfaces
        Shapes and materials; the inertia is assumed to be spherical.
    angular_velocity : array_like, shape (3,)
        Angular velocity of all targets, body frame, rad/s.
    rng : numpy.random.Generator
        Source of the attitudes.
    attitudes : int
        Number of attitudes per target and window.

    Returns
    -------
    InformationTables

    Raises
    ------
    ConfigurationError
        If `attitudes` is less than 1, the propagator is unknown, or shapes or orbits of the
        arguments disagree.
    ConvergenceError
        If a satellite meets the center of a primary.
    """
    count_of("attitudes", attitudes)
    view, sun = observations.view(), _sun_of(orbits, slots, targets, windows, sun_position)
    position = targets.position
    shape = (len(windows.start), position.shape[2], attitudes)
    quaternion = normalize(rng.standard_normal((*shape, 4)))
    turning = _turning(windows, quaternion, np.asarray(angular_velocity, dtype=float), observations)
    weight = observations.per_hour * windows.step_hours / view[0].noise_variance[0]

    def add(window: int, track: Array, out: Array) -> None:
        own = position[window], sun[window], view, tuple(each[window] for each in turning)
        add_magnitudes(track, *own, surfaces, view[0].limiting_magnitude, weight, out)

    return _tables(orbits, slots, windows, shape, 3, add, propagator, progress)


def _turning(
    windows: Windows, quaternion: Array, rate: Array, observations: ObservationSettings
) -> tuple:
    """Frames, attitudes and their derivatives in every window; see
    `observation_kernels.add_magnitudes`. The inertial frame is the rotating one at the start of a
    window."""
    shape = windows.times.shape
    frame, growth = np.zeros((*shape, 3, 3)), np.empty((*shape, 6, 6))
    attitude = np.empty((*shape, *quaternion.shape[1:]))
    sigma = observations.initial.components()[:6]
    transition = np.empty((6, 6))
    for w, start in enumerate(windows.start):
        for k, time in enumerate(windows.times[w]):
            angle, elapsed_s = time - start, (time - start) * TIME_UNIT_S
            frame[w, k] = [
                [np.cos(angle), -np.sin(angle), 0.0],
                [np.sin(angle), np.cos(angle), 0.0],
                [0.0, 0.0, 1.0],
            ]
            spherical_transition(rate, elapsed_s, transition)
            growth[w, k] = np.roll(transition * sigma, 3, axis=1)
            for j, s in np.ndindex(quaternion.shape[1:3]):
                attitude[w, k, j, s] = propagate_spherical(quaternion[w, j, s], rate, elapsed_s)
    return frame, attitude, growth
