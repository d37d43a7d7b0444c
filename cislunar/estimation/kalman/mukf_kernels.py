"""Compiled steps of the error-state multiplicative unscented filter (Paul & Fan, section 2.4).

The error state of a target is (attitude error, angular velocity, position, velocity): generalized
Rodrigues parameters, rad/s in the body frame, and nondimensional in the propagation frame. Body
parameters may precede it, see `cislunar.estimation.kalman.parameter_states`.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.attitude.grp import quaternion_from_grp_components
from cislunar.attitude.quaternion import multiply_components
from cislunar.compiled import copy_into, njit, njit_alloc, njit_noalloc
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
from cislunar.estimation.kalman.attitude_dispersion import rotation_differences
from cislunar.estimation.kalman.gaussian_mixture import (
    after_step,
    before_step,
    step_mixture,
    updated,
)
from cislunar.estimation.kalman.parameter_states import expected_of_bodies, variance_factor
from cislunar.estimation.kalman.splitting import (
    NO_LIMITS,
    make_split_work,
    open_if_curved,
    update_mixture,
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
from cislunar.runtime import Array

SIZE = 12
"""States of the motion."""


class FilterState(NamedTuple):
    """Estimates of all targets, which the kernels change in place; arrays by target.
    Means `quaternion` (4,) inertial to body frame, `omega` (3,) rad/s, body frame, `translation`
    (6,) nondimensional, propagation frame; `root` (n, n), lower Cholesky factors of the
    covariances; `failed`, HEALTHY or the reason for which an estimate ended; `counters`
    (N_COUNTERS,); `parameters` (n - 12,), deviations of the body; `noise_factor`, on the assumed
    variance of a magnitude."""

    quaternion: Array
    omega: Array
    translation: Array
    root: Array
    failed: NDArray[np.uint8]
    counters: NDArray[np.int64]
    parameters: Array
    noise_factor: Array


@njit_noalloc
def _compose_left(quaternion, d1, d2, d3, d4):
    """quaternion <- d (x) quaternion, normalized."""
    q1, q2, q3, q4 = multiply_components(
        d1, d2, d3, d4, quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    )
    scale = 1.0 / np.sqrt(q1 * q1 + q2 * q2 + q3 * q3 + q4 * q4)
    quaternion[0] = q1 * scale
    quaternion[1] = q2 * scale
    quaternion[2] = q3 * scale
    quaternion[3] = q4 * scale


@njit_noalloc
def _apply(state, j, correction, constants):
    """Inject a mean error state (n,): multiplicative in the attitude, additive otherwise."""
    p = len(constants.parameters)
    for c in range(p):
        state.parameters[j, c] += correction[c]
    d1, d2, d3, d4 = quaternion_from_grp_components(
        correction[p], correction[p + 1], correction[p + 2]
    )
    _compose_left(state.quaternion[j], d1, d2, d3, d4)
    for c in range(3):
        state.omega[j, c] += correction[p + 3 + c]
    for c in range(6):
        state.translation[j, c] += correction[p + 6 + c]


@njit_noalloc
def predict(state, j, k, bodies, scene, constants, work):
    """Propagate the estimate of target j over the step from time k (Paul & Fan, eqs. 22, 37, 41);
    its health. The mean attitude error after the step is injected at once; the paper keeps it until
    the update. The difference is of third order in the standard deviations."""
    quaternion, omega, translation = state.quaternion[j], state.omega[j], state.translation[j]
    root, weights = state.root[j], constants.weights
    bundle, differences = work.bundle, work.differences
    before = 6 + len(constants.parameters)
    sigma_points(translation, root[before:], weights.spread, bundle)
    forces = of_state(constants.forces, j)
    step_cloud(forces, k * scene.step, bundle, scene.step, work.slopes, work.stage)
    given = scene.step_s, bodies, j, constants, differences
    turn = rotation_differences(omega, state.parameters[j], root, *given)
    for c in range(6):
        center = bundle[c, 0]
        for i in range(differences.shape[0]):
            differences[i, before + c] = bundle[c, 1 + i] - center
    difference_moments(differences, weights.outer, weights.mean_shift, work.shift, work.covariance)
    add_process_noise(work.covariance, constants)
    _compose_left(quaternion, turn[0], turn[1], turn[2], turn[3])
    for c in range(6):
        translation[c] = bundle[c, 0]
    _apply(state, j, work.shift, constants)
    if not np.isfinite(np.sum(quaternion)):
        return NOT_FINITE
    health = translation_condition(translation, scene.primaries[k + 1], constants)
    return health if health != HEALTHY else take_covariance(work.covariance, root)


@njit_alloc
def _predict_rotation(state, j, bodies, step_s, constants, work):
    """Propagate body parameters, attitude and angular velocity alone over a step; their health."""
    quaternion, root, weights = state.quaternion[j], state.root[j], constants.weights
    size, differences = 6 + len(constants.parameters), work.differences
    given = step_s, bodies, j, constants, differences
    turn = rotation_differences(state.omega[j], state.parameters[j], root, *given)
    shift, covariance = np.zeros(root.shape[0]), np.empty((size, size))
    difference_moments(
        differences[:, :size], weights.outer, weights.mean_shift, shift[:size], covariance
    )
    for c in range(size):
        covariance[c, c] += constants.process_variance[c]
    _compose_left(quaternion, turn[0], turn[1], turn[2], turn[3])
    _apply(state, j, shift, constants)
    return take_covariance(covariance, root[:size, :size])


@njit_noalloc
def _step(state, mixture, j, k, bodies, scene, constants, work, orbit_work):
    """Propagate target j over the step from time k; its health. While the orbit is a mixture, its
    estimate is independent of that of the rotation."""
    before = 6 + len(constants.parameters)
    translation, rows = state.translation[j], state.root[j, before:]
    given = scene, constants, orbit_work
    if mixture.count[j] > 0:
        health = step_mixture(mixture, j, translation, rows, k, *given)
        turned = _predict_rotation(state, j, bodies, scene.step_s, constants, work)
        return turned if health == HEALTHY else health
    before_step(mixture, j, translation, rows, k, orbit_work)
    health = predict(state, j, k, bodies, scene, constants, work)
    return after_step(mixture, j, translation, rows, work.shift[before:], health, k + 1, *given)


@njit_noalloc
def update(state, j, measurements, row, k, scene, surfaces, constants, limits, nonlinearity, work):
    """Use one record of target j at time k (Paul & Fan, eqs. 51, 52); its outcome. See
    `update_translation` for `limits`, `nonlinearity` and the outcomes."""
    value, variance = measurements.value, measurements.variance[row]
    half_field, curvature = limits
    quaternion, translation, root = state.quaternion[j], state.translation[j], state.root[j]
    counters, spread, innovation = state.counters[j], constants.weights.spread, work.innovation
    place = scene.observer_position[measurements.observer[row], k]
    axes = scene.observer_axes[k]
    angle = 1 if constants.use_magnitude else 0
    sigma_points(translation, root[6 + len(constants.parameters) :], spread, work.bundle)
    if constants.use_magnitude:
        light = place, axes, scene.sun_position[k], scene.frame_axes[k], surfaces, j
        if len(constants.parameters) > 0:
            mean, kinds = state.parameters[j], (constants.rotation_kinds, constants.surface_kinds)
            magnitude, ra, dec, undetectable = expected_of_bodies(
                work.bundle, quaternion, mean, root, spread, *light, *kinds, work.block,
                work.expected,
            )  # fmt: skip
        else:
            magnitude, ra, dec, undetectable = expected_measurements(
                work.bundle, quaternion, root, spread, *light, work.block, work.expected
            )
        innovation[0] = value[row, 0] - magnitude
        counters[FLOOR_HITS] += undetectable
    else:
        ra, dec = expected_directions(work.bundle, place, axes, work.expected)
    off_ra, off_dec = wrap_angle(value[row, 1] - ra), value[row, 2] - dec
    if not in_field(off_ra, off_dec, dec, half_field):
        return OUTSIDE_FIELD
    innovation[angle] = off_ra
    innovation[angle + 1] = off_dec
    out = work.expected_shift, work.cross, work.even
    innovation_moments(work.expected, variance[1 - angle :], constants.weights, *out)
    even, cross = work.even[angle:, angle:], work.cross[:, angle:]
    if curvature < np.inf and is_curved(even, cross, variance[1:], nonlinearity, curvature):
        return CURVED
    for a in range(innovation.shape[0]):
        innovation[a] -= work.expected_shift[a]
    factor = state.noise_factor[j]
    if constants.use_magnitude:
        assumed = variance[0] + constants.extra_variance
        if constants.noise_memory > 0.0:
            work.even[0, 0] -= variance[0]
            given = work.cross, work.even, innovation, assumed, factor, constants.noise_memory
            factor = variance_factor(*given)
            work.even[0, 0] += variance[0]
        # no change, to the last bit, for the variance of the sensor
        work.even[0, 0] += factor * assumed - variance[0]
    if not square_root_update(
        root, work.cross, work.even, innovation, work.correction, work.covariance
    ):
        return FAILED_UPDATE
    state.noise_factor[j] = factor
    _apply(state, j, work.correction, constants)
    return ACCEPTED


@njit_alloc
def _update_split(state, mixture, j, measurements, row, k, scene, surfaces, constants, work, stack):
    """Use one record of a target whose orbit is a mixture; its outcome. The angles update the orbit
    component by component. The whole record updates the rotation with the moments of the mixture
    before the update."""
    n = 6 + len(constants.parameters)
    translation, root = state.translation[j].copy(), state.root[j, n:, n:].copy()
    ra, dec = measurements.value[row, 1], measurements.value[row, 2]
    observer = measurements.observer[row]
    place, half_field = scene.observer_position[observer, k], constants.half_field[observer]
    observation = ra, dec, measurements.variance[row, 1:], place, scene.observer_axes[k]
    given = observation, half_field, k, scene, constants, stack
    outcome = update_mixture(mixture, j, translation, root, *given)
    if outcome == ACCEPTED:
        if constants.use_magnitude:
            given = state, j, measurements, row, k, scene, surfaces, constants
            update(*given, NO_LIMITS, 0.0, work)
        state.translation[j], state.root[j, n:, n:] = translation, root
        state.root[j, n:, :n] = 0.0
    return outcome


@njit_noalloc
def _use(state, mixture, j, measurements, row, k, scene, surfaces, constants, work, stack):
    """Use one record of target j at time k; whether it was used. A record is not used if it has NaN
    or is further than half the field of view from the expected direction."""
    value, counters = measurements.value, state.counters[j]
    if not np.isfinite(value[row, 0] + value[row, 1] + value[row, 2]):
        return False
    given = measurements, row, k, scene, surfaces, constants
    outcome = CURVED
    if mixture.count[j] == 0:
        limits = constants.half_field[measurements.observer[row]], constants.curvature
        outcome = update(state, j, *given, limits, mixture.nonlinearity[j], work)
        if outcome == CURVED:
            place = scene.observer_position[measurements.observer[row], k]
            variance = measurements.variance[row, 1:]
            observation = value[row, 1], value[row, 2], variance, place, scene.observer_axes[k]
            estimate = state.translation[j], state.root[j, 6 + len(constants.parameters) :]
            rest = k, scene, constants, stack.filter
            if not open_if_curved(mixture, j, *estimate, observation, *rest):
                outcome = update(state, j, *given, NO_LIMITS, 0.0, work)
        if outcome == ACCEPTED:
            updated(mixture, j)
    if outcome == CURVED:
        outcome = _update_split(state, mixture, j, *given, work, stack)
    if outcome == ACCEPTED:
        counters[UPDATES] += 1
    elif outcome == OUTSIDE_FIELD:
        counters[OUT_OF_FIELD] += 1
    else:
        counters[CHOLESKY_FAILURES] += 1
    return outcome == ACCEPTED


@njit_noalloc
def _advance_target(
    j, first, scene, surfaces, bodies, constants, measurements, state, mixture, out, work, stack
):
    """Filter one target over an interval that begins at time `first`."""
    offset = measurements.offset
    for i in range(offset.shape[1] - 1):
        k = first + i
        if state.failed[j] == HEALTHY:
            given = bodies, scene, constants, work, stack.filter
            state.failed[j] = _step(state, mixture, j, k - 1, *given)
            if state.failed[j] == LOST_DEFINITENESS:
                state.counters[j, CHOLESKY_FAILURES] += 1
        healthy = state.failed[j] == HEALTHY
        for row in range(offset[j, i], offset[j, i + 1]):
            given = scene, surfaces, constants, work, stack
            out.used[row] = healthy and _use(state, mixture, j, measurements, row, k, *given)
        if not healthy:
            leave_out(out, j, i)
            continue
        copy_into(out.quaternion[j, i], state.quaternion[j])
        copy_into(out.angular_velocity[j, i], state.omega[j])
        copy_into(out.translation[j, i], state.translation[j])
        p = len(constants.parameters)
        deviations(state.root[j, p:], out.sigma[j, i])
        if i < out.covariance.shape[1]:
            covariance_of(state.root[j, p + 6 :], out.covariance[j, i])


@njit(cache=True, error_model="numpy", nogil=True)
def advance(targets, first, scene, surfaces, bodies, constants, measurements, state, mixture, out):
    """Filter the targets of a range over an interval that begins at time `first`."""
    work = make_workspace(SIZE + len(constants.parameters), 3 if constants.use_magnitude else 2)
    stack = make_split_work(mixture.weight.shape[1])
    for j in range(targets[0], targets[1]):
        given = surfaces, bodies, constants, measurements, state, mixture, out, work, stack
        _advance_target(j, first, scene, *given)


@njit(cache=True, error_model="numpy")
def predict_all(k, scene, bodies, constants, state, mixture):
    """Propagate all healthy targets over the step from time k; other translations become NaN."""
    work = make_workspace(SIZE + len(constants.parameters), 3)
    orbit_work = make_workspace(6, 2)
    for j in range(state.failed.shape[0]):
        if state.failed[j] == HEALTHY:
            state.failed[j] = _step(
                state, mixture, j, k, bodies, scene, constants, work, orbit_work
            )
        if state.failed[j] != HEALTHY:
            state.translation[j, :] = np.nan
