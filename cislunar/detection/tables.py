"""Tables of exposures and detections, with the names of the Astrometry Data Exchange Standard.

Columns are those of `cislunar.exchange.observations`; ``expID``, which the standard does not have,
names the exposure. No column states what a detection is of.
"""

from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from cislunar.detection.exposures import Detections, Exposures
from cislunar.exchange.observation_files import observation_table
from cislunar.exchange.observations import checked, observation_dates, require
from cislunar.observation.scene import Scene
from cislunar.observation.sensor import ARCSECOND
from cislunar.observation.sightline import angles_of_vectors, unit_vectors
from cislunar.runtime import Array

EXPOSURE_COLUMNS = ("expID", "stn", "obsTime", "ra", "dec", "fieldDeg", "limMag", "falseAlarms")
DETECTION_COLUMNS = (
    *("obsID", "expID", "stn", "obsTime", "ra", "dec", "rmsRA", "rmsDec", "rmsCorr", "mag"),
    "rmsMag",
)


def exposure_table(
    exposures: Exposures,
    false_alarms_deg2: float,
    scene: Scene,
    first: int,
    epoch_tdb: float,
    axes: ArrayLike,
) -> pd.DataFrame:
    """Table of exposures.

    Parameters
    ----------
    exposures : Exposures
    false_alarms_deg2 : float
        Mean number of false alarms per square degree of the tangent plane.
    scene : Scene
    first : int
        Index of the first step among the scene's times.
    epoch_tdb : float
        Time of index 0 of the scene, s past J2000, TDB.
    axes : array_like, shape (time, 3, 3)
        Rotations from the propagation frame to the ICRF at the scene's times.

    Returns
    -------
    DataFrame
        Columns `EXPOSURE_COLUMNS`: ``obsTime`` is UTC; ``ra`` and ``dec`` are those of the
        boresight, ICRF, deg; ``fieldDeg`` is the width of the field, deg; ``limMag`` is in mag;
        ``falseAlarms`` is the mean number in the field.
    """
    index = first + exposures.step
    ra, dec, _ = icrf_directions(exposures.boresight, None, _turns(index, scene, axes))
    width = np.rad2deg(2.0 * exposures.half_field)
    side = np.rad2deg(2.0 * np.tan(exposures.half_field))
    return pd.DataFrame(
        {
            "expID": exposure_names(exposures, first),
            "stn": exposures.observer,
            "obsTime": _dates(index, scene, epoch_tdb),
            "ra": ra,
            "dec": dec,
            "fieldDeg": width,
            "limMag": exposures.limiting_magnitude,
            "falseAlarms": false_alarms_deg2 * side**2,
        }
    )


def detection_table(
    detections: Detections,
    exposures: Exposures,
    scene: Scene,
    first: int,
    epoch_tdb: float,
    axes: ArrayLike,
) -> pd.DataFrame:
    """Detections by `DETECTION_COLUMNS`; see `exposure_table` for the arguments."""
    of = detections.exposure
    index = first + exposures.step[of]
    turn = _turns(index, scene, axes)
    ra, dec, covariance = icrf_directions(detections.value[:, 1:], detections.variance[:, 1:], turn)
    name = np.array(exposure_names(exposures, first), dtype=object)[of]
    begin = np.searchsorted(of, of)
    return pd.DataFrame(
        {
            "obsID": [
                f"{each}-{k}" for each, k in zip(name, np.arange(of.size) - begin, strict=True)
            ],
            "expID": name,
            "stn": exposures.observer[of],
            "obsTime": _dates(index, scene, epoch_tdb),
            "ra": ra,
            "dec": dec,
            **direction_errors(covariance),
            "mag": detections.value[:, 0],
            "rmsMag": np.sqrt(detections.variance[:, 0]),
        }
    )


def exposure_names(exposures: Exposures, first: int) -> list[str]:
    """Names of exposures by the index of the scene's time and the observer."""
    return [
        f"{first + step}-{observer}"
        for step, observer in zip(exposures.step.tolist(), exposures.observer.tolist(), strict=True)
    ]


