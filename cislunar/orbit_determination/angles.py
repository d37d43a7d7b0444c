"""Measured directions of one or several objects from moving observers, in the propagation frame.

The functions of this package that process measurements take `Angles`. `make_angles` builds them
from directions in the propagation frame of a force model, and `angles_from_table` from a table with
the column names of the Astrometry Data Exchange Standard (ADES).

With `light_time`, a direction points from the observer at the time of detection to the object at
the time at which the light left it. With the range rho, the position r and the inertial velocity v
of the object, and the position o of the observer, the vector between them is, to first order in the
light time tau = rho / c,

    p = r(t) - tau (v + v_o) - o(t),                                                            (1)

where v_o is the velocity of the origin of the propagation frame. Directions relative to catalog
stars refer to the barycenter of the solar system, about which the Earth-Moon barycenter moves at
30 km/s. The second order is below 0.1 m in cislunar space.
"""

from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from cislunar.constants import LENGTH_UNIT_KM, TIME_UNIT_S
from cislunar.detection import read_detections
from cislunar.dynamics import CR3BP, EphemerisForces, pulsating_frame
from cislunar.ephemeris.bodies import BODY_COLUMNS, BodyTable, read_table
from cislunar.errors import ConfigurationError
from cislunar.observation import ARCSECOND, unit_vectors
from cislunar.runtime.arguments import Array, Indices, array_of

LIGHT_SPEED = 299_792.458 * TIME_UNIT_S / LENGTH_UNIT_KM
"""Nondimensional."""

OBSERVER_POSITION_COLUMNS = ("sys", "ctr", "pos1", "pos2", "pos3")
_CENTERS = {"399": "earth", "301": "moon", "3": None}


class Angles(NamedTuple):
    """Measured directions, in order of time.

    Attributes
    ----------
    time : ndarray, shape (row,)
        Nondimensional, since the epoch of the force model.
    observer : ndarray of int, shape (row,)
        Number of the observer.
    observer_position : ndarray, shape (row, 3)
        Positions of the observers, nondimensional, propagation frame.
    direction : ndarray, shape (row, 3)
        Unit vectors from observer to object, propagation frame.
    basis : ndarray, shape (row, 2, 3)
        Unit vectors normal to the direction and to each other, along which errors are given.
    covariance : ndarray, shape (row, 2, 2)
        Of the errors along the basis, rad^2.
    magnitude, magnitude_variance : ndarray, shape (row,)
        mag and mag^2; NaN where unknown.
    sun : ndarray, shape (row, 3)
        Positions of the Sun, nondimensional, propagation frame; NaN where unknown.
    origin_velocity : ndarray, shape (row, 3)
        v_o of equation (1), nondimensional, axes of the propagation frame.
    light_delay : float
        1 / c with the speed of light c, nondimensional; 0 if directions are geometric.
    """

    time: Array
    observer: Indices
    observer_position: Array
    direction: Array
    basis: Array
    covariance: Array
    magnitude: Array
    magnitude_variance: Array
    sun: Array
    origin_velocity: Array
    light_delay: float

    def rows(self, which: ArrayLike) -> "Angles":
        """The rows that an array of indices or a mask selects, in its order."""
        return Angles(*(each[which] for each in self[:-1]), self.light_delay)


def exposure_numbers(angles: Angles) -> Indices:
    """Numbers (row,) of the exposures of detections: equal for equal times and observers."""
    order = np.lexsort((angles.observer, angles.time))
    changes = np.any([np.diff(each[order]) != 0 for each in (angles.time, angles.observer)], axis=0)
    out = np.zeros(order.size, dtype=np.int64)
    out[order[1:]] = np.cumsum(changes)
    return out


def frame_rate(forces: tuple) -> float:
    """Angular rate of the propagation frame of a force model about z, nondimensional: 1 in the
    CR3BP, otherwise 0."""
    return 1.0 if isinstance(forces, CR3BP) else 0.0


def rotate_about_z(vector: ArrayLike, angle: ArrayLike) -> Array:
    """Vectors (..., 3) rotated about z by angles (...), rad, positive from x to y."""
    given = np.asarray(vector, dtype=float)
    x, y, c, s = given[..., 0], given[..., 1], np.cos(angle), np.sin(angle)
    out = np.empty((*np.broadcast_shapes(x.shape, c.shape), 3))
    out[..., 0], out[..., 1], out[..., 2] = c * x - s * y, s * x + c * y, given[..., 2]
    return out


