"""Targets whose bodies depart at random from what is believed of them."""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.attitude.departures import departed_rotation
from cislunar.attitude.inertia import TORQUE, inertia_matrix
from cislunar.errors import ConfigurationError
from cislunar.observation.body_spread import BodySpread, surface_groups
from cislunar.observation.scene import TargetSurfaces, body_of
from cislunar.photometry.departures import departed_body
from cislunar.photometry.materials import NOTHING

Array = NDArray[np.float64]

Generators = Callable[[int, int], np.random.Generator]
"""Generator of a target and a kind of departure, by their numbers: each has its own, so that none
moves the draws of another."""

_INERTIA, _TORQUE = 7, 8
"""Numbers of the kinds of departure of the rotation, after those of `surface_groups`."""

_MOST_DRAWS = 1000


def surface_table(spread: BodySpread, surfaces: TargetSurfaces) -> tuple[NDArray[np.int64], Array]:
    """Departures of all targets' surfaces that are not known, filled up with `NOTHING`.

    Parameters
    ----------
    spread : BodySpread
    surfaces : TargetSurfaces

    Returns
    -------
    kinds : ndarray of int, shape (target, n)
    sigma : ndarray, shape (target, n)
    """
    counts = np.diff(surfaces.first)
    size = spread.surface_kinds(int(counts.max(initial=0)))[0].size
    kinds, sigma = np.full((counts.size, size), NOTHING), np.zeros((counts.size, size))
    for j, n_facets in enumerate(counts.tolist()):
        own, deviations = spread.surface_kinds(n_facets)
        kinds[j, : own.size], sigma[j, : own.size] = own, deviations
    return kinds, sigma


def drawn_surfaces(
    surfaces: TargetSurfaces, spread: BodySpread, generator: Generators
) -> TargetSurfaces:
    """Targets whose surfaces depart at random from what is believed of them.

    Parameters
    ----------
    surfaces : TargetSurfaces
        As believed.
    spread : BodySpread
        How far they depart.
    generator : Generators

    Returns
    -------
    TargetSurfaces

    Raises
    ------
    ConfigurationError
        See `BodySpread.require_possible`.
    """
    areas, normals, material, lengths = (
        each.copy()
        for each in (surfaces.areas, surfaces.normals, surfaces.material, surfaces.lengths)
    )
    for j in range(lengths.shape[0]):
        body = body_of(surfaces, j)
        spread.require_possible(body.materials)
        own = slice(surfaces.first[j], surfaces.first[j + 1])
        rows = slice(surfaces.first_material[j], surfaces.first_material[j + 1])
        kinds, sigma = spread.surface_kinds(body.areas.size)
        draws = [
            generator(j, number).standard_normal(count)
            for number, (key, (_, count)) in enumerate(surface_groups(body.areas.size).items())
            if getattr(spread, key) > 0.0
        ]
        departed = departed_body(kinds, sigma * np.concatenate([np.empty(0), *draws]), body)
        areas[own], normals[own], lengths[j] = departed.areas, departed.normals, departed.lengths
        material[rows] = departed.materials
    return surfaces._replace(areas=areas, normals=normals, material=material, lengths=lengths)


def drawn_rotations(
    inertia: Array, spread: BodySpread, generator: Generators
) -> tuple[Array, Array]:
    """Inertia and torque of targets that depart at random from what is believed of them.

    Parameters
    ----------
    inertia : ndarray, shape (target, 3, 3)
        As believed.
    spread : BodySpread
        How far they depart.
    generator : Generators

    Returns
    -------
    inertia : ndarray, shape (target, 3, 3)
        Drawn again where no rigid body has it.
    angular_acceleration : ndarray, shape (target, 3)
        By a torque constant in the body frame, rad/s^2.

    Raises
    ------
    ConfigurationError
        If no draw is the inertia of a rigid body.
    """
    kinds, sigma = spread.rotation_kinds()
    new, forced = inertia.copy(), np.zeros((inertia.shape[0], 3))
    numbers = np.where(kinds >= TORQUE, _TORQUE, _INERTIA)
    for j, believed in enumerate(inertia):
        streams = {number: generator(j, number) for number in np.unique(numbers).tolist()}
        inverse = np.linalg.inv(believed)
        for _ in range(_MOST_DRAWS):
            draws = [each.standard_normal(int((numbers == n).sum())) for n, each in streams.items()]
            amounts = sigma * np.concatenate([np.empty(0), *draws])
            departed_rotation(
                kinds, amounts, believed, inverse, (new[j], inverse.copy(), forced[j])
            )
            if _possible(new[j]):
                break
        else:
            raise ConfigurationError(
                f"log_inertia = {spread.log_inertia}: none of {_MOST_DRAWS} draws is the inertia "
                "of a rigid body; lower it"
            )
    return new, forced


def true_departures(
    unknowns: BodySpread, believed: TargetSurfaces, true: TargetSurfaces, forced: ArrayLike
) -> Array:
    """By how much targets truly depart in what an estimator does not know of them.

    Parameters
    ----------
    unknowns : BodySpread
        What is not known; its sizes do not matter.
    believed, true : TargetSurfaces
    forced : array_like, shape (3,) or (target, 3)
        True angular acceleration by a torque, rad/s^2.

    Returns
    -------
    ndarray, shape (target, n)
        In the order of `BodySpread.named` and in its units; NaN where a difference of the bodies
        could be told in several ways (scale, stretch, facets).
    """
    count = true.inertia.shape[0]
    n_facets = int(np.diff(believed.first).max(initial=0))  # the true body may have more
    moments = [np.diagonal(each.inertia, axis1=1, axis2=2) for each in (believed, true)]
    ratios = [each[:, 1:] / each[:, :1] for each in moments]
    torques = np.broadcast_to(np.rad2deg(forced) * 3600.0**2, (count, 3))
    change = {
        f"log_inertia_{axis}": np.log(ratios[1][:, i] / ratios[0][:, i])
        for i, axis in enumerate("yz")
    }
    change |= {f"angular_acceleration_deg_h2_{a}": torques[:, i] for i, a in enumerate("xyz")}
    (d0, s0, a0, m0, f0), (d1, s1, a1, m1, f1) = _only_material(believed), _only_material(true)
    with np.errstate(divide="ignore", invalid="ignore"):
        change["log_albedo"] = np.log(a1 / a0)
        change["log_slope"] = np.log(m1 / m0)
        change["logit_reflectance"] = np.log(f1 * (1.0 - f0) / (f0 * (1.0 - f1)))
        change["logit_specular_share"] = np.log(s1 * d0 / (s0 * d1))
    unclear = np.full(count, np.nan)
    columns = [change.get(name, unclear) for name in unknowns.named(n_facets)]
    return np.reshape(columns, (-1, count)).T


def _only_material(surfaces: TargetSurfaces) -> Array:
    """Material of each target, shape (5, target); NaN where it has several."""
    first = surfaces.first_material
    return np.where(np.diff(first) == 1, surfaces.material[first[:-1]].T, np.nan)


def _possible(inertia: Array) -> bool:
    """Whether a rigid body has such an inertia."""
    try:
        inertia_matrix(inertia)
    except ConfigurationError:
        return False
    return True
