"""Effect of each reading of the photometric equations: ``tables/photometry.csv``."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pandas as pd

from cislunar.photometry import apparent_magnitude, icosahedron, returned_light, sphere_magnitude
from cislunar.photometry.materials import IRRADIANCE_LAWS, Material, PhotometryModel
from cislunar.runtime import Array

_PHASE_ANGLES_DEG = (0.0, 30.0, 60.0, 90.0, 120.0)
_INCIDENCES_DEG = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0)
_SPHERES = (0.5, 1.0)
"""Diffuse reflection coefficients of the spheres for comparison."""

RANGE = "range at the limiting magnitude"
BRIGHTER = "brighter with the printed Fresnel term"
RETURNED = "share of the incident light a facet returns"

_RANGE_M = 1e8
_ATTITUDES = 20_000


def photometry_table(
    material: Mapping[str, float], limiting_magnitude: float, seed: int
) -> pd.DataFrame:
    """Rows of ``tables/photometry.csv``, from the configuration key ``task2.material``.

    Columns quantity, angle_deg, model, value, unit. Ranges and brightness are medians over random
    attitudes of the icosahedron of 4 pi m^2, by phase angle; the light returned by a single facet
    stands by angle of incidence. An object is lost at the limiting magnitude.
    """
    surface, rng = Material(**material), np.random.default_rng(seed)
    attitude = rng.normal(size=(_ATTITUDES, 4))
    attitude /= np.linalg.norm(attitude, axis=1)[:, None]
    rows = [
        *_ranges(surface, attitude, limiting_magnitude),
        *_fresnel(surface, attitude),
        *(
            (RETURNED, angle, "sqrt", returned_light(surface, np.deg2rad(angle)), "1")
            for angle in _INCIDENCES_DEG
        ),
    ]
    return pd.DataFrame(rows, columns=["quantity", "angle_deg", "model", "value", "unit"])


def _magnitudes(surface: Material, attitude: Array, phase_deg: float, **model: Any) -> Array:
    """Magnitudes of the icosahedron in the attitudes given, at `_RANGE_M`."""
    phase = np.deg2rad(phase_deg)
    view = np.array([np.cos(phase), np.sin(phase), 0.0])
    return apparent_magnitude(
        attitude, [1.0, 0.0, 0.0], view, _RANGE_M, icosahedron(), surface, PhotometryModel(**model)
    )


def _ranges(surface: Material, attitude: Array, limit: float) -> Iterator[tuple]:
    def in_thousand_km(magnitude: float) -> float:
        return _RANGE_M * 10.0 ** (0.2 * (limit - magnitude)) / 1e6

    for phase in _PHASE_ANGLES_DEG:
        for law in IRRADIANCE_LAWS:
            seen = np.median(_magnitudes(surface, attitude, phase, irradiance=law))
            yield RANGE, phase, f"facets, {law}", in_thousand_km(float(seen)), "1000 km"
        for coefficient in _SPHERES:
            sphere = sphere_magnitude(
                _RANGE_M, np.deg2rad(phase), diffuse_reflection_coefficient=coefficient
            )
            yield RANGE, phase, f"sphere, C_d = {coefficient:g}", in_thousand_km(sphere), "1000 km"


def _fresnel(surface: Material, attitude: Array) -> Iterator[tuple]:
    for phase in _PHASE_ANGLES_DEG:
        root, printed = (
            _magnitudes(surface, attitude, phase, irradiance="4pi", fresnel=form)
            for form in ("sqrt", "printed")
        )
        lit = np.isfinite(root)
        yield BRIGHTER, phase, "printed", float(np.median((root - printed)[lit])), "mag"
