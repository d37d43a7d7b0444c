"""Characterization of objects from light curves, compared with the truth.

The estimates are those of `cislunar.estimation.light_curves.model_selection`. The truth of the
amplitude and of area times albedo is evaluated at the times and in the geometry of the same rows,
without noise.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.attitude.quaternion import attitude_matrix
from cislunar.estimation.light_curves.model_selection.characterization import (
    Characterization,
    amplitude_of,
    area_albedo_of,
)
from cislunar.estimation.light_curves.row_blocks import RANGE, SUN, VIEW
from cislunar.observation.target_surfaces import TargetSurfaces, body_of
from cislunar.photometry.bodies import apparent_body_magnitude
from cislunar.photometry.materials import PhotometryModel
from cislunar.runtime import Array

INTERVAL_PARTS = ("estimate", "low", "high")
"""An estimate, and the ends of its 95 % interval."""


class CharacterizedTargets(NamedTuple):
    """Characterization of all targets; arrays, NaN where there is no light curve.

    Attributes
    ----------
    spin_period, amplitude, area_albedo : ndarray, shape (target, 3)
        `INTERVAL_PARTS` in h, mag and m^2, see `Characterization`.
    spin_axis : ndarray, shape (target, 3)
        Estimated unit vector, inertial frame.
    spin_axis_radius : ndarray, shape (target,)
        Angle from it within which the axis lies with 95 %, deg.
    true_spin_period, true_amplitude, true_area_albedo : ndarray, shape (target,)
        Truth, in the same units.
    true_spin_axis : ndarray, shape (target, 3)
        Truth, inertial frame.
    """

    spin_period: Array
    spin_axis: Array
    spin_axis_radius: Array
    amplitude: Array
    area_albedo: Array
    true_spin_period: Array
    true_spin_axis: Array
    true_amplitude: Array
    true_area_albedo: Array


class _Field(NamedTuple):
    """A field of `CharacterizedTargets`: dimensions after that of the targets, unit, meaning."""

    dims: tuple[str, ...]
    unit: str
    meaning: str


_INTERVAL, _AXIS = ("interval_part",), ("inertial_axis",)
_MEANINGS = {
    "spin_period": "spin period at the epoch, 2 pi over the angular velocity",
    "spin_axis": "direction of the angular velocity at the epoch, inertial frame",
    "amplitude": (
        "amplitude of the light curve, from the 5th to the 95th percentile of its magnitudes, "
        "reduced to one range and by the phase function of a diffuse sphere"
    ),
    "area_albedo": "cross-section times albedo of the diffuse sphere that is as bright on average",
}

CHARACTERIZED_FIELDS = {
    "spin_period": _Field(_INTERVAL, "h", f"estimated {_MEANINGS['spin_period']}"),
    "spin_axis": _Field(_AXIS, "1", f"estimated {_MEANINGS['spin_axis']}"),
    "spin_axis_radius": _Field(
        (), "degree", "angle from spin_axis within which the axis lies with 95 %"
    ),
    "amplitude": _Field(_INTERVAL, "mag", f"estimated {_MEANINGS['amplitude']}"),
    "area_albedo": _Field(_INTERVAL, "m2", f"estimated {_MEANINGS['area_albedo']}"),
    "true_spin_period": _Field((), "h", f"true {_MEANINGS['spin_period']}"),
    "true_spin_axis": _Field(_AXIS, "1", f"true {_MEANINGS['spin_axis']}"),
    "true_amplitude": _Field((), "mag", f"true {_MEANINGS['amplitude']}, without noise"),
    "true_area_albedo": _Field((), "m2", f"true {_MEANINGS['area_albedo']}, without noise"),
}
"""The fields of `CharacterizedTargets` in a data set."""


def characterized_targets(
    found: Sequence[Characterization | None],
    light_curves: Sequence[Array],
    attitudes: Sequence[Array],
    quaternion: Array,
    omega: Array,
    surfaces: TargetSurfaces,
) -> CharacterizedTargets:
    """Estimates of all targets, compared with the truth.

    Parameters
    ----------
    found : sequence of Characterization or None
        Estimate of each target; None without any.
    light_curves : sequence of ndarray, shape (row, ROW_COLUMNS)
        The light curves that were characterized, see
        `cislunar.estimation.light_curves.light_curve.cost`.
    attitudes : sequence of ndarray, shape (row, 4)
        True attitudes at the times of their rows, inertial frame to body frame.
    quaternion, omega : ndarray, shapes (target, 4) and (target, 3)
        True attitudes, and angular velocities (rad/s, body frame) at the epoch.
    surfaces : TargetSurfaces
        True shapes and materials.
    """
    count = len(found)
    shapes = [(count, *(3,) * len(each.dims)) for each in CHARACTERIZED_FIELDS.values()]
    out = CharacterizedTargets(*(np.full(shape, np.nan) for shape in shapes))
    for j, (each, data, attitude) in enumerate(zip(found, light_curves, attitudes, strict=True)):
        rate = np.linalg.norm(omega[j])
        out.true_spin_period[j] = 2.0 * np.pi / rate / 3600.0
        out.true_spin_axis[j] = attitude_matrix(quaternion[j]).T @ omega[j] / rate
        if each is None:
            continue
        out.spin_period[j], out.amplitude[j] = each.spin_period_h, each.amplitude_mag
        out.area_albedo[j], out.spin_axis[j] = each.area_albedo_m2, each.spin_axis
        out.spin_axis_radius[j] = each.spin_axis_radius_deg
        magnitude = _true_magnitudes(j, data, attitude, surfaces)
        out.true_amplitude[j] = amplitude_of(magnitude, data, surfaces.irradiance_4pi)
        out.true_area_albedo[j] = area_albedo_of(magnitude, data, surfaces.irradiance_4pi)
    return out


def _true_magnitudes(j: int, data: Array, attitude: Array, surfaces: TargetSurfaces) -> Array:
    """Magnitudes of target j without noise in the geometry of a light curve."""
    model = PhotometryModel(
        irradiance="4pi" if surfaces.irradiance_4pi else None,
        fresnel="sqrt" if surfaces.fresnel_sqrt else "printed",
    )
    geometry = attitude, data[:, SUN], data[:, VIEW], data[:, RANGE]
    return apparent_body_magnitude(*geometry, body_of(surfaces, j), model)


def within_intervals(found: CharacterizedTargets) -> dict[str, NDArray[np.bool_]]:
    """Whether the truth lies within the 95 % interval, by quantity; shape (target,)."""
    inside = {
        name: (interval[..., 1] <= true) & (true <= interval[..., 2])
        for name, interval, true in (
            ("spin_period", found.spin_period, found.true_spin_period),
            ("amplitude", found.amplitude, found.true_amplitude),
            ("area_albedo", found.area_albedo, found.true_area_albedo),
        )
    }
    inside["spin_axis"] = spin_axis_error_deg(found) <= found.spin_axis_radius
    return inside


def spin_axis_error_deg(found: CharacterizedTargets) -> Array:
    """Angle between true and estimated spin axis, deg; shape (target,)."""
    cosine = np.sum(found.spin_axis * found.true_spin_axis, axis=-1)
    return np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0)))
