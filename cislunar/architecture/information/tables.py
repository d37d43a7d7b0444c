"""Tables behind the information objectives: what each place tells of every moving target.

An item is a target in a window of some hours, for the attitude with one of its attitudes. The
state at the start of the window is known as at the epoch of a run, and to begin with no better; a
matrix of the tables is the Fisher information of the window's looks about that state, in units of
its initial uncertainty (whitened).
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.architecture.information.looks import PACKED, add_directions, add_magnitudes
from cislunar.architecture.places import Places
from cislunar.attitude.quaternion import normalize
from cislunar.attitude.rigid_body import propagate_spherical, spherical_transition
from cislunar.constants import MU, TIME_UNIT_S
from cislunar.dynamics.cr3bp import CR3BP, primary_positions
from cislunar.dynamics.propagation import advance_orbits, propagate_stm
from cislunar.errors import ConfigurationError
from cislunar.estimation.spread import INITIAL_SPREAD, Spread
from cislunar.observation.scene import TargetSurfaces
from cislunar.observation.sensor import Sensor
from cislunar.observation.sightline import METRES
from cislunar.orbits.families import OrbitSet
from cislunar.photometry.sphere import faintness_per_squared_range
from cislunar.visibility.counts import satellite_tracks

Array = NDArray[np.float64]

HOUR = 3600.0 / TIME_UNIT_S
"""An hour in the unit of time."""


@dataclass(frozen=True)
class Looks:
    """How targets are looked at, and what is known of them before.

    Attributes
    ----------
    sensor : Sensor
        Noise and limits of the observers.
    radius_m, diffuse_reflection_coefficient : float
        Of the sphere that stands in for a target when it is judged whether it is seen, as in
        tasking.
    per_hour : float
        Looks that an observer takes in an hour, shared evenly among the targets it sees then.
    initial : Spread
        Uncertainty at the start of a window.

    Raises
    ------
    ConfigurationError
        If `per_hour` or a part of `initial` is not positive.
    """

    sensor: Sensor = field(default_factory=Sensor)
    radius_m: float = 1.0
    diffuse_reflection_coefficient: float = 0.5
    per_hour: float = 60.0
    initial: Spread = INITIAL_SPREAD

    def __post_init__(self) -> None:
        if not (self.per_hour > 0.0 and np.isfinite(self.per_hour)):
            raise ConfigurationError(f"per_hour = {self.per_hour} must be positive and finite")
        if not np.all(self.initial.components() > 0.0):
            raise ConfigurationError(f"initial = {self.initial} must be positive throughout")

    def view(self, mu: float) -> tuple:
        """Limits, faintness and places of Earth and Moon, as the compiled kernels take them."""
        faintness = faintness_per_squared_range(
            self.sensor.limiting_magnitude,
            radius_m=self.radius_m,
            diffuse_reflection_coefficient=self.diffuse_reflection_coefficient,
        )
        return self.sensor.limits(), faintness * METRES**2, primary_positions(float(mu))


class Windows(NamedTuple):
    """Windows of equal length, and the times in them at which is looked.

    Attributes
    ----------
    start : ndarray, shape (window,)
        Nondimensional, since the epoch.
    times : ndarray, shape (window, sample)
        Nondimensional, since the epoch: the middles of steps.
    step_hours : float
        Length of a step.
    """

    start: Array
    times: Array
    step_hours: float


def windows_of(
    horizon_days: float, count: int, *, hours: float = 24.0, step_hours: float = 1.0
) -> Windows:
    """Windows spread evenly over a horizon, the first at its beginning, the last at its end.

    Parameters
    ----------
    horizon_days : float
        Horizon, days.
    count : int
        Number of windows.
    hours : float
        Length of each.
    step_hours : float
        Time between looks that stand for all of a step; it divides `hours`.

    Returns
    -------
    Windows

    Raises
    ------
    ConfigurationError
        If there is no window, one does not fit the horizon, or the step does not divide it.
    """
    if count < 1:
        raise ConfigurationError(f"windows = {count} must be at least 1")
    if not 0.0 < hours <= 24.0 * horizon_days:
        raise ConfigurationError(
            f"window_hours = {hours} must be positive and within the horizon of {horizon_days} days"
        )
    samples = hours / step_hours if step_hours > 0.0 else 0.0
    if round(samples) < 1 or abs(samples - round(samples)) > 1e-9:
        raise ConfigurationError(
            f"step_hours = {step_hours} must divide window_hours = {hours} into whole steps"
        )
    start = np.linspace(0.0, 24.0 * horizon_days - hours, count) * HOUR
    middle = (np.arange(round(samples)) + 0.5) * step_hours * HOUR
    return Windows(start, start[:, None] + middle, float(step_hours))


@dataclass(frozen=True)
class InformationTables:
    """What a satellite at every place tells of every item.

    Attributes
    ----------
    matrix : ndarray, shape (place, item, 21)
        Whitened Fisher information, dimensionless, the lower triangle row by row. Items run over
        the attitudes of a target, the targets of a window, then over the next window.
    nuisance : int
        How many of the six states, from the first, have to be found but do not count.
    shape : tuple of int
        Windows, targets and attitudes; their product is the number of items.
    orbit, phase, family, stability_index : ndarray, shape (place,)
        The places, see `cislunar.architecture.places.Places`.
    """

    matrix: Array
    nuisance: int
    shape: tuple[int, int, int]
    orbit: NDArray[np.int64]
    phase: Array
    family: NDArray[np.str_]
    stability_index: Array


class MovingTargets(NamedTuple):
    """Targets in every window.

    Attributes
    ----------
    position : ndarray, shape (window, sample, target, 3)
        Nondimensional, rotating frame.
    motion : ndarray, shape (window, sample, target, 3, 6)
        Its derivative by the state at the start of the window.
    """

    position: Array
    motion: Array


def moving_targets(
    state: ArrayLike, period: ArrayLike, windows: Windows, mu: float = MU
) -> MovingTargets:
    """Follow targets through every window.

    Parameters
    ----------
    state : array_like, shape (target, 6)
        At the epoch, nondimensional, rotating frame.
    period : array_like, shape (target,)
        Nondimensional; 0 for a target that flies on freely.
    windows : Windows
        Windows and times of looks.
    mu : float
        Mass ratio.

    Returns
    -------
    MovingTargets

    Raises
    ------
    ConvergenceError
        If a target runs into the centre of a body.
    """
    states, shape = np.asarray(state, dtype=float), (*windows.times.shape, len(state))
    position, motion = np.empty((*shape, 3)), np.empty((*shape, 3, 6))
    for w, (start, times) in enumerate(zip(windows.start, windows.times, strict=True)):
        for j, at_start in enumerate(advance_orbits(states, period, float(start), mu)):
            later, matrix = propagate_stm(at_start, times - start, forces=CR3BP(mu))
            position[w, :, j], motion[w, :, j] = later[:, :3], matrix[:, :3]
    return MovingTargets(position, motion)


def _tables(
    orbits: OrbitSet,
    places: Places,
    windows: Windows,
    shape: tuple[int, int, int],
    nuisance: int,
    add: Callable[[int, Array, Array], None],
    propagator: str,
    mu: float,
    progress: Callable[[int, int], None] | None,
) -> InformationTables:
    """Tables of all places; `add` takes window, track and the matrices (target, attitude, 21)."""
    matrix = np.zeros((places.orbit.size, *shape, PACKED))
    used = np.unique(places.orbit)
    for number, orbit in enumerate(used, start=1):
        own = np.flatnonzero(places.orbit == orbit)
        tracks = satellite_tracks(
            orbits.state[[orbit]], orbits.period[[orbit]], places.phase[own], windows.times.ravel(),
            propagator=propagator, mu=mu,
        )[0].reshape(own.size, *windows.times.shape, 3)  # fmt: skip
        for place, track in zip(own, tracks, strict=True):
            for w in range(shape[0]):
                add(w, track[w], matrix[place, w])
        if progress is not None:
            progress(number, used.size)
    items = matrix.reshape(len(matrix), -1, PACKED)
    return InformationTables(items, nuisance, shape, **places._asdict())


def orbit_information(
    orbits: OrbitSet,
    places: Places,
    targets: MovingTargets,
    windows: Windows,
    sun_position: ArrayLike,
    looks: Looks,
    *,
    reaches: ArrayLike | None = None,
    propagator: str = "dopri5",
    mu: float = MU,
    progress: Callable[[int, int], None] | None = None,
) -> InformationTables:
    """Tabulate what the directions tell of position and velocity of moving targets.

    A table has 168 bytes for each place, target and window: 168 MB for 1000 places, 100 targets and
    10 windows.

    Parameters
    ----------
    orbits : OrbitSet
        Orbits of the observers.
    places : Places
        Their places, see `cislunar.architecture.places`.
    targets : MovingTargets
        From `moving_targets`, of the same windows.
    windows : Windows
        Windows and times of looks.
    sun_position : array_like, shape (window, sample, 3)
        Sun at those times, nondimensional, rotating frame.
    looks : Looks
        Sensor, looks in an hour, initial uncertainty.
    reaches : array_like, shape (target, angle, attitude), optional
        From `cislunar.architecture.information.brightness.squared_reaches`: a look then counts by
        the share of attitudes in which the target is bright enough. Without it a look counts in
        full wherever the sphere of `looks` is bright enough, as tasking judges.
    propagator : str
        Of the observers, see `cislunar.visibility.counts.satellite_tracks`.
    mu : float
        Mass ratio.
    progress : callable, optional
        Called with (orbits done, orbits).

    Returns
    -------
    InformationTables
    """
    view, sun = looks.view(mu), np.ascontiguousarray(sun_position, dtype=float)
    motion = np.ascontiguousarray(targets.motion * looks.initial.components()[6:])
    worth = looks.per_hour * windows.step_hours / view[0].noise_variance[1]
    bright = np.empty((0, 1, 1)) if reaches is None else np.ascontiguousarray(reaches, dtype=float)

    def add(window: int, track: Array, out: Array) -> None:
        own = targets.position[window], motion[window], sun[window]
        add_directions(track, *own, view, bright, worth, out[:, 0])

    shape = (len(windows.start), targets.position.shape[2], 1)
    return _tables(orbits, places, windows, shape, 0, add, propagator, mu, progress)


def attitude_information(
    orbits: OrbitSet,
    places: Places,
    targets: MovingTargets,
    windows: Windows,
    sun_position: ArrayLike,
    looks: Looks,
    surfaces: TargetSurfaces,
    angular_velocity: ArrayLike,
    rng: np.random.Generator,
    *,
    attitudes: int = 1,
    propagator: str = "dopri5",
    mu: float = MU,
    progress: Callable[[int, int], None] | None = None,
) -> InformationTables:
    """Tabulate what the light curves tell of the attitude of moving targets.

    The six states are angular velocity, which has to be found from the same light curve but does
    not count, and attitude. Every target has in every window attitudes of its own, drawn uniformly
    over all rotations. Memory as for `orbit_information`, times `attitudes`.

    Parameters
    ----------
    orbits, places, targets, windows, sun_position, looks
        As for `orbit_information`. The looks of a step have the brightness and slope of its middle.
    surfaces : TargetSurfaces
        Shapes and materials; the inertia is taken to be spherical.
    angular_velocity : array_like, shape (3,)
        Of all targets, body frame, rad/s.
    rng : numpy.random.Generator
        Source of the attitudes.
    attitudes : int
        Number of them for each target and window.
    propagator, mu, progress
        As for `orbit_information`.

    Returns
    -------
    InformationTables

    Raises
    ------
    ConfigurationError
        If `attitudes` is below 1.
    """
    if attitudes < 1:
        raise ConfigurationError(f"attitudes = {attitudes} must be at least 1")
    view, sun = looks.view(mu), np.ascontiguousarray(sun_position, dtype=float)
    position = targets.position
    shape = (len(windows.start), position.shape[2], attitudes)
    quaternion = normalize(rng.standard_normal((*shape, 4)))
    turning = _turning(windows, quaternion, np.asarray(angular_velocity, dtype=float), looks)
    worth = looks.per_hour * windows.step_hours / view[0].noise_variance[0]

    def add(window: int, track: Array, out: Array) -> None:
        own = position[window], sun[window], view, tuple(each[window] for each in turning)
        add_magnitudes(track, *own, surfaces, view[0].limiting_magnitude, worth, out)

    return _tables(orbits, places, windows, shape, 3, add, propagator, mu, progress)


def _turning(windows: Windows, quaternion: Array, rate: Array, looks: Looks) -> tuple:
    """Frame, attitudes and their growth in every window; see `looks.add_magnitudes`.

    The inertial frame is the rotating one at the start of a window.
    """
    shape = windows.times.shape
    frame, growth = np.zeros((*shape, 3, 3)), np.empty((*shape, 6, 6))
    attitude = np.empty((*shape, *quaternion.shape[1:]))
    sigma = looks.initial.components()[:6]
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
