"""Attributables: directions and rates of tracklets, fitted to their detections.

An attributable is the direction and its rate, with covariance, at a reference time. The offsets of
the detections in the plane tangent at their mean direction are fitted by a polynomial of time, in
axes that do not rotate. The same linear estimator is applied to the positions of the observer and
gives its position o and its velocity w, which correspond to the direction u and its rate d. An
object at the range rho with the range rate rho' has the inertial velocity

    v = w + rho' u + rho d                                                                      (1)

(Milani et al. 2004, Icarus 168, 1). Since both are estimated in the same way, the curvature of the
observer's path causes no error in equation (1).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import chi2

from cislunar.errors import ConfigurationError
from cislunar.orbit_determination.angles import (
    Angles,
    require_order,
    rotate_about_z,
    tangent_basis,
)
from cislunar.runtime import Array, Indices, count_of, indices_of

_CURVATURE_CHI_SQUARED = float(chi2.ppf(0.999, 2))
"""Decrease of chi squared from which a path is fitted with a curvature."""


class Attributables(NamedTuple):
    """Directions and rates of tracklets, in order of time.

    Attributes
    ----------
    time : ndarray, shape (tracklet,)
        Weighted mean time of the detections, nondimensional, since the epoch of the force model.
    observer : ndarray of int, shape (tracklet,)
        Number of the observer.
    observer_position, observer_velocity : ndarray, shape (tracklet, 3)
        Position and inertial velocity of the observer, nondimensional, axes of the propagation
        frame at that time.
    direction, rate : ndarray, shape (tracklet, 3)
        Unit vector, and its derivative in axes that do not rotate; axes of the propagation frame.
    basis : ndarray, shape (tracklet, 2, 3)
        Unit vectors along right ascension and declination.
    covariance : ndarray, shape (tracklet, 4, 4)
        Covariance of direction and rate along the basis, rad and nondimensional time.
    curvature : ndarray, shape (tracklet, 2)
        Errors of direction and rate, along each axis, by a unit second derivative of the offsets.
    chi_squared : ndarray, shape (tracklet,)
        Squared residuals of the polynomials in variances.
    detections : tuple of ndarray of int
        Rows of the angles of each tracklet.
    """

    time: Array
    observer: Indices
    observer_position: Array
    observer_velocity: Array
    direction: Array
    rate: Array
    basis: Array
    covariance: Array
    curvature: Array
    chi_squared: Array
    detections: tuple[Indices, ...]

    def take(self, which: ArrayLike) -> "Attributables":
        """Some of the tracklets, in the order of their indices."""
        chosen = np.atleast_1d(np.asarray(which, dtype=np.int64))
        parts = tuple(self.detections[k] for k in chosen.tolist())
        return Attributables(*(each[chosen] for each in self[:-1]), parts)


def attributables(
    angles: Angles,
    tracklets: Sequence[ArrayLike],
    *,
    rate: float = 1.0,
    degree: int | None = None,
    known: Attributables | None = None,
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
    known : Attributables, optional
        Result for the first rows of the same angles, from which equal tracklets are taken.

    Returns
    -------
    Attributables

    Raises
    ------
    ConfigurationError
        If a tracklet has detections of several observers or at fewer than two different times, a
        row does not exist or repeats, the angles are not in order of time, or the degree is not a
        whole number from 1 to one less than the number of different times.
    """
    if degree is not None:
        count_of("degree", degree)
    require_order(angles.time)
    parts = [np.ravel(rows) for rows in tracklets]
    indices_of("tracklets", np.concatenate([np.empty(0), *parts]), angles.time.size)
    sets = [np.sort(rows.astype(np.int64)) for rows in parts]
    more = np.diff(np.concatenate([np.empty(0), *sets])) > 0
    more[np.cumsum([rows.size for rows in sets], dtype=np.int64)[:-1] - 1] = True
    if not np.all(more) or any(rows.dtype == bool for rows in parts):
        raise ConfigurationError("tracklets: give the number of each row once, not a mask")
    before = {} if known is None else {d.tobytes(): k for k, d in enumerate(known.detections)}
    at = np.array([before.get(rows.tobytes(), -1) for rows in sets], dtype=np.int64)
    size = np.array([rows.size for rows in sets], dtype=np.int64)
    shapes = ((), (), (3,), (3,), (3,), (3,), (2, 3), (4, 4), (2,), ())
    columns = [
        np.empty((len(sets), *shape), dtype=np.int64 if c == 1 else float)
        for c, shape in enumerate(shapes)
    ]
    parts = [(np.flatnonzero(at >= 0), None if known is None else known[:-1])]
    for each in np.unique(size[at < 0]).tolist():
        own = np.flatnonzero((at < 0) & (size == each))
        parts.append((own, _of_equal_size(angles, np.array([sets[k] for k in own]), rate, degree)))
    for own, values in parts:
        if own.size:
            for column, value in zip(columns, values, strict=True):
                column[own] = value[at[own]] if at[own[0]] >= 0 else value
    order = np.lexsort((columns[1], columns[0]))
    return Attributables(*(each[order] for each in columns), tuple(sets[k] for k in order.tolist()))


