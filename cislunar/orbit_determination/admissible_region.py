"""Admissible region of an attributable, and its samples: distance, energy and brightness.

An attributable does not determine the range and the range rate of an object. The admissible region
bounds them by limits on the range, on the distance from the barycenter, on the Jacobi constant (the
energy in the Earth-Moon system), and on the size that the brightness implies (Milani et al. 2004,
Icarus 168, 1; Tommei, Milani & Rossi 2007, Celest. Mech. Dyn. Astron. 97, 289, for the Earth
alone). In ephemeris dynamics the Jacobi constant is that of the pulsating frame at the time of the
state.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import model_validator

from cislunar.constants import EARTH_RADIUS_KM, LENGTH_UNIT_KM, MOON_RADIUS_KM, MU, TIME_UNIT_S
from cislunar.dynamics import (
    CR3BP,
    EARTH_MOON,
    UNITS,
    EphemerisForces,
    from_inertial,
    jacobi_constant,
    primary_distances,
    pulsating_frame,
)
from cislunar.errors import ConfigurationError
from cislunar.orbit_determination.angles import Angles, frame_rate
from cislunar.orbit_determination.tracklets import Attributables
from cislunar.photometry import phase_angle, sphere_magnitude
from cislunar.runtime import Array
from cislunar.runtime.settings_fields import Number, Positive, Section, setting


class AdmissibleRegion(Section):
    """Limits on the orbits that are possible before any angle is known."""

    # fmt: off

    least_range_km: Positive = setting(
        "least distance from an observer, which excludes the solution that moves along with it",
        "km", default=2500)
    largest_distance_km: Positive = setting(
        "largest distance from the Earth-Moon barycenter", "km", default=730_360)
    least_jacobi: Number = setting(
        "least Jacobi constant, which bounds the speed: 0.5 admits prograde and polar orbits about "
        "the Earth, whose constants are at least 1/a, and excludes wide retrograde ones",
        "1", default=0.5)
    largest_jacobi: Number = setting("largest Jacobi constant", "1", default=8)
    least_size_m2: Positive = setting(
        "least product of diffuse reflection coefficient and squared radius of the sphere that is "
        "as bright", "m^2", default=0.016)
    largest_size_m2: Positive = setting("largest such product", "m^2", default=10)
    magnitude_scatter: Positive = setting(
        "largest standard deviation of the magnitudes of one object about that of a sphere", "mag",
        default=0.9)

    # fmt: on

    @model_validator(mode="after")
    def _is_not_empty(self) -> "AdmissibleRegion":
        """A limit is not beyond its opposite."""
        for least, largest in (
            ("least_range_km", "largest_distance_km"), ("least_jacobi", "largest_jacobi"),
            ("least_size_m2", "largest_size_m2"),
        ):  # fmt: skip
            if getattr(self, least) >= getattr(self, largest):
                raise ConfigurationError(f"{least} must be below {largest}")
        return self

    @property
    def radius(self) -> float:
        """Largest distance from the barycenter, nondimensional."""
        return self.largest_distance_km / LENGTH_UNIT_KM

    @property
    def position_sigma(self) -> float:
        """Standard deviation of one coordinate of a uniform distribution in the sphere of `radius`,
        nondimensional."""
        return self.radius / np.sqrt(5.0)

    @property
    def velocity_sigma(self) -> float:
        """Standard deviation of one component of the velocity, uniform up to the speed that the
        least Jacobi constant permits at half the largest distance, nondimensional."""
        return float(np.sqrt(self._fastest2(0.5 * self.radius) / 5.0))

    @property
    def log_density(self) -> float:
        """Logarithm of the density of states that are uniform over the spheres of `radius` and of
        the largest speed of `velocity_sigma`, nondimensional."""
        speed = np.sqrt(self._fastest2(0.5 * self.radius))
        return -float(2.0 * np.log(4.0 * np.pi / 3.0) + 3.0 * np.log(self.radius * speed))

    def _fastest2(self, distance: float) -> float:
        return max(distance**2 + 2.0 / distance - self.least_jacobi, 1e-3)


def states_in_rotating_frame(state: ArrayLike, time: ArrayLike, forces: tuple) -> Array:
    """States in the rotating frame of Earth and Moon.

    Parameters
    ----------
    state : array_like, shape (n, 6)
        Nondimensional, propagation frame.
    time : array_like, shape () or (n,)
        Nondimensional, since the epoch of the force model.
    forces : NamedTuple
        CR3BP or ephemeris forces.

    Returns
    -------
    ndarray, shape (n, 6)
        Nondimensional; in the CR3BP the given states, otherwise states in the pulsating frame.

    Raises
    ------
    ConfigurationError
        If the force model is another one, which has no rotating frame, or a time lies outside of
        its table.
    """
    states = np.asarray(state, dtype=float)
    if isinstance(forces, CR3BP) or len(states) == 0:
        return states
    if not isinstance(forces, EphemerisForces):
        raise ConfigurationError(
            f"forces = {type(forces).__name__} has no rotating frame of Earth and Moon; use CR3BP "
            "or ephemeris forces"
        )
    tdb = forces.epoch + np.broadcast_to(time, len(states)) * TIME_UNIT_S
    return from_inertial(states * UNITS, pulsating_frame(forces.table, tdb))


def is_admissible(
    state: ArrayLike, time: ArrayLike, forces: tuple, region: AdmissibleRegion
) -> NDArray[np.bool_]:
    """Whether states are outside of both bodies, and within the limits of distance and Jacobi
    constant.

    Parameters
    ----------
    state, time, forces
        See `states_in_rotating_frame`.
    region : AdmissibleRegion

    Returns
    -------
    ndarray of bool, shape (n,)

    Raises
    ------
    ConfigurationError
        If the force model has no rotating frame, or a time lies outside of its table.
    """
    states = states_in_rotating_frame(state, time, forces)
    mu = getattr(forces, "mu", MU)
    earth, moon = primary_distances(states, mu)
    with np.errstate(all="ignore"):
        jacobi = jacobi_constant(states, mu)
        return (
            (np.linalg.norm(states[:, :3], axis=1) <= region.radius)
            & (earth > EARTH_RADIUS_KM / LENGTH_UNIT_KM)
            & (moon > MOON_RADIUS_KM / LENGTH_UNIT_KM)
            & (jacobi >= region.least_jacobi)
            & (jacobi <= region.largest_jacobi)
        )


def sphere_magnitude_residuals(offset: ArrayLike, angles: Angles) -> Array:
    """Measured magnitudes (row,) minus those of a sphere of 1 m^2 at `offset` (row, 3) from the
    observer; NaN where the magnitude or the position of the Sun is unknown."""
    line = np.asarray(offset, dtype=float)
    meters = np.linalg.norm(line, axis=1) * LENGTH_UNIT_KM * 1e3
    phase = phase_angle(line, angles.observer_position + line - angles.sun)
    return angles.magnitude - sphere_magnitude(meters, phase)


def implied_size(offset: ArrayLike, angles: Angles) -> tuple[float, float]:
    """Size of the sphere that is as bright as an object, and the scatter about its magnitude.

    Parameters
    ----------
    offset : array_like, shape (row, 3)
        Position of the object minus that of the observer, nondimensional.
    angles : Angles
        Of the same rows.

    Returns
    -------
    size_m2, scatter_mag : float
        Diffuse reflection coefficient times squared radius, and standard deviation of magnitudes;
        NaN if no row has a magnitude and a position of the Sun.
    """
    residual = sphere_magnitude_residuals(offset, angles)
    residual = residual[~np.isnan(residual)]
    if residual.size == 0:
        return np.nan, np.nan
    return float(10.0 ** (-0.4 * np.mean(residual))), float(np.std(residual))


def is_brightness_admissible(offset: ArrayLike, angles: Angles, region: AdmissibleRegion) -> bool:
    """Whether the size and the scatter of `implied_size` are within the region; true if the
    brightness is unknown."""
    size, scatter = implied_size(offset, angles)
    if np.isnan(size):
        return True
    inside = region.least_size_m2 <= size <= region.largest_size_m2
    return bool(inside and scatter <= region.magnitude_scatter)


def range_grid(region: AdmissibleRegion, count: int) -> Array:
    """Ranges (count,) from the least to twice the largest distance, nondimensional, equally spaced
    in their logarithms."""
    least = region.least_range_km / LENGTH_UNIT_KM
    return np.geomspace(least, 2.0 * region.radius, count)


def states_at_ranges(
    tracklets: Attributables,
    which: ArrayLike,
    ranges: ArrayLike,
    range_rates: ArrayLike,
    rate: float,
) -> Array:
    """States (n, 6) of objects at given ranges and range rates, nondimensional, propagation frame,
    at the times of the tracklets with the indices `which`
    (`cislunar.orbit_determination.tracklets`, equation 1). `rate` is the angular rate of the
    frame."""
    k = np.asarray(which)
    rho, rho_rate = (np.asarray(each, dtype=float)[:, None] for each in (ranges, range_rates))
    position = tracklets.observer_position[k] + rho * tracklets.direction[k]
    velocity = (
        tracklets.observer_velocity[k] + rho_rate * tracklets.direction[k] + rho * tracklets.rate[k]
    )
    velocity -= np.cross([0.0, 0.0, rate], position)
    return np.concatenate([position, velocity], axis=1)


def sample_region(
    tracklets: Attributables,
    which: int,
    region: AdmissibleRegion,
    *,
    forces: tuple = EARTH_MOON,
    n_ranges: int = 40,
    n_rates: int = 11,
) -> Array:
    """Sample the admissible region of an attributable: the virtual objects of Milani et al.

    Parameters
    ----------
    tracklets : Attributables
    which : int
        Index of the attributable.
    region : AdmissibleRegion
    forces : NamedTuple
        CR3BP or ephemeris forces.
    n_ranges : int
        Number of ranges, equally spaced in their logarithms.
    n_rates : int
        Number of range rates at each range, equally spaced between the limits that the least Jacobi
        constant gives.

    Returns
    -------
    ndarray, shape (sample, 6)
        States at the time of the attributable, nondimensional, propagation frame; none if the
        region is empty.

    Raises
    ------
    ConfigurationError
        If the force model has no rotating frame, or a time lies outside of its table.
    """
    ranges, rate = range_grid(region, n_ranges), frame_rate(forces)
    one = np.full(n_ranges, which)
    base, moved = (
        states_in_rotating_frame(
            states_at_ranges(tracklets, one, ranges, each, rate), tracklets.time[which], forces
        )
        for each in (np.zeros(n_ranges), np.ones(n_ranges))
    )
    # |v + rho' w|^2 <= 2 U - C, a quadratic inequality in the range rate
    v, w = base[:, 3:], moved[:, 3:] - base[:, 3:]
    excess = region.least_jacobi - jacobi_constant(base, getattr(forces, "mu", MU))
    square, along = np.sum(w**2, axis=1), np.sum(v * w, axis=1)
    half = np.sqrt(np.maximum(along**2 - square * excess, 0.0)) / square
    share = (np.arange(n_rates) + 0.5) / n_rates
    rates = (-along / square - half)[:, None] + 2.0 * half[:, None] * share
    rho = np.repeat(ranges, n_rates)
    states = states_at_ranges(tracklets, np.full(rho.size, which), rho, rates.ravel(), rate)
    kept = is_admissible(states, tracklets.time[which], forces, region)
    return states[kept & np.repeat(half > 0.0, n_rates)]
