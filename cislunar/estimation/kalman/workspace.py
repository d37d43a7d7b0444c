"""Shared parts of the unscented filters: constants, scratch arrays, health and field of view."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.compiled import copy_into, njit_alloc, njit_inline, njit_noalloc
from cislunar.dynamics.forces import of_targets, require_targets
from cislunar.dynamics.tableau import STAGES8
from cislunar.errors import ConfigurationError
from cislunar.estimation.estimator import (
    HEALTHY,
    INSIDE_PRIMARY,
    LOST_DEFINITENESS,
    NOT_FINITE,
)
from cislunar.estimation.initial_sigma import ProcessNoise
from cislunar.estimation.triangular import cholesky
from cislunar.estimation.unscented import UNSCENTED_WEIGHTS, UnscentedWeights
from cislunar.observation.scene import Scene
from cislunar.observation.sensor import Sensors, sensor_limits
from cislunar.observation.sightline import inside_primary
from cislunar.photometry.facet_blocks import BLOCK_ROWS, LANES
from cislunar.runtime import Array

_NO_KINDS = np.empty(0, np.int64), np.empty(0, np.int64)


class FilterConstants(NamedTuple):
    """Constants of a filter of n states.
    `forces`: force model, see `cislunar.dynamics.forces`. Added to the covariance at each step:
    `process_variance` (n,) to the diagonal, `process_covariance` to that of position and
    velocity on the same axis. `half_field` (observer,): half the fields of view, rad.
    `use_magnitude`: whether the update uses the magnitude. `weights`: of sigma points.
    `curvature`: second-order part of predicted angles, in noise variances, from which an orbit's
    Gaussian is split; inf for never. `rotation_kinds`, `surface_kinds`: deviations of rotation
    and surface that are estimated as well, as the first of the n states; `parameters`: the kinds
    of all of them, in a tuple whose length the compiler knows. `extra_variance`: added to the
    variance of a magnitude, mag^2. `noise_memory`: number of magnitudes over which their
    variance is averaged; 0 if it is known."""

    forces: tuple
    process_variance: Array
    process_covariance: float
    half_field: Array
    use_magnitude: bool
    weights: UnscentedWeights
    curvature: float
    parameters: tuple[int, ...]
    rotation_kinds: NDArray[np.int64]
    surface_kinds: NDArray[np.int64]
    extra_variance: float
    noise_memory: float


def filter_constants(
    n: int,
    scene: Scene,
    sensor: Sensors,
    process_noise: ProcessNoise | None,
    forces: tuple,
    use_magnitude: bool,
    splitting: bool,
    extra_magnitude_noise: float = 0.0,
    noise_memory: float | None = None,
    kinds: tuple[NDArray[np.int64], NDArray[np.int64]] = _NO_KINDS,
) -> FilterConstants:
    """Constants of a filter of the last n of the twelve states of the motion, and of deviations of
    the `kinds` of rotation and surface, which are constant.

    Raises
    ------
    ConfigurationError
        If the added noise or the memory is out of range, or `sensor` is neither one sensor nor one
        for each observer.
    """
    if not 0.0 <= extra_magnitude_noise < np.inf:
        raise ConfigurationError(
            f"extra_magnitude_noise = {extra_magnitude_noise} mag must be finite and at least 0"
        )
    if noise_memory is not None and not 1.0 < noise_memory < np.inf:
        raise ConfigurationError(
            f"noise_memory = {noise_memory} must be a number of magnitudes above 1, or None"
        )
    process = ProcessNoise() if process_noise is None else process_noise
    variance, covariance = process.covariance(scene.step_s)
    constant = kinds[0].size + kinds[1].size
    return FilterConstants(
        forces,
        np.append(np.zeros(constant), variance[12 - n :]),
        covariance,
        sensor_limits(sensor, scene.observer_position.shape[0]).half_field,
        bool(use_magnitude),
        UNSCENTED_WEIGHTS,
        1.0 if splitting else np.inf,
        tuple(np.append(*kinds).tolist()),
        *kinds,
        float(extra_magnitude_noise) ** 2,
        float(noise_memory or 0.0),
    )


def with_new_tracks(
    constants: FilterConstants, forces: tuple | None, n_tracks: int, n_new: int
) -> tuple[FilterConstants, FilterConstants]:
    """Constants of a filter to which tracks are added, and of a filter of the new tracks alone. The
    force model is `forces`, if given.

    Raises
    ------
    ConfigurationError
        If the force model has values for another number of targets.
    """
    common = constants.forces if forces is None else forces
    require_targets(common, n_tracks + n_new)
    own = of_targets(common, np.arange(n_tracks, n_tracks + n_new))
    return constants._replace(forces=common), constants._replace(forces=own)


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


@njit_alloc
def make_workspace(size, measured):
    """Scratch arrays for `size` states and `measured` components of a measurement."""
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


@njit_noalloc
def translation_condition(translation, primaries, constants):
    """Health of a translation (6,): HEALTHY, NOT_FINITE or INSIDE_PRIMARY. If Gaussians are split,
    a mean inside the Moon may be that of a distribution curved around it."""
    if not np.isfinite(np.sum(translation)):
        return NOT_FINITE
    if constants.curvature < np.inf:
        return HEALTHY
    inside = inside_primary(translation[0], translation[1], translation[2], primaries)
    return INSIDE_PRIMARY if inside else HEALTHY


@njit_inline
def add_process_noise(covariance, constants):
    """Add the process noise of a step to a covariance (n, n), in its lower triangle."""
    n = covariance.shape[0]
    for c in range(n):
        covariance[c, c] += constants.process_variance[c]
    for c in range(n - 3, n):
        covariance[c, c - 3] += constants.process_covariance


@njit_noalloc
def noise_of_gap(n_steps, dt, constants):
    """Variance of position, covariance with velocity and variance of velocity on each axis. They
    are the accumulated process noise of `n_steps` steps of free motion, an approximation for times
    that are short compared with a revolution."""
    position, velocity = constants.process_variance[-6], constants.process_variance[-1]
    both = constants.process_covariance
    once, squared = n_steps * (n_steps - 1) / 2.0, (n_steps - 1) * n_steps * (2 * n_steps - 1) / 6.0
    return (
        n_steps * position + 2.0 * once * dt * both + squared * dt * dt * velocity,
        n_steps * both + once * dt * velocity,
        n_steps * velocity,
    )


@njit_noalloc
def has_orbit_noise(constants):
    """Whether position or velocity has process noise."""
    return constants.process_variance[-6] > 0.0 or constants.process_variance[-1] > 0.0


@njit_noalloc
def add_orbit_noise(covariance, n_steps, dt, constants):
    """Add the noise of a few steps to a covariance (6, 6) of the orbit."""
    position, both, velocity = noise_of_gap(n_steps, dt, constants)
    for c in range(3):
        covariance[c, c] += position
        covariance[c + 3, c] += both
        covariance[c, c + 3] += both
        covariance[c + 3, c + 3] += velocity


@njit_noalloc
def take_covariance(covariance, root):
    """Put the Cholesky factor of a covariance, which is overwritten, into `root`; returns the
    health."""
    if not cholesky(covariance):
        total = 0.0  # of the lower triangle, the only valid one
        for c in range(covariance.shape[0]):
            for d in range(c + 1):
                total += covariance[c, d]
        return LOST_DEFINITENESS if np.isfinite(total) else NOT_FINITE
    copy_into(root, covariance)
    return HEALTHY


@njit_noalloc
def in_field(off_ra, off_dec, declination, half_field):
    """Whether a direction lies in the field of view about the expected one."""
    # Right ascension is scaled to an arc: it is not defined at the pole of the body frame.
    return abs(off_ra) * np.cos(declination) <= half_field and abs(off_dec) <= half_field


@njit_noalloc
def deviations(rows, sigma):
    """Standard deviations (m,) of the last m of n states, given their rows (m, n) of the lower
    Cholesky factor of the covariance."""
    before = rows.shape[1] - rows.shape[0]
    for c in range(sigma.shape[0]):
        total = 0.0
        for d in range(before + c + 1):
            total += rows[c, d] * rows[c, d]
        sigma[c] = np.sqrt(total)


@njit_noalloc
def covariance_of(rows, covariance):
    """Covariance (n, n) of some states, given their rows (n, m) of a Cholesky factor."""
    for c in range(rows.shape[0]):
        for d in range(c + 1):
            total = 0.0
            for k in range(rows.shape[1]):
                total += rows[c, k] * rows[d, k]
            covariance[c, d] = total
            covariance[d, c] = total


@njit_noalloc
def leave_out(out, j, i):
    """Put NaN into the estimates of target j at step i, whose estimate has ended."""
    out.quaternion[j, i, :] = np.nan
    out.angular_velocity[j, i, :] = np.nan
    out.translation[j, i, :] = np.nan
    out.sigma[j, i, :] = np.nan
    if i < out.covariance.shape[1]:
        out.covariance[j, i, :, :] = np.nan