def tangent_basis(direction: ArrayLike) -> Array:
    """Orthonormal vectors along right ascension and declination.

    Parameters
    ----------
    direction : array_like, shape (..., 3)
        Unit vectors.

    Returns
    -------
    ndarray, shape (..., 2, 3)
        At a pole, right ascension is taken as zero.
    """
    unit = np.asarray(direction, dtype=float)
    x, y, z = unit[..., 0], unit[..., 1], unit[..., 2]
    ra = np.arctan2(y, x)
    s, c = np.sin(ra), np.cos(ra)
    out = np.zeros((*unit.shape[:-1], 2, 3))
    out[..., 0, 0], out[..., 0, 1] = -s, c
    out[..., 1, 0], out[..., 1, 1], out[..., 1, 2] = -z * c, -z * s, x * c + y * s
    return out


def make_angles(
    time: ArrayLike,
    observer: ArrayLike,
    observer_position: ArrayLike,
    direction: ArrayLike,
    sigma_rad: ArrayLike,
    *,
    magnitude: ArrayLike = np.nan,
    magnitude_sigma: ArrayLike = 0.1,
    sun: ArrayLike = np.nan,
    light_time: bool = False,
) -> Angles:
    """Measured directions from arrays in the propagation frame.

    Parameters
    ----------
    time : array_like, shape (row,)
        Nondimensional, since the epoch of the force model, in increasing order.
    observer : array_like of int, shape (row,)
    observer_position : array_like, shape (row, 3)
        Positions of the observers, nondimensional, propagation frame.
    direction : array_like, shape (row, 3)
        Vectors of any length from observer to object, propagation frame.
    sigma_rad : array_like, shape () or (row,)
        Standard deviation along each of two perpendicular directions, rad.
    magnitude, magnitude_sigma : array_like, shape () or (row,)
        Magnitudes, NaN where unknown, and their standard deviations, mag.
    sun : array_like, shape (row, 3), optional
        Positions of the Sun, nondimensional, propagation frame, for the limits of brightness.
    light_time : bool
        Whether directions are those of equation (1) with v_o = 0; otherwise they are geometric.

    Returns
    -------
    Angles

    Raises
    ------
    ConfigurationError
        If the shape of an argument is wrong, a value other than a magnitude or a position of the
        Sun is not finite, a direction has no length, a standard deviation is not positive, or the
        times decrease.
    """
    times = array_of("time", time, ("row",))
    n = times.size
    vectors = array_of("direction", direction, (n, 3))
    length = np.linalg.norm(vectors, axis=1)
    sigma = _of_rows("sigma_rad", sigma_rad, n, finite=True)
    brightness = _of_rows("magnitude", magnitude, n)
    noise = _of_rows("magnitude_sigma", magnitude_sigma, n)
    owner = np.asarray(observer)
    if owner.shape != (n,) or owner.dtype.kind not in "iu":
        raise ConfigurationError(f"observer has shape {owner.shape}; give {n} whole numbers")
    for name, right in (
        ("length of direction", length > 0.0),
        ("sigma_rad", sigma > 0.0),
        ("magnitude_sigma", (noise > 0.0) | np.isnan(brightness)),
    ):
        for row in np.flatnonzero(~right)[:1].tolist():
            raise ConfigurationError(f"{name} of row {row} must be positive")
    require_order(times)
    unit = vectors / length[:, None]
    return Angles(
        times,
        owner.astype(np.int64),
        array_of("observer_position", observer_position, (n, 3)),
        unit,
        tangent_basis(unit),
        sigma[:, None, None] ** 2 * np.eye(2),
        brightness,
        noise**2,
        _of_rows("sun", sun, n, 3),
        np.zeros((n, 3)),
        1.0 / LIGHT_SPEED if light_time else 0.0,
    )


def _of_rows(name: str, given: ArrayLike, *shape: int, finite: bool = False) -> Array:
    """An argument that has a value for each row, or one for all."""
    values = array_of(name, given, finite=finite)
    return (
        np.full(shape, values) if values.ndim == 0 else array_of(name, values, shape, finite=False)
    )


