"""Maneuvers within the detections of an orbit, and its radiation pressure.

One fit may agree with the detections on both sides of a small maneuver: its bias is significant
against the covariance of the orbit long before chi squared of all detections is. For a fit, let r
be the standardized residuals, A their derivatives with respect to the state at the epoch, and B(t)
those with respect to an impulse at a time t before the epoch. With the rate of maneuvers and the
normal prior of changes of velocity of `cislunar.survey.maneuvers.lineage`, the odds of one maneuver
to none are

    L = rate int mean over s of |1 + s^2 G|^(-1/2) exp(d' (G + s^-2 1)^-1 d / 2) dt,           (1)
    G = B' Q B,   d = B' Q r,   Q = 1 - A (A' A)^-1 A'.

The generalized likelihood ratio of Willsky & Jones (1976, IEEE Transactions on Automatic Control
21, 108) maximizes over time and impulse instead of integrating over a prior. The decisions of the
catalog use the more probable of the two: if L exceeds 1, the state is that after a maneuver, with
the moments of the mixture over times and scales, and a further maneuver is sought, up to a total of
four. The derivatives with respect to the most probable impulse are then appended to A. If L_i is
the ratio for the i-th maneuver after i - 1 others, p_i = L_i / (1 + L_i), and x_i and P_i are state
and covariance after i maneuvers, a second state and covariance average over the numbers of
maneuvers: they are the moments of the mixture of the x_i and P_i with the probabilities

    p_1 ... p_i (1 - p_(i+1)),                                                                 (2)

up to the first i with L_i < 1, or to four, after which no further one counts. With n the last one,
its probability is p_1 ... p_n.

A maneuver shortly before the last detections hardly changes the angles, but it changes the
velocity. If it is not detected, the first covariance can be too small by orders of magnitude. The
averaged one is larger, but may still be too small.

If the radiation pressure on objects is uncertain, its factor is estimated with the state: A has the
derivative by it, and its prior is a further residual. Covariances consider what remains of the
errors of the observers (`cislunar.survey.navigation`).

Assumptions and limitations
---------------------------
- A maneuver is an impulse.
- All objects have the same rate of maneuvers. The search ends if one further maneuver is
  improbable, although two together may be more probable, as in a gap without detections.
- The mixture has no part without the earlier of two maneuvers and with the later one.
- The sums of equation (1) lose digits if a disturbance grows by more than 1e4 between the first and
  the last detection of an orbit, as over two weeks near L1.
- Residuals are linear in the impulse and in the factor, as they are if one fit nearly agrees with
  them.
- Equation (2) is dominated by large impulses of small probability shortly before the last
  detection, so that the distribution has longer tails than a normal one of its covariance.
- Predictions by `cislunar.orbit_determination.orbits_at` have the assumed radiation pressure, and
  the prior variance of its factor, which those of `cislunar.survey.maneuvers.orbit_paths` lack.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import expit, logsumexp

from cislunar.constants import SECONDS_PER_DAY, TIME_UNIT_S
from cislunar.dynamics import VELOCITY_UNIT_M_S
from cislunar.orbit_determination import Angles, OrbitFits, propagated
from cislunar.runtime import Array
from cislunar.survey.maneuvers.line_integrals import moments
from cislunar.survey.maneuvers.lineage import Lineage
from cislunar.survey.navigation import ObservedPath, RemainingErrors, observed_paths
from cislunar.survey.settings import LineageSettings

_COARSE_S, _FINE_S, _WORTH, _HALVINGS = 900.0, 60.0, 12.0, 8
"""Longest intervals of the integral of equation (1): of all times, and of those whose logarithm of
the integrand is at most `_WORTH` below the largest. The last one before the last detection is
halved so often, since the velocity after a large impulse there is hardly known."""

_MOST = 4
"""Maneuvers that are sought within an orbit; after the last of these no further one counts."""


class OrbitsWithManeuvers(NamedTuple):
    """Result of `maneuvers_within`; residuals are those of the given fits.

    Attributes
    ----------
    fits : OrbitFits
        With other states, covariances and roots of the orbits that contain a maneuver with a
        probability of at least one half, and of all if the radiation pressure is uncertain.
    averaged : OrbitFits
        With states, covariances and roots that average over the number of maneuvers, equation (2).
    lineage : Lineage
        Maneuvers of at least `LineageSettings.least_probability`, if all earlier ones of the search
        have it, too. Each has the same orbit before and after it.
    """

    fits: OrbitFits
    averaged: OrbitFits
    lineage: Lineage


def maneuvers_within(
    fits: OrbitFits,
    angles: Angles,
    *,
    forces: tuple,
    settings: LineageSettings,
    radiation_sigma: float = 0.0,
    remaining: RemainingErrors | None = None,
) -> OrbitsWithManeuvers:
    """Orbits whose states and covariances allow for maneuvers between their detections, and for an
    uncertain radiation pressure.

    Parameters
    ----------
    fits : OrbitFits
        Converged fits, each at the time of its last detection.
    angles : Angles
        Detections, to whose rows the fits refer.
    forces : NamedTuple
        CR3BP or ephemeris forces.
    settings : LineageSettings
    radiation_sigma : float
        Standard deviation of the factor of the radiation pressure on an object; 0: it is as in
        `forces`.
    remaining : RemainingErrors, optional
        Errors of the observers that the covariances of the fits consider; none if omitted.

    Returns
    -------
    OrbitsWithManeuvers
    """
    rows: list[tuple] = []
    moved: dict[int, tuple[Array, Array]] = {}
    averaged: dict[int, tuple[Array, Array]] = {}
    every = range(fits.epoch.size)
    for k, path in observed_paths(fits, every, angles.rows, forces, radiation_sigma):
        found = _Search(fits, k, path, forces, settings, remaining)
        rows += found.maneuvers()
        averaged[k] = found.averaged
        if found.moved:
            moved[k] = found.state, found.covariance
    shapes = ((), (), (), (), (), (), (3,), (3, 3), (6,), (6, 6))
    columns = zip(*rows, strict=True) if rows else [()] * len(shapes)
    lineage = Lineage(
        *(np.array(each, dtype=np.int64 if c < 2 else float).reshape(-1, *shapes[c])
          for c, each in enumerate(columns))
    )  # fmt: skip
    return OrbitsWithManeuvers(_updated(fits, moved), _updated(fits, averaged), lineage)


def _updated(fits: OrbitFits, found: dict[int, tuple[Array, Array]]) -> OrbitFits:
    """Fits, some of which have other states and covariances."""
    if not found:
        return fits
    return fits.updated(list(found), *map(np.array, zip(*found.values(), strict=True)))


def _fine(near: Array, width: float, parts: int, to_the_end: bool) -> tuple[Array, Array]:
    """Middles and widths of the parts of intervals with the middles `near`; if the last one ends at
    the last detection, with halved parts next to it."""
    offset = width / parts * (np.arange(parts) - 0.5 * (parts - 1))
    time = (near[:, None] + offset).ravel()
    widths = np.full(time.size, width / parts)
    if to_the_end:
        left = np.append(widths[-1] * 0.5 ** np.arange(_HALVINGS + 1), 0.0)
        end = time[-1] + 0.5 * widths[-1]
        time = np.concatenate([time[:-1], end - 0.5 * (left[:-1] + left[1:])])
        widths = np.concatenate([widths[:-1], -np.diff(left)])
    return time, widths


def _inverse(design: Array) -> tuple[Array, Array]:
    """An orthonormal basis q of the columns of a matrix, and the inverse of q' design."""
    length = np.linalg.norm(design, axis=0)
    q, triangle = np.linalg.qr(design / length)
    return q, np.linalg.inv(triangle) / length[:, None]


