"""Distances from which bodies in random attitude are bright enough to be measured."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.compiled import njit
from cislunar.observation.sightline import METERS
from cislunar.observation.target_surfaces import TargetSurfaces, body_of
from cislunar.photometry.body_blocks import body_magnitude
from cislunar.runtime.arguments import array_of

_PHASE_ANGLES = 91
"""Number of phase angles of the table, from 0 to 180 degrees."""


@njit(cache=True, error_model="numpy")
def _fill_squared_ranges(surfaces, target, quaternion, limit, out):
    """Squared detection ranges (angle, attitude) of one target, ascending along the attitudes."""
    body = body_of(surfaces, target)
    for a in range(out.shape[0]):
        angle = np.pi * a / (out.shape[0] - 1)
        for s in range(out.shape[1]):
            q = quaternion[s]
            magnitude = body_magnitude(
                (q[0], q[1], q[2], q[3]), (1.0, 0.0, 0.0), (np.cos(angle), np.sin(angle), 0.0),
                1.0, body, surfaces.irradiance_4pi, surfaces.fresnel_sqrt,
            )  # fmt: skip
            out[a, s] = 10.0 ** (0.4 * (limit - magnitude)) / METERS**2
        out[a] = np.sort(out[a])


def squared_detection_ranges(
    surfaces: TargetSurfaces, limiting_magnitude: float, quaternion: ArrayLike
) -> NDArray[np.float64]:
    """Squares of the distances at which bodies have a magnitude, by phase angle and attitude.

    Parameters
    ----------
    surfaces : TargetSurfaces
        Shapes and materials.
    limiting_magnitude : float
        Limiting magnitude of the sensor, mag.
    quaternion : array_like, shape (attitude, 4)
        Attitudes, unit quaternions, relative to the plane of Sun, body and observer.

    Returns
    -------
    ndarray, shape (target, angle, attitude)
        Squared nondimensional units of length, at 91 phase angles, evenly from 0 to 180
        degrees, ascending along the attitudes; 0 where nothing is both lit and seen.

    Raises
    ------
    ConfigurationError
        If the attitudes have another shape or are not finite, or there is none.
    """
    attitudes = array_of("quaternion", quaternion, ("attitude", 4))
    found = np.empty((surfaces.first.size - 1, _PHASE_ANGLES, len(attitudes)))
    for target in range(len(found)):
        _fill_squared_ranges(surfaces, target, attitudes, float(limiting_magnitude), found[target])
    return found


@njit(cache=True, error_model="numpy")
def bright_share(dx, dy, dz, fx, fy, fz, squared_ranges):
    """Share of the attitudes in which a body is bright enough, from its `squared_ranges` (angle,
    attitude). d is the vector from the observer to the body, f that from the Sun. The nearest
    tabulated phase angle is used."""
    squared = dx * dx + dy * dy + dz * dz
    cosine = (dx * fx + dy * fy + dz * fz) / np.sqrt(squared * (fx * fx + fy * fy + fz * fz))
    angle = np.arccos(min(1.0, max(-1.0, cosine)))
    row = squared_ranges[int(angle / np.pi * (squared_ranges.shape[0] - 1) + 0.5)]
    return (row.size - np.searchsorted(row, squared, side="right")) / row.size
