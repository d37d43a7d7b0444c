"""Compiled steps of the error-state multiplicative unscented filter (Paul & Fan, section 2.4).

The error state of a target is (attitude error, angular velocity, position, velocity): generalized
Rodrigues parameters, rad/s in the body frame, and nondimensional in the rotating frame. Carried
along are the attitude quaternion, the other means, and the lower Cholesky factor of the covariance.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cislunar.attitude.grp import GRP_A, GRP_F, quaternion_from_grp_components
from cislunar.attitude.quaternion import multiply_components
from cislunar.dynamics.bundle import step_bundle
from cislunar.dynamics.forces import of_state
from cislunar.estimation.estimator import (
    CHOLESKY_FAILURES,
    FLOOR_HITS,
    HEALTHY,
    LOST_DEFINITENESS,
    NOT_FINITE,
    OUT_OF_FIELD,
    UPDATES,
)
from cislunar.estimation.expected import expected_directions, expected_measurements
from cislunar.estimation.kalman.attitude_spread import rotation_differences
from cislunar.estimation.kalman.workspace import (
    add_process_noise,
    covariance_of,
    deviations,
    in_field,
    make_workspace,
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

Array = NDArray[np.float64]

SIZE = 12


class FilterState(NamedTuple):
    """Estimates of all targets, which the kernels change in place.

    Attributes
    ----------
    quaternion, omega, translation : ndarray, shapes (target, 4), (target, 3), (target, 6)
        Means: inertial to body; rad/s, body frame; nondimensional, rotating frame.
    root : ndarray, shape (target, 12, 12)
        Lower Cholesky factors of the covariances.
    failed : ndarray of uint8, shape (target,)
        HEALTHY, or why an estimate came to an end.
    counters : ndarray of int, shape (target, N_COUNTERS)
    """

    quaternion: Array
    omega: Array
    translation: Array
    root: Array
    failed: NDArray[np.uint8]
    counters: NDArray[np.int64]


@njit(cache=True, error_model="numpy")
def _turn_left(quaternion, d1, d2, d3, d4):
    """quaternion <- d (x) quaternion, normalised."""
    q1, q2, q3, q4 = multiply_components(
        d1, d2, d3, d4, quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    )
    scale = 1.0 / np.sqrt(q1 * q1 + q2 * q2 + q3 * q3 + q4 * q4)
    quaternion[0] = q1 * scale
    quaternion[1] = q2 * scale
    quaternion[2] = q3 * scale
    quaternion[3] = q4 * scale


@njit(cache=True, error_model="numpy")
def _apply(quaternion, omega, translation, correction):
    """Inject a mean error state: multiplicative in the attitude, additive else."""
    d1, d2, d3, d4 = quaternion_from_grp_components(
        correction[0], correction[1], correction[2], GRP_A, GRP_F
    )
    _turn_left(quaternion, d1, d2, d3, d4)
    for c in range(3):
        omega[c] += correction[3 + c]
    for c in range(6):
        translation[c] += correction[6 + c]


@njit(cache=True, error_model="numpy")
def predict(state, j, k, bodies, scene, constants, work):
    """Carry the estimate of target j over the step from time k (Paul & Fan, eqs. 22, 37, 41).

    Returns its health.

    The mean attitude error after the step is injected at once, so that the error state is zero
    again; the paper carries it to the update. It is of third order in the spread.
    """
    quaternion, omega, translation = state.quaternion[j], state.omega[j], state.translation[j]
    root, weights = state.root[j], constants.weights
    bundle, differences = work.bundle, work.differences
    sigma_points(translation, root[6:], weights.spread, bundle)
    forces = of_state(constants.forces, j)
    step_bundle(forces, k * scene.step, bundle, scene.step, work.slopes, work.stage)
    turn = rotation_differences(omega, root, weights.spread, scene.step_s, bodies, j, differences)
    for c in range(6):
        center = bundle[c, 0]
        for i in range(2 * SIZE):
            differences[i, 6 + c] = bundle[c, 1 + i] - center
    difference_moments(differences, weights.outer, weights.mean_shift, work.shift, work.covariance)
    add_process_noise(work.covariance, constants)
    _turn_left(quaternion, turn[0], turn[1], turn[2], turn[3])
    for c in range(6):
        translation[c] = bundle[c, 0]
    _apply(quaternion, omega, translation, work.shift)
    if not np.isfinite(np.sum(quaternion)):
        return NOT_FINITE
    health = translation_condition(translation, scene.primaries[k + 1])
    return health if health != HEALTHY else take_covariance(work.covariance, root)


@njit(cache=True, error_model="numpy")
def update(state, j, measurements, row, k, scene, surfaces, constants, work):
    """Use one record, of target j at time k (Paul & Fan, eqs. 51, 52); whether it was used.

    It is not if it holds NaN or lies further than half the field of view from the expected
    direction.
    """
    value, variance = measurements.value, measurements.variance[row]
    if not np.isfinite(value[row, 0] + value[row, 1] + value[row, 2]):
        return False
    quaternion, translation, root = state.quaternion[j], state.translation[j], state.root[j]
    counters, spread, innovation = state.counters[j], constants.weights.spread, work.innovation
    place = scene.observer_position[measurements.observer[row], k]
    axes = scene.observer_axes[k]
    angle = 1 if constants.use_magnitude else 0
    sigma_points(translation, root[6:], spread, work.bundle)
    if constants.use_magnitude:
        magnitude, ra, dec, dark = expected_measurements(
            work.bundle,
            quaternion,
            root,
            spread,
            place,
            axes,
            scene.sun_position[k],
            scene.frame_axes[k],
            surfaces,
            j,
            work.block,
            work.expected,
        )
        innovation[0] = value[row, 0] - magnitude
        counters[FLOOR_HITS] += dark
    else:
        ra, dec = expected_directions(work.bundle, place, axes, work.expected)
    off_ra, off_dec = wrap_angle(value[row, 1] - ra), value[row, 2] - dec
    if not in_field(off_ra, off_dec, dec, constants.half_field):
        counters[OUT_OF_FIELD] += 1
        return False
    innovation[angle] = off_ra
    innovation[angle + 1] = off_dec
    innovation_moments(
        work.expected,
        variance[1 - angle :],
        constants.weights,
        work.expected_shift,
        work.cross,
        work.even,
    )
    for a in range(innovation.shape[0]):
        innovation[a] -= work.expected_shift[a]
    if not square_root_update(
        root, work.cross, work.even, innovation, work.correction, work.covariance
    ):
        counters[CHOLESKY_FAILURES] += 1
        return False
    _apply(quaternion, state.omega[j], translation, work.correction)
    counters[UPDATES] += 1
    return True


@njit(cache=True, error_model="numpy")
def advance(first, scene, surfaces, bodies, constants, measurements, state, out):
    """Filter all targets over an interval that begins at time `first`, target by target."""
    work = make_workspace(SIZE, 3 if constants.use_magnitude else 2)
    offset = measurements.offset
    for j in range(offset.shape[0]):
        for i in range(offset.shape[1] - 1):
            k = first + i
            if state.failed[j] == HEALTHY:
                state.failed[j] = predict(state, j, k - 1, bodies, scene, constants, work)
                if state.failed[j] == LOST_DEFINITENESS:
                    state.counters[j, CHOLESKY_FAILURES] += 1
            healthy = state.failed[j] == HEALTHY
            for row in range(offset[j, i], offset[j, i + 1]):
                out.used[row] = healthy and update(
                    state, j, measurements, row, k, scene, surfaces, constants, work
                )
            if not healthy:
                out.quaternion[j, i, :] = np.nan
                out.angular_velocity[j, i, :] = np.nan
                out.translation[j, i, :] = np.nan
                out.sigma[j, i, :] = np.nan
                if i < out.covariance.shape[1]:
                    out.covariance[j, i, :, :] = np.nan
                continue
            out.quaternion[j, i, :] = state.quaternion[j]
            out.angular_velocity[j, i, :] = state.omega[j]
            out.translation[j, i, :] = state.translation[j]
            deviations(state.root[j], out.sigma[j, i])
            if i < out.covariance.shape[1]:
                covariance_of(state.root[j, 6:], out.covariance[j, i])


@njit(cache=True, error_model="numpy")
def predict_all(k, scene, bodies, constants, state):
    """Carry all healthy targets over the step from time k; the others' translations become NaN."""
    work = make_workspace(SIZE, 3)
    for j in range(state.failed.shape[0]):
        if state.failed[j] == HEALTHY:
            state.failed[j] = predict(state, j, k, bodies, scene, constants, work)
        if state.failed[j] != HEALTHY:
            state.translation[j, :] = np.nan
