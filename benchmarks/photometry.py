"""Time of one apparent magnitude: compiled kernel against plain NumPy, and bodies with shadows.

Run ``python benchmarks/photometry.py``. Prints the best of several repeats, in microseconds per
magnitude, and the ratios; exits with an error if the two kernels of an icosahedron disagree. A body
with shadows and several materials is compared with the convex kernel on as many facets, its own,
measured in turns; the directions are random, and those of a slow tumble.
"""

import argparse

import numpy as np
from _timing import best_time
from numba import njit

from cislunar.attitude.quaternion import from_rotation_vector, normalize, to_inertial
from cislunar.constants import SUN_APPARENT_MAGNITUDE
from cislunar.photometry import spacecraft
from cislunar.photometry.bodies import body_magnitude, build_body
from cislunar.photometry.facets import (
    FLOOR_MAGNITUDE,
    facet_magnitude,
    facet_magnitude_gradient,
)
from cislunar.photometry.materials import Material
from cislunar.photometry.shapes import Facets, icosphere

RANGE_M = 1e7


def numpy_magnitude(quaternion, sun, view, facets: Facets, material: Material):
    """Magnitudes of n geometries with arrays of shape (n, F), as one would write it in NumPy."""
    normals = to_inertial(quaternion[..., None, :], facets.normals)
    half = sun + view
    half = half / np.linalg.norm(half, axis=-1, keepdims=True)
    lit, seen, tilt = (np.einsum("...fi,...i->...f", normals, v) for v in (sun, view, half))
    bright = (lit > 0.0) & (seen > 0.0)
    lit, seen, tilt = (np.where(bright, cosine, 1.0) for cosine in (lit, seen, tilt))
    q = np.sum(view * half, axis=-1, keepdims=True)
    root = np.sqrt(material.normal_reflectance)
    p = np.sqrt(q**2 - 1.0 + ((1.0 + root) / (1.0 - root)) ** 2)
    fresnel = 0.5 * ((p - q) / (p + q)) ** 2
    fresnel = fresnel * (1.0 + ((q * (p + q) - 1.0) / (q * (p - q) + 1.0)) ** 2)
    slope2 = material.rms_slope**2
    beckmann = np.exp((1.0 - tilt**-2) / slope2) / (slope2 * tilt**4)
    attenuation = np.minimum(1.0, 2.0 * tilt * np.minimum(lit, seen) / q)
    reflectance = material.diffuse_weight * material.diffuse_albedo * lit * seen
    reflectance = reflectance + material.specular_weight * attenuation * beckmann * fresnel
    flux = np.sum(np.where(bright, facets.areas * reflectance, 0.0), axis=-1)
    flux = flux / (4.0 * np.pi**2 * RANGE_M**2)
    faintest = 10.0 ** ((SUN_APPARENT_MAGNITUDE - FLOOR_MAGNITUDE) / 2.5)
    return SUN_APPARENT_MAGNITUDE - 2.5 * np.log10(np.maximum(flux, faintest))


@njit
def compiled_magnitudes(quaternion, sun, view, areas, normals, material, out):
    """`facet_magnitude` of n geometries, called as the filters call it."""
    for i in range(out.shape[0]):
        out[i] = facet_magnitude(
            quaternion[i], sun[i], view[i], RANGE_M, areas, normals, material, True, True
        )


@njit
def compiled_gradients(quaternion, sun, view, areas, normals, material, out):
    """`facet_magnitude_gradient` of n geometries."""
    for i in range(out.shape[0]):
        out[i] = facet_magnitude_gradient(
            quaternion[i], sun[i], view[i], RANGE_M, areas, normals, material, True, True
        )[0]


@njit
def body_magnitudes(quaternion, sun, view, body, out):
    """`body_magnitude` of n geometries."""
    for i in range(out.shape[0]):
        out[i] = body_magnitude(quaternion[i], sun[i], view[i], RANGE_M, body, True, True)


def compare_bodies(quaternion, sun, view, repeats: int) -> None:
    """Print what shadows and materials cost at equal facets."""
    n = len(quaternion)
    out = np.empty(n)
    axis = np.array([0.3, -0.5, 0.81])
    tumble = np.array([from_rotation_vector(angle * axis) for angle in np.linspace(0.0, 40.0, n)])
    still = [np.repeat(v[:1], n, axis=0) for v in (sun, view)]
    print(f"{'body':>15} {'facets':>6} {'geometry':>8} {'convex':>7} {'shadows':>7}  us  ratio")
    for name, materials in spacecraft.SURFACES.items():
        body = build_body(getattr(spacecraft, name)(), materials)
        for label, geometry in (("random", (quaternion, sun, view)), ("tumble", (tumble, *still))):
            convex, shadowed = np.inf, np.inf
            for _ in range(repeats):
                task = (*geometry, body.areas, body.normals, body.materials[0], out)
                convex = min(convex, best_time(lambda t=task: compiled_magnitudes(*t), 1))
                task = (*geometry, body, out)
                shadowed = min(shadowed, best_time(lambda t=task: body_magnitudes(*t), 1))
            print(
                f"{name:>15} {body.areas.size:6d} {label:>8} {1e6 * convex / n:7.3f} "
                f"{1e6 * shadowed / n:7.3f}      {shadowed / convex:.2f}"
            )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--geometries", type=int, default=5000)
    parser.add_argument("--repeats", type=int, default=20)
    arguments = parser.parse_args()
    n = arguments.geometries
    rng = np.random.default_rng(0)
    quaternion = normalize(rng.normal(size=(n, 4)))
    sun, view = (v / np.linalg.norm(v, axis=1)[:, None] for v in rng.normal(size=(2, n, 3)))
    material = Material()
    print(f"{'facets':>6} {'compiled':>9} {'gradient':>9} {'one by one':>11} {'batch':>7}  us")
    for subdivisions in (0, 2):
        facets = icosphere(subdivisions)
        out = np.empty(n)
        inputs = (quaternion, sun, view, facets.areas, facets.normals, material.as_array(), out)
        compiled_gradients(*inputs)
        compiled_magnitudes(*inputs)
        np.testing.assert_allclose(
            out, numpy_magnitude(quaternion, sun, view, facets, material), rtol=1e-12
        )
        few = range(min(n, 200))
        tasks = {
            "compiled": (lambda i=inputs: compiled_magnitudes(*i), n),
            "gradient": (lambda i=inputs: compiled_gradients(*i), n),
            "single": (
                lambda f=facets, k=few: [
                    numpy_magnitude(quaternion[i], sun[i], view[i], f, material) for i in k
                ],
                len(few),
            ),
            "batch": (lambda f=facets: numpy_magnitude(quaternion, sun, view, f, material), n),
        }
        us = {
            name: 1e6 * best_time(task, arguments.repeats if count == n else 3) / count
            for name, (task, count) in tasks.items()
        }
        print(
            f"{facets.areas.size:6d} {us['compiled']:9.3f} {us['gradient']:9.3f} "
            f"{us['single']:11.1f} {us['batch']:7.2f}"
        )
        print(
            f"       NumPy one by one / compiled = {us['single'] / us['compiled']:.0f}, "
            f"NumPy batch / compiled = {us['batch'] / us['compiled']:.0f}"
        )
    compare_bodies(quaternion, sun, view, arguments.repeats)


if __name__ == "__main__":
    main()
