"""Tracklets: detections of one pass of an object by one observer, and their attributables.

Two detections of one observer form a pair if their separation in time, their angular rate and their
difference of magnitude are within the settings. Later detections near the straight path of the pair
on the sky extend it. A detection may be in several tracklets; linking chooses among them.

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
from numpy.typing import ArrayLike, NDArray
from scipy.stats import chi2

from cislunar.constants import TIME_UNIT_S
from cislunar.errors import ConfigurationError
from cislunar.observation import ARCSECOND
from cislunar.orbit_determination.angles import Angles, tangent_basis
from cislunar.orbit_determination.tracklet_settings import TrackletSettings

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

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
    magnitude, magnitude_sigma : ndarray, shape (tracklet,)
        Weighted mean and its standard deviation, mag; NaN if unknown.
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
    magnitude: Array
    magnitude_sigma: Array
    chi_squared: Array
    detections: tuple[Indices, ...]

    def take(self, which: ArrayLike) -> "Attributables":
        """Some of the tracklets, in the order of their indices."""
        chosen = np.atleast_1d(np.asarray(which, dtype=np.int64))
        parts = tuple(self.detections[k] for k in chosen.tolist())
        return Attributables(*(each[chosen] for each in self[:-1]), parts)


def rotate_about_z(vector: ArrayLike, angle: ArrayLike) -> Array:
    """Vectors (..., 3) rotated about z by angles (...), rad, positive from x to y."""
    given = np.asarray(vector, dtype=float)
    x, y, c, s = given[..., 0], given[..., 1], np.cos(angle), np.sin(angle)
    out = np.empty((*np.broadcast_shapes(x.shape, c.shape), 3))
    out[..., 0], out[..., 1], out[..., 2] = c * x - s * y, s * x + c * y, given[..., 2]
    return out


def index_pairs(begin: Indices, end: Indices) -> Indices:
    """Pairs (2, pair) of each index k with those from ``begin[k]`` to before ``end[k]``."""
    count = np.maximum(end - begin, 0)
    first = np.repeat(np.arange(begin.size), count)
    within = np.arange(first.size) - np.repeat(np.cumsum(count) - count, count)
    return np.stack([first, begin[first] + within])


def form_tracklets(
    angles: Angles, settings: TrackletSettings | None = None, *, rate: float = 1.0
) -> list[Indices]:
    """Group detections of each observer into tracklets.

    Parameters
    ----------
    angles : Angles
        Detections, in order of time. Those of one observer at one time are of different objects.
    settings : TrackletSettings, optional
    rate : float
        Angular rate of the propagation frame (`frame_rate`).

    Returns
    -------
    list of ndarray of int
        Rows of the angles, at least `least_detections` each, in order of time; no tracklet contains
        another.
    """
    settings = TrackletSettings() if settings is None else settings
    gap = settings.largest_gap_min * 60.0 / TIME_UNIT_S
    # the share above 1 keeps a span that equals the limit but for rounding in one part
    longest = settings.largest_span_min * 60.0 / TIME_UNIT_S * (1.0 + 1e-9)
    fastest = settings.largest_rate_arcsec_s * ARCSECOND * TIME_UNIT_S
    acceleration = settings.largest_acceleration_arcsec_s2 * ARCSECOND * TIME_UNIT_S**2
    fixed = rotate_about_z(angles.direction, rate * angles.time)
    sigma = np.sqrt(np.trace(angles.covariance, axis1=1, axis2=2))
    found: list[Indices] = []
    for observer in np.unique(angles.observer).tolist():
        rows = np.flatnonzero(angles.observer == observer)
        times = angles.time[rows]
        after = np.searchsorted(times, times, side="right")
        until = np.searchsorted(times, times + gap, side="right")
        a, b = rows[index_pairs(after, until)]
        apart = np.linalg.norm(fixed[b] - fixed[a], axis=1)
        difference = np.abs(angles.magnitude[b] - angles.magnitude[a])
        kept = apart <= fastest * (angles.time[b] - angles.time[a])
        kept &= ~(difference > settings.largest_magnitude_difference)
        later: dict[int, list[int]] = {}
        for p, q in zip(a[kept].tolist(), b[kept].tolist(), strict=True):
            later.setdefault(p, []).append(q)
        used: set[tuple[int, int]] = set()
        for p in sorted(later):
            for q in later[p]:
                if (p, q) in used:
                    continue
                chain = [p, q]
                while True:
                    near = [
                        (offset, each)
                        for each in later.get(chain[-1], ())
                        if (
                            offset := _path_offset(
                                angles.time, fixed, sigma, acceleration, chain, each
                            )
                        )
                        <= 1
                    ]
                    if not near:
                        break
                    soonest = min(angles.time[each] for _, each in near)
                    chain.append(min(n for n in near if angles.time[n[1]] == soonest)[1])
                used.update((chain[i], each) for i in range(len(chain)) for each in chain[i + 1 :])
                span = angles.time[chain[-1]] - angles.time[p]
                for part in np.array_split(chain, max(1, int(np.ceil(span / longest)))):
                    if part.size >= settings.least_detections:
                        found.append(part)
    return found


def _path_offset(time, fixed, sigma, acceleration, chain, row) -> float:
    """Distance of a detection from the straight path of the first and last of a chain, over the
    allowance for its curvature and five standard deviations."""
    p, q = chain[0], chain[-1]
    ratio = (time[row] - time[p]) / (time[q] - time[p])
    expected = fixed[p] + (fixed[q] - fixed[p]) * ratio
    allowed = 0.5 * acceleration * (time[row] - time[p]) * (time[row] - time[q])
    noise = np.hypot(sigma[row], sigma[p] * abs(1.0 - ratio) + sigma[q] * abs(ratio))
    return float(np.linalg.norm(fixed[row] - expected) / (allowed + 5.0 * noise))


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
        If a tracklet has detections of several observers or at fewer than two different times.
    """
    before = {} if known is None else {tuple(d.tolist()): k for k, d in enumerate(known.detections)}
    found = []
    for rows in map(np.sort, tracklets):
        k = before.get(tuple(rows.tolist()))
        found.append(
            _attributable(angles, rows, rate, degree) if k is None else [each[k] for each in known]
        )
    order = sorted(range(len(found)), key=lambda k: (found[k][0], found[k][1]))
    shapes = ((), (), (3,), (3,), (3,), (3,), (2, 3), (4, 4), (), (), ())
    columns = [
        np.array([found[k][c] for k in order], dtype=np.int64 if c == 1 else float)
        for c in range(len(shapes))
    ]
    columns = [each.reshape(-1, *shape) for each, shape in zip(columns, shapes, strict=True)]
    return Attributables(*columns, tuple(found[k][-1] for k in order))


