"""Errors of the observers in a survey: larger variances, and calibration by confirmed orbits.

An observer has a constant error b of its assumed position (three components e) and of its measured
right ascension and declination. The offset of the predicted from the measured direction along the
tangent basis then is

    r = G b - A dx + noise,   G = [basis / rho, -diag(cos dec, 1)],                            (1)

with the error dx of the fitted orbit, the range rho and A = (basis / rho) Phi. Eliminating dx of
every confirmed orbit from the normal equations with the noise W^-1 leaves those of the errors of
all observers (Tapley, Schutz & Born 2004, Statistical Orbit Determination, section 6.2),

    N = P_0^-1 + sum (G'WG - G'WA (A'WA)^-1 A'WG),
    N b = sum (G'W r - G'WA (A'WA)^-1 A'W r).                                                  (2)

If the radiation pressure on objects is uncertain, its factor with its prior is eliminated with dx.

Detections are corrected by the estimate. What remains of the errors adds to the variances of the
angles with which detections are linked, that of the position as seen from a tenth of the Earth-Moon
distance. It is common to all detections of an observer, so that the covariance of an orbit
considers it apart (`considered`).

Assumptions and limitations
---------------------------
- The errors are constant.
- In linking, what remains of an observer's error is independent from detection to detection.
"""

from typing import NamedTuple

import numpy as np

from cislunar.estimation.navigation import ObserverErrorSigma
from cislunar.observation import Scene
from cislunar.orbit_determination import CONVERGED, Angles, OrbitFits
from cislunar.runtime import Array, Indices
from cislunar.survey.navigation.paths import ObservedPath, observed_paths

_NEAR = 0.1
"""Range at which a position error counts in the variance of angles, nondimensional."""

_ESTIMATED = 5
"""Position and two zero-point offsets."""


class ObserverCalibration(NamedTuple):
    """Estimated errors of the observers, true minus assumed.

    Attributes
    ----------
    mean : ndarray, shape (observer, 5)
        Position, nondimensional, and zero-point offsets of right ascension and declination, rad.
    covariance : ndarray, shape (observer, 5, observer, 5)
    """

    mean: Array
    covariance: Array


class RemainingErrors(NamedTuple):
    """What is uncertain about detections once the errors of their observers are corrected.

    Attributes
    ----------
    angles : Angles
        As measured.
    scene : Scene
    errors : ObserverCalibration
    """

    angles: Angles
    scene: Scene
    errors: ObserverCalibration

    def corrected(self, rows: Indices) -> Angles:
        """Some of the detections, corrected."""
        return corrected_angles(self.angles.rows(rows), self.scene, self.errors)

    def covariance(self, gain: Array, path: ObservedPath) -> Array:
        """Covariance (m, m) of m quantities that are estimated from an orbit's detections with a
        gain (m, row, 2), equation (3)."""
        total = self.errors.covariance.reshape(self.errors.mean.size, -1)
        noise = np.einsum("inb,nbc,jnc->ij", gain, self.angles.covariance[path.rows], gain)
        by_error = _by_error(path, self.scene)
        shift = gain.reshape(len(gain), -1) @ by_error.reshape(-1, len(total))
        return noise + shift @ total @ shift.T


def uncalibrated(prior: ObserverErrorSigma, n_observers: int) -> ObserverCalibration:
    """The prior of the errors of all observers."""
    sigma = np.tile(prior.constant()[:_ESTIMATED], n_observers)
    shape = n_observers, _ESTIMATED
    return ObserverCalibration(np.zeros(shape), np.diag(sigma**2).reshape(*shape, *shape))


def corrected_angles(angles: Angles, scene: Scene, errors: ObserverCalibration) -> Angles:
    """Angles without the estimated errors of their observers, with larger variances.

    Parameters
    ----------
    angles : Angles
        As measured, along right ascension and declination of the observers' body frames.
    scene : Scene
    errors : ObserverCalibration

    Returns
    -------
    Angles
    """
    scale, own = _scale(angles, scene), errors.mean[angles.observer]
    offset = np.einsum("nac,na->nc", angles.basis, scale * own[:, 3:])
    unit = angles.direction - offset
    unit /= np.linalg.norm(unit, axis=1)[:, None]
    basis = angles.basis - np.einsum("nac,nc->na", angles.basis, unit)[..., None] * unit[:, None]
    basis /= np.linalg.norm(basis, axis=2)[..., None]
    each = np.arange(len(errors.mean))
    left = errors.covariance[each, :, each][angles.observer]
    variance = scale[:, :, None] * left[:, 3:, 3:] * scale[:, None, :]
    position = np.trace(left[:, :3, :3], axis1=1, axis2=2) / (3.0 * _NEAR**2)
    return angles._replace(
        observer_position=angles.observer_position + own[:, :3],
        direction=unit,
        basis=basis,
        covariance=angles.covariance + variance + position[:, None, None] * np.eye(2),
    )


