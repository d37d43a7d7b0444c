"""Compiled steps of an unscented filter for position and velocity from angles alone.

The translation half of the paper's filter (Paul & Fan, section 2.4): six states, thirteen sigma
points, right ascension and declination. The magnitude says next to nothing about the orbit, so
that leaving it to the attitude's estimator changes the orbit by less than its noise.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cislunar.dynamics.bundle import step_bundle
from cislunar.dynamics.tableau import STAGES8
from cislunar.estimation.triangular import cholesky
from cislunar.estimation.unscented import (
    UnscentedWeights,
    difference_moments,
    innovation_moments,
    square_root_update,
    unscented_weights,
)
from cislunar.observation.measurement import (
    EARTH_RADIUS,
    MOON_RADIUS,
    direction_angles,
    wrap_angle,
)

Array = NDArray[np.float64]

SIZE = 6
POINTS = 2 * SIZE + 1
WEIGHTS = unscented_weights(SIZE)

# Condition of an estimate.
HEALTHY, NOT_FINITE, INSIDE_PRIMARY, LOST_DEFINITENESS = range(4)

# What became of a measurement.
USED, OUTSIDE_FIELD, FAILED_UPDATE = range(3)


class TranslationConstants(NamedTuple):
    """Numbers the kernels need.

    Attributes
    ----------
    forces : NamedTuple
        Force model, see `cislunar.dynamics.forces`.
    process_variance : ndarray, shape (6,)
        Added to the covariance's diagonal at each step.
    noise_variance : ndarray, shape (2,)
        Of right ascension and declination, rad^2.
    half_field : float
        Half the field of view, rad.
    weights : UnscentedWeights
        For six states.
    """

    forces: tuple
    process_variance: Array
    noise_variance: Array
    half_field: float
    weights: UnscentedWeights


class Workspace(NamedTuple):
    """Scratch arrays, reused over targets and steps."""

    bundle: Array
    slopes: Array
    stage: Array
    differences: Array
    shift: Array
    covariance: Array
    angles: Array
    angle_shift: Array
    cross: Array
    even: Array
    innovation: Array
    correction: Array


@njit(cache=True)
def make_workspace():
    """Scratch arrays (compiled)."""
    return Workspace(
        np.empty((SIZE, POINTS)),
        np.empty((STAGES8, SIZE, POINTS)),
        np.empty((SIZE, POINTS)),
        np.empty((POINTS - 1, SIZE)),
        np.empty(SIZE),
        np.empty((SIZE, SIZE)),
        np.empty((POINTS - 1, 2)),
        np.empty(2),
        np.empty((SIZE, 2)),
        np.empty((2, 2)),
        np.empty(2),
        np.empty(SIZE),
    )


@njit(cache=True, error_model="numpy")
def translation_condition(translation, mu):
    """Whether a translation is usable: HEALTHY, NOT_FINITE or INSIDE_PRIMARY (compiled)."""
    if not np.isfinite(np.sum(translation)):
        return NOT_FINITE
    x, y, z = translation[0], translation[1], translation[2]
    off_axis = y * y + z * z
    if (x + mu) ** 2 + off_axis < EARTH_RADIUS * EARTH_RADIUS:
        return INSIDE_PRIMARY
    if (x - 1.0 + mu) ** 2 + off_axis < MOON_RADIUS * MOON_RADIUS:
        return INSIDE_PRIMARY
    return HEALTHY


@njit(cache=True, error_model="numpy")
def _spread(translation, root, spread, bundle):
    """Sigma points by column, into `bundle`."""
    for c in range(SIZE):
        mean = translation[c]
        bundle[c, 0] = mean
        for i in range(SIZE):
            delta = spread * root[c, i]
            bundle[c, 1 + i] = mean + delta
            bundle[c, 1 + SIZE + i] = mean - delta


@njit(cache=True, error_model="numpy")
def predict_translation(translation, root, t, step, constants, work):
    """Carry one target's translation over a step (compiled).

    Parameters
    ----------
    translation : ndarray, shape (6,)
        Mean, nondimensional, rotating frame; updated in place.
    root : ndarray, shape (6, 6)
        Lower Cholesky factor of the covariance; updated in place.
    t, step : float
        Time at the start, since the epoch, and step; nondimensional.
    constants : TranslationConstants
    work : Workspace

    Returns
    -------
    int
        HEALTHY, NOT_FINITE, INSIDE_PRIMARY or LOST_DEFINITENESS.
    """
    weights, bundle, differences = constants.weights, work.bundle, work.differences
    _spread(translation, root, weights.spread, bundle)
    step_bundle(constants.forces, t, bundle, step, work.slopes, work.stage)
    for c in range(SIZE):
        center = bundle[c, 0]
        for i in range(POINTS - 1):
            differences[i, c] = bundle[c, 1 + i] - center
    difference_moments(differences, weights.outer, weights.mean_shift, work.shift, work.covariance)
    for c in range(SIZE):
        work.covariance[c, c] += constants.process_variance[c]
        translation[c] = bundle[c, 0] + work.shift[c]
    health = translation_condition(translation, constants.forces.mu)
    if health != HEALTHY:
        return health
    if not cholesky(work.covariance):
        return LOST_DEFINITENESS if np.isfinite(np.sum(work.covariance)) else NOT_FINITE
    root[:, :] = work.covariance
    return HEALTHY


@njit(cache=True, error_model="numpy")
def update_translation(
    translation, root, right_ascension, declination, observer, axes, constants, work
):
    """Use one direction of one target (compiled).

    Parameters
    ----------
    translation, root : ndarray
        The estimate, as in `predict_translation`; updated in place.
    right_ascension, declination : float
        Measured, rad.
    observer : ndarray, shape (3,)
        Position of the observer, nondimensional, rotating frame.
    axes : ndarray, shape (3, 3)
        Rotation from the rotating frame to the observer's body.
    constants : TranslationConstants
    work : Workspace

    Returns
    -------
    int
        USED; OUTSIDE_FIELD if the direction lies further than half the field of view from the
        expected one; FAILED_UPDATE, with the estimate unspoilt, if numbers were not finite.
    """
    weights, bundle, angles = constants.weights, work.bundle, work.angles
    _spread(translation, root, weights.spread, bundle)
    ra0, dec0 = 0.0, 0.0
    for point in range(POINTS):
        ra, dec = direction_angles(
            bundle[0, point] - observer[0],
            bundle[1, point] - observer[1],
            bundle[2, point] - observer[2],
            axes,
        )
        if point == 0:
            ra0, dec0 = ra, dec
        else:
            angles[point - 1, 0] = wrap_angle(ra - ra0)
            angles[point - 1, 1] = dec - dec0
    off_ra, off_dec = wrap_angle(right_ascension - ra0), declination - dec0
    # Right ascension is compared on the sky: at the pole of the body frame it means nothing.
    if not (
        abs(off_ra) * np.cos(dec0) <= constants.half_field and abs(off_dec) <= constants.half_field
    ):
        return OUTSIDE_FIELD
    innovation_moments(
        angles, constants.noise_variance, weights, work.angle_shift, work.cross, work.even
    )
    work.innovation[0] = off_ra - work.angle_shift[0]
    work.innovation[1] = off_dec - work.angle_shift[1]
    if not square_root_update(
        root, work.cross, work.even, work.innovation, work.correction, work.covariance
    ):
        return FAILED_UPDATE
    for c in range(SIZE):
        translation[c] += work.correction[c]
    return USED
