"""Mixture of reflection laws, for estimators to which the law is unknown (compiled).

The facet sum of a body with a mixed law is, with l = N.L and v = N.V of facet i,

    T = sum_i A_i (d rho ((1 - eta) l v + 1.4 eta l v / (l + v))
                   + s ((1 - kappa) C_i + kappa F0 / delta^2 l v cos^n(a))),   n = 1 / (2 delta^2).

C_i is the specular term of Cook & Torrance (`cislunar.photometry.facets`), and the lobe that of the
Lambert-Phong law (`cislunar.photometry.body_blocks`), with a the angle between the observer and the
mirrored Sun. The term l v / (l + v) is the law of Lommel and Seeliger (Hapke 2012, Theory of
Reflectance and Emittance Spectroscopy, chapter 8). The factor 1.4 makes it about as bright as the
Lambertian term at l = v = 0.7. To the magnitude of T

    b1 (alpha - 1.2) + b2 ((alpha - 1.2)^2 - 0.3)

is added, with the phase angle alpha in rad. With shares kappa and eta of 0 and without phase
terms the law is that of Cook & Torrance. Shares below 0 and above 1 are allowed, so that a Gaussian
prior is possible; where T is then not positive the object is dark.
"""

import numpy as np

from cislunar.compiled import njit_noalloc
from cislunar.photometry.facet_blocks import (
    BY_HALF2,
    BY_LIT,
    BY_LOMMEL_SEELIGER_SHARE,
    BY_PHONG_SHARE,
    BY_REFLECTANCE,
    BY_SEEN,
    BY_SLOPE,
    FREE,
    INVERSE_HALF2,
    LIT,
    MAGNITUDE,
    OWN,
    OWN_BY_LIT,
    OWN_BY_SEEN,
    OWN_IN_FULL,
    PHASE_ANGLE,
    SEEN,
    SHINE,
    SPECULAR,
    TOTAL,
    facet_glint,
)
from cislunar.photometry.facets import FLOOR_MAGNITUDE, LN10

COOK_TORRANCE = (0.0, 0.0, 0.0, 0.0)
"""The law without deviations: kappa, eta, b1 and b2."""

_LOMMEL_SEELIGER = 1.4
_MIDDLE_PHASE, _PHASE_SPREAD = 1.2, 0.3
"""Mean phase angle, rad, and its variance, rad^2, for which the phase terms vanish on average."""


@njit_noalloc
def phase_terms(angle):
    """Factors of b1 and of b2 in the magnitude at a phase angle, rad."""
    excess = angle - _MIDDLE_PHASE
    return excess, excess * excess - _PHASE_SPREAD


@njit_noalloc
def phase_magnitude(angle, law):
    """Phase terms of a magnitude, mag, at a phase angle, rad; `law` as `COOK_TORRANCE`."""
    first, second = phase_terms(angle)
    return law[2] * first + law[3] * second


@njit_noalloc
def add_phase_terms(b, count, law):
    """Add the phase terms to the magnitudes, and to the derivative of the sum by |L + V|^2."""
    for k in range(count):
        cosine = min(max(0.5 / b[INVERSE_HALF2, k] - 1.0, -1.0), 1.0)
        angle = np.arccos(cosine)
        b[PHASE_ANGLE, k] = angle
        if not b[MAGNITUDE, k] < FLOOR_MAGNITUDE:
            continue
        b[MAGNITUDE, k] += phase_magnitude(angle, law)
        sine = np.sqrt(1.0 - cosine * cosine)
        if sine > 0.0:  # cos(alpha) = |L + V|^2 / 2 - 1
            slope = (law[2] + 2.0 * law[3] * phase_terms(angle)[0]) * -0.5 / sine
            b[BY_HALF2, k] -= LN10 / 2.5 * b[TOTAL, k] * slope


