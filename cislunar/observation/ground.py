"""Positions of observers on the rotating Earth.

The rotation of the Earth is SPICE's frame IAU_EARTH with the constants of the text kernel
pck00010.tpc (Archinal et al. 2011, Celest. Mech. Dyn. Astron. 109, 101, table 1), on the ellipsoid
of the same kernel. It neglects nutation and takes TDB for UT, which displaces a station by some 10
km. Simulations are not affected, since their estimators know the positions of their observers.
"""

import numpy as np
from numpy.typing import ArrayLike

from cislunar.constants import LENGTH_UNIT_KM, MU
from cislunar.dynamics.cr3bp import primary_positions
from cislunar.dynamics.frames import earth_moon_axes
from cislunar.ephemeris.bodies import BODY_COLUMNS, BodyTable, read_table
from cislunar.errors import ConfigurationError
from cislunar.runtime import Array, array_of

_EARTH = 399
_POOL = {
    "BODY399_POLE_RA": (0.0, -0.641, 0.0),
    "BODY399_POLE_DEC": (90.0, -0.557, 0.0),
    "BODY399_PM": (190.147, 360.9856235, 0.0),
}
_RADII_KM = 6378.1366, 6356.7519


def earth_rotation(time: ArrayLike) -> Array:
    """Rotation from J2000 axes to Earth-fixed axes by SPICE at TDB seconds past J2000 (time,),
    shape (time, 3, 3)."""
    import spiceypy

    # constants that the caller has loaded from another kernel take precedence
    for name in [name for name in _POOL if not spiceypy.expool(name)]:
        spiceypy.pdpool(name, _POOL[name])
    return np.array([spiceypy.tipbod("J2000", _EARTH, float(t)) for t in np.ravel(time)])


def station_positions(
    latitude_deg: ArrayLike, longitude_deg: ArrayLike, height_m: ArrayLike
) -> Array:
    """Earth-fixed positions of stations.

    Parameters
    ----------
    latitude_deg, longitude_deg : array_like, shape (station,)
        Geodetic, deg; longitude east.
    height_m : array_like, shape (station,)
        Height above the ellipsoid, m.

    Returns
    -------
    ndarray, shape (station, 3)
        km.

    Raises
    ------
    ConfigurationError
        If a station is not on the globe, or the arrays are not finite or not of the same length.
    """
    given = [array_of("latitude_deg", latitude_deg, ("station",))]
    for name, each in (("longitude_deg", longitude_deg), ("height_m", height_m)):
        given.append(array_of(name, each, given[0].shape))
    import spiceypy

    equatorial, polar = _RADII_KM
    found = []
    for latitude, longitude, height in np.transpose(given).tolist():
        if not (abs(latitude) <= 90.0 and -180.0 <= longitude <= 360.0 and abs(height) < 1e5):
            raise ConfigurationError(
                f"station at latitude_deg = {latitude}, longitude_deg = {longitude}, height_m = "
                f"{height} is not on the globe: give latitudes in [-90, 90], longitudes in "
                "[-180, 360] and heights in m"
            )
        angles = np.deg2rad(longitude), np.deg2rad(latitude)
        flattening = (equatorial - polar) / equatorial
        found.append(spiceypy.georec(*angles, 1e-3 * height, equatorial, flattening))
    return np.array(found)


def station_tracks(
    position_km: ArrayLike, table: BodyTable, time: ArrayLike, *, inertial: bool = False
) -> Array:
    """Positions of stations on the rotating Earth.

    Parameters
    ----------
    position_km : array_like, shape (station, 3)
        Earth-fixed positions, see `station_positions`.
    table : BodyTable
        Ephemeris of Earth and Moon, which defines the rotating frame.
    time : array_like, shape (time,)
        TDB seconds past J2000.
    inertial : bool
        True for the barycentric frame with J2000 axes; otherwise the rotating frame, about the
        Earth of the CR3BP.

    Returns
    -------
    ndarray, shape (station, time, 3)
        Nondimensional.

    Raises
    ------
    ConfigurationError
        If a time lies outside of the table.
    """
    times = np.asarray(time, dtype=float)
    fixed = np.asarray(position_km, dtype=float)
    out = np.einsum("tji,sj->sti", earth_rotation(times), fixed) / LENGTH_UNIT_KM
    position, velocity, _ = read_table(table, times)
    if inertial:
        return out + position[:, BODY_COLUMNS["earth"]] / LENGTH_UNIT_KM
    axes = earth_moon_axes(position, velocity)
    return np.einsum("tij,stj->sti", axes, out) + np.array(primary_positions(MU)[0])