def _of_equal_size(angles: Angles, rows: Indices, rate: float, degree: int | None) -> tuple:
    """Columns of the attributables of tracklets of the same number of detections, `rows` (tracklet,
    detection)."""
    times, owners = angles.time[rows], angles.observer[rows]
    distinct = 1 + np.count_nonzero(np.diff(times, axis=1) > 0.0, axis=1)
    mixed = np.any(owners != owners[:, :1], axis=1)
    for k in np.flatnonzero(mixed | (distinct < 2)).tolist():
        raise ConfigurationError(
            f"a tracklet of rows {rows[k].tolist()} has {np.unique(owners[k]).size} observers and "
            f"{distinct[k]} times; it needs one observer and two different times"
        )
    if degree is not None and np.any(distinct <= degree):
        raise ConfigurationError(
            f"degree = {degree} needs {degree + 1} different times in every tracklet; lower it"
        )
    weight = 1.0 / np.trace(angles.covariance[rows], axis1=2, axis2=3)
    middle = np.sum(weight * times, axis=1) / np.sum(weight, axis=1)
    since = times - middle[:, None]
    directions, positions = (
        rotate_about_z(each[rows], rate * since)
        for each in (angles.direction, angles.observer_position)
    )
    mean = np.einsum("tn,tnc->tc", weight, directions)
    mean /= np.linalg.norm(mean, axis=1)[:, None]
    tangents = tangent_basis(mean)
    # an offset by the unit error vectors, projected to the plane at the mean direction
    errors = rotate_about_z(angles.basis[rows], rate * since[:, :, None])
    along = np.einsum("tnc,tc->tn", directions, mean)
    offset = np.einsum("tnc,tac->tna", directions, tangents) / along[:, :, None]
    outward = np.einsum("tnbc,tc->tnb", errors, mean)
    turned = np.einsum("tac,tnbc->tnab", tangents, errors) - offset[..., None] * outward[:, :, None]
    turned /= along[:, :, None, None]
    noise = turned @ angles.covariance[rows] @ turned.swapaxes(2, 3)
    largest = np.abs(since).max(axis=1)
    scaled = since / largest[:, None]

    def fitted(order: int, which: Indices) -> tuple[Array, Array]:
        """Estimators of the first two coefficients, and chi squared."""
        design = scaled[which, :, None] ** np.arange(order + 1)
        weighted = (weight[which, :, None] * design).swapaxes(1, 2)
        estimator = np.linalg.solve(weighted @ design, weighted)
        left = offset[which] - design @ (estimator @ offset[which])
        inverse = np.linalg.inv(noise[which])
        return estimator[:, :2], np.einsum("tna,tnab,tnb->t", left, inverse, left)

    estimator, chi_squared = fitted(1 if degree is None else degree, np.arange(len(rows)))
    many = np.flatnonzero(distinct >= 4)
    if degree is None and many.size:
        curved = fitted(2, many)
        better = np.flatnonzero(chi_squared[many] - curved[1] > _CURVATURE_CHI_SQUARED)
        estimator[many[better]], chi_squared[many[better]] = (each[better] for each in curved)
    estimator[:, 1] /= largest[:, None]
    shift, drift = np.moveaxis(estimator @ offset @ tangents, 1, 0)
    position, velocity = np.moveaxis(estimator @ positions, 1, 0)
    curvature = 0.5 * np.einsum("tin,tn->ti", estimator, since**2)
    unit = mean + shift
    length = np.linalg.norm(unit, axis=1)[:, None]
    unit /= length
    motion = drift / length
    motion -= np.sum(motion * unit, axis=1)[:, None] * unit
    basis = tangent_basis(unit)
    covariance = np.einsum("tin,tnab,tjn->tiajb", estimator, noise, estimator).reshape(-1, 4, 4)
    turn = basis @ tangents.swapaxes(1, 2) / length[:, None]
    change = np.zeros_like(covariance)
    change[:, :2, :2] = change[:, 2:, 2:] = turn
    return (
        middle, owners[:, 0], position, velocity, unit, motion, basis,
        change @ covariance @ change.swapaxes(1, 2), curvature, chi_squared,
    )  # fmt: skip
