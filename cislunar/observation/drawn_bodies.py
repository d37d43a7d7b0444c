"""Targets whose bodies depart at random from what is believed of them."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cislunar.observation.body_spread import BodySpread, surface_groups
from cislunar.observation.scene import TargetSurfaces
from cislunar.photometry.departures import departed_surface
from cislunar.photometry.materials import NOTHING

Array = NDArray[np.float64]


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
    surfaces: TargetSurfaces,
    spread: BodySpread,
    generator: Callable[[int, int], np.random.Generator],
) -> TargetSurfaces:
    """Targets that depart at random from what is believed of them.

    Parameters
    ----------
    surfaces : TargetSurfaces
        As believed.
    spread : BodySpread
        How far they depart.
    generator : callable
        Generator of a target and a kind of departure, by their numbers: each has its own, so that
        none moves the draws of another.

    Returns
    -------
    TargetSurfaces

    Raises
    ------
    ConfigurationError
        See `BodySpread.require_possible`.
    """
    areas, normals, material = (
        surfaces.areas.copy(),
        surfaces.normals.copy(),
        surfaces.material.copy(),
    )
    for j, row in enumerate(surfaces.material):
        spread.require_possible(row)
        own = slice(surfaces.first[j], surfaces.first[j + 1])
        kinds, sigma = spread.surface_kinds(own.stop - own.start)
        draws = [
            generator(j, number).standard_normal(count)
            for number, (key, (_, count)) in enumerate(surface_groups(own.stop - own.start).items())
            if getattr(spread, key) > 0.0
        ]
        amounts = sigma * np.concatenate([np.empty(0), *draws])
        areas[own], normals[own], material[j] = departed_surface(
            kinds, amounts, areas[own], normals[own], row
        )
    return surfaces._replace(areas=areas, normals=normals, material=material)