@njit_noalloc
def add_mixed_facet(b, count, whole, normal, factors, material, specular, law, with_slopes):
    """Add a facet of area `whole`, of which the share `FREE` is lit and seen.

    `factors` are d rho, 1 / delta^2 and the largest tan^2(phi) with a glint; `specular` (3, LANES)
    has the factor of the Cook-Torrance term and its logarithmic derivatives by the odds of the
    normal reflectance and by |L + V|^2. With slopes all derivatives are added as in `body_blocks`.
    """
    nx, ny, nz = normal
    diffuse, steepness, far = factors
    kappa, lam = law[0], law[1]
    exponent, f0 = 0.5 * steepness, material[4]
    bright = material[1] * f0 * steepness  # s F0 / delta^2
    for k in range(count):
        lit, seen = b[LIT, k], b[SEEN, k]
        if not (lit > 0.0 and seen > 0.0):
            for row in (OWN_BY_LIT, OWN_BY_SEEN, OWN, OWN_IN_FULL):
                b[row, k] = 0.0
            continue
        inverse_half2, area = b[INVERSE_HALF2, k], whole * b[FREE, k]
        glint, attenuation, secant2, both, lower = facet_glint(
            lit, seen, inverse_half2, b[SPECULAR, k], steepness, far
        )
        limited = attenuation < 1.0
        glint_attenuation = attenuation if limited else 1.0
        shine = glint * glint_attenuation
        product = lit * seen
        mirrored = 2.0 * product + 1.0 - 0.5 / inverse_half2  # cos a = 2 (N.L)(N.V) - L.V
        lobe, lobe_slope, log = 0.0, 0.0, 0.0
        if mirrored > 0.0:
            lobe = bright * mirrored**exponent
            lobe_slope, log = exponent * lobe / mirrored, np.log(mirrored)
        phong = product * lobe
        lommel = _LOMMEL_SEELIGER / both
        spread = diffuse * (1.0 - lam + lam * lommel)
        own = product * spread + (1.0 - kappa) * shine + kappa * phong
        b[TOTAL, k] += area * own
        if not with_slopes:
            continue
        slope = (secant2 * steepness - 2.0) * secant2 * glint * 2.0 * both * inverse_half2
        slope *= glint_attenuation
        edge = 4.0 * inverse_half2 * glint if limited else 0.0
        glint_by_lit = slope + edge * (lower + (both if lit < seen else 0.0))
        glint_by_seen = slope + edge * (lower + (0.0 if lit < seen else both))
        steady = spread + kappa * (lobe + 2.0 * product * lobe_slope)
        thinner = diffuse * lam * lommel * product / both
        by_lit = area * (seen * steady - thinner + (1.0 - kappa) * glint_by_lit)
        by_seen = area * (lit * steady - thinner + (1.0 - kappa) * glint_by_seen)
        b[OWN_IN_FULL, k] = whole * own
        b[OWN_BY_LIT, k], b[OWN_BY_SEEN, k] = by_lit, by_seen
        b[BY_LIT, k], b[BY_SEEN, k] = b[BY_LIT, k] + by_lit * nx, b[BY_SEEN, k] + by_seen * nx
        b[BY_LIT + 1, k] += by_lit * ny
        b[BY_LIT + 2, k] += by_lit * nz
        b[BY_SEEN + 1, k] += by_seen * ny
        b[BY_SEEN + 2, k] += by_seen * nz
        # parts of the specular light, for derivatives by material and law
        of_glint, of_lobe = area * (1.0 - kappa) * shine, area * kappa * phong
        excess = (1.0 - secant2) * steepness
        power = (1.0 if limited else 2.0) + excess - steepness
        b[OWN, k] = of_glint + of_lobe
        b[SHINE, k] += of_glint + of_lobe
        b[BY_SLOPE, k] -= 2.0 * ((1.0 + excess) * of_glint + (1.0 + exponent * log) * of_lobe)
        b[BY_REFLECTANCE, k] += of_glint * specular[1, k] + of_lobe * (1.0 - f0)
        b[BY_HALF2, k] += of_glint * (power * inverse_half2 + specular[2, k])
        b[BY_HALF2, k] -= 0.5 * area * kappa * product * lobe_slope
        b[BY_PHONG_SHARE, k] += area * (phong - shine)
        b[BY_LOMMEL_SEELIGER_SHARE, k] += area * diffuse * product * (lommel - 1.0)
