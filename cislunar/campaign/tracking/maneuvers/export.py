"""Maneuvers of a cell for other tools."""

from typing import Literal

import numpy as np
import xarray as xr

from cislunar.campaign.tracking.records import frame_of, recorded_names
from cislunar.exchange.ocm import Maneuver

_PROBABLE = 0.5
"""Probability from which on an estimated maneuver is exported."""


def cell_maneuvers(
    cell: xr.Dataset,
    sun: xr.Dataset,
    which: Literal["true", "estimated"] = "true",
    *,
    seed: int = 0,
) -> dict[str, list[Maneuver]]:
    """Maneuvers of a cell by the names of the targets, to be written by `cislunar.exchange`.

    Parameters
    ----------
    cell, sun : xarray.Dataset
        A cell and its ``ephemeris/sun.nc``. True maneuvers need the truth in `task2.record`,
        estimated ones `task2.maneuver_detection.recover`.
    which : {"true", "estimated"}
    seed : int
        Index of the realization.

    Returns
    -------
    dict of str to list of Maneuver
        In order of time, with the basis "SIMULATED" or "DETERMINED"; targets without maneuvers are
        left out. Estimated ones have a probability of at least 0.5, and the standard deviations of
        their magnitude and direction.
    """
    prefix = "maneuver" if which == "true" else "recovered"
    if f"{prefix}_seed" not in cell:
        return {}
    own = {name: cell[f"{prefix}_{name}"].values for name in ("seed", "target", "velocity")}
    sigma = np.full((own["seed"].size, 2), np.nan)
    if which == "true":
        chosen = own["seed"] == seed
        start, duration = cell["maneuver_start"].values, cell["maneuver_duration"].values
    else:
        chosen = (own["seed"] == seed) & (cell["recovered_probability"].values >= _PROBABLE)
        start, duration = cell["recovered_time"].values, np.zeros(own["seed"].size)
        size = np.linalg.norm(own["velocity"], axis=1)
        way = own["velocity"] / size[:, None]
        covariance = cell["recovered_covariance"].values
        along = np.einsum("mi,mij,mj->m", way, covariance, way)
        # of each of the two components across
        across = 0.5 * (np.trace(covariance, axis1=1, axis2=2) - along)
        sigma = np.sqrt(np.column_stack([along, across])) / size[:, None]
        sigma *= 100.0, np.rad2deg(1.0)
    rows = np.flatnonzero(chosen)
    rows = rows[np.argsort(start[rows], kind="stable")]
    frame, found = frame_of(cell, sun), {}
    # over a burn, the rotating frame is that of its middle
    axes = frame.to_icrf(start[rows] + 0.5 * duration[rows])
    changes = np.einsum("mij,mj->mi", axes, 1e-3 * own["velocity"][rows])
    names = np.array(recorded_names(cell))[own["target"][rows]]
    columns = names, frame.tdb_s(start[rows]), changes, duration[rows], sigma[rows]
    basis = "SIMULATED" if which == "true" else "DETERMINED"
    for name, tdb_s, change, length, deviations in zip(*columns, strict=True):
        several = found.setdefault(str(name), [])
        number = str(len(several) + 1)
        given = number, float(tdb_s), change, float(length), *map(float, deviations), basis
        several.append(Maneuver(*given))
    return found
