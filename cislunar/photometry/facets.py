"""Apparent magnitude of a convex faceted object (Paul & Fan, section 2.2).

Each plane facet reflects by the Cook-Torrance model: a Lambertian part and a specular part with
Beckmann slopes, geometric attenuation and Fresnel reflectance. The Sun and the observer are
distant, so that all facets share both directions, the half-vector, the Fresnel factor and the
range. Both directions are unit vectors from the object, in the inertial frame.

The paper's specular reflectance has a factor [(N.L)(N.V)]^-1, which its facet sum multiplies by
(N.L)(N.V). The two factors are canceled here, so that a facet near grazing loses no precision:

    R_i = A_i / pi * (d rho (N.L)(N.V) + s alpha_i D_i F).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from cislunar.attitude.quaternion import rotate_components
from cislunar.compiled import njit, njit_alloc, njit_noalloc
from cislunar.constants import SUN_APPARENT_MAGNITUDE
from cislunar.errors import ConfigurationError
from cislunar.photometry.materials import REFLECTION_LAWS, Material, PhotometryModel
from cislunar.photometry.shapes import Facets
from cislunar.runtime import Array
from cislunar.runtime.arguments import array_of, number_of, require_kind, require_unit

IRRADIANCE_FLOOR: float = 1e-22
"""Smallest irradiance, relative to the Sun's, that the filters convert to a magnitude."""

FLOOR_MAGNITUDE: float = SUN_APPARENT_MAGNITUDE + 55.0
"""Magnitude of `IRRADIANCE_FLOOR`, 28.26; `facet_magnitude` returns it for a dark object."""

_LARGEST_EXPONENT = 745.0
"""exp(-x) is zero in double precision for larger x."""

LN10 = np.log(10.0)


@njit_alloc
def fresnel_reflectance(cosine, normal_reflectance, fresnel_sqrt):
    """Unpolarized Fresnel reflectance of a microfacet at q = V.H (Paul & Fan, eqs. 12-15). With
    `fresnel_sqrt`, p = sqrt(q^2 - 1 + b^2) as in Cook & Torrance (1982), so that F(q = 1) = F0;
    otherwise p has no root, as printed in the paper."""
    q = cosine
    root = np.sqrt(normal_reflectance)
    b = (1.0 + root) / (1.0 - root)
    p = q * q - 1.0 + b * b
    if fresnel_sqrt:
        p = np.sqrt(p)
    ratio = (p - q) / (p + q)
    second = (q * (p + q) - 1.0) / (q * (p - q) + 1.0)
    return 0.5 * ratio * ratio * (1.0 + second * second)


@njit_noalloc
def reflection_constants(material, half2, fresnel_sqrt):
    """d rho, s F / delta^2, 1 / delta^2, and the largest tan^2(phi) with a glint, of a material.
    `material` is a row ``[d, s, rho, delta_rms, F0]`` and `half2` is |L + V|^2."""
    steepness = 1.0 / (material[3] * material[3])
    far = _LARGEST_EXPONENT / steepness  # largest tan^2(phi) with exp(-tan^2(phi)/delta^2) > 0
    fresnel = fresnel_reflectance(0.5 * np.sqrt(half2), material[4], fresnel_sqrt)
    return material[0] * material[2], material[1] * fresnel * steepness, steepness, far


@njit_noalloc
def _facet_reflectance(lit, seen, lower, inverse_half2, diffuse, specular, steepness, far):
    """pi R_i / A_i of a facet with N.L = `lit` and N.V = `seen`, of which `lower` is the lesser."""
    both = lit + seen
    reflectance = diffuse * lit * seen
    cosine2 = both * both * inverse_half2  # (N.H)^2
    if 1.0 - cosine2 < far * cosine2:  # else the glint underflows
        secant2 = 1.0 / cosine2
        attenuation = min(1.0, 4.0 * both * lower * inverse_half2)
        beckmann = np.exp((1.0 - secant2) * steepness) * secant2 * secant2
        reflectance += specular * attenuation * beckmann
    return reflectance