def angles_from_table(
    source: str | pd.DataFrame,
    forces: tuple,
    *,
    epoch_tdb: float | None = None,
    bodies: BodyTable | None = None,
    light_time: bool = True,
) -> Angles:
    """Measured directions from a table with the column names of ADES.

    Parameters
    ----------
    source : str, Path or DataFrame
        Columns as in `cislunar.detection.read_detections`, and the position of each observer at
        the time of detection: ``sys`` is "ICRF_KM", ``ctr`` the NAIF number of its center (399
        Earth, 301 Moon, 3 barycenter of both), and ``pos1``, ``pos2`` and ``pos3`` are km.
    forces : NamedTuple
        Force model in whose propagation frame the angles are returned.
    epoch_tdb : float, optional
        Time zero of the CR3BP, TDB seconds past J2000; by default the first detection. Ephemeris
        forces have an epoch.
    bodies : BodyTable, optional
        Positions of Earth, Moon and Sun, required for the CR3BP, whose frame is the pulsating
        frame. Ephemeris forces have a table.
    light_time : bool
        Whether to correct for light time by equation (1); False for geometric directions, such as
        those of a simulation.

    Returns
    -------
    Angles
        Observers are numbered in the alphabetic order of ``stn``.

    Raises
    ------
    ConfigurationError, InputFileError
        If a column is missing, a value is impossible, or the bodies do not cover the times.
    """
    table = read_detections(source)
    missing = [name for name in OBSERVER_POSITION_COLUMNS if name not in table]
    if missing:
        raise ConfigurationError(
            f"detections: columns {', '.join(missing)} are missing; give the observers' positions "
            f"by {', '.join(OBSERVER_POSITION_COLUMNS)}"
        )
    tdb = table["tdb"].to_numpy()
    if isinstance(forces, EphemerisForces):
        bodies, epoch = forces.table, forces.epoch
    elif bodies is None:
        raise ConfigurationError("bodies: the CR3BP needs a table of bodies (tabulate_bodies)")
    else:
        epoch = float(tdb[0]) if epoch_tdb is None else float(epoch_tdb)
    position, velocity, _ = read_table(bodies, tdb)
    centers = table["ctr"].astype(str).to_numpy()
    for row in np.flatnonzero((table["sys"] != "ICRF_KM") | ~np.isin(centers, list(_CENTERS)))[:1]:
        raise ConfigurationError(
            f"detections, row {row + 1}: sys = {table['sys'].iloc[row]} and ctr = {centers[row]} "
            f"must be ICRF_KM and one of {', '.join(_CENTERS)}"
        )
    observer = array_of("pos1, pos2, pos3", table[["pos1", "pos2", "pos3"]].to_numpy())
    for code, body in _CENTERS.items():
        if body is not None:
            observer = observer + np.where(
                (centers == code)[:, None], position[:, BODY_COLUMNS[body]], 0.0
            )
    ra, dec = np.deg2rad(table[["ra", "dec"]].to_numpy()).T
    unit = unit_vectors(ra, dec)
    basis = tangent_basis(unit)
    sun, drift = position[:, BODY_COLUMNS["sun"]], -velocity[:, BODY_COLUMNS["sun"]]
    if isinstance(forces, EphemerisForces):
        observer, sun = observer / LENGTH_UNIT_KM, sun / LENGTH_UNIT_KM
    else:
        frame = pulsating_frame(bodies, tdb)
        offset = np.stack([observer, sun]) - frame.origin[:, :3]
        observer, sun = np.einsum("nij,knj->kni", frame.axes, offset) / frame.length[:, None]
        unit, drift = (np.einsum("nij,nj->ni", frame.axes, each) for each in (unit, drift))
        basis = np.einsum("nij,naj->nai", frame.axes, basis)
    rms = table[["rmsRA", "rmsDec"]].to_numpy() * ARCSECOND
    covariance = rms[:, :, None] * rms[:, None] * np.eye(2)
    covariance[:, 0, 1] = covariance[:, 1, 0] = rms.prod(axis=1) * table["rmsCorr"].to_numpy()
    times = (tdb - epoch) / TIME_UNIT_S
    require_order(times)
    return Angles(
        times,
        np.unique(table["stn"].to_numpy().astype(str), return_inverse=True)[1].astype(np.int64),
        np.ascontiguousarray(observer),
        np.ascontiguousarray(unit),
        np.ascontiguousarray(basis),
        covariance,
        table["mag"].to_numpy(),
        table["rmsMag"].to_numpy() ** 2,
        np.ascontiguousarray(sun),
        drift * TIME_UNIT_S / LENGTH_UNIT_KM,
        1.0 / LIGHT_SPEED if light_time else 0.0,
    )


def require_order(times: Array) -> None:
    """Raise a `ConfigurationError` if the times (row,) of detections are not in order."""
    for row in np.flatnonzero(np.diff(times) < 0.0)[:1].tolist():
        raise ConfigurationError(
            f"time of row {row + 1} is before that of row {row}; sort the rows"
        )
