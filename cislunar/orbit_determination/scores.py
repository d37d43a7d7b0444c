"""Settings of linking: generation of hypotheses, their choice, and confirmation; their scores.

The score of a hypothesis, an orbit with its n detections, is the logarithm of its likelihood ratio
to the assumption that its detections are clutter, that is, false alarms or detections of objects
that are not linked:

    ln n_0 + ln p(angles) + ln p(magnitudes) + n ln P_D - sum ln kappa,                         (1)

with the expected number n_0 of objects in the region, p(angles) by `log_evidence`, p(magnitudes) of
a sphere of unknown size with a scatter, the detection probability P_D, and the density kappa of
clutter. All constants are included, so that hypotheses with different numbers of detections are
comparable. Exposures without a detection are not counted.
"""

import numpy as np
from numpy.typing import ArrayLike

from cislunar.orbit_determination.admissible_region import (
    AdmissibleRegion,
    sphere_magnitude_residuals,
)
from cislunar.orbit_determination.angles import Angles
from cislunar.orbit_determination.initial_orbits import InitialOrbitSettings
from cislunar.orbit_determination.least_squares import OrbitFits
from cislunar.orbit_determination.pairs import PairSettings
from cislunar.orbit_determination.verdicts import ORBIT, VerdictSettings, log_evidence
from cislunar.runtime import Array
from cislunar.runtime.settings_fields import Count, Number, Positive, Section, number, setting


class ConfirmationRule(Section):
    """When a linked orbit is confirmed; otherwise it stays a candidate.

    A confirmed orbit is the only one that its detections permit, all directions of state space are
    determined, and its likelihood ratio is large enough. One of two further conditions holds:

    - The orbit has tracklets of at least `observers_alone` observers, or it has at least
      `tracklets` tracklets, and at least `observers` observers with `tracklets_each` of them each.
      If it has two or three observers, the hypothesis that one of them saw another object is
      rejected.
    - The orbit has at least `tracklets` tracklets, and its position has a standard deviation of at
      most `largest_sigma_km`. The detections of one observer alone determine an orbit, and those of
      the others agree with it (`cislunar.orbit_determination.verdicts.determined_by_one`).
    """

    # fmt: off

    observers_alone: Count = setting(
        "number of observers that is sufficient", "1", default=3)
    observers: Count = setting(
        "number of observers with several tracklets each that is sufficient", "1", default=2)
    tracklets_each: Count = setting("tracklets that each of these needs", "1", default=2)
    tracklets: Count = setting("tracklets that these need in all", "1", default=5)
    largest_sigma_km: Positive = setting(
        "largest standard deviation of the position of an orbit that one observer alone "
        "determines", "km", default=100)
    least_log_ratio: Number = setting(
        "least logarithm of the likelihood ratio to false alarms", "1", default=10)

    separation_significance: number(gt=0, lt=0.5) = setting(
        "probability of a larger decrease of chi squared by an orbit of its own for each observer "
        "of two or three, or by all observers but one, below which an orbit is not confirmed", "1",
        default=0.003)

    # fmt: on

    def confirms(
        self,
        observers: ArrayLike,
        verdict: str,
        log_ratio: float,
        separation: float = 1.0,
        by_one: bool = False,
    ) -> bool:
        """Whether an orbit is confirmed.

        Parameters
        ----------
        observers : array_like of int, shape (tracklet,)
            Observers of its tracklets.
        verdict : str
            See `cislunar.orbit_determination.verdicts`.
        log_ratio : float
            Score of the orbit (`log_scores`).
        separation : float
            See `cislunar.orbit_determination.verdicts.separation_probability`.
        by_one : bool
            Whether the detections of one observer determine the orbit, those of the others agree,
            and the standard deviation of the position is small enough.

        Returns
        -------
        bool
        """
        counts = np.unique(np.asarray(observers), return_counts=True)[1]
        several = counts >= self.tracklets_each
        enough = counts.size >= self.observers_alone or (
            np.count_nonzero(several) >= self.observers and counts.sum() >= self.tracklets
        )
        seen = (enough and separation >= self.separation_significance) or (
            by_one and counts.sum() >= self.tracklets
        )
        return bool(seen and verdict == ORBIT and log_ratio >= self.least_log_ratio)


