"""What a filter needs to know of the world: observers, Sun, frames, and how targets reflect.

Frames. Positions are in the rotating barycentric frame of the CR3BP. The inertial frame coincides
with it at the epoch; at time t the rotating frame is turned by the angle t (nondimensional) about
z. Among the bodies as they are, positions are about the same barycenter in axes that do not turn,
those of J2000: what is called the rotating frame here and in the estimators is that then, and the
inertial frame is the instantaneous frame of Earth and Moon when a run begins. Target attitudes are
relative to the inertial frame, and right ascension and declination are measured in the observer's
body frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from cislunar.attitude.inertia import inertia_matrix
from cislunar.attitude.quaternion import attitude_matrix
from cislunar.attitude.rigid_body import propagate_spherical
from cislunar.constants import MU, TIME_UNIT_S
from cislunar.dynamics.bounds import require_nondimensional
from cislunar.dynamics.cr3bp import primary_positions
from cislunar.errors import ConfigurationError
from cislunar.photometry.bodies import Body, plain_body
from cislunar.photometry.materials import Material, PhotometryModel
from cislunar.photometry.shadows.joined import joined_shadows
from cislunar.photometry.shadows.table import Shadows
from cislunar.photometry.shapes import Facets

Array = NDArray[np.float64]

OBSERVER_RATE_DEG_H = (0.0, 0.0, 1.0)
"""Angular velocity of the observers' bodies, deg/h (Paul & Fan, table 3)."""


class Scene(NamedTuple):
    """Observers and Sun on the grid of measurement times.

    Attributes
    ----------
    step_s : float
        Time between measurements, s.
    step : float
        The same, nondimensional.
    observer_position : ndarray, shape (observer, time, 3)
        Nondimensional, rotating frame; index 0 of `time` is the epoch.
    sun_position : ndarray, shape (time, 3)
        Nondimensional, rotating frame.
    frame_axes : ndarray, shape (time, 3, 3)
        Rotation from the rotating to the inertial frame.
    observer_axes : ndarray, shape (time, 3, 3)
        Rotation from the rotating frame to the body frame of the observers.
    primaries : ndarray, shape (time, 2, 3)
        Centres of Earth and Moon, nondimensional, rotating frame.
    """

    step_s: float
    step: float
    observer_position: Array
    sun_position: Array
    frame_axes: Array
    observer_axes: Array
    primaries: Array


class TargetSurfaces(NamedTuple):
    """Shapes, materials and inertia of the targets, in the layout of the compiled kernels.

    All that is known of the targets as bodies, or believed: how they reflect and how they turn.

    Attributes
    ----------
    areas : ndarray, shape (facet,)
        Facet areas of all targets one after the other, m^2.
    normals : ndarray, shape (facet, 3)
        Outward unit normals, body frame.
    first : ndarray of int, shape (target + 1,)
        Target j owns the facets ``first[j] : first[j + 1]``.
    material : ndarray, shape (row, 5)
        Materials of all targets one after the other, as of
        `cislunar.photometry.materials.Material.as_array`.
    irradiance_4pi, fresnel_sqrt : bool
        Readings of the reflection model, see `PhotometryModel`.
    inertia : ndarray, shape (target, 3, 3)
        Inertia matrices, body frame. Only their ratios matter: bodies turn without torque.
    first_material : ndarray of int, shape (target + 1,)
        Target j owns the materials ``first_material[j] : first_material[j + 1]``.
    rows : ndarray of int, shape (facet,)
        Row of each facet among its target's materials.
    shadows : Shadows
        Those of all targets in one table.
    lengths : ndarray, shape (target, 3)
    rough, phong : ndarray of bool, shape (target,)
        As of `cislunar.photometry.bodies.Body`.
    """

    areas: Array
    normals: Array
    first: NDArray[np.int64]
    material: Array
    irradiance_4pi: bool
    fresnel_sqrt: bool
    inertia: Array
    first_material: NDArray[np.int64]
    rows: NDArray[np.int64]
    shadows: Shadows
    lengths: Array
    rough: NDArray[np.bool_]
    phong: NDArray[np.bool_]


