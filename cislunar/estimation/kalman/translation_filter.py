"""Compiled steps of an unscented filter for position and velocity from angles alone.

The filter is the translation part of the paper's filter (Paul & Fan, section 2.4): six states,
thirteen sigma points, right ascension and declination. The magnitude contains almost no information
on the orbit; without it the orbit changes by less than its uncertainty.
"""

import numpy as np

from cislunar.compiled import njit_noalloc
from cislunar.dynamics.bundle import step_cloud
from cislunar.dynamics.forces import of_state
from cislunar.estimation.estimator import HEALTHY
from cislunar.estimation.expected import expected_directions
from cislunar.estimation.kalman.workspace import (
    add_process_noise,
    in_field,
    take_covariance,
    translation_condition,
)
from cislunar.estimation.unscented import (
    difference_moments,
    innovation_moments,
    sigma_points,
    square_root_update,
)
from cislunar.observation.sightline import wrap_angle

SIZE = 6

# Outcomes of an update.
ACCEPTED, OUTSIDE_FIELD, FAILED_UPDATE, CURVED = range(4)


@njit_noalloc
def predict_translation(translation, root, j, k, scene, constants, work):
    """Propagate mean (6,) and root (6, 6) of target j over the step from time k; their health."""
    weights, bundle, differences = constants.weights, work.bundle, work.differences
    sigma_points(translation, root, weights.spread, bundle)
    forces = of_state(constants.forces, j)
    step_cloud(forces, k * scene.step, bundle, scene.step, work.slopes, work.stage)
    for c in range(SIZE):
        center = bundle[c, 0]
        for i in range(2 * SIZE):
            differences[i, c] = bundle[c, 1 + i] - center
    difference_moments(differences, weights.outer, weights.mean_shift, work.shift, work.covariance)
    add_process_noise(work.covariance, constants)
    for c in range(SIZE):
        translation[c] = bundle[c, 0] + work.shift[c]
    health = translation_condition(translation, scene.primaries[k + 1], constants)
    return health if health != HEALTHY else take_covariance(work.covariance, root)


@njit_noalloc
def is_curved(even, cross, variance, nonlinearity, limit):
    """Whether the second-order part of predicted angles exceeds `limit` noise variances. `even` (2,
    2) and `cross` (n, 2) are those of `innovation_moments`. `nonlinearity` bounds the shift of the
    mean by earlier curvature of the flow, in standard deviations; it contributes twice the square
    of the corresponding shift of the angles."""
    for a in range(2):
        linear = 0.0
        for i in range(cross.shape[0]):
            linear += cross[i, a] * cross[i, a]
        if (
            even[a, a] - variance[a] + 2.0 * nonlinearity * nonlinearity * linear
            > limit * variance[a]
        ):
            return True
    return False


@njit_noalloc
def update_translation(translation, root, observation, limits, nonlinearity, weights, work):
    """Update one target by one direction: ACCEPTED, OUTSIDE_FIELD, CURVED, or FAILED_UPDATE. An
    observation is right ascension and declination, their variances (2,), and the position (3,) of
    the observer with the rotation (3, 3) from the propagation frame to its body frame. `limits` are
    half the field of view and the limit of `is_curved`. The update fails if it is not finite. Only
    an accepted direction changes the estimate."""
    right_ascension, declination, variance, observer, axes = observation
    half_field, curvature = limits
    sigma_points(translation, root, weights.spread, work.bundle)
    ra0, dec0 = expected_directions(work.bundle, observer, axes, work.expected)
    off_ra, off_dec = wrap_angle(right_ascension - ra0), declination - dec0
    if not in_field(off_ra, off_dec, dec0, half_field):
        return OUTSIDE_FIELD
    innovation_moments(work.expected, variance, weights, work.expected_shift, work.cross, work.even)
    if curvature < np.inf and is_curved(work.even, work.cross, variance, nonlinearity, curvature):
        return CURVED
    work.innovation[0] = off_ra - work.expected_shift[0]
    work.innovation[1] = off_dec - work.expected_shift[1]
    if not square_root_update(
        root, work.cross, work.even, work.innovation, work.correction, work.covariance
    ):
        return FAILED_UPDATE
    for c in range(SIZE):
        translation[c] += work.correction[c]
    return ACCEPTED