class _Search:
    """Search within one orbit. `state` and `covariance` are those with the maneuvers so far, and
    `averaged` are those of equation (2)."""

    def __init__(
        self,
        fits: OrbitFits,
        k: int,
        path: ObservedPath,
        forces: tuple,
        settings: LineageSettings,
        remaining: RemainingErrors | None,
    ) -> None:
        self.k, self.settings, self.forces, self.moved = k, settings, forces, False
        self.start, self.epoch = fits.state[[k]], fits.epoch[[k]]
        self.state, self.covariance = fits.state[k], fits.covariance[k]
        self.path, self.time, self.remaining = path, path.angles.time, remaining
        root = np.linalg.cholesky(path.angles.covariance)
        white, self.white = np.linalg.solve(root, path.basis), np.linalg.inv(root)
        self.residual = -np.einsum("nac,nc->na", white, path.way).ravel()
        self.by_state = white @ path.by_state
        self.by_factor = (white @ path.by_factor).reshape(self.residual.size, -1)
        self.scales = np.array(settings.scales_m_s)[:, None] / VELOCITY_UNIT_M_S
        self.rate = settings.maneuvers_per_day * TIME_UNIT_S / SECONDS_PER_DAY

    def _by_velocity(self, time: Array) -> Array:
        """Derivatives (time, 6, 3) of the state at the epoch by impulses that precede it."""
        return np.linalg.inv(propagated(self.start, self.epoch, time, self.forces)[1][0])[:, :, 3:]

    def _sums(self, q: Array, left: Array) -> tuple[Array, Array, Array]:
        """Sums of the outer products of rows of q, over the first k detections and over all others
        with the priors, and of rows of q times residuals over the first k; for k from zero to the
        number of detections."""
        size, n = 2 * self.time.size, q.shape[1]
        each = q[:, :, None] * q[:, None]
        pairs = each[:size].reshape(-1, 2, n, n).sum(axis=1)
        early = np.concatenate([np.zeros((1, n, n)), np.cumsum(pairs, axis=0)])
        last = each[size:].sum(axis=0)[None]
        late = np.cumsum(np.concatenate([last, pairs[::-1]]), axis=0)[::-1]
        moment = (q[:size] * left[:size, None]).reshape(-1, 2, n).sum(axis=1)
        return early, late, np.concatenate([np.zeros((1, n)), np.cumsum(moment, axis=0)])

    def _integrand(
        self, sums: tuple, basis: Array, time: Array, by_velocity: Array, width: ArrayLike
    ) -> tuple[Array, Array, Array, Array]:
        """Logarithms (scale, time) of the parts of equation (1), changes of velocity with their
        covariances, and products (time, basis, 3) with impulses of the orthonormal basis q of the
        derivatives by all else. The derivative by the state at the epoch is q times `basis`."""
        early, late, moment = (each[np.searchsorted(self.time, time)] for each in sums)
        # B is -q u for detections before the impulse and zero for others; early + late is 1
        u = basis @ by_velocity
        along = -early @ u
        g = -along.swapaxes(1, 2) @ (late @ u)
        d = -np.einsum("tn,tni->ti", moment, u)
        value, axes = np.linalg.eigh(0.5 * (g + g.swapaxes(1, 2)))
        # rounding may make an eigenvalue negative
        value, squared = np.maximum(value, 0.0), self.scales[..., None] ** 2
        spread = axes * (squared / (1.0 + squared * value))[:, :, None] @ axes.swapaxes(1, 2)
        change = np.einsum("stij,tj->sti", spread, d)
        whole = np.log1p(squared * value).sum(axis=-1)
        log_part = 0.5 * (np.einsum("sti,ti->st", change, d) - whole)
        return log_part + np.log(self.rate * width / self.scales.size), change, spread, along

    def _covariance(self, q: Array, inverse: Array) -> Array:
        """Covariance of the state by the noise, and by what remains of the observers' errors."""
        if self.remaining is None:
            return (inverse @ inverse.T)[:6, :6]
        gain = inverse[:6] @ q.T
        count = self.residual.size
        of_angles = np.einsum("inb,nbc->inc", gain[:, :count].reshape(6, -1, 2), self.white)
        return self.remaining.covariance(of_angles, self.path) + gain[:, count:] @ gain[:, count:].T

    def maneuvers(self) -> list[tuple]:
        """Rows of a `Lineage`; changes the state and the covariance."""
        rows: list[tuple] = []
        design, residual = self.by_state.reshape(-1, 6), self.residual
        if self.by_factor.size:
            design = np.block([[design, self.by_factor], [np.zeros((1, 6)), np.ones((1, 1))]])
            residual = np.append(residual, 0.0)
            self.moved = True
        span = self.time[-1] - self.time[0]
        count = int(np.ceil(span * TIME_UNIT_S / _COARSE_S)) if self.rate > 0.0 else 0
        if self.moved or count:
            q, inverse = _inverse(design)
            self.state = self.state + (inverse @ (q.T @ residual))[:6]
            self.covariance = self._covariance(q, inverse)
        coarse = self.time[0] + span / max(count, 1) * (np.arange(count) + 0.5)
        parts = max(1, int(np.ceil(span / max(count, 1) * TIME_UNIT_S / _FINE_S)))
        by_coarse = self._by_velocity(coarse) if count else None
        # probabilities, states and covariances without a further maneuver, and with one
        ended, left = [], 1.0
        last = left, self.state, self.covariance
        while count and len(ended) < _MOST:
            sums = self._sums(q, residual - q @ (q.T @ residual))
            basis, width = q.T @ design[:, :6], span / count
            log_part, *_ = self._integrand(sums, basis, coarse, by_coarse, width)
            near = log_part.max(axis=0) >= log_part.max() - _WORTH
            time, width = _fine(coarse[near], width, parts, bool(near[-1]))
            by_velocity = self._by_velocity(time)
            log_part, change, spread, along = self._integrand(sums, basis, time, by_velocity, width)
            log_ratio = float(logsumexp(log_part))
            probability, share = float(expit(log_ratio)), np.exp(log_part - log_ratio)
            gain = -(inverse @ along)[:, :6]
            shift, extra = moments(
                share.ravel(), np.einsum("tij,stj->sti", gain, change).reshape(-1, 6),
                (gain @ spread @ gain.swapaxes(1, 2)).reshape(-1, 6, 6),
            )  # fmt: skip
            ended.append((left * (1.0 - probability), self.state, self.covariance))
            left *= probability
            last = left, self.state + shift, self.covariance + extra
            if log_ratio < 0.0:
                break
            self.moved = True
            _, self.state, self.covariance = last
            if probability >= self.settings.least_probability and len(rows) == len(ended) - 1:
                at = share.sum(axis=0)
                when = float(at @ time)
                variance = float(at @ ((time - when) ** 2 + width**2 / 12.0))
                velocity, between = moments(
                    share.ravel(), change.reshape(-1, 3), spread.reshape(-1, 3, 3)
                )
                rows.append((
                    self.k, self.k, log_ratio, probability, when, np.sqrt(variance),
                    VELOCITY_UNIT_M_S * velocity, VELOCITY_UNIT_M_S**2 * between,
                    self.state, self.covariance,
                ))  # fmt: skip
            # further ones are sought beside the most probable one, with its prior
            scale, best = np.unravel_index(np.argmax(share), share.shape)
            n = design.shape[1]
            before = 2 * np.searchsorted(self.time, time[best])
            impulse = np.zeros((residual.size, 3))
            impulse[:before] = -self.by_state.reshape(-1, 6)[:before] @ by_velocity[best]
            prior = np.eye(3, n + 3, n) / self.scales[scale]
            design = np.concatenate([np.concatenate([design, impulse], axis=1), prior])
            residual = np.concatenate([residual, np.zeros(3)])
            q, inverse = _inverse(design)
        self.averaged = moments(*map(np.array, zip(*ended, last, strict=True)))
        return rows
