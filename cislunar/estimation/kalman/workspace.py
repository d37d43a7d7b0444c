"""What the kernels of the unscented filters share: constants, scratch arrays, health, the field."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cislunar.compiled import allocating, borrowing, put
from cislunar.dynamics.tableau import STAGES8
from cislunar.estimation.estimator import (
    HEALTHY,
    INSIDE_PRIMARY,
    LOST_DEFINITENESS,
    NOT_FINITE,
)
from cislunar.estimation.spread import ProcessNoise
from cislunar.estimation.triangular import cholesky
from cislunar.estimation.unscented import UnscentedWeights, unscented_weights
from cislunar.observation.scene import Scene
from cislunar.observation.sensor import Sensors, sensor_limits
from cislunar.observation.sightline import inside_primary
from cislunar.photometry.facet_blocks import BLOCK_ROWS, LANES

Array = NDArray[np.float64]


class FilterConstants(NamedTuple):
    """Numbers the kernels of a filter need.

    Attributes
    ----------
    forces : NamedTuple
        Force model, see `cislunar.dynamics.forces`.
    process_variance : ndarray, shape (n,)
        Added to the covariance's diagonal at each step.
    process_covariance : float
        Added to that of position and velocity on the same axis.
    half_field : ndarray, shape (observer,)
        Half the fields of view, rad.
    use_magnitude : bool
        False leaves the magnitude out of the update.
    weights : UnscentedWeights
        For n states.
    orbit_weights : UnscentedWeights
        For position and velocity alone.
    curvature : float
        Second-order part of predicted angles, noise variances, beyond which an orbit's Gaussian is
        split; inf for never.
    """

    forces: tuple
    process_variance: Array
    process_covariance: float
    half_field: Array
    use_magnitude: bool
    weights: UnscentedWeights
    orbit_weights: UnscentedWeights
    curvature: float


def filter_constants(
    n: int,
    scene: Scene,
    sensor: Sensors,
    process_noise: ProcessNoise | None,
    forces: tuple,
    use_magnitude: bool,
    splitting: bool,
) -> FilterConstants:
    """Constants of a filter of the last n of the twelve states."""
    process = ProcessNoise() if process_noise is None else process_noise
    variance, covariance = process.covariance(scene.step_s)
    return FilterConstants(
        forces,
        variance[12 - n :],
        covariance,
        sensor_limits(sensor, scene.observer_position.shape[0]).half_field,
        bool(use_magnitude),
        unscented_weights(n),
        unscented_weights(6),
        1.0 if splitting else np.inf,
    )


class Workspace(NamedTuple):
    """Scratch arrays of one target's filter, reused over targets and steps."""

    bundle: Array
    slopes: Array
    stage: Array
    differences: Array
    block: Array
    shift: Array
    covariance: Array
    expected: Array
    expected_shift: Array
    cross: Array
    even: Array
    innovation: Array
    correction: Array


@allocating
def make_workspace(size, measured):
    """Scratch arrays for so many states and components of a measurement."""
    outer = 2 * size
    return Workspace(
        np.empty((6, outer + 1)),
        np.empty((STAGES8, 6, outer + 1)),
        np.empty((6, outer + 1)),
        np.empty((outer, size)),
        np.empty((BLOCK_ROWS, LANES)),
        np.empty(size),
        np.empty((size, size)),
        np.empty((outer, measured)),
        np.empty(measured),
        np.empty((size, measured)),
        np.empty((measured, measured)),
        np.empty(measured),
        np.empty(size),
    )


@borrowing
def translation_condition(translation, primaries, constants):
    """Whether a translation (6,) is usable: HEALTHY, NOT_FINITE or INSIDE_PRIMARY.

    Where estimates are split, a mean inside the Moon is that of a spread bent about it.
    """
    if not np.isfinite(np.sum(translation)):
        return NOT_FINITE
    if constants.curvature < np.inf:
        return HEALTHY
    inside = inside_primary(translation[0], translation[1], translation[2], primaries)
    return INSIDE_PRIMARY if inside else HEALTHY


@njit(cache=True, error_model="numpy", inline="always")
def add_process_noise(covariance, constants):
    """Add what a step of process noise does to a covariance (n, n), to its lower triangle."""
    n = covariance.shape[0]
    for c in range(n):
        covariance[c, c] += constants.process_variance[c]
    for c in range(n - 3, n):
        covariance[c, c - 3] += constants.process_covariance


@borrowing
def noise_of_gap(n_steps, dt, constants):
    """Variance of position, covariance with velocity, variance of velocity on each axis.

    What so many steps of process noise add up to in free motion.
    """
    position, velocity = constants.process_variance[-6], constants.process_variance[-1]
    both = constants.process_covariance
    once, squared = n_steps * (n_steps - 1) / 2.0, (n_steps - 1) * n_steps * (2 * n_steps - 1) / 6.0
    return (
        n_steps * position + 2.0 * once * dt * both + squared * dt * dt * velocity,
        n_steps * both + once * dt * velocity,
        n_steps * velocity,
    )


@borrowing
def add_orbit_noise(covariance, n_steps, dt, constants):
    """Add the noise of a gap to a covariance (6, 6) of the orbit, to its lower triangle."""
    position, both, velocity = noise_of_gap(n_steps, dt, constants)
    for c in range(3):
        covariance[c, c] += position
        covariance[c + 3, c] += both
        covariance[c + 3, c + 3] += velocity


@borrowing
def take_covariance(covariance, root):
    """Put the Cholesky factor of a covariance, which is spoilt, into `root`; returns the health."""
    if not cholesky(covariance):
        total = 0.0  # of the lower triangle: what is above it means nothing
        for c in range(covariance.shape[0]):
            for d in range(c + 1):
                total += covariance[c, d]
        return LOST_DEFINITENESS if np.isfinite(total) else NOT_FINITE
    put(root, covariance)
    return HEALTHY


@borrowing
def in_field(off_ra, off_dec, declination, half_field):
    """Whether a direction lies in the field of view about the expected one."""
    # Right ascension is compared on the sky: at the pole of the body frame it means nothing.
    return abs(off_ra) * np.cos(declination) <= half_field and abs(off_dec) <= half_field


@borrowing
def deviations(root, sigma):
    """Standard deviations (n,) of a covariance given by its lower Cholesky factor (n, n)."""
    for c in range(sigma.shape[0]):
        total = 0.0
        for d in range(c + 1):
            total += root[c, d] * root[c, d]
        sigma[c] = np.sqrt(total)


@borrowing
def covariance_of(rows, covariance):
    """Covariance (n, n) of some states, given their rows (n, m) of a Cholesky factor."""
    for c in range(rows.shape[0]):
        for d in range(c + 1):
            total = 0.0
            for k in range(rows.shape[1]):
                total += rows[c, k] * rows[d, k]
            covariance[c, d] = total
            covariance[d, c] = total


@borrowing
def leave_out(out, j, i):
    """Put NaN for step i of target j, whose estimate has come to an end, into the estimates."""
    out.quaternion[j, i, :] = np.nan
    out.angular_velocity[j, i, :] = np.nan
    out.translation[j, i, :] = np.nan
    out.sigma[j, i, :] = np.nan
    if i < out.covariance.shape[1]:
        out.covariance[j, i, :, :] = np.nan
