"""Fields that divide the sky of an observer, and how objects are seen from the observers.

Fields lie in rows of declination, in axes that do not rotate. Each field is covered by a square
field of view about its center, so that a direction belongs to one field.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr

from cislunar.compiled import njit, njit_noalloc
from cislunar.errors import ConfigurationError
from cislunar.observation import (
    METERS,
    Scene,
    SensorLimits,
    dimming,
    direction_angles,
    extinction,
    in_clear_view,
    limits_of,
    sphere_margin,
    unit_vectors,
)
from cislunar.photometry import faintness_per_squared_range
from cislunar.runtime import Array, Indices
from cislunar.runtime.arguments import array_of, count_of

_MARGIN = 0.96
"""Width of a field over that of the field of view: rows of declination are curved in it."""


class FieldGrid:
    """Fields of equal size over the sky.

    Parameters
    ----------
    field_of_view_deg : float
        Full width of the field of view, below 60 deg.

    Attributes
    ----------
    center : ndarray, shape (field, 2)
        Right ascension and declination, rad.
    direction : ndarray, shape (field, 3)
        Unit vectors of the centers.

    Raises
    ------
    ConfigurationError
        If the field of view is not between 0 and 60 deg.
    """

    def __init__(self, field_of_view_deg: float) -> None:
        if not 0.0 < field_of_view_deg < 60.0:
            raise ConfigurationError(
                f"field_of_view_deg = {field_of_view_deg} must be below 60 deg for a search"
            )
        width = np.deg2rad(_MARGIN * field_of_view_deg)
        self._rows = int(np.ceil(np.pi / width))
        self._height = np.pi / self._rows
        edges = -0.5 * np.pi + self._height * np.arange(self._rows + 1)
        # the widest parallel within a row
        widest = np.where(
            edges[:-1] * edges[1:] <= 0.0, 1.0, np.maximum(np.cos(edges[:-1]), np.cos(edges[1:]))
        )
        self._count = np.maximum(1, np.ceil(2.0 * np.pi * widest / width - 1e-9)).astype(np.int64)
        self._first = np.concatenate([[0], np.cumsum(self._count)])
        row = np.repeat(np.arange(self._rows), self._count)
        column = np.arange(row.size) - self._first[row]
        ra = (column + 0.5) * 2.0 * np.pi / self._count[row]
        self.center = np.stack([ra, edges[row] + 0.5 * self._height], axis=1)
        self.direction = unit_vectors(*self.center.T)

    def field_of(self, ra: ArrayLike, dec: ArrayLike) -> Indices:
        """Field of each direction, rad."""
        row = np.floor((np.asarray(dec) + 0.5 * np.pi) / self._height).astype(np.int64)
        row = np.clip(row, 0, self._rows - 1)
        turn = np.mod(np.asarray(ra), 2.0 * np.pi) / (2.0 * np.pi)
        column = np.minimum((turn * self._count[row]).astype(np.int64), self._count[row] - 1)
        return self._first[row] + column


class Views(NamedTuple):
    """Objects as seen from observers at one time.

    Attributes
    ----------
    ra, dec : ndarray, shape (observer, object)
        rad, inertial frame of the scene.
    margin : ndarray, shape (observer, object)
        Limiting magnitude minus the magnitude of a diffuse sphere of 1 m^2; minus infinity if the
        line of sight is not clear or the object is not lit.
    """

    ra: Array
    dec: Array
    margin: Array


@njit_noalloc
def sphere_margin_at(scene, own, faintness, o, k, x, y, z):
    """Limiting magnitude of observer o minus the magnitude of a diffuse sphere of 1 m^2 at a
    position; minus infinity if the line of sight is not clear or the sphere is not lit."""
    sun, primaries = scene.sun_position[k], scene.primaries[k]
    ox = scene.observer_position[o, k, 0]
    oy = scene.observer_position[o, k, 1]
    oz = scene.observer_position[o, k, 2]
    dx, dy, dz = x - ox, y - oy, z - oz
    if not in_clear_view(ox, oy, oz, dx, dy, dz, sun, own, primaries):
        return -np.inf
    return sphere_margin(dx, dy, dz, x - sun[0], y - sun[1], z - sun[2], faintness[o]) - extinction(
        ox, oy, oz, dx, dy, dz, primaries[0], own
    )


def faintness_of(limits: SensorLimits) -> Array:
    """`sphere_margin` needs this (observer,) of each telescope."""
    limit, own = np.unique(limits.limiting_magnitude, return_inverse=True)
    return METERS**2 * np.array([faintness_per_squared_range(each) for each in limit])[own]


@njit(cache=True, error_model="numpy")
def _see(scene, limits, faintness, k, position, ra, dec, margin):
    for o in range(ra.shape[0]):
        own, place = limits_of(limits, o), scene.observer_position[o, k]
        for j in range(position.shape[0]):
            x, y, z = position[j, 0], position[j, 1], position[j, 2]
            dx, dy, dz = x - place[0], y - place[1], z - place[2]
            ra[o, j], dec[o, j] = direction_angles(dx, dy, dz, scene.frame_axes[k])
            margin[o, j] = sphere_margin_at(scene, own, faintness, o, k, x, y, z)


def views(
    scene: Scene, limits: SensorLimits, index: int, position: ArrayLike, *, eclipse: bool = False
) -> Views:
    """Directions and brightness of objects for all observers.

    Parameters
    ----------
    scene : Scene
    limits : SensorLimits
        Of all observers (`cislunar.observation.sensor_limits`).
    index : int
        Time of the scene.
    position : array_like, shape (object, 3)
        Nondimensional, propagation frame.
    eclipse : bool
        Whether objects are dimmer in the penumbra of Earth and Moon and invisible in the umbra.

    Returns
    -------
    Views

    Raises
    ------
    ConfigurationError
        If the scene does not have the time, the positions have another shape, or the limits are not
        those of all observers.
    """
    index = count_of("index", index, 0, scene.observer_position.shape[1] - 1)
    place = np.ascontiguousarray(array_of("position", position, (None, 3), finite=False))
    shape = scene.observer_position.shape[0], place.shape[0]
    if len(limits.limiting_magnitude) != shape[0]:
        raise ConfigurationError(
            f"limits of {len(limits.limiting_magnitude)} observers: give those of all {shape[0]}"
        )
    out = np.empty(shape), np.empty(shape), np.empty(shape)
    _see(scene, limits, faintness_of(limits), index, place, *out)
    if eclipse:
        sky = scene.sun_position[[index]], scene.primaries[[index]]
        out[2][:] -= dimming(place[:, None], *sky)[:, 0]
    return Views(*out)


def detection_probability(
    margin: ArrayLike, size_m2: ArrayLike, sigma_mag: ArrayLike, loss: float
) -> Array:
    """Probability that an exposure detects objects in its field.

    Parameters
    ----------
    margin : array_like, shape (observer, object)
        See `Views`.
    size_m2 : array_like, shape (object,)
        Diffuse reflection coefficient times squared radius.
    sigma_mag : array_like, broadcast to the margins
        Standard deviation of a measured magnitude about that of the sphere, mag. Without any, an
        object is detected if it is bright enough.
    loss : float
        Share of detectable objects that an exposure loses.

    Returns
    -------
    ndarray, shape (observer, object)
    """
    brighter = np.asarray(margin) + 2.5 * np.log10(np.asarray(size_m2, dtype=float))
    sigma = np.asarray(sigma_mag, dtype=float)
    exact = sigma == 0.0
    spread = ndtr(brighter / np.where(exact, 1.0, sigma))
    return (1.0 - loss) * np.where(exact, 0.5 + 0.5 * np.sign(brighter), spread)