@njit(cache=True, error_model="numpy", inline="always")
def body_of(surfaces, j):
    """The `Body` of target j, whose arrays are views."""
    facets = slice(surfaces.first[j], surfaces.first[j + 1])
    shared = surfaces.shadows
    return Body(
        surfaces.areas[facets],
        surfaces.normals[facets],
        surfaces.rows[facets],
        surfaces.material[surfaces.first_material[j] : surfaces.first_material[j + 1]],
        Shadows(
            shared.steps,
            shared.column[facets],
            shared.lookup,
            shared.masks,
            shared.shares,
            shared.settled,
        ),
        surfaces.lengths[j],
        surfaces.rough[j],
        surfaces.phong[j],
    )


def make_scene(
    observer_position: ArrayLike,
    sun_position: ArrayLike,
    step_s: float,
    *,
    observer_rate_deg_h: ArrayLike = OBSERVER_RATE_DEG_H,
    time_unit_s: float = TIME_UNIT_S,
    mu: float = MU,
    axes: ArrayLike | None = None,
    primaries: ArrayLike | None = None,
) -> Scene:
    """Assemble a scene from positions on the grid of measurement times.

    Parameters
    ----------
    observer_position : array_like, shape (observer, time, 3)
        Nondimensional, rotating frame.
    sun_position : array_like, shape (time, 3)
        Nondimensional, rotating frame, at the same times.
    step_s : float
        Time between measurements, s.
    observer_rate_deg_h : array_like, shape (3,)
        Constant angular velocity of the observers' bodies, body frame, deg/h. At the epoch they
        are aligned with the inertial frame.
    time_unit_s : float
        Nondimensional unit of time, s.
    mu : float
        Mass ratio, which says where Earth and Moon are.
    axes : array_like, shape (3, 3), optional
        Rotation from the frame of the positions to the inertial frame of attitudes, if the former
        does not turn; otherwise it turns about z, once in ``2 pi time_unit_s``.
    primaries : array_like, shape (time, 2, 3), optional
        Centres of Earth and Moon, if they are not at rest in the frame of the positions.

    Returns
    -------
    Scene

    Raises
    ------
    ConfigurationError
        If there are no observers, the shapes disagree, the step is not positive, or a position can
        only be in km.
    """
    observers = np.ascontiguousarray(observer_position, dtype=float)
    sun = np.ascontiguousarray(sun_position, dtype=float)
    if observers.ndim != 3 or observers.shape[0] == 0:
        raise ConfigurationError(
            f"observers: positions of shape {observers.shape} given; at least one observer and "
            "the shape (observer, time, 3) are needed"
        )
    if sun.shape != observers.shape[1:]:
        raise ConfigurationError(
            f"sun_position has shape {sun.shape}, the observers call for {observers.shape[1:]}"
        )
    if not step_s > 0.0:
        raise ConfigurationError(f"step_s = {step_s} must be positive")
    require_nondimensional("observer_position", observers)
    elapsed_s = step_s * np.arange(sun.shape[0])
    if axes is None:
        angle = elapsed_s / time_unit_s
        to_inertial = np.zeros((angle.size, 3, 3))
        to_inertial[:, 0, 0] = to_inertial[:, 1, 1] = np.cos(angle)
        to_inertial[:, 1, 0] = np.sin(angle)
        to_inertial[:, 0, 1] = -np.sin(angle)
        to_inertial[:, 2, 2] = 1.0
    else:
        to_inertial = np.tile(np.asarray(axes, dtype=float), (elapsed_s.size, 1, 1))
    if primaries is None:
        primaries = np.tile(primary_positions(float(mu)), (elapsed_s.size, 1, 1))
    rate = np.deg2rad(np.asarray(observer_rate_deg_h, dtype=float)) / 3600.0
    to_body = attitude_matrix(constant_rate_attitude([0.0, 0.0, 0.0, 1.0], rate, elapsed_s))
    return Scene(
        float(step_s),
        float(step_s / time_unit_s),
        observers,
        sun,
        to_inertial,
        np.ascontiguousarray(to_body @ to_inertial),
        np.ascontiguousarray(primaries, dtype=float),
    )