def read_detections(source: str | Path | pd.DataFrame) -> pd.DataFrame:
    """Read a table of detections in order of time.

    Parameters
    ----------
    source : str, Path or DataFrame
        Comma-separated, or a table, with `DETECTION_COLUMNS`; further columns are kept. Or a
        pipe-separated ADES file, named ``*.psv``, with identifiers, standard deviations and
        magnitudes: its detections from one station at one time are of one exposure, and an empty
        correlation is zero.

    Returns
    -------
    DataFrame
        With ``tdb``, s past J2000, besides the columns. ``obsID``, ``expID`` and ``stn`` are text.

    Raises
    ------
    ConfigurationError, InputFileError
        If a column or a name is missing, a value is impossible, an identifier occurs twice, or the
        times are not sorted.
    """
    given, place, fault = observation_table(source, "detections")
    if place.lower().endswith(".psv"):
        correlation = given["rmsCorr"].fillna(0.0) if "rmsCorr" in given else 0.0
        given = given.assign(expID=given["stn"] + "-" + given["obsTime"], rmsCorr=correlation)
    table = given.assign(**checked(given, (), DETECTION_COLUMNS, fault, place))
    once = ~table["obsID"].duplicated()
    require(given, "obsID", once, "not occur twice", fault, place)
    early = np.diff(table["tdb"], prepend=-np.inf) < 0.0
    rule = "not be before that of the row above; sort the table by time"
    require(given, "obsTime", ~early, rule, fault, place)
    return table


def _dates(index: NDArray[np.int64], scene: Scene, epoch_tdb: float) -> list[str]:
    """Dates, UTC, of times of the scene."""
    times, row = np.unique(index, return_inverse=True)
    dates = observation_dates(epoch_tdb + scene.step_s * times)
    return [dates[k] for k in row]


def icrf_directions(
    direction: ArrayLike, variance: ArrayLike | None, turn: ArrayLike
) -> tuple[Array, Array, Array]:
    """Directions in the ICRF.

    Parameters
    ----------
    direction, variance : array_like, shape (n, 2)
        Right ascension and declination, rad, in any frame, and their variances, rad^2; None for
        directions without errors.
    turn : array_like, shape (n, 3, 3)
        Rotations from that frame to the ICRF.

    Returns
    -------
    ra, dec : ndarray, shape (n,)
        Deg, ICRF.
    covariance : ndarray, shape (n, 2, 2)
        Of the arcs along right ascension and declination, rad^2.
    """
    turn = np.asarray(turn, dtype=float)
    ra, dec = np.asarray(direction, dtype=float).T
    unit, along = _tangents(ra, dec)
    ra_new, dec_new = angles_of_vectors(np.einsum("nij,nj->ni", turn, unit)).T
    covariance = np.zeros((ra.size, 2, 2))
    if variance is not None:
        _, new = _tangents(ra_new, dec_new)
        mixed = np.einsum("nai,nij,nbj->nab", new, turn, along)
        scaled = variance * np.column_stack([np.cos(dec) ** 2, np.ones(dec.size)])
        covariance = np.einsum("nab,nb,ncb->nac", mixed, scaled, mixed)
    return np.rad2deg(ra_new) % 360.0, np.rad2deg(dec_new), covariance


def direction_errors(covariance: Array) -> dict[str, Array]:
    """Columns ``rmsRA``, ``rmsDec`` (arcsec) and ``rmsCorr`` of covariances (n, 2, 2), rad^2."""
    rms = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    return {
        "rmsRA": rms[:, 0] / ARCSECOND,
        "rmsDec": rms[:, 1] / ARCSECOND,
        "rmsCorr": covariance[:, 0, 1] / rms.prod(axis=1),
    }


def _turns(index: NDArray[np.int64], scene: Scene, axes: ArrayLike) -> Array:
    """Rotations from the body frames of observers to the ICRF, of times of the scene."""
    return np.asarray(axes, dtype=float)[index] @ scene.observer_axes[index].swapaxes(1, 2)


def _tangents(ra: Array, dec: Array) -> tuple[Array, Array]:
    """Unit vectors (n, 3), and those along right ascension and declination (n, 2, 3)."""
    zero = np.zeros_like(ra)
    unit = unit_vectors(ra, dec)
    east = np.stack([-np.sin(ra), np.cos(ra), zero], axis=-1)
    north = np.cross(unit, east)
    return unit, np.stack([east, north], axis=1)