class LinkingSettings(Section):
    """Generation and choice of links."""

    # fmt: off

    gaps_h: tuple[Positive, ...] = setting(
        "longest times between the tracklets of a pair, one after the other", "h",
        default=(3, 8, 24))
    spans_h: tuple[Positive, ...] = setting(
        "times before and after an orbit's tracklets within which others are sought, one after the "
        "other", "h", default=(3, 6, 12, 24))
    window_h: Positive = setting(
        "time before the last tracklet within which tracklets that are in no orbit are linked", "h",
        default=36)
    longest_arc_days: Positive = setting(
        "time before the last detection of an orbit within which its detections determine it: over "
        "weeks, the fit of an unstable orbit is singular in double precision", "day", default=14)
    gate_probability: number(gt=0, lt=1) = setting(
        "probability that the gate keeps a tracklet of an orbit", "1", default=0.9999)
    exclusive_tracklets: Count = setting(
        "number of tracklets from which on those of an orbit are not in further pairs", "1",
        default=3)
    several_starts_below: Count = setting(
        "tracklets below which all solutions for the detections of a link are sought", "1",
        default=4)
    expected_objects: Positive = setting(
        "expected number of unknown objects in the region", "1", default=200)
    detection_probability: number(gt=0, lt=1) = setting(
        "probability of detecting an object that is in the field", "1", default=0.9)
    magnitude_sigma: Positive = setting(
        "standard deviation of an object's magnitudes about those of a sphere", "mag", default=0.4)
    pairs: PairSettings = setting("", default=PairSettings())
    verdict: VerdictSettings = setting("", default=VerdictSettings())
    starts: InitialOrbitSettings = setting(
        "", default=InitialOrbitSettings(n_tracklets=2, n_ranges=16, n_rates=5))
    confirmation: ConfirmationRule = setting("", default=ConfirmationRule())

    # fmt: on


def log_scores(
    fits: OrbitFits,
    angles: Angles,
    region: AdmissibleRegion,
    settings: LinkingSettings,
    log_clutter: ArrayLike,
) -> Array:
    """Scores of hypotheses, equation (1).

    The score is minus infinity if the fit has not converged, the size that the brightness implies
    is outside of the region, the sphere would be unlit at a detection, or two detections are in one
    exposure. Distance and Jacobi constant are not checked.

    Parameters
    ----------
    fits : OrbitFits
    angles : Angles
    region : AdmissibleRegion
    settings : LinkingSettings
    log_clutter : array_like, shape () or (row,)
        Logarithm of the density of clutter, per steradian and, for rows with a magnitude and a
        position of the Sun, per magnitude (`cislunar.detection.DetectionProcess.log_intensity`).

    Returns
    -------
    ndarray, shape (fit,)
    """
    n = np.diff(fits.begin)
    score = log_evidence(fits, angles, region) + np.log(settings.expected_objects)
    kappa = np.broadcast_to(np.asarray(log_clutter, dtype=float), angles.time.shape)
    each = np.log(settings.detection_probability) - kappa[fits.row]
    residual = sphere_magnitude_residuals(fits.position, angles.rows(fits.row))
    variance = settings.magnitude_sigma**2 + angles.magnitude_variance[fits.row]
    known = np.isfinite(residual) & np.isfinite(variance)
    # minus infinity of the sphere: unlit, though detected
    each = np.where(np.isinf(residual), -np.inf, each)
    weight = np.where(known, 1.0 / np.where(known, variance, 1.0), 0.0)
    value = np.where(known, residual, 0.0)
    of = np.repeat(np.arange(n.size), n)

    def summed(values: Array) -> Array:
        return np.bincount(of, values, minlength=n.size)

    total = summed(weight)
    some = total > 0.0
    mean = summed(weight * value) / np.where(some, total, 1.0)
    log_normal = np.where(known, 0.5 * np.log(np.where(known, weight, 1.0) / (2.0 * np.pi)), 0.0)
    each = each + log_normal - 0.5 * weight * (value - mean[of]) ** 2
    width = 2.5 * np.log10(region.largest_size_m2 / region.least_size_m2)
    size = 0.5 * np.log(2.0 * np.pi / np.where(some, total, 1.0)) - np.log(width)
    score += summed(each) + np.where(some, size, 0.0)
    # brightness as a constraint, too: sizes outside of the region have no density
    largest, least = -2.5 * np.log10([region.least_size_m2, region.largest_size_m2])
    score[some & ((mean < least) | (mean > largest))] = -np.inf
    exposure = angles.observer[fits.row], angles.time[fits.row], of
    order = np.lexsort(exposure)
    again = np.all([np.diff(values[order]) == 0 for values in exposure], axis=0)
    score[of[order[1:]][again]] = -np.inf
    return score
