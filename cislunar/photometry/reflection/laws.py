"""Reflection laws of a facet other than the Cook-Torrance model (compiled).

A law gives pi f_r, with f_r the bidirectional reflectance distribution function (BRDF), so that

    R_i = A_i / pi * (N.L)(N.V) * pi f_r.

With l = N.L, v = N.V, h = |L + V|, a the angle between the observer and the mirrored Sun, and the
parameters d, s, rho, delta, F0 of `cislunar.photometry.materials.Material`:

    Lambert             d rho
    Lommel-Seeliger     c d rho / (l + v),   c = 3 / (8 (1 - ln 2))
    Phong               s F0 / delta^2 cos^n(a),   n = 1 / (2 delta^2)
    GGX                 4 pi s D G F / (4 l v)

Phong's lobe is in the form that is symmetric in Sun and observer (Lafortune & Willems 1994). The
Lommel-Seeliger law (Seeliger 1884; Hapke, Theory of Reflectance and Emittance Spectroscopy, 2nd
ed., section 8.5) describes dark, porous surfaces; c makes a sphere return as much light as the
Lambertian sphere of the same d rho, so that d rho up to 1 / (2 c) = 0.41 conserves energy. GGX is
the microfacet law of Walter et al. (2007, eq. 33) with the height-correlated Smith term of Heitz
(2014, eq. 99) and the Fresnel term of Schlick (1994):

    D = delta^2 / (pi t^2),   t = (N.H)^2 (delta^2 - 1) + 1,
    G / (4 l v) = 1 / (2 (l g(v) + v g(l))),   g(x) = sqrt(delta^2 + (1 - delta^2) x^2),
    F = F0 + (1 - F0) (1 - h / 2)^5.

At its peak at normal incidence every lobe is as bright as that of the Cook-Torrance model with the
same parameters; hence the factor 4. A tabulated law is interpolated linearly in the cosines of
incidence, emission and azimuth and does not depend on the material.
"""

import numpy as np

from cislunar.compiled import njit_noalloc
from cislunar.photometry.materials import REFLECTION_LAWS, TABULATED

LAMBERT_PHONG = REFLECTION_LAWS.index("lambert-phong")
GGX = REFLECTION_LAWS.index("lommel-seeliger-ggx")

LOMMEL_SEELIGER = 3.0 / (8.0 * (1.0 - np.log(2.0)))
"""Factor c of the Lommel-Seeliger law, at which its sphere has the Bond albedo d rho: the Bond
albedo of f_r = w / (4 pi (l + v)) is 2/3 (1 - ln 2) w."""

_SMALLEST_SINE2 = 1e-24
"""Product of squared sines below which a direction is along the normal and has no azimuth."""


@njit_noalloc
def reflectance(law, lit, seen, inverse_half2, material, table):
    """pi f_r of a facet and its derivatives.

    Parameters
    ----------
    law : int
        Place in `cislunar.photometry.materials.REFLECTION_LAWS`, from 1 on, or `TABULATED`.
    lit, seen : float
        N.L and N.V, both above 0.
    inverse_half2 : float
        1 / |L + V|^2.
    material : ndarray, shape (5,)
        ``[d, s, rho, delta_rms, F0]``.
    table : ReflectanceTable
        Of a tabulated law.

    Returns
    -------
    diffuse, lobe : float
        The two parts of pi f_r, dimensionless; of a tabulated law all of it is the lobe.
    by_lit, by_seen, by_half2 : float
        Derivatives of their sum by N.L, N.V and |L + V|^2.
    by_slope, by_odds : float
        Derivatives of the lobe by the logarithms of delta and of F0 / (1 - F0).
    """
    if law == TABULATED:
        return _tabulated(lit, seen, inverse_half2, table)
    diffuse, slope = material[0] * material[2], 0.0
    if law != LAMBERT_PHONG:
        diffuse *= LOMMEL_SEELIGER / (lit + seen)
        slope = -diffuse / (lit + seen)
    if law == GGX:
        lobe = _ggx(lit, seen, inverse_half2, material)
    else:
        lobe = _phong(lit, seen, inverse_half2, material)
    shine, by_lit, by_seen, by_half2, by_slope, by_odds = lobe
    return diffuse, shine, by_lit + slope, by_seen + slope, by_half2, by_slope, by_odds


@njit_noalloc
def _phong(lit, seen, inverse_half2, material):
    """Phong's lobe with its derivatives; see `reflectance`."""
    steepness = 1.0 / (material[3] * material[3])
    exponent = 0.5 * steepness
    mirrored = 2.0 * (lit * seen) + 1.0 - 0.5 / inverse_half2  # cos a = 2 (N.L)(N.V) - L.V
    if not mirrored > 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    lobe = material[1] * material[4] / (material[3] * material[3]) * mirrored**exponent
    slope = exponent * lobe / mirrored
    by_slope = -2.0 * lobe * (1.0 + exponent * np.log(mirrored))
    return (
        lobe, 2.0 * seen * slope, 2.0 * lit * slope, -0.5 * slope, by_slope,
        lobe * (1.0 - material[4]),
    )  # fmt: skip


