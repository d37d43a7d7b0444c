"""Evidence of an orbit, directions of state space that angles leave undetermined, and verdicts.

A fit may converge although the angles do not determine the orbit. The covariance P of a solution is
therefore compared with that of the admissible region, P_0. A direction of state space is
undetermined if its standard deviation is not small compared with that of the region, by the
eigenvalues of P relative to P_0. The range is also undetermined if its standard deviation is not
small compared with the range itself, since the covariance then does not describe the possible
orbits.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigvalsh
from scipy.stats import chi2

from cislunar.orbit_determination.admissible_region import AdmissibleRegion
from cislunar.orbit_determination.angles import Angles
from cislunar.orbit_determination.least_squares import CONVERGED, OrbitFits, fit_orbits
from cislunar.runtime import Array, Indices
from cislunar.runtime.settings_fields import Section, number, setting

ORBIT = "orbit"
SEVERAL_ORBITS = "several orbits"
DIRECTION_ONLY = "direction only"
CONTRADICTORY = "contradictory angles"
NO_ORBIT = "no orbit"
"""Verdicts, in this order: one determined orbit; several orbits that agree with the angles; fits
that leave the range or another direction undetermined, or too few angles for a fit; converged fits
that all disagree with the angles; no fit that converges to an admissible orbit."""


class VerdictSettings(Section):
    """Conditions on a fit that agrees with its angles, and on an orbit that is determined."""

    # fmt: off

    significance: number(gt=0, lt=0.5) = setting(
        "probability of a larger chi squared below which a fit disagrees with its angles", "1",
        default=1e-4)
    undetermined_share: number(gt=0, lt=1) = setting(
        "standard deviation, relative to that of the admissible region, from which a direction of "
        "state space is undetermined", "1", default=0.06)
    undetermined_range_share: number(gt=0, lt=1) = setting(
        "standard deviation of the range, relative to the range, from which it is undetermined",
        "1", default=0.1)
    rival_log_ratio: number(gt=0) = setting(
        "logarithm of the ratio of evidence up to which another solution is a rival of the best",
        "1", default=7)

    # fmt: on


def region_covariance(region: AdmissibleRegion) -> Array:
    """Covariance (6, 6) of states that are uniform over the admissible region, nondimensional."""
    return np.diag(np.repeat([region.position_sigma**2, region.velocity_sigma**2], 3))


def agrees(fits: OrbitFits, significance: float) -> NDArray[np.bool_]:
    """Whether fits have converged and agree with their angles.

    Parameters
    ----------
    fits : OrbitFits
    significance : float
        Least probability of a larger chi squared.

    Returns
    -------
    ndarray of bool, shape (fit,)
    """
    # without degrees of freedom residuals vanish; the tolerance is that of the iteration
    limit = np.where(fits.degrees > 0, chi2.isf(significance, np.maximum(fits.degrees, 1)), 1e-2)
    return (fits.status == CONVERGED) & (fits.chi_squared <= limit)


def separation_probability(fits: OrbitFits, angles: Angles, *, forces: tuple) -> Array:
    """Probability that an orbit of one object fits its angles worse than separate orbits of two
    objects by more than it does, where one observer saw one and the others saw the other.

    Two observers of different objects may agree on an orbit where neither object is. If there is
    one object, chi squared decreases by a chi-squared variable if the angles of one observer have
    an orbit of their own (the extra sum of squares; Draper & Smith 1998, Applied Regression
    Analysis, section 6.1). It has 6 degrees of freedom, or one for each angle of an observer with
    fewer.

    Parameters
    ----------
    fits : OrbitFits
        Converged fits.
    angles : Angles
    forces : NamedTuple
        Force model.

    Returns
    -------
    ndarray, shape (fit,)
        The least probability over the observers. 0 if there are two observers and one of
        them has fewer than three rows, or the fit to its angles does not converge from the orbit; 1
        if there are one or more than three observers.

    Raises
    ------
    ConfigurationError
        If the force model does not cover the times of the angles.
    """
    of, parts = [], []
    for k in range(fits.epoch.size):
        rows = fits.detections(k)
        owner = angles.observer[rows]
        observers = np.unique(owner)
        if observers.size in (2, 3):
            for each in observers[: None if observers.size == 3 else 1]:
                of.append(k)
                parts += [rows[owner == each], rows[owner != each]]
    out = np.ones(fits.epoch.size)
    number = np.repeat(of, 2).astype(np.int64)
    size = np.array([part.size for part in parts], dtype=np.int64)
    fitted = np.flatnonzero(size >= 3)
    separate = fit_orbits(
        angles, [parts[m] for m in fitted], fits.state[number[fitted]], fits.epoch[number[fitted]],
        forces=forces,
    )  # fmt: skip
    chi_squared, failed = np.zeros(size.size), size < 3
    chi_squared[fitted], failed[fitted] = separate.chi_squared, separate.status != CONVERGED
    decrease = fits.chi_squared[of] - chi_squared.reshape(-1, 2).sum(axis=1)
    degrees = np.minimum(2 * size, 6).reshape(-1, 2).sum(axis=1) - 6
    probability = np.where(degrees > 0, chi2.sf(np.maximum(decrease, 0.0), degrees), 1.0)
    two = np.bincount(np.array(of, dtype=np.int64), minlength=fits.epoch.size)[of] == 1
    probability[two & failed.reshape(-1, 2).any(axis=1)] = 0.0
    np.minimum.at(out, of, probability)
    return out


def determined_by_one(
    fits: OrbitFits,
    angles: Angles,
    region: AdmissibleRegion,
    settings: VerdictSettings | None = None,
    *,
    forces: tuple,
) -> tuple[NDArray[np.bool_], Array]:
    """Whether the detections of one observer alone determine an orbit, and whether those of all
    others agree with it.

    Parameters
    ----------
    fits : OrbitFits
        Converged fits.
    angles : Angles
    region : AdmissibleRegion
    settings : VerdictSettings, optional
    forces : NamedTuple
        Force model.

    Returns
    -------
    determined : ndarray of bool, shape (fit,)
        Whether a fit to the detections of the observer with most detections (the first of equals)
        agrees with them and leaves no direction of state space undetermined.
    probability : ndarray, shape (fit,)
        Probability of a larger increase of chi squared by the angles of all other observers, each
        of which is a degree of freedom; 1 if there are none.

    Raises
    ------
    ConfigurationError
        If the force model does not cover the times of the angles.
    """
    settings = VerdictSettings() if settings is None else settings
    parts = []
    for k in range(fits.epoch.size):
        rows = fits.detections(k)
        observers, count = np.unique(angles.observer[rows], return_counts=True)
        parts.append(rows[angles.observer[rows] == observers[np.argmax(count)]])
    own = np.array([k for k, part in enumerate(parts) if part.size >= 3], dtype=np.int64)
    alone = fit_orbits(
        angles, [parts[k] for k in own], fits.state[own], fits.epoch[own], forces=forces
    )
    determined, probability = np.zeros(len(parts), dtype=bool), np.zeros(len(parts))
    determined[own] = agrees(alone, settings.significance)
    determined[own] &= undetermined_directions(alone, region, settings) == 0
    increase = np.maximum(fits.chi_squared[own] - alone.chi_squared, 0.0)
    degrees = 2 * (np.diff(fits.begin)[own] - np.diff(alone.begin))
    probability[own] = np.where(degrees > 0, chi2.sf(increase, np.maximum(degrees, 1)), 1.0)
    return determined, probability


def undetermined_directions(
    fits: OrbitFits, region: AdmissibleRegion, settings: VerdictSettings | None = None
) -> Indices:
    """Number of undetermined directions of state space of each fit; 6 if it has not converged.

    Parameters
    ----------
    fits : OrbitFits
    region : AdmissibleRegion
    settings : VerdictSettings, optional

    Returns
    -------
    ndarray of int, shape (fit,)
        At least 1 if the range is undetermined.
    """
    settings = VerdictSettings() if settings is None else settings
    prior = region_covariance(region)
    scale = 1.0 / np.sqrt(np.diag(prior))
    out = np.full(fits.epoch.size, 6, dtype=np.int64)
    for k in np.flatnonzero(fits.status == CONVERGED).tolist():
        covariance = fits.covariance[k]
        share = eigvalsh(scale[:, None] * covariance * scale)
        out[k] = np.count_nonzero(share > settings.undetermined_share**2)
        # the row of least range, as an estimate for the epoch
        lines = fits.position[fits.begin[k] : fits.begin[k + 1]]
        distance = np.linalg.norm(lines, axis=1).min()
        line = lines[np.argmin(np.sum(lines**2, axis=1))] / distance
        sigma = np.sqrt(line @ covariance[:3, :3] @ line)
        out[k] = max(out[k], int(sigma > settings.undetermined_range_share * distance))
    return out


def log_evidence(fits: OrbitFits, angles: Angles, region: AdmissibleRegion) -> Array:
    """Logarithm of the evidence of each fit: the density of its angles, for an object anywhere in
    the region.

    It is approximated by Laplace's method about the solution (MacKay 2003, Information Theory,
    Inference, and Learning Algorithms, chapter 27), with all constants:

        sum ln N(residual; 0, R) + ln p(state) + 3 ln(2 pi) + ln det(P^-1 + P_0^-1)^(-1/2).

    Parameters
    ----------
    fits : OrbitFits
    angles : Angles
    region : AdmissibleRegion
        States are uniform over the spheres of its largest distance and speed.

    Returns
    -------
    ndarray, shape (fit,)
        The density is per steradian for each detection. Minus infinity for a fit that has not
        converged.
    """
    sigma = np.sqrt(np.diag(region_covariance(region)))
    noise = np.log(2.0 * np.pi) + 0.5 * np.linalg.slogdet(angles.covariance[fits.row])[1]
    out = np.full(fits.epoch.size, -np.inf)
    for k in np.flatnonzero(fits.status == CONVERGED).tolist():
        each = noise[fits.begin[k] : fits.begin[k + 1]]
        # of P in units of P_0; from the factor, since P may be singular in double precision
        share = np.linalg.svd(fits.root[k] / sigma, compute_uv=False)
        volume = 3.0 * np.log(2.0 * np.pi) + np.sum(np.log(sigma) - 0.5 * np.log1p(share**-2.0))
        out[k] = -0.5 * fits.chi_squared[k] - each.sum() + region.log_density + volume
    return out
