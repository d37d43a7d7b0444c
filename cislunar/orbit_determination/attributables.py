"""Attributables of tracklets: direction and its rate, with covariance, at a reference time.

The offsets of the detections in the plane tangent at their mean direction are fitted by a
polynomial of time, in axes that do not rotate. The same linear estimator is applied to the
positions of the observer and gives its position o and its velocity w, which correspond to the
direction u and its rate d. An object at the range rho with the range rate rho' has the inertial
velocity

    v = w + rho' u + rho d                                                                      (1)

(Milani et al. 2004, Icarus 168, 1). Since both are estimated in the same way, the curvature of the
observer's path causes no error in equation (1).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import chi2

from cislunar.errors import ConfigurationError
from cislunar.orbit_determination.angles import Angles, tangent_basis
from cislunar.runtime.settings_fields import Positive, Section, setting

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_BEND = float(chi2.ppf(0.999, 2))
"""Decrease of chi squared from which a path is fitted with a curvature."""


class Attributables(NamedTuple):
    """Tracklets reduced to direction and rate, in order of time.

    Attributes
    ----------
    time : ndarray, shape (tracklet,)
        Weighted mean time of the detections, nondimensional, since the epoch of the force model.
    observer : ndarray of int, shape (tracklet,)
        Number of the observer.
    place, velocity : ndarray, shape (tracklet, 3)
        Position and inertial velocity of the observer, nondimensional, axes of the propagation
        frame at that time.
    direction, rate : ndarray, shape (tracklet, 3)
        Unit vector, and its derivative in axes that do not rotate; axes of the propagation frame.
    basis : ndarray, shape (tracklet, 2, 3)
        Unit vectors along right ascension and declination.
    covariance : ndarray, shape (tracklet, 4, 4)
        Covariance of direction and rate along the basis, rad and nondimensional time.
    magnitude, magnitude_sigma : ndarray, shape (tracklet,)
        Weighted mean and its standard deviation, mag; NaN if unknown.
    chi_squared : ndarray, shape (tracklet,)
        Squared residuals of the polynomials in variances.
    detections : tuple of ndarray of int
        Rows of the angles of each tracklet.
    """

    time: Array
    observer: Indices
    place: Array
    velocity: Array
    direction: Array
    rate: Array
    basis: Array
    covariance: Array
    magnitude: Array
    magnitude_sigma: Array
    chi_squared: Array
    detections: tuple[Indices, ...]

    def take(self, which: ArrayLike) -> "Attributables":
        """Some of the tracklets, in the order of their indices."""
        chosen = np.atleast_1d(np.asarray(which, dtype=np.int64))
        parts = tuple(self.detections[k] for k in chosen.tolist())
        return Attributables(*(each[chosen] for each in self[:-1]), parts)


class TrackletSettings(Section):
    """Conditions on detections of one observer that may belong to one pass of an object."""

    # fmt: off

    largest_gap_min: Positive = setting(
        "longest time between consecutive detections of a tracklet", "min", default=15)
    largest_rate_arcsec_s: Positive = setting(
        "fastest motion on the sky", "arcsec/s", default=3.5)
    largest_magnitude_difference: Positive = setting(
        "largest difference of magnitude between consecutive detections", "mag", default=1.5)
    largest_acceleration_arcsec_s2: Positive = setting(
        "largest change of the rate in time, within which a third detection continues two others",
        "arcsec/s^2", default=3e-4)

    # fmt: on


def turned_about_z(vector: ArrayLike, angle: ArrayLike) -> Array:
    """Vectors rotated about z.

    Parameters
    ----------
    vector : array_like, shape (..., 3)
    angle : array_like, shape (...)
        rad, positive from x to y.

    Returns
    -------
    ndarray, shape (..., 3)
    """
    x, y, z = np.moveaxis(np.asarray(vector, dtype=float), -1, 0)
    c, s = np.cos(angle), np.sin(angle)
    return np.stack(np.broadcast_arrays(c * x - s * y, s * x + c * y, z), axis=-1)


def attributables(
    angles: Angles, tracklets: Sequence[ArrayLike], *, rate: float = 1.0, degree: int | None = None
) -> Attributables:
    """Fit the direction and rate of each tracklet.

    Parameters
    ----------
    angles : Angles
    tracklets : sequence of array_like of int
        Rows of the angles of each tracklet, of one observer, at two different times at least.
    rate : float
        Angular rate of the propagation frame (`frame_rate`).
    degree : int, optional
        Degree of the polynomials. By default it is 1, or 2 where detections at four or more times
        require it at a significance of 0.001.

    Returns
    -------
    Attributables

    Raises
    ------
    ConfigurationError
        If a tracklet has detections of several observers or at fewer than two different times.
    """
    found = [_attributable(angles, np.sort(np.asarray(rows)), rate, degree) for rows in tracklets]
    order = sorted(range(len(found)), key=lambda k: (found[k][0], found[k][1]))
    if not found:
        shapes = ((), (), (3,), (3,), (3,), (3,), (2, 3), (4, 4), (), (), ())
        columns = [np.empty((0, *shape)) for shape in shapes]
    else:
        columns = [np.array([found[k][c] for k in order]) for c in range(11)]
    columns[1] = columns[1].astype(np.int64)
    return Attributables(*columns, tuple(found[k][11] for k in order))


def _attributable(angles: Angles, rows: Indices, rate: float, degree: int | None) -> tuple:
    times, owners = angles.time[rows], np.unique(angles.observer[rows])
    if owners.size != 1 or np.unique(times).size < 2:
        raise ConfigurationError(
            f"a tracklet of rows {rows.tolist()} has {owners.size} observers and "
            f"{np.unique(times).size} times; it needs one observer and two different times"
        )
    weight = 1.0 / np.trace(angles.covariance[rows], axis1=1, axis2=2)
    middle = float(weight @ times / weight.sum())
    turn = rate * (times - middle)
    directions = turned_about_z(angles.direction[rows], turn)
    places = turned_about_z(angles.place[rows], turn)
    mean = weight @ directions
    mean /= np.linalg.norm(mean)
    tangents = tangent_basis(mean)
    # an offset by the unit error vectors, projected to the plane at the mean direction
    errors = turned_about_z(angles.basis[rows], turn[:, None])
    along = directions @ mean
    offset = directions @ tangents.T / along[:, None]
    mixed = np.einsum("ac,nbc->nab", tangents, errors) - np.einsum(
        "na,nb->nab", offset, errors @ mean
    )
    mixed /= along[:, None, None]
    noise = mixed @ angles.covariance[rows] @ mixed.swapaxes(1, 2)
    since = times - middle
    scaled = since / np.abs(since).max()

    def fitted(order: int) -> tuple[Array, Array, float]:
        design = np.vander(scaled, order + 1, increasing=True)
        estimator = np.linalg.solve(
            (weight[:, None] * design).T @ design, (weight[:, None] * design).T
        )
        left = offset - design @ (estimator @ offset)
        return estimator, left, float(np.einsum("na,nab,nb", left, np.linalg.inv(noise), left))

    best = fitted(1 if degree is None else degree)
    if degree is None and np.unique(times).size >= 4:
        bent = fitted(2)
        best = bent if best[2] - bent[2] > _BEND else best
    estimator = best[0][:2].copy()
    estimator[1] /= np.abs(since).max()
    (x, y), (dx, dy) = estimator @ offset
    place, velocity = estimator @ places
    unit = mean + x * tangents[0] + y * tangents[1]
    length = np.linalg.norm(unit)
    unit /= length
    motion = (dx * tangents[0] + dy * tangents[1]) / length
    motion -= (motion @ unit) * unit
    basis = tangent_basis(unit)
    covariance = np.einsum("in,nab,jn->iajb", estimator, noise, estimator).reshape(4, 4)
    change = np.kron(np.eye(2), basis @ tangents.T / length)
    bright = angles.magnitude_variance[rows]
    known = np.isfinite(bright) & np.isfinite(angles.magnitude[rows])
    share = np.where(known, 1.0 / np.where(known, bright, 1.0), 0.0)
    total = share.sum()
    magnitude = share[known] @ angles.magnitude[rows][known] / total if total else np.nan
    return (
        middle, int(owners[0]), place, velocity, unit, motion, basis,
        change @ covariance @ change.T, magnitude, total**-0.5 if total else np.nan, best[2], rows,
    )  # fmt: skip