@njit_noalloc
def facet_irradiance(
    quaternion, sun_direction, view_direction, range_m, areas, normals, material,
    irradiance_4pi, fresnel_sqrt,
):  # fmt: skip
    """Irradiance at the observer relative to the Sun's at 1 au, F_t / I
    (Paul & Fan, eqs. 7, 8; compiled).

    Parameters
    ----------
    quaternion : ndarray, shape (4,)
        Attitude of the object, inertial to body, scalar last.
    sun_direction, view_direction : ndarray, shape (3,)
        Unit vectors from the object to the Sun and to the observer, inertial frame.
    range_m : float
        Distance from the object to the observer, m.
    areas : ndarray, shape (F,)
        Facet areas, m^2.
    normals : ndarray, shape (F, 3)
        Outward unit normals, body frame.
    material : ndarray, shape (5,)
        ``[d, s, rho, delta_rms, F0]``, see `cislunar.photometry.materials.Material`.
    irradiance_4pi : bool
        True: the flux spreads as 1/(4 pi r^2), as printed; False: as 1/r^2.
    fresnel_sqrt : bool
        See `fresnel_reflectance`.

    Returns
    -------
    float
        Sum of the facets (Paul & Fan, section 2.2); 0 if none is both lit and seen.
    """
    q1, q2, q3, q4 = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    lx, ly, lz = sun_direction[0], sun_direction[1], sun_direction[2]
    vx, vy, vz = view_direction[0], view_direction[1], view_direction[2]
    # |L + V|^2 is zero with the Sun straight behind the object; no facet is lit and seen then
    half2 = (lx + vx) ** 2 + (ly + vy) ** 2 + (lz + vz) ** 2
    lx, ly, lz = rotate_components(q1, q2, q3, q4, lx, ly, lz)
    vx, vy, vz = rotate_components(q1, q2, q3, q4, vx, vy, vz)
    diffuse, specular, steepness, far = reflection_constants(material, half2, fresnel_sqrt)
    inverse_half2 = 1.0 / half2
    total = 0.0
    for i in range(areas.shape[0]):
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        lit = nx * lx + ny * ly + nz * lz
        seen = nx * vx + ny * vy + nz * vz
        lower = min(lit, seen)
        if lower <= 0.0:
            continue
        total += areas[i] * _facet_reflectance(
            lit, seen, lower, inverse_half2, diffuse, specular, steepness, far
        )
    spread = np.pi * range_m * range_m
    if irradiance_4pi:
        spread *= 4.0 * np.pi
    return total / spread


@njit_noalloc
def facet_magnitude(
    quaternion, sun_direction, view_direction, range_m, areas, normals, material,
    irradiance_4pi, fresnel_sqrt,
):  # fmt: skip
    """Apparent magnitude of a faceted object (Paul & Fan, eq. 6; compiled); see `facet_irradiance`.
    The magnitude never exceeds `FLOOR_MAGNITUDE`. A dark object returns exactly that value, so that
    the filter stays finite if a sigma point becomes dark."""
    flux = facet_irradiance(
        quaternion, sun_direction, view_direction, range_m, areas, normals, material,
        irradiance_4pi, fresnel_sqrt,
    )  # fmt: skip
    if flux <= IRRADIANCE_FLOOR:
        return FLOOR_MAGNITUDE
    return SUN_APPARENT_MAGNITUDE - 2.5 * np.log10(flux)


@njit_noalloc
def facet_sums(light, view, half2, fresnel, areas, normals, material):
    """Sum of A_i (d rho (N.L)(N.V) + s alpha_i D_i F), m^2, and its derivatives by the directions
    (Paul & Fan, eqs. 9-11, 16, 17).

    `light` and `view` are L and V in the body frame, `half2` is |L + V|^2. Returned are the sum,
    its derivatives by L through N.L alone and by V through N.V alone (tuples of three), its
    derivative by |L + V|^2 at constant N.L, N.V and F, and its specular part."""
    lx, ly, lz = light
    vx, vy, vz = view
    diffuse = material[0] * material[2]
    steepness = 1.0 / (material[3] * material[3])
    far = _LARGEST_EXPONENT / steepness  # largest tan^2(phi) with exp(-tan^2(phi)/delta^2) > 0
    specular = material[1] * fresnel * steepness
    inverse_half2 = 1.0 / half2
    total, shine, by_half2 = 0.0, 0.0, 0.0
    ax, ay, az = 0.0, 0.0, 0.0  # sum of A dR/d(N.L) N
    bx, by, bz = 0.0, 0.0, 0.0  # sum of A dR/d(N.V) N
    for i in range(areas.shape[0]):
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        lit = nx * lx + ny * ly + nz * lz
        seen = nx * vx + ny * vy + nz * vz
        lower = min(lit, seen)
        if lower <= 0.0:
            continue
        both = lit + seen
        area = areas[i]
        reflectance = diffuse * lit * seen
        by_lit, by_seen = diffuse * seen, diffuse * lit
        cosine2 = both * both * inverse_half2
        if 1.0 - cosine2 < far * cosine2:
            secant2 = 1.0 / cosine2
            glint = specular * np.exp((1.0 - secant2) * steepness) * secant2 * secant2
            slope = (secant2 * steepness - 2.0) * secant2 * glint * 2.0 * both * inverse_half2
            power = 2.0 - secant2 * steepness  # d log D / d log |L + V|^2
            attenuation = 4.0 * both * lower * inverse_half2
            if attenuation < 1.0:
                edge = 4.0 * inverse_half2 * glint
                by_lit += slope * attenuation + edge * (lower + (both if lit < seen else 0.0))
                by_seen += slope * attenuation + edge * (lower + (0.0 if lit < seen else both))
                glint *= attenuation
                power -= 1.0
            else:
                by_lit += slope
                by_seen += slope
            reflectance += glint
            shine += area * glint
            by_half2 += area * glint * power * inverse_half2
        total += area * reflectance
        by_lit *= area
        by_seen *= area
        ax, ay, az = ax + by_lit * nx, ay + by_lit * ny, az + by_lit * nz
        bx, by, bz = bx + by_seen * nx, by + by_seen * ny, bz + by_seen * nz
    return total, (ax, ay, az), (bx, by, bz), by_half2, shine