def calibrate(
    fits: OrbitFits,
    given: RemainingErrors,
    prior: ObserverErrorSigma,
    *,
    forces: tuple,
    radiation_sigma: float = 0.0,
) -> ObserverCalibration:
    """Estimate the errors of the observers from the residuals of orbits, equation (2).

    Parameters
    ----------
    fits : OrbitFits
        Orbits of objects, fitted to the angles that the errors of `given` correct.
    given : RemainingErrors
        With the errors with which the orbits were fitted.
    prior : ObserverErrorSigma
        Standard deviations of the errors before any detection.
    forces : NamedTuple
        CR3BP or ephemeris forces.
    radiation_sigma : float
        Standard deviation of the factor of the radiation pressure on an object; 0: it is known.

    Returns
    -------
    ObserverCalibration
        Components without a prior standard deviation are not estimated. Orbits that cannot be
        propagated to their detections do not count.
    """
    angles, scene, errors = given
    shape = errors.mean.shape
    sigma = np.tile(prior.constant()[:_ESTIMATED], len(errors.mean))
    # in standard deviations of the prior
    normal = np.eye(sigma.size)
    right = -errors.mean.ravel() / np.where(sigma > 0.0, sigma, 1.0)
    every = range(fits.epoch.size)
    for _, path in observed_paths(fits, every, given.corrected, forces, radiation_sigma):
        white = np.linalg.inv(np.linalg.cholesky(angles.covariance[path.rows]))
        by_error = _by_error(path, scene).reshape(*path.basis.shape[:2], -1)
        g = (white @ (by_error * sigma)).reshape(-1, sigma.size)
        offset = np.einsum("nac,nc->na", path.basis, path.way)
        others = [path.basis @ each for each in (path.by_state, path.by_factor)]
        others = (white @ np.concatenate(others, axis=2)).reshape(len(g), -1)
        more = others.shape[1] - 6  # rows of the prior of the factor
        others = np.concatenate([others, np.eye(more, 6 + more, 6)])
        q, _ = np.linalg.qr(others / np.linalg.norm(others, axis=0))
        g = np.concatenate([g, np.zeros((more, sigma.size))])
        g -= q @ (q.T @ g)
        normal += g.T @ g
        right += g[: len(g) - more].T @ (white @ offset[..., None]).ravel()
    covariance = np.linalg.inv(normal)
    mean = (sigma * (covariance @ right)).reshape(shape)
    scaled = sigma[:, None] * covariance * sigma
    return ObserverCalibration(errors.mean + mean, scaled.reshape(*shape, *shape))


def considered(fits: OrbitFits, remaining: RemainingErrors, *, forces: tuple) -> OrbitFits:
    """Orbits with the covariance due to noise and to what remains of the errors of the observers.

    With the weights W that a fit has used and its gain K = (A'WA)^-1 A'W, noise R and the
    covariance C of the errors give

        P = K (R + G C G') K'.                                                                 (3)

    Parameters
    ----------
    fits : OrbitFits
        Orbits fitted to the angles that the errors of `remaining` correct.
    remaining : RemainingErrors
    forces : NamedTuple
        CR3BP or ephemeris forces.

    Returns
    -------
    OrbitFits
        With other covariances and roots; those of fits that have not converged, or that cannot be
        propagated to their detections, are kept.
    """
    found: dict[int, Array] = {}
    converged = np.flatnonzero(fits.status == CONVERGED).tolist()
    for k, path in observed_paths(fits, converged, remaining.corrected, forces):
        by_state = path.basis @ path.by_state
        weighted = np.linalg.solve(path.angles.covariance, by_state).reshape(-1, 6)
        gain = (fits.covariance[k] @ weighted.T).reshape(6, -1, 2)
        found[k] = remaining.covariance(gain, path)
    which = list(found)
    return fits.updated(which, fits.state[which], np.array([*found.values()]).reshape(-1, 6, 6))


def _by_error(path: ObservedPath, scene: Scene) -> Array:
    """G (row, 2, observer, 5) of equation (1)."""
    own, count = path.angles, path.rows.size
    result = np.zeros((count, 2, scene.observer_position.shape[0], _ESTIMATED))
    each = np.arange(count)
    result[each, :, own.observer, :3] = path.basis
    result[each[:, None], [0, 1], own.observer[:, None], [3, 4]] = -_scale(own, scene)
    return result


def _scale(angles: Angles, scene: Scene) -> Array:
    """Offset (row, 2) of a direction along its basis by an offset of right ascension, and of
    declination, in the observer's body frame."""
    index = np.rint(angles.time / scene.step).astype(np.int64)
    pole = np.einsum("nc,nc->n", scene.observer_axes[index, 2], angles.direction)
    return np.stack([np.sqrt(np.maximum(1.0 - pole**2, 0.0)), np.ones(pole.size)], axis=1)
