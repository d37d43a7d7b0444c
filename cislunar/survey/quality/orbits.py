"""Quality of a catalog against the truth: completeness, purity, wrong orbits and consistency.

Only this package and the simulation of a survey read the origins of detections.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.special import chdtri

from cislunar.constants import LENGTH_UNIT_KM
from cislunar.detection import FALSE_ALARM
from cislunar.dynamics import EARTH_MOON
from cislunar.errors import ConfigurationError
from cislunar.orbit_determination import (
    Angles,
    Attributables,
    LinkedOrbits,
    OrbitFits,
    OrbitStates,
    orbits_at,
    squared_distances,
)
from cislunar.runtime import Array, Flags, Indices
from cislunar.survey.settings import QualitySettings

_NEAR = 1e-6
"""Largest difference of an epoch from a time of the truth, in steps."""

_LARGEST_NEES = float(chdtri(6, 0.05))
"""95th percentile of chi squared with six degrees of freedom."""

ORBIT_COLUMNS = (
    "day", "confirmed", "verdict", "object", "detections", "right_detections", "observers",
    "error_km", "sigma_km", "nees", "now_km", "now_nees", "averaged_nees",
)  # fmt: skip


class CatalogState(NamedTuple):
    """Quality at one time. Shares are NaN if there is nothing to divide by.

    Attributes
    ----------
    day : float
        Time since the start.
    objects, detected, findable : int
        Objects in the truth, those with a detection, and those with enough tracklets.
    confirmed, right, wrong, false, duplicate : int
        Confirmed orbits; those of one object with a small error, one for each object; those of an
        object with a large error, or of several with equally many detections; those most of whose
        detections are false alarms; further orbits with a small error of an object that has a
        correct one.
    candidates : int
        Orbits that are not confirmed.
    linked : int
        Findable objects of which an orbit, confirmed or not, has most of its detections.
    completeness : float
        Correct confirmed orbits of findable objects over findable objects.
    completeness_all : float
        Correct confirmed orbits over all objects.
    completeness_inside, completeness_outside : float
        `completeness` of the objects that are on orbits of the families, and of those outside.
    completeness_all_inside, completeness_all_outside : float
        The same for `completeness_all`.
    purity : float
        Share of the detections in confirmed orbits that are of the object that most are of.
    nees : float
        Mean normalized estimation error squared of the correct confirmed orbits and of duplicates;
        6 if consistent.
    covered : float
        Share of them whose true state is within the region of 95 % of their covariance.
    nees_averaged, covered_averaged : float
        `nees` and `covered`, of the same orbits, by states and covariances that allow for
        undetected maneuvers (`cislunar.survey.maneuvers.OrbitsWithManeuvers`).
    median_error_km : float
        Median position error of the correct confirmed orbits and of duplicates.
    completeness_maneuvering : float
        `completeness` of the objects that have maneuvered so far.
    custody : float
        Findable objects with a confirmed orbit whose position error now is at most
        `QualitySettings.custody_km`, over findable objects.
    nees_now : float
        Mean normalized estimation error squared, now, of confirmed orbits with an error of at most
        `QualitySettings.right_km`; 6 if consistent.
    nees_ballistic, nees_now_ballistic : float
        The same for the objects that have not maneuvered so far.
    error_known_km : float
        Geometric mean over the known objects (`QualitySettings.known_days`) of the position error
        of their confirmed orbit now. An object without such an orbit, or with a larger error,
        counts with `QualitySettings.right_km`, so that losing objects does not lower the mean.
    """

    day: float
    objects: int
    detected: int
    findable: int
    confirmed: int
    right: int
    wrong: int
    false: int
    duplicate: int
    candidates: int
    linked: int
    completeness: float
    completeness_all: float
    completeness_inside: float
    completeness_outside: float
    completeness_all_inside: float
    completeness_all_outside: float
    purity: float
    nees: float
    covered: float
    nees_averaged: float
    covered_averaged: float
    median_error_km: float
    completeness_maneuvering: float
    custody: float
    nees_now: float
    nees_ballistic: float
    nees_now_ballistic: float
    error_known_km: float


def orbit_table(
    orbits: LinkedOrbits,
    angles: Angles,
    origin: ArrayLike,
    truth: Callable[[Indices, Indices], Array],
    last: int,
    step: float,
    day: float,
    forces: tuple = EARTH_MOON,
    radiation_sigma: float = 0.0,
    averaged: OrbitFits | None = None,
) -> pd.DataFrame:
    """Linked orbits and the objects that they are of.

    Parameters
    ----------
    orbits : LinkedOrbits
    angles : Angles
        Detections, to whose rows the orbits refer.
    origin : array_like of int, shape (row,)
        Object of each detection, or `FALSE_ALARM`.
    truth : callable
        Returns the true states (row, 6), nondimensional, propagation frame, of objects (row,) at
        indices of times (row,).
    last : int
        Index of the time of the table.
    step : float
        Time between two indices, nondimensional.
    day : float
        Time of the table.
    forces : NamedTuple
        Assumed force model, by which confirmed orbits are propagated to the time of the table.
    radiation_sigma : float
        Assumed standard deviation of the factor of the radiation pressure on an object.
    averaged : OrbitFits, optional
        The same orbits with states and covariances that allow for undetected maneuvers; those of
        `orbits` if omitted.

    Returns
    -------
    DataFrame
        Columns `ORBIT_COLUMNS`; `object` is that of most detections, or `FALSE_ALARM`. `now_km` and
        `now_nees` are NaN for orbits that are not confirmed. If several objects have equally many
        detections, `object` is the first of them, and all errors are NaN.

    Raises
    ------
    ConfigurationError
        If the epoch of an orbit is not a multiple of the step.
    """
    given, rows, fits = np.asarray(origin), [], orbits.fits
    index = np.rint(fits.epoch / step)
    for k in np.flatnonzero(np.abs(fits.epoch / step - index) > _NEAR)[:1].tolist():
        raise ConfigurationError(
            f"orbits: the epoch of orbit {k} is no time of the truth; give multiples of the step"
        )
    averaged = fits if averaged is None else averaged
    confirmed = np.flatnonzero(orbits.confirmed)
    starts = OrbitStates.of(fits.take(confirmed))
    moved, kept = orbits_at(starts, last * step, forces, radiation_sigma)
    present = dict(
        zip(confirmed[kept].tolist(), zip(moved.state, moved.covariance, strict=True), strict=True)
    )
    owners = [owner_of(given[orbits.detections(k)]) for k in range(orbits.log_ratio.size)]
    real = [k for k, (main, _, alone) in enumerate(owners) if alone and main != FALSE_ALARM]
    of = np.array([owners[k][0] for k in real], dtype=np.int64)
    then = truth(of, index[real].astype(np.int64))
    true = dict(zip(real, zip(then, truth(of, np.full(of.size, last)), strict=True), strict=True))
    for k, (main, right, _) in enumerate(owners):
        own = orbits.detections(k)
        error = nees = now_km = now_nees = averaged_nees = np.nan
        covariance = fits.covariance[k]
        if k in true:
            miss = true[k][0] - fits.state[k]
            error = float(np.linalg.norm(miss[:3])) * LENGTH_UNIT_KM
            nees = _nees(miss, covariance)
            averaged_nees = _nees(true[k][0] - averaged.state[k], averaged.covariance[k])
            if k in present:
                off = true[k][1] - present[k][0]
                now_km = float(np.linalg.norm(off[:3])) * LENGTH_UNIT_KM
                now_nees = _nees(off, present[k][1])
        sigma = float(np.sqrt(np.trace(covariance[:3, :3]))) * LENGTH_UNIT_KM
        rows.append(
            (day, bool(orbits.confirmed[k]), orbits.verdict[k], main, own.size, right,
             np.unique(angles.observer[own]).size, error, sigma, nees,
             now_km, now_nees, averaged_nees)
        )  # fmt: skip
    # with the types of the columns, if there are no orbits
    return pd.DataFrame(rows, columns=list(ORBIT_COLUMNS)).astype(
        {"confirmed": bool, "object": np.int64, "error_km": float}
    )


def _nees(miss: Array, covariance: Array) -> float:
    return float(squared_distances(miss[None], covariance[None])[0])


def owner_of(origin: Indices) -> tuple[int, int, bool]:
    """The object, or `FALSE_ALARM`, that most detections of an orbit are of, their number, and
    whether there is one such object."""
    names, counts = np.unique(origin, return_counts=True)
    return (
        int(names[np.argmax(counts)]),
        int(counts.max()),
        np.count_nonzero(counts == counts.max()) == 1,
    )


def true_tracklets(tracklets: Attributables, origin: ArrayLike, n_objects: int) -> Indices:
    """Number of tracklets (object,) all of whose detections are of one object; tracklets that share
    detections count once."""
    given, count, used = np.asarray(origin), np.zeros(n_objects, dtype=np.int64), set()
    for rows in tracklets.detections:
        main = int(given[rows[0]])
        if main == FALSE_ALARM or np.any(given[rows] != main) or used & set(rows.tolist()):
            continue
        used.update(rows.tolist())
        count[main] += 1
    return count


def right_objects(table: pd.DataFrame, settings: QualitySettings) -> Indices:
    """Objects with a correct confirmed orbit in a table (`orbit_table`), in increasing order."""
    real = table[table["confirmed"] & (table["object"] != FALSE_ALARM)]
    return np.unique(real.loc[real["error_km"] <= settings.right_km, "object"].to_numpy(np.int64))


def catalog_state(
    table: pd.DataFrame,
    origin: ArrayLike,
    tracklets: Indices,
    settings: QualitySettings,
    outside: ArrayLike | None = None,
    maneuvered: ArrayLike | None = None,
    known: ArrayLike = (),
) -> CatalogState:
    """Quality of the orbits of a table.

    Parameters
    ----------
    table : DataFrame
        See `orbit_table`, of one time.
    origin : array_like of int, shape (row,)
        Object of each detection so far, or `FALSE_ALARM`.
    tracklets : ndarray of int, shape (object,)
        See `true_tracklets`.
    settings : QualitySettings
    outside : array_like of bool, shape (object,), optional
        Which objects are on no orbit of the families; none if omitted.
    maneuvered : array_like of bool, shape (object,), optional
        Which objects have maneuvered so far; none if omitted.
    known : array_like of int, shape (known,)
        Objects that had a correct orbit `QualitySettings.known_days` before.
    """
    given, n = np.asarray(origin), tracklets.size
    findable = tracklets >= settings.findable_tracklets
    chosen = table[table["confirmed"]]
    real = chosen[chosen["object"] != FALSE_ALARM]
    small = (real["error_km"] <= settings.right_km).to_numpy()
    right = right_objects(table, settings)
    linked = table.loc[table["object"] != FALSE_ALARM, "object"].to_numpy(dtype=np.int64)
    good = real[small]
    total = int(chosen["detections"].sum())

    beyond = np.zeros(n, dtype=bool) if outside is None else np.asarray(outside, dtype=bool)
    everything, held = np.ones(n, dtype=bool), np.isin(np.arange(n), right)

    def share(part: float, whole: float) -> float:
        return float(part / whole) if whole else float("nan")

    def completeness(group: Flags) -> tuple[float, float]:
        return tuple(share((held & own).sum(), own.sum()) for own in (group & findable, group))

    moved = np.zeros(n, dtype=bool) if maneuvered is None else np.asarray(maneuvered, dtype=bool)
    near = real[(real["now_km"] <= settings.custody_km).to_numpy()]
    kept = np.isin(np.arange(n), near["object"].to_numpy(dtype=np.int64))
    present = real[(real["now_km"] <= settings.right_km).to_numpy()]
    shares = [completeness(group) for group in (everything, ~beyond, beyond)]
    error = real.groupby("object")["now_km"].min().reindex(np.asarray(known, dtype=np.int64))
    error = error.fillna(np.inf).clip(upper=settings.right_km)

    return CatalogState(
        day=float(table["day"].iloc[0]) if len(table) else float("nan"),
        objects=n,
        detected=int(np.unique(given[given != FALSE_ALARM]).size),
        findable=int(findable.sum()),
        confirmed=len(chosen),
        right=int(right.size),
        wrong=int(np.count_nonzero(~small)),
        false=len(chosen) - len(real),
        duplicate=int(np.count_nonzero(small)) - int(right.size),
        candidates=len(table) - len(chosen),
        linked=int(findable[np.unique(linked)].sum()),
        completeness=shares[0][0],
        completeness_all=shares[0][1],
        completeness_inside=shares[1][0],
        completeness_outside=shares[2][0],
        completeness_all_inside=shares[1][1],
        completeness_all_outside=shares[2][1],
        purity=share(real["right_detections"].sum(), total),
        nees=mean_of(good["nees"]),
        covered=share((good["nees"] <= _LARGEST_NEES).sum(), len(good)),
        nees_averaged=mean_of(good["averaged_nees"]),
        covered_averaged=share((good["averaged_nees"] <= _LARGEST_NEES).sum(), len(good)),
        median_error_km=float(good["error_km"].median()) if len(good) else float("nan"),
        completeness_maneuvering=completeness(moved)[0],
        custody=share((kept & findable).sum(), findable.sum()),
        nees_now=mean_of(present["now_nees"]),
        nees_ballistic=mean_of(good["nees"][~moved[good["object"].to_numpy(dtype=np.int64)]]),
        nees_now_ballistic=mean_of(
            present["now_nees"][~moved[present["object"].to_numpy(dtype=np.int64)]]
        ),
        error_known_km=float(np.exp(mean_of(np.log(error)))),
    )


def mean_of(values: pd.Series) -> float:
    """The mean; NaN of nothing."""
    return float(values.mean()) if len(values) else float("nan")
