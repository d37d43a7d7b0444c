"""Curves of orbits, and tracks of satellites and moving targets, in the rotating frame."""

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from cislunar.constants import SECONDS_PER_DAY
from cislunar.dynamics import CR3BP, propagate_many, propagate_periodic
from cislunar.figures.axes import Array

_SECONDS_PER_HOUR = SECONDS_PER_DAY / 24.0


def evenly_seen(curve: ArrayLike, samples: int) -> Array:
    """Positions along a curve (n, 3) as fractional row numbers, closer where it bends.

    Half of the samples are distributed by length and half by the angle of the bends, so that a
    close pass of a body keeps its shape.
    """
    steps = np.diff(np.asarray(curve, dtype=float), axis=0)
    length = np.linalg.norm(steps, axis=1)
    unit = steps / np.maximum(length, np.finfo(float).tiny)[:, None]
    turn = np.arccos(np.clip(np.sum(unit[1:] * unit[:-1], axis=1), -1.0, 1.0))
    # the angle at a point is divided between the two steps that meet there
    bend = np.zeros(len(length))
    bend[1:] += 0.5 * turn
    bend[:-1] += 0.5 * turn
    share = sum(part / part.sum() if part.sum() > 0.0 else 0.0 for part in (length, bend))
    passed = np.concatenate(([0.0], np.cumsum(share)))
    return np.interp(np.linspace(0.0, passed[-1], samples), passed, np.arange(len(passed)))


def orbit_curve(orbits: xr.Dataset, index: int, samples: int = 241) -> Array:
    """One period of an orbit at equal steps of arc length, shape (samples, 3), nondimensional."""
    times = np.linspace(-0.5, 0.5, 2049) * float(orbits["period"].values[index])
    once = _positions(orbits, index, times[:-1])
    fine = np.vstack((once, once[:1]))
    arc = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(fine, axis=0), axis=1))))
    at = np.linspace(0.0, arc[-1], samples)
    return np.column_stack([np.interp(at, arc, fine[:, axis]) for axis in range(3)])


def orbit_track_km(orbits: xr.Dataset, index: int, samples: int) -> Array:
    """One period of an orbit in few exact points, closed, shape (samples, 3), km."""
    times = np.linspace(-0.5, 0.5, 1025) * float(orbits["period"].values[index])
    fine = _positions(orbits, index, times)
    at = np.interp(evenly_seen(fine, samples), np.arange(len(times)), times)
    track = _positions(orbits, index, at)
    track[-1] = track[0]
    return track * float(orbits.attrs["length_unit_km"])


def satellite_tracks(
    orbits: xr.Dataset, index: int, satellites: int, hours: ArrayLike = 0.0, phase: float = 0.0
) -> Array:
    """Satellites of the orbit in a row of ``orbits/families.nc``, equally spaced in time.

    Positions at `hours` since the epoch, shape (...), have shape (..., satellites, 3) and are
    nondimensional. All satellites are ahead by `phase`, a share of the period.
    """
    period = float(orbits["period"].values[index])
    phases = phase * period + np.arange(satellites) * period / satellites
    times = _nondimensional(orbits, hours)[..., None] + phases
    return _positions(orbits, index, times.ravel()).reshape(*times.shape, 3)


def target_tracks_km(tracked: xr.Dataset, hours: ArrayLike) -> Array:
    """Moving targets at ascending times since the epoch, shape (n_times, n_targets, 3), km."""
    times, forces = _nondimensional(tracked, hours), CR3BP(float(tracked.attrs["mu"]))
    # some are not periodic, so all are propagated
    tracks = propagate_many(tracked["state"].values, times, forces=forces)[..., :3]
    return np.moveaxis(tracks, 0, 1) * float(tracked.attrs["length_unit_km"])


def _positions(orbits: xr.Dataset, index: int, times: Array) -> Array:
    """Positions on an orbit at given times, shape (n_times, 3), nondimensional."""
    state, period = orbits["state"].values[index], float(orbits["period"].values[index])
    return propagate_periodic(state, period, times, mu=float(orbits.attrs["mu"]))[:, :3]


def _nondimensional(orbits: xr.Dataset, hours: ArrayLike) -> Array:
    return np.asarray(hours, dtype=float) * _SECONDS_PER_HOUR / float(orbits.attrs["time_unit_s"])
