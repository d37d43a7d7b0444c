"""One target as seen from one observer along their paths: detection outcome, magnitude and angles.
The target is the diffuse sphere of the architecture (Paul & Fan, section 2.3), without noise."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.compiled import njit_noalloc
from cislunar.constants import LENGTH_UNIT_KM, MU
from cislunar.dynamics.bounds import require_nondimensional
from cislunar.dynamics.cr3bp import primary_positions
from cislunar.errors import ConfigurationError
from cislunar.observation.measurement import DETECTED, EXCLUDED, FAINT, OCCULTED
from cislunar.observation.sensor import Sensor, extinction
from cislunar.observation.sightline import BRIGHT, CLEAR, obstacle
from cislunar.photometry.sphere import phase_angle, sphere_magnitude
from cislunar.quantities import in_unit, nondimensional
from cislunar.runtime.arguments import Array, array_of, number_of, require_kind


class Sightings(NamedTuple):
    """A target as seen from an observer at each time.

    Attributes
    ----------
    outcome : ndarray of uint8, shape (time,)
        DETECTED, FAINT, EXCLUDED or OCCULTED of `cislunar.observation.measurement`.
    magnitude, range_km, phase_angle_deg : ndarray, shape (time,)
        Apparent magnitude (inf where no lit part is visible), distance from observer to target, and
        angle at the target between Sun and observer. The magnitude is that without the atmosphere,
        by which a telescope on the ground is nevertheless limited.
    body_angle_deg : ndarray, shape (time, 3)
        Angles at the observer between the target and the centers of Sun, Moon and Earth.
    """

    outcome: NDArray[np.uint8]
    magnitude: Array
    range_km: Array
    phase_angle_deg: Array
    body_angle_deg: Array


@njit_noalloc
def _find_outcomes(observer, way, sun, magnitude, limits, primaries, outcome):
    """Write the detection outcomes (time,) of apparent magnitudes without air."""
    for k in range(outcome.size):
        x, y, z = observer[k, 0], observer[k, 1], observer[k, 2]
        dx, dy, dz = way[k, 0], way[k, 1], way[k, 2]
        air = extinction(x, y, z, dx, dy, dz, primaries[0], limits)
        outcome[k] = DETECTED if magnitude[k] + air <= limits.limiting_magnitude else FAINT
        found = obstacle(x, y, z, dx, dy, dz, sun[k], limits, primaries)
        if found != CLEAR:
            outcome[k] = EXCLUDED if found == BRIGHT else OCCULTED


def sightings(
    observer: ArrayLike,
    target: ArrayLike,
    sun: ArrayLike,
    sensor: Sensor | None = None,
    *,
    radius_m: float = 1.0,
    diffuse_reflection_coefficient: float = 1.0,
    mu: float = MU,
) -> Sightings:
    """Detection outcome, magnitude and angles of a diffuse sphere along two paths.

    Parameters
    ----------
    observer, target, sun : array_like, shape (time, 3)
        Positions at the same times, nondimensional, rotating frame, or quantities of
        `astropy.units`.
    sensor : Sensor, optional
        Limiting magnitude, exclusion angles and occultation; the paper's if omitted.
    radius_m, diffuse_reflection_coefficient : float
        Radius of the sphere, m, and its C_d, dimensionless.
    mu : float
        Mass ratio.

    Returns
    -------
    Sightings

    Raises
    ------
    ConfigurationError
        If an input is impossible, or a position is not finite or evidently in km.
    """
    given = {"observer": observer, "target": target, "sun": sun}
    positions = [
        np.ascontiguousarray(array_of(name, nondimensional(name, each, "length"), ("time", 3)))
        for name, each in given.items()
    ]
    if len({position.shape for position in positions}) != 1:
        raise ConfigurationError(
            f"observer, target and sun have shapes {[each.shape for each in positions]}; give one "
            "position of each at every time, shape (time, 3)"
        )
    radius_m = number_of("radius_m", in_unit("radius_m", radius_m, "m"), positive=True)
    diffuse_reflection_coefficient = number_of(
        "diffuse_reflection_coefficient", diffuse_reflection_coefficient, positive=True
    )
    sensor = Sensor() if sensor is None else sensor
    require_kind("sensor", sensor, Sensor, "give a Sensor of cislunar.observation")
    watcher, watched, light = positions
    require_nondimensional("observer", watcher)
    require_nondimensional("target", watched)
    limits = sensor.limits()
    way = watched - watcher
    together = np.flatnonzero(~np.any(way, axis=1))
    if together.size:
        raise ConfigurationError(
            f"observer and target are at the same position at time {together[0]}; give the paths "
            "of different objects"
        )
    range_km = np.linalg.norm(way, axis=1) * LENGTH_UNIT_KM
    phase = phase_angle(way, watched - light)
    magnitude = sphere_magnitude(
        range_km * 1e3,
        phase,
        radius_m=radius_m,
        diffuse_reflection_coefficient=diffuse_reflection_coefficient,
    )
    outcome = np.empty(len(way), dtype=np.uint8)
    primaries = np.array(primary_positions(mu))
    _find_outcomes(watcher, way, light, magnitude, limits, primaries, outcome)
    earth, moon = primaries
    bodies = np.stack([light, np.broadcast_to(moon, way.shape), np.broadcast_to(earth, way.shape)])
    angles = phase_angle(way, bodies - watcher)
    return Sightings(outcome, magnitude, range_km, np.rad2deg(phase), np.rad2deg(angles).T)
