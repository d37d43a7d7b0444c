"""Hand-over of cataloged orbits to the tracking loop.

A confirmed orbit has a state and a covariance at its epoch. Detections without identity tell little
of the attitude, whose prior is therefore uniform over all rotations. Estimators represent an
attitude by generalized Rodrigues parameters p with a normal distribution. The prior is the normal
distribution with the second moments of uniform attitudes; by their density (1 - cos t) / pi of the
angle t (Miles 1965, Biometrika 52, 636) the variance of each parameter is

    1/3 int_0^pi |p(t)|^2 (1 - cos t) / pi dt,   |p(t)| = f sin(t/2) / (a + cos(t/2)).         (1)

Only what the catalog knows is used; which orbit is of which object is not.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import quad

from cislunar.attitude import grp
from cislunar.errors import ConfigurationError
from cislunar.estimation.estimator import InitialEstimate
from cislunar.orbit_determination import LinkedOrbits, OrbitStates, orbits_at
from cislunar.runtime.arguments import number_of
from cislunar.survey.settings import ANGULAR_VELOCITY_SIGMA_DEG_H


class HandOver(NamedTuple):
    """Confirmed orbits as targets of the tracking loop.

    Attributes
    ----------
    initial : InitialEstimate
        Estimates at the time of the hand-over, with a covariance for each target.
    orbit : ndarray of int, shape (target,)
        Index of each target's orbit in the catalog.
    """

    initial: InitialEstimate
    orbit: NDArray[np.int64]


def uniform_attitude_sigma() -> float:
    """Standard deviation of each parameter of an attitude that is uniform over all rotations,
    equation (1), in generalized Rodrigues parameters."""

    def integrand(angle: float) -> float:
        size = grp.GRP_F * np.sin(0.5 * angle) / (grp.GRP_A + np.cos(0.5 * angle))
        return size**2 * (1.0 - np.cos(angle)) / np.pi

    return float(np.sqrt(quad(integrand, 0.0, np.pi)[0] / 3.0))


def hand_over(
    orbits: LinkedOrbits,
    time: float,
    *,
    forces: tuple,
    radiation_sigma: float = 0.0,
    angular_velocity_sigma_deg_h: float = ANGULAR_VELOCITY_SIGMA_DEG_H,
) -> HandOver:
    """Confirmed orbits of a catalog as initial estimates of the tracking loop.

    Parameters
    ----------
    orbits : LinkedOrbits
        Orbits of a catalog, for instance `SurveyResult.linked`.
    time : float
        Time from which the orbits are tracked, nondimensional, in the time of their epochs.
    forces : NamedTuple
        Force model of the catalog, CR3BP or ephemeris forces.
    radiation_sigma : float
        Standard deviation of the factor of the radiation pressure on an object; 0: it is known.
    angular_velocity_sigma_deg_h : float
        Standard deviation of each component of the unknown angular velocity, deg/h.

    Returns
    -------
    HandOver
        Estimates have no rotation on average. Orbits that meet a body before `time` are left out.

    Raises
    ------
    ConfigurationError
        If no confirmed orbit can be handed over, or a number is impossible.
    """
    time = number_of("time", time)
    if number_of("radiation_sigma", radiation_sigma) < 0.0:
        raise ConfigurationError(f"radiation_sigma = {radiation_sigma} must not be negative")
    rate = number_of("angular_velocity_sigma_deg_h", angular_velocity_sigma_deg_h, positive=True)
    confirmed = np.flatnonzero(orbits.confirmed)
    fits = orbits.fits.take(confirmed)
    states, kept = orbits_at(OrbitStates.of(fits), time, forces, radiation_sigma)
    state, translation = states.state, states.covariance
    n = len(state)
    if n == 0:
        raise ConfigurationError(
            f"none of {orbits.confirmed.size} orbits, {confirmed.size} of them confirmed, can be "
            f"handed over at time = {time:g}; observe longer, or relax linking.confirmation"
        )
    covariance = np.zeros((n, 12, 12))
    rotation = np.repeat([uniform_attitude_sigma(), np.deg2rad(rate) / 3600.0], 3)
    covariance[:, range(6), range(6)] = rotation**2
    covariance[:, 6:, 6:] = 0.5 * (translation + translation.swapaxes(1, 2))
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2).mean(axis=0))
    initial = InitialEstimate(
        np.tile([0.0, 0.0, 0.0, 1.0], (n, 1)), np.zeros((n, 3)), state, sigma, covariance
    )
    return HandOver(initial, confirmed[kept])