@njit_noalloc
def _ggx(lit, seen, inverse_half2, material):
    """The GGX lobe with its derivatives; see `reflectance`."""
    s, f0, square = material[1], material[4], material[3] * material[3]
    both = lit + seen
    cosine2 = min(both * both * inverse_half2, 1.0)
    t = 1.0 + cosine2 * (square - 1.0)
    g_lit = np.sqrt(square + (1.0 - square) * lit * lit)
    g_seen = np.sqrt(square + (1.0 - square) * seen * seen)
    width = lit * g_seen + seen * g_lit
    half = min(0.5 / np.sqrt(inverse_half2), 1.0)
    beyond = (1.0 - half) ** 4
    fresnel = f0 + (1.0 - f0) * beyond * (1.0 - half)
    shape = 4.0 * s * square / (t * t) * 0.5 / width
    lobe = shape * fresnel
    by_log = -2.0 * (square - 1.0) * cosine2 / t  # d log D / d log (N.H)^2
    rest = (1.0 - square) * lit * seen
    by_lit = lobe * (2.0 * by_log / both - (g_seen + rest / g_lit) / width)
    by_seen = lobe * (2.0 * by_log / both - (g_lit + rest / g_seen) / width)
    by_half2 = -lobe * by_log * inverse_half2 - shape * 0.625 * (1.0 - f0) * beyond / half
    broader = lit * (1.0 - seen * seen) / g_seen + seen * (1.0 - lit * lit) / g_lit
    by_slope = lobe * (2.0 - 4.0 * square * cosine2 / t - square * broader / width)
    by_odds = shape * (1.0 - beyond * (1.0 - half)) * f0 * (1.0 - f0)
    return lobe, by_lit, by_seen, by_half2, by_slope, by_odds


@njit_noalloc
def _place(nodes, x):
    """Index of the interval of decreasing nodes that contains x, and the position within it."""
    i = 0
    while i < nodes.shape[0] - 2 and nodes[i + 1] > x:
        i += 1
    return i, (x - nodes[i]) / (nodes[i + 1] - nodes[i])


@njit_noalloc
def _tabulated(lit, seen, inverse_half2, table):
    """A tabulated law, trilinear in the cosines of incidence, emission and azimuth."""
    i, x = _place(table.incidence, min(lit, 1.0))
    j, y = _place(table.emission, min(seen, 1.0))
    k, z, z_by_lit, z_by_seen, z_by_half2 = 0, 0.0, 0.0, 0.0, 0.0
    last = table.azimuth.shape[0] - 1
    if last > 0:
        sine2_lit, sine2_seen = max(1.0 - lit * lit, 0.0), max(1.0 - seen * seen, 0.0)
        cosine = 1.0
        if sine2_lit * sine2_seen > _SMALLEST_SINE2:
            sines = np.sqrt(sine2_lit * sine2_seen)
            cosine = (0.5 / inverse_half2 - 1.0 - lit * seen) / sines
            if abs(cosine) < 1.0:
                z_by_lit = cosine * lit / sine2_lit - seen / sines
                z_by_seen = cosine * seen / sine2_seen - lit / sines
                z_by_half2 = 0.5 / sines
        k, z = _place(table.azimuth, max(min(cosine, 1.0), -1.0))
    dx = 1.0 / (table.incidence[i + 1] - table.incidence[i])
    dy = 1.0 / (table.emission[j + 1] - table.emission[j])
    dz = 1.0 / (table.azimuth[k + 1] - table.azimuth[k]) if last > 0 else 0.0
    value, by_x, by_y, by_z = 0.0, 0.0, 0.0, 0.0
    for p in range(2):
        for q in range(2):
            low = table.values[i + p, j + q, k]
            rise = table.values[i + p, j + q, k + 1] - low if last > 0 else 0.0
            own, along, across = low + z * rise, x if p == 1 else 1.0 - x, y if q == 1 else 1.0 - y
            value += along * across * own
            by_x += (dx if p == 1 else -dx) * across * own
            by_y += (dy if q == 1 else -dy) * along * own
            by_z += along * across * rise * dz
    return 0.0, value, by_x + by_z * z_by_lit, by_y + by_z * z_by_seen, by_z * z_by_half2, 0.0, 0.0


@njit_noalloc
def directional_hemispherical_reflectance(law, incidence, material, table, nodes, weights):
    """Share of the light at an angle of incidence, rad, that a facet returns into its half space:
    the integral of f_r (N.V) over all V, with a quadrature rule on (0, 1) for N.V and for the
    azimuth over pi. For the other arguments see `reflectance`."""
    lit, total = np.cos(incidence), 0.0
    for i in range(nodes.shape[0]):
        seen = nodes[i]
        across = np.sin(incidence) * np.sqrt(1.0 - seen * seen)
        for k in range(nodes.shape[0]):
            half2 = 2.0 + 2.0 * (lit * seen + across * np.cos(np.pi * nodes[k]))
            found = reflectance(law, lit, seen, 1.0 / half2, material, table)
            total += 2.0 * seen * (found[0] + found[1]) * weights[i] * weights[k]
    return total
