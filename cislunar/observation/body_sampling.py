"""Targets with randomly sampled body-parameter deviations."""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.attitude.inertia import TORQUE, inertia_matrix
from cislunar.attitude.parameter_deviations import perturbed_rotation
from cislunar.errors import ConfigurationError
from cislunar.observation.body_parameters import (
    REFLECTION_LAW,
    BodyParameterPrior,
    surface_groups,
)
from cislunar.observation.target_surfaces import TargetSurfaces, body_of
from cislunar.photometry.materials import NOTHING, TABULATED
from cislunar.photometry.parameter_deviations import perturbed_body
from cislunar.runtime import Array

_Generators = Callable[[int, int], np.random.Generator]
"""Generator for a target and a group of deviations, by their numbers. Each pair has its own stream,
so that no group changes the draws of another."""

_INERTIA, _TORQUE = 7, 8
"""Numbers of the groups of rotation deviations, after those of `surface_groups`."""

_MOST_DRAWS = 1000


def _drawn(generator: np.random.Generator, count: int, freedom: float | None) -> Array:
    """Deviations of standard deviation 1: normal ones, or of Student's t distribution, which
    divides the same normal numbers by the root of a chi-squared one each."""
    normal = generator.standard_normal(count)
    if freedom is None:
        return normal
    return normal * np.sqrt((freedom - 2.0) / generator.chisquare(freedom, count))


def surface_table(
    prior: BodyParameterPrior, surfaces: TargetSurfaces
) -> tuple[NDArray[np.int64], Array]:
    """Kinds and prior standard deviations of the surface deviations of all targets, (target, n)
    each, filled up with `NOTHING`."""
    counts = np.diff(surfaces.first)
    size = prior.surface_kinds(int(counts.max(initial=0)))[0].size
    kinds, sigma = np.full((counts.size, size), NOTHING), np.zeros((counts.size, size))
    for j, n_facets in enumerate(counts.tolist()):
        own, deviations = prior.surface_kinds(n_facets)
        kinds[j, : own.size], sigma[j, : own.size] = own, deviations
    return kinds, sigma


def sample_surfaces(
    surfaces: TargetSurfaces,
    prior: BodyParameterPrior,
    generator: _Generators,
    freedom: float | None = None,
) -> TargetSurfaces:
    """Targets whose surfaces deviate at random from the assumed surfaces.

    Parameters
    ----------
    surfaces : TargetSurfaces
        Assumed surfaces.
    prior : BodyParameterPrior
        Standard deviations of the deviations.
    generator : callable
        Returns the numpy.random.Generator of a target and a group of deviations, given their
        numbers.
    freedom : float, optional
        Degrees of freedom, above 2, of Student's t distribution of the deviations, which has these
        standard deviations; normal if omitted.

    Raises
    ------
    ConfigurationError
        If the reflection law is to deviate, or the light does not depend on a parameter.
    """
    for key in REFLECTION_LAW:
        if getattr(prior, key) > 0.0:
            raise ConfigurationError(
                f"{key} = {getattr(prior, key)}: true bodies have one reflection law; set it to 0 "
                "and choose the law by truth.reflection"
            )
    areas, normals, material, lengths = (
        each.copy()
        for each in (surfaces.areas, surfaces.normals, surfaces.material, surfaces.lengths)
    )
    for j in range(lengths.shape[0]):
        body = body_of(surfaces, j)
        prior.require_possible(body.materials, int(body.law))
        own = slice(surfaces.first[j], surfaces.first[j + 1])
        rows = slice(surfaces.first_material[j], surfaces.first_material[j + 1])
        kinds, sigma = prior.surface_kinds(body.areas.size)
        draws = [
            _drawn(generator(j, number), count, freedom)
            for number, (key, (_, count)) in enumerate(surface_groups(body.areas.size).items())
            if getattr(prior, key) > 0.0
        ]
        perturbed = perturbed_body(kinds, sigma * np.concatenate([np.empty(0), *draws]), body)
        areas[own], normals[own], lengths[j] = perturbed.areas, perturbed.normals, perturbed.lengths
        material[rows] = perturbed.materials
    return surfaces._replace(areas=areas, normals=normals, material=material, lengths=lengths)


