"""Tracks of orbits, satellites and moving targets, in kilometers and thinned for a page."""

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from cislunar.constants import SECONDS_PER_DAY
from cislunar.dynamics.cr3bp import CR3BP
from cislunar.dynamics.propagation import propagate, propagate_periodic

Array = NDArray[np.float64]

_SECONDS_PER_HOUR = SECONDS_PER_DAY / 24.0
_FINE = 1024


def evenly_seen(curve: ArrayLike, samples: int) -> Array:
    """Places along a curve, denser where it bends.

    Half of the samples are spread over its length, half over the angle it turns through, so that
    a close pass by a body keeps its shape.

    Parameters
    ----------
    curve : array_like, shape (n, 3)
        Points of the curve.
    samples : int
        Places wanted.

    Returns
    -------
    ndarray, shape (samples,)
        Fractional row numbers from 0 to n - 1.
    """
    steps = np.diff(np.asarray(curve, dtype=float), axis=0)
    length = np.linalg.norm(steps, axis=1)
    unit = steps / np.maximum(length, np.finfo(float).tiny)[:, None]
    turn = np.arccos(np.clip(np.sum(unit[1:] * unit[:-1], axis=1), -1.0, 1.0))
    # The turn at a point is shared by the two steps that meet there.
    bend = np.zeros(len(length))
    bend[1:] += 0.5 * turn
    bend[:-1] += 0.5 * turn
    share = sum(part / part.sum() if part.sum() > 0.0 else 0.0 for part in (length, bend))
    passed = np.concatenate(([0.0], np.cumsum(share)))
    return np.interp(np.linspace(0.0, passed[-1], samples), passed, np.arange(len(passed)))


def orbit_track_km(orbits: xr.Dataset, index: int, samples: int) -> Array:
    """One period of an orbit in few points, each of them exact.

    Parameters
    ----------
    orbits : xarray.Dataset
        ``orbits/families.nc``.
    index : int
        Row of the orbit.
    samples : int
        Points; the last is the first.

    Returns
    -------
    ndarray, shape (samples, 3)
        Rotating frame, km.
    """
    state, period = orbits["state"].values[index], float(orbits["period"].values[index])
    mu = float(orbits.attrs["mu"])
    times = np.linspace(-0.5, 0.5, _FINE + 1) * period
    fine = propagate_periodic(state, period, times, mu=mu)[:, :3]
    at = np.interp(evenly_seen(fine, samples), np.arange(_FINE + 1), times)
    track = propagate_periodic(state, period, at, mu=mu)[:, :3]
    track[-1] = track[0]
    return track * float(orbits.attrs["length_unit_km"])


def satellite_tracks_km(orbits: xr.Dataset, index: int, satellites: int, hours: ArrayLike) -> Array:
    """Satellites of an orbit, equally spaced in time, at some times.

    Parameters
    ----------
    orbits : xarray.Dataset
        ``orbits/families.nc``.
    index : int
        Row of the orbit.
    satellites : int
        Satellites on it.
    hours : array_like, shape (n_times,)
        Times since the epoch, h.

    Returns
    -------
    ndarray, shape (n_times, satellites, 3)
        Rotating frame, km.
    """
    period = float(orbits["period"].values[index])
    times = _nondimensional(orbits, hours)
    phases = np.arange(satellites) * period / satellites
    states = propagate_periodic(
        orbits["state"].values[index],
        period,
        (times[:, None] + phases).ravel(),
        mu=float(orbits.attrs["mu"]),
    )
    track = states[:, :3].reshape(len(times), satellites, 3)
    return track * float(orbits.attrs["length_unit_km"])


def target_tracks_km(tracked: xr.Dataset, hours: ArrayLike) -> Array:
    """Moving targets at some times.

    Parameters
    ----------
    tracked : xarray.Dataset
        ``orbits/tracked.nc``.
    hours : array_like, shape (n_times,)
        Times since the epoch, ascending, h.

    Returns
    -------
    ndarray, shape (n_times, n_targets, 3)
        Rotating frame, km.
    """
    times, forces = _nondimensional(tracked, hours), CR3BP(float(tracked.attrs["mu"]))
    # Some are not periodic, so all are propagated.
    tracks = [propagate(state, times, forces=forces)[:, :3] for state in tracked["state"].values]
    return np.stack(tracks, axis=1) * float(tracked.attrs["length_unit_km"])


def _nondimensional(orbits: xr.Dataset, hours: ArrayLike) -> Array:
    return np.asarray(hours, dtype=float) * _SECONDS_PER_HOUR / float(orbits.attrs["time_unit_s"])