@njit(cache=True)
def _irradiances(quaternion, sun, view, range_m, areas, normals, material, flag_4pi, flag_sqrt):
    """`facet_irradiance` of n geometries, given as arrays of n rows."""
    result = np.empty(range_m.shape[0])
    for i in range(result.shape[0]):
        result[i] = facet_irradiance(
            quaternion[i], sun[i], view[i], range_m[i], areas, normals, material,
            flag_4pi, flag_sqrt,
        )  # fmt: skip
    return result


def broadcast_geometries(
    quaternion: ArrayLike, sun_direction: ArrayLike, view_direction: ArrayLike, range_m: ArrayLike
) -> tuple[tuple[int, ...], list[Array]]:
    """Broadcast geometries as in `apparent_magnitude` and flatten them for compiled loops: the
    common shape, and the four arguments, contiguous, with shapes (n, 4), (n, 3), (n, 3) and (n,).
    """
    given = {
        "quaternion": (quaternion, 4),
        "sun_direction": (sun_direction, 3),
        "view_direction": (view_direction, 3),
        "range_m": (np.asarray(range_m)[..., None], 1),
    }
    vectors = [array_of(name, each, finite=False) for name, (each, _) in given.items()]
    for name, a in zip(given, vectors, strict=True):
        if a.shape[-1:] != (given[name][1],):
            raise ConfigurationError(f"{name} has shape {a.shape}; give (..., {given[name][1]})")
        if name != "range_m":
            require_unit(name, a)
        elif np.any(a <= 0.0):
            raise ConfigurationError(f"range_m = {a.min():g} must be positive")
    try:
        shape = np.broadcast_shapes(*(a.shape[:-1] for a in vectors))
    except ValueError:
        shapes = ", ".join(str(a.shape[:-1]) for a in vectors)
        raise ConfigurationError(
            f"{', '.join(given)} have shapes {shapes} without the axis of components; give as many "
            "of each, or one"
        ) from None
    rows = [
        np.ascontiguousarray(np.broadcast_to(a, (*shape, a.shape[-1]))).reshape(-1, a.shape[-1])
        for a in vectors
    ]
    return shape, [*rows[:3], rows[3][:, 0].copy()]


def apparent_magnitude(
    quaternion: ArrayLike,
    sun_direction: ArrayLike,
    view_direction: ArrayLike,
    range_m: ArrayLike,
    facets: Facets,
    material: Material | None = None,
    model: PhotometryModel | None = None,
    *,
    sun_magnitude: float = SUN_APPARENT_MAGNITUDE,
) -> Array:
    """Apparent magnitudes of a faceted object over arrays (Paul & Fan, section 2.2).

    Parameters
    ----------
    quaternion : array_like, shape (..., 4)
        Attitudes, inertial to body, scalar last.
    sun_direction, view_direction : array_like, shape (..., 3)
        Unit vectors from the object to the Sun and to the observer, inertial frame.
    range_m : array_like, shape (...)
        Distances from the object to the observer, m.
    facets : Facets
        Shape.
    material : Material, optional
        Surface; the default material if omitted.
    model : PhotometryModel, optional
        Law of irradiance and form of the Fresnel term; by default light spreads as 1/r^2, and the
        Fresnel term has the root. `cislunar.observation.target_surfaces` applies other laws of
        reflection than that of Cook & Torrance.
    sun_magnitude : float
        Magnitude of the Sun in the sensor's band.

    Returns
    -------
    ndarray, shape (...)
        Magnitudes of the broadcast geometries; inf where no facet is both lit and seen.

    Raises
    ------
    ConfigurationError
        If shapes disagree, a quaternion or a direction is not of unit norm, a range is not
        positive, `model` has another reflection law, or an argument is of another kind.
    """
    material = Material() if material is None else material
    model = PhotometryModel() if model is None else model
    sun_magnitude = number_of("sun_magnitude", sun_magnitude)
    require_kind("facets", facets, Facets, "give Facets, such as icosahedron()")
    require_kind("material", material, Material, "give a Material of cislunar.photometry")
    require_kind("model", model, PhotometryModel, "give a PhotometryModel of cislunar.photometry")
    if model.law != 0:
        raise ConfigurationError(
            f"model.reflection = {model.reflection!r}: facets of one material reflect by "
            f"{REFLECTION_LAWS[0]!r} here; use cislunar.observation.target_surfaces for other laws"
        )
    shape, rows = broadcast_geometries(quaternion, sun_direction, view_direction, range_m)
    flux = _irradiances(
        *rows,
        np.ascontiguousarray(facets.areas, dtype=float),
        np.ascontiguousarray(facets.normals, dtype=float),
        material.as_array(),
        model.irradiance_4pi,
        model.fresnel_sqrt,
    ).reshape(shape)
    with np.errstate(divide="ignore"):
        return sun_magnitude - 2.5 * np.log10(flux)