def sample_rotations(
    inertia: Array,
    prior: BodyParameterPrior,
    generator: _Generators,
    freedom: float | None = None,
) -> tuple[Array, Array]:
    """Inertia and torque of targets that deviate at random from the assumed ones.

    Parameters
    ----------
    inertia : ndarray, shape (target, 3, 3)
        Assumed inertia.
    prior : BodyParameterPrior
        Standard deviations of the deviations.
    generator : callable
        Returns the numpy.random.Generator of a target and a group of deviations, given their
        numbers.
    freedom : float, optional
        See `sample_surfaces`.

    Returns
    -------
    inertia : ndarray, shape (target, 3, 3)
        Sampled again where no rigid body has it.
    angular_acceleration : ndarray, shape (target, 3)
        Due to a torque that is constant in the body frame, rad/s^2.

    Raises
    ------
    ConfigurationError
        If no draw is the inertia of a rigid body.
    """
    kinds, sigma = prior.rotation_kinds()
    new, forced = inertia.copy(), np.zeros((inertia.shape[0], 3))
    numbers = np.where(kinds >= TORQUE, _TORQUE, _INERTIA)
    for j, assumed in enumerate(inertia):
        streams = {number: generator(j, number) for number in np.unique(numbers).tolist()}
        inverse = np.linalg.inv(assumed)
        for _ in range(_MOST_DRAWS):
            draws = [
                _drawn(each, int((numbers == n).sum()), freedom) for n, each in streams.items()
            ]
            amounts = sigma * np.concatenate([np.empty(0), *draws])
            perturbed_rotation(
                kinds, amounts, assumed, inverse, (new[j], inverse.copy(), forced[j])
            )
            if _possible(new[j]):
                break
        else:
            raise ConfigurationError(
                f"log_inertia = {prior.log_inertia}: none of {_MOST_DRAWS} draws is the inertia "
                "of a rigid body; lower it"
            )
    return new, forced


def true_deviations(
    estimated_parameters: BodyParameterPrior,
    assumed: TargetSurfaces,
    true: TargetSurfaces,
    forced: ArrayLike,
) -> Array:
    """True body-parameter deviations of targets from the assumed bodies.

    Parameters
    ----------
    estimated_parameters : BodyParameterPrior
        Estimated parameters; their prior standard deviations do not matter.
    assumed, true : TargetSurfaces
    forced : array_like, shape (3,) or (target, 3)
        True angular acceleration by a torque, rad/s^2; NaN for a torque that varies.

    Returns
    -------
    ndarray, shape (target, n)
        In the order and units of `BodyParameterPrior.named`. NaN where a difference of the bodies
        is not unique (scale, axis scales, facets) or the true law has no such parameters (a table).
    """
    count = true.inertia.shape[0]
    n_facets = int(np.diff(assumed.first).max(initial=0))  # the true body may have more
    moments = [np.diagonal(each.inertia, axis1=1, axis2=2) for each in (assumed, true)]
    ratios = [each[:, 1:] / each[:, :1] for each in moments]
    torques = np.broadcast_to(np.rad2deg(forced) * 3600.0**2, (count, 3))
    change = {
        f"log_inertia_{axis}": np.log(ratios[1][:, i] / ratios[0][:, i])
        for i, axis in enumerate("yz")
    }
    change |= {f"angular_acceleration_deg_h2_{a}": torques[:, i] for i, a in enumerate("xyz")}
    (d0, s0, a0, m0, f0), (d1, s1, a1, m1, f1) = _only_material(assumed), _only_material(true)
    with np.errstate(divide="ignore", invalid="ignore"):
        change["log_albedo"] = np.log(a1 / a0)
        change["log_slope"] = np.log(m1 / m0)
        change["logit_reflectance"] = np.log(f1 * (1.0 - f0) / (f0 * (1.0 - f1)))
        change["logit_specular_share"] = np.log(s1 * d0 / (s0 * d1))
    unclear = np.full(count, np.nan)
    columns = [change.get(name, unclear) for name in estimated_parameters.named(n_facets)]
    return np.reshape(columns, (-1, count)).T


def _only_material(surfaces: TargetSurfaces) -> Array:
    """Material of each target, shape (5, target); NaN for one of several materials or none."""
    first = surfaces.first_material
    known = (np.diff(first) == 1) & (surfaces.law != TABULATED)
    return np.where(known, surfaces.material[first[:-1]].T, np.nan)


def _possible(inertia: Array) -> bool:
    """Whether a rigid body has such an inertia."""
    try:
        inertia_matrix(inertia)
    except ConfigurationError:
        return False
    return True
