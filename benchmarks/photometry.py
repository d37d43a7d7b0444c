"""Time of one apparent magnitude: compiled kernel against plain NumPy, and bodies with shadows.

    python benchmarks/photometry.py [--geometries 5000] [--repeats 20]

Prints the best of several repeats, in microseconds per magnitude, and the time ratios of NumPy to
the compiled kernel of one geometry and of the latter to the kernel of blocks. It exits with an
error if they disagree. A body with shadows and several materials is compared with the convex kernel
on the same facets, measured in turn; the directions are random, and those of a slow tumble.
"""

import argparse

import numpy as np
from _timing import best_time
from numba import njit

from cislunar.attitude.quaternion import from_rotation_vector, normalize, to_inertial
from cislunar.constants import SUN_APPARENT_MAGNITUDE
from cislunar.photometry import spacecraft
from cislunar.photometry.bodies import build_body, plain_body
from cislunar.photometry.body_blocks import body_magnitude_gradients, body_magnitudes
from cislunar.photometry.facet_blocks import (
    BLOCK_ROWS,
    LANES,
    MAGNITUDE,
    RANGE,
    SUN,
    VIEW,
)
from cislunar.photometry.facet_derivatives import facet_magnitude_derivatives
from cislunar.photometry.facets import (
    FLOOR_MAGNITUDE,
    facet_magnitude,
)
from cislunar.photometry.materials import Material
from cislunar.photometry.shapes import Facets, icosphere

RANGE_M = 1e7


def numpy_magnitude(quaternion, sun, view, facets: Facets, material: Material):
    """Magnitudes of n geometries with arrays of shape (n, F) in plain NumPy."""
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
def compiled_derivatives(quaternion, sun, view, areas, normals, material, out):
    """`facet_magnitude_derivatives` of n geometries."""
    for i in range(out.shape[0]):
        out[i] = facet_magnitude_derivatives(
            quaternion[i], sun[i], view[i], RANGE_M, areas, normals, material, True, True
        )[0]


@njit
def blocked(quaternion, sun, view, body, with_gradient, out):
    """`body_magnitudes` or `body_magnitude_gradients` of n geometries; fills the blocks as well."""
    block = np.empty((BLOCK_ROWS, LANES))
    block[RANGE] = RANGE_M
    for first in range(0, out.shape[0], LANES):
        count = min(LANES, out.shape[0] - first)
        for k in range(count):
            for c in range(4):
                block[c, k] = quaternion[first + k, c]
            for c in range(3):
                block[SUN + c, k], block[VIEW + c, k] = sun[first + k, c], view[first + k, c]
        if with_gradient:
            body_magnitude_gradients(block, count, body, True, True)
        else:
            body_magnitudes(block, count, body, True, True)
        out[first : first + count] = block[MAGNITUDE, :count]


def compare_bodies(quaternion, sun, view, repeats: int) -> None:
    """Print the cost of shadows and materials with the same facets, in blocks."""
    n = len(quaternion)
    out = np.empty(n)
    axis = np.array([0.3, -0.5, 0.81])
    tumble = np.array([from_rotation_vector(angle * axis) for angle in np.linspace(0.0, 40.0, n)])
    still = [np.repeat(v[:1], n, axis=0) for v in (sun, view)]
    print("body, facets, geometry, quantity: convex, us; with shadows, us; time ratio")
    for name, materials in spacecraft.SURFACES.items():
        body = build_body(getattr(spacecraft, name)(), materials)
        plain = plain_body(body.facets, next(iter(materials.values())))
        for label, geometry in (("random", (quaternion, sun, view)), ("tumble", (tumble, *still))):
            for what, gradient in (("magnitude", False), ("gradient", True)):
                best = [np.inf, np.inf]
                for _ in range(repeats):
                    for number, each in enumerate((plain, body)):
                        task = (*geometry, each, gradient, out)
                        taken = best_time(lambda t=task: blocked(*t), 1)
                        best[number] = min(best[number], taken)
                convex, shadowed = (1e6 * taken / n for taken in best)
                print(
                    f"{name}, {body.areas.size}, {label}, {what}: {convex:.3f}, {shadowed:.3f}, "
                    f"{shadowed / convex:.2f}"
                )


def main() -> None:
    """Print times and ratios."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--geometries", type=int, default=5000)
    parser.add_argument("--repeats", type=int, default=20)
    arguments = parser.parse_args()
    n = arguments.geometries
    rng = np.random.default_rng(0)
    quaternion = normalize(rng.normal(size=(n, 4)))
    sun, view = (v / np.linalg.norm(v, axis=1)[:, None] for v in rng.normal(size=(2, n, 3)))
    material = Material()
    print("us per magnitude; in a block, the rows of a tumbling body share their lit facets")
    axis = np.array([0.3, -0.5, 0.81])
    tumble = np.array([from_rotation_vector(angle * axis) for angle in np.linspace(0.0, 40.0, n)])
    still = [np.repeat(v[:1], n, axis=0) for v in (sun, view)]
    for subdivisions in (0, 2):
        facets = icosphere(subdivisions)
        out, out_of_blocks = np.empty(n), np.empty(n)
        shape = (facets.areas, facets.normals, material.as_array())
        body = plain_body(facets, material)
        inputs = (quaternion, sun, view, *shape)
        in_blocks = (quaternion, sun, view, body)
        compiled_magnitudes(*inputs, out)
        blocked(*in_blocks, False, out_of_blocks)
        np.testing.assert_allclose(out_of_blocks, out, atol=1e-11, rtol=0.0)
        np.testing.assert_allclose(
            out, numpy_magnitude(quaternion, sun, view, facets, material), rtol=1e-12
        )
        few = range(min(n, 200))
        tasks = {
            "one by one": (lambda i=inputs, o=out: compiled_magnitudes(*i, o), n),
            "blocks": (lambda i=in_blocks, o=out: blocked(*i, False, o), n),
            "derivatives one by one": (lambda i=inputs, o=out: compiled_derivatives(*i, o), n),
            "gradient in blocks": (lambda i=in_blocks, o=out: blocked(*i, True, o), n),
            "NumPy one by one": (
                lambda f=facets, k=few: [
                    numpy_magnitude(quaternion[i], sun[i], view[i], f, material) for i in k
                ],
                len(few),
            ),
            "NumPy": (lambda f=facets: numpy_magnitude(quaternion, sun, view, f, material), n),
        }
        for name, kernel, given in (
            ("one by one", compiled_magnitudes, shape),
            ("blocks", blocked, (body, False)),
        ):
            tasks[f"tumble {name}"] = (
                lambda k=kernel, g=given, o=out: k(tumble, *still, *g, o),
                n,
            )
        us = {
            name: 1e6 * best_time(task, arguments.repeats if count == n else 3) / count
            for name, (task, count) in tasks.items()
        }
        print(f"{facets.areas.size} facets: ", ", ".join(f"{k} {v:.3f}" for k, v in us.items()))
        pairs = [(key, "one by one") for key in ("NumPy one by one", "NumPy")]
        pairs += [("one by one", "blocks"), ("tumble one by one", "tumble blocks")]
        pairs += [("derivatives one by one", "gradient in blocks")]
        print("  time ratios: ", ", ".join(f"{a} / {b} = {us[a] / us[b]:.1f}" for a, b in pairs))
    compare_bodies(quaternion, sun, view, arguments.repeats)


if __name__ == "__main__":
    main()