def _attributable(angles: Angles, rows: Indices, rate: float, degree: int | None) -> tuple:
    times, owners = angles.time[rows], np.unique(angles.observer[rows])
    if owners.size != 1 or np.unique(times).size < 2:
        raise ConfigurationError(
            f"a tracklet of rows {rows.tolist()} has {owners.size} observers and "
            f"{np.unique(times).size} times; it needs one observer and two different times"
        )
    weight = 1.0 / np.trace(angles.covariance[rows], axis1=1, axis2=2)
    middle = float(weight @ times / weight.sum())
    since = times - middle
    directions, positions = (
        rotate_about_z(each[rows], rate * since)
        for each in (angles.direction, angles.observer_position)
    )
    mean = weight @ directions
    mean /= np.linalg.norm(mean)
    tangents = tangent_basis(mean)
    # an offset by the unit error vectors, projected to the plane at the mean direction
    errors = rotate_about_z(angles.basis[rows], rate * since[:, None])
    along = directions @ mean
    offset = directions @ tangents.T / along[:, None]
    mixed = np.einsum("ac,nbc->nab", tangents, errors) - np.einsum(
        "na,nb->nab", offset, errors @ mean
    )
    mixed /= along[:, None, None]
    noise = mixed @ angles.covariance[rows] @ mixed.swapaxes(1, 2)
    scaled = since / np.abs(since).max()

    def fitted(order: int) -> tuple[Array, float]:
        design = np.vander(scaled, order + 1, increasing=True)
        estimator = np.linalg.solve(
            (weight[:, None] * design).T @ design, (weight[:, None] * design).T
        )
        left = offset - design @ (estimator @ offset)
        return estimator, float(np.einsum("na,nab,nb", left, np.linalg.inv(noise), left))

    best = fitted(1 if degree is None else degree)
    if degree is None and np.unique(times).size >= 4:
        curved = fitted(2)
        best = curved if best[1] - curved[1] > _CURVATURE_CHI_SQUARED else best
    estimator = best[0][:2].copy()
    estimator[1] /= np.abs(since).max()
    shift, drift = estimator @ offset @ tangents
    position, velocity = estimator @ positions
    unit = mean + shift
    length = np.linalg.norm(unit)
    unit /= length
    motion = drift / length
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
        middle, int(owners[0]), position, velocity, unit, motion, basis,
        change @ covariance @ change.T, magnitude, total**-0.5 if total else np.nan, best[1], rows,
    )  # fmt: skip