@njit(cache=True)
def _attitude_history(quaternion, rate, elapsed_s, out):
    for k in range(elapsed_s.size):
        out[k] = propagate_spherical(quaternion, rate, elapsed_s[k])


def constant_rate_attitude(quaternion: ArrayLike, rate: ArrayLike, elapsed_s: ArrayLike) -> Array:
    """Attitudes of a torque-free body of spherical inertia at many times (closed form).

    Parameters
    ----------
    quaternion : array_like, shape (4,)
        Attitude at the epoch, inertial to body.
    rate : array_like, shape (3,)
        Angular velocity, body frame, rad/s.
    elapsed_s : array_like, shape (time,)
        Times since the epoch, s.

    Returns
    -------
    ndarray, shape (time, 4)
        Unit quaternions.
    """
    times = np.asarray(elapsed_s, dtype=float)
    out = np.empty((times.size, 4))
    _attitude_history(
        np.asarray(quaternion, dtype=float), np.asarray(rate, dtype=float), times, out
    )
    return out


def target_surfaces(
    facets: Facets | Body | Sequence[Facets | Body],
    material: Material | Sequence[Material],
    n_targets: int,
    model: PhotometryModel | None = None,
    *,
    inertia: ArrayLike = 1.0,
) -> TargetSurfaces:
    """Lay out shapes, materials and inertia for the compiled kernels.

    Parameters
    ----------
    facets : Facets, Body or sequence of them
        One shape for all targets, or one for each; a `Body` brings its own materials.
    material : Material or sequence of Material
        One surface for all targets, or one for each.
    n_targets : int
        Number of targets.
    model : PhotometryModel, optional
        Reading of the reflection model; if omitted light spreads as 1/r^2. The paper's own law,
        `cislunar.photometry.materials.PRINTED`, makes targets 2.75 mag fainter.
    inertia : array_like, shape (), (3,), (3, 3) or (target, 3, 3)
        One for all targets (see `cislunar.attitude.inertia.inertia_matrix`), or a matrix for
        each; spherical if omitted.

    Returns
    -------
    TargetSurfaces

    Raises
    ------
    ConfigurationError
        If a sequence does not hold one entry for each target, or no rigid body has such an inertia.
    """
    shapes = [facets] * n_targets if isinstance(facets, Facets | Body) else list(facets)
    surfaces = [material] * n_targets if isinstance(material, Material) else list(material)
    given = np.asarray(inertia, dtype=float)
    inertias = list(given) if given.ndim == 3 else [given] * n_targets
    for key, entries in (("facets", shapes), ("material", surfaces), ("inertia", inertias)):
        if len(entries) != n_targets:
            raise ConfigurationError(
                f"{key}: {len(entries)} entries given for {n_targets} targets; give one for all, "
                "or one for each"
            )
    model = PhotometryModel() if model is None else model
    bodies = [
        shape if isinstance(shape, Body) else plain_body(shape, surface)
        for shape, surface in zip(shapes, surfaces, strict=True)
    ]
    phong = np.array([model.phong or body.phong for body in bodies])
    return TargetSurfaces(
        np.concatenate([body.areas for body in bodies]),
        np.ascontiguousarray(np.concatenate([body.normals for body in bodies])),
        _starts([body.areas.size for body in bodies]),
        np.concatenate([body.materials for body in bodies]),
        model.irradiance_4pi,
        model.fresnel_sqrt,
        np.array([inertia_matrix(each) for each in inertias]),
        _starts([len(body.materials) for body in bodies]),
        np.concatenate([body.rows for body in bodies]),
        joined_shadows([body.shadows for body in bodies]),
        np.array([body.lengths for body in bodies]),
        np.array([body.rough for body in bodies]) | phong,
        phong,
    )


def _starts(counts: list[int]) -> NDArray[np.int64]:
    """Where each of several parts of such lengths begins, and where the last one ends."""
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
