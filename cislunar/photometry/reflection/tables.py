"""Tables of a bidirectional reflectance distribution function (BRDF), and their files.

A file is a comma-separated table in UTF-8 with a row for each combination of angles, in any order,
or a NetCDF file with a variable ``brdf_per_sr`` over the same angles as coordinates:

=================  ===========================================================================
column             contents
=================  ===========================================================================
``incidence_deg``  angle between the normal and the Sun, from 0 to 90
``emission_deg``   angle between the normal and the observer, from 0 to 90
``azimuth_deg``    optional; angle between the planes of incidence and emission, from 0 (the
                   observer on the side of the Sun) to 180; the reflectance is symmetric about
                   the plane of incidence
``brdf_per_sr``    reflected radiance divided by the irradiance of the facet, sr^-1
=================  ===========================================================================
"""

from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cislunar.errors import InputFileError
from cislunar.exchange.table_rows import named_rows, row_numbers
from cislunar.runtime import Array

_ANGLES = {"incidence_deg": 90.0, "emission_deg": 90.0, "azimuth_deg": 180.0}
"""Last angle of each axis; the first one is 0."""

_VALUES = "brdf_per_sr"


class ReflectanceTable(NamedTuple):
    """A tabulated BRDF, in the layout of the kernels.

    Attributes
    ----------
    incidence, emission, azimuth : ndarray, shapes (n,), (m,) and (k,)
        Cosines of the angles, decreasing from 1. One azimuth stands for all.
    values : ndarray, shape (n, m, k)
        pi times the BRDF, dimensionless; 1 for a white Lambertian surface.
    """

    incidence: Array
    emission: Array
    azimuth: Array
    values: Array


NO_TABLE = ReflectanceTable(*(np.empty(0) for _ in range(3)), np.empty((0, 0, 0)))
"""The table of a body that follows no tabulated law."""


def load_reflectance_table(path: str | Path) -> ReflectanceTable:
    """Read a tabulated BRDF.

    Parameters
    ----------
    path : str or Path
        ``.csv`` or ``.nc``; see the module.

    Returns
    -------
    ReflectanceTable

    Raises
    ------
    InputFileError
        If the file cannot be read, a combination of angles is missing or occurs twice, a value is
        negative, the angles do not reach from 0 to 90 (azimuth 180) degrees, or the reflectance
        depends on the azimuth where a direction is along the normal.
    """
    place = Path(path)
    if not place.is_file():
        raise InputFileError(f"{place}: there is no such table of a reflection law")
    return _loaded(str(path), place.stat().st_mtime_ns)


@lru_cache(maxsize=16)
def _loaded(path: str, _changed: int) -> ReflectanceTable:
    """The table of a file; the cache depends on its time, `_changed`."""
    angles, values = (_of_netcdf if path.lower().endswith(".nc") else _of_csv)(path)
    for (name, last), found in zip(_ANGLES.items(), angles, strict=True):
        if found.size > 1 and (found[0] != 0.0 or found[-1] != last):
            raise InputFileError(
                f"{path}: {name} reaches from {found[0]:g} to {found[-1]:g}; give it from 0 to "
                f"{last:g}"
            )
        if found.size == 1 and name != "azimuth_deg":
            raise InputFileError(f"{path}: {name} has one value; give it from 0 to {last:g}")
    wrong = np.argwhere(~(values >= 0.0) | ~np.isfinite(values))
    if wrong.size:
        place = ", ".join(
            f"{name} = {each[i]:g}" for name, each, i in zip(_ANGLES, angles, wrong[0], strict=True)
        )
        value = values[tuple(wrong[0])]
        raise InputFileError(
            f"{path}: no {_VALUES} at {place}; complete the table"
            if np.isnan(value)
            else f"{path}: {_VALUES} = {value:g} at {place} must be a number, at least 0"
        )
    for name, along in zip(_ANGLES, (values[0], values[:, 0]), strict=False):
        if np.ptp(along, axis=-1).max() > 1e-6 * values.max():
            raise InputFileError(
                f"{path}: {_VALUES} depends on azimuth_deg at {name} = 0, where no azimuth "
                "exists; give the mean"
            )
    # the cosine of 90 degrees is exactly zero
    cosines = [np.where(each == 90.0, 0.0, np.cos(np.deg2rad(each))) for each in angles]
    return ReflectanceTable(*cosines, np.ascontiguousarray(np.pi * values))


def _of_csv(path: str) -> tuple[list[Array], Array]:
    """Angles, increasing, and values (n, m, k) of a comma-separated table; NaN in gaps."""
    header, rows = named_rows(path, "angle", "incidence_deg", ("emission_deg", _VALUES))
    columns = (*(name for name in _ANGLES if name in header), _VALUES)
    table = np.array([row_numbers(place, row, (columns, 1.0)) for place, row in rows])
    if len(columns) == 3:
        table = np.insert(table, 2, 0.0, axis=1)
    found = [np.unique(column, return_inverse=True) for column in table[:, :3].T]
    values = np.full([angles.size for angles, _ in found], np.nan)
    for (place, _), *index, value in zip(
        rows, *(each for _, each in found), table[:, 3], strict=True
    ):
        if np.isfinite(values[tuple(index)]):
            raise InputFileError(f"{place}: these angles occur twice; remove one row")
        values[tuple(index)] = value
    return [angles for angles, _ in found], values


def _of_netcdf(path: str) -> tuple[list[Array], Array]:
    """As `_of_csv`, of a NetCDF file."""
    import xarray as xr  # slow to import

    try:
        with xr.open_dataset(path) as file:
            values = file[_VALUES].load()
    except (OSError, ValueError, KeyError) as error:
        raise InputFileError(f"{path}: no {_VALUES} can be read ({error})") from None
    if "azimuth_deg" not in values.dims:
        values = values.expand_dims(azimuth_deg=[0.0])
    if set(values.dims) != set(_ANGLES) or not set(_ANGLES) <= set(values.coords):
        raise InputFileError(
            f"{path}: {_VALUES} has the dimensions {', '.join(map(str, values.dims))}; give "
            f"{', '.join(_ANGLES)}, each with a coordinate"
        )
    values = values.sortby(list(_ANGLES)).transpose(*_ANGLES)
    angles = [np.asarray(values[name].values, dtype=float) for name in _ANGLES]
    return angles, np.asarray(values.values, dtype=float)
