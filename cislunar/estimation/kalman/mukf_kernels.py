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
from cislunar.compiled import allocating, borrowing, put
from cislunar.dynamics.bundle import step_cloud
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
from cislunar.estimation.kalman.parts import after_step, before_step, step_parts, updated
from cislunar.estimation.kalman.splitting import (
    NO_LIMITS,
    make_split_work,
    open_if_curved,
    update_parts,
)
from cislunar.estimation.kalman.translation_filter import (
    ACCEPTED,
    CURVED,
    FAILED_UPDATE,
    OUTSIDE_FIELD,
    is_curved,
)
from cislunar.estimation.kalman.workspace import (
    add_process_noise,
    covariance_of,
    deviations,
    in_field,
    leave_out,
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


@borrowing
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


@borrowing
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


@borrowing
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
    step_cloud(forces, k * scene.step, bundle, scene.step, work.slopes, work.stage)
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
    health = translation_condition(translation, scene.primaries[k + 1], constants)
    return health if health != HEALTHY else take_covariance(work.covariance, root)


@allocating
def _predict_rotation(state, j, bodies, step_s, constants, work):
    """Carry attitude and angular velocity alone over a step; their health."""
    quaternion, root, weights = state.quaternion[j], state.root[j], constants.weights
    differences = work.differences
    turn = rotation_differences(
        state.omega[j], root, weights.spread, step_s, bodies, j, differences
    )
    shift, covariance = np.zeros(SIZE), np.empty((6, 6))
    difference_moments(differences[:, :6], weights.outer, weights.mean_shift, shift[:6], covariance)
    for c in range(6):
        covariance[c, c] += constants.process_variance[c]
    _turn_left(quaternion, turn[0], turn[1], turn[2], turn[3])
    _apply(quaternion, state.omega[j], state.translation[j], shift)
    return take_covariance(covariance, root[:6, :6])


@borrowing
def _step(state, parts, j, k, bodies, scene, constants, work, orbit_work):
    """Carry target j over the step from time k; its health.

    While the orbit is a mixture, what is known of it is independent of the rotation.
    """
    translation, rows = state.translation[j], state.root[j, 6:]
    given = scene, constants, orbit_work
    if parts.count[j] > 0:
        health = step_parts(parts, j, translation, rows, k, *given)
        turned = _predict_rotation(state, j, bodies, scene.step_s, constants, work)
        return turned if health == HEALTHY else health
    before_step(parts, j, translation, rows, k, orbit_work)
    health = predict(state, j, k, bodies, scene, constants, work)
    return after_step(parts, j, translation, rows, work.shift[6:], health, k + 1, *given)


@borrowing
def update(state, j, measurements, row, k, scene, surfaces, constants, limits, strain, work):
    """Use one record of target j at time k (Paul & Fan, eqs. 51, 52); its outcome.

    `limits` and `strain`, and what may come of it, are as of `update_translation`.
    """
    value, variance = measurements.value, measurements.variance[row]
    half_field, curvature = limits
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
    if not in_field(off_ra, off_dec, dec, half_field):
        return OUTSIDE_FIELD
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
    even, cross = work.even[angle:, angle:], work.cross[:, angle:]
    if curvature < np.inf and is_curved(even, cross, variance[1:], strain, curvature):
        return CURVED
    for a in range(innovation.shape[0]):
        innovation[a] -= work.expected_shift[a]
    if not square_root_update(
        root, work.cross, work.even, innovation, work.correction, work.covariance
    ):
        return FAILED_UPDATE
    _apply(quaternion, state.omega[j], translation, work.correction)
    return ACCEPTED


@allocating
def _update_split(state, parts, j, measurements, row, k, scene, surfaces, constants, work, stack):
    """Use one record of a target whose orbit is a mixture; its outcome.

    The orbit is updated by the angles, part by part. The rotation is updated by all of the record
    with the moments of the mixture before.
    """
    translation, root = state.translation[j].copy(), state.root[j, 6:, 6:].copy()
    ra, dec = measurements.value[row, 1], measurements.value[row, 2]
    observer = measurements.observer[row]
    place, half_field = scene.observer_position[observer, k], constants.half_field[observer]
    look = ra, dec, measurements.variance[row, 1:], place, scene.observer_axes[k]
    given = look, half_field, k, scene, constants, stack
    outcome = update_parts(parts, j, translation, root, *given)
    if outcome == ACCEPTED:
        if constants.use_magnitude:
            given = state, j, measurements, row, k, scene, surfaces, constants
            update(*given, NO_LIMITS, 0.0, work)
        state.translation[j], state.root[j, 6:, 6:] = translation, root
        state.root[j, 6:, :6] = 0.0
    return outcome


@borrowing
def _use(state, parts, j, measurements, row, k, scene, surfaces, constants, work, stack):
    """Use one record of target j at time k; whether it was used.

    It is not if it holds NaN or lies further than half the field of view from the expected
    direction.
    """
    value, counters = measurements.value, state.counters[j]
    if not np.isfinite(value[row, 0] + value[row, 1] + value[row, 2]):
        return False
    given = measurements, row, k, scene, surfaces, constants
    outcome = CURVED
    if parts.count[j] == 0:
        limits = constants.half_field[measurements.observer[row]], constants.curvature
        outcome = update(state, j, *given, limits, parts.strain[j], work)
        if outcome == CURVED:
            place = scene.observer_position[measurements.observer[row], k]
            variance = measurements.variance[row, 1:]
            look = value[row, 1], value[row, 2], variance, place, scene.observer_axes[k]
            estimate = state.translation[j], state.root[j, 6:]
            rest = k, scene, constants, stack.filter
            if not open_if_curved(parts, j, *estimate, look, *rest):
                outcome = update(state, j, *given, NO_LIMITS, 0.0, work)
        if outcome == ACCEPTED:
            updated(parts, j)
    if outcome == CURVED:
        outcome = _update_split(state, parts, j, *given, work, stack)
    if outcome == ACCEPTED:
        counters[UPDATES] += 1
    elif outcome == OUTSIDE_FIELD:
        counters[OUT_OF_FIELD] += 1
    else:
        counters[CHOLESKY_FAILURES] += 1
    return outcome == ACCEPTED


@borrowing
def _advance_target(
    j, first, scene, surfaces, bodies, constants, measurements, state, parts, out, work, stack
):
    """Filter one target over an interval that begins at time `first`."""
    offset = measurements.offset
    for i in range(offset.shape[1] - 1):
        k = first + i
        if state.failed[j] == HEALTHY:
            given = bodies, scene, constants, work, stack.filter
            state.failed[j] = _step(state, parts, j, k - 1, *given)
            if state.failed[j] == LOST_DEFINITENESS:
                state.counters[j, CHOLESKY_FAILURES] += 1
        healthy = state.failed[j] == HEALTHY
        for row in range(offset[j, i], offset[j, i + 1]):
            given = scene, surfaces, constants, work, stack
            out.used[row] = healthy and _use(state, parts, j, measurements, row, k, *given)
        if not healthy:
            leave_out(out, j, i)
            continue
        put(out.quaternion[j, i], state.quaternion[j])
        put(out.angular_velocity[j, i], state.omega[j])
        put(out.translation[j, i], state.translation[j])
        deviations(state.root[j], out.sigma[j, i])
        if i < out.covariance.shape[1]:
            covariance_of(state.root[j, 6:], out.covariance[j, i])


@njit(cache=True, error_model="numpy", nogil=True)
def advance(targets, first, scene, surfaces, bodies, constants, measurements, state, parts, out):
    """Filter targets, from one to before another, over an interval that begins at time `first`."""
    work = make_workspace(SIZE, 3 if constants.use_magnitude else 2)
    stack = make_split_work(parts.weight.shape[1])
    for j in range(targets[0], targets[1]):
        given = surfaces, bodies, constants, measurements, state, parts, out, work, stack
        _advance_target(j, first, scene, *given)


@njit(cache=True, error_model="numpy")
def predict_all(k, scene, bodies, constants, state, parts):
    """Carry all healthy targets over the step from time k; the others' translations become NaN."""
    work = make_workspace(SIZE, 3)
    orbit_work = make_workspace(6, 2)
    for j in range(state.failed.shape[0]):
        if state.failed[j] == HEALTHY:
            state.failed[j] = _step(state, parts, j, k, bodies, scene, constants, work, orbit_work)
        if state.failed[j] != HEALTHY:
            state.translation[j, :] = np.nan
