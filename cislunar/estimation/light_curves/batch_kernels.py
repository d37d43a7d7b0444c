"""Compiled steps of the batch estimator: orbit, light curve and modes over an interval."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.attitude.attitude_integrator import TURN_OF_LONG_STEP, TURN_PER_STEP
from cislunar.compiled import copy_into, njit, njit_alloc, njit_noalloc
from cislunar.estimation.estimator import (
    CHOLESKY_FAILURES,
    HEALTHY,
    LOST_DEFINITENESS,
    OUT_OF_FIELD,
    UPDATES,
)
from cislunar.estimation.kalman.gaussian_mixture import step_orbit
from cislunar.estimation.kalman.splitting import make_split_work, use_direction
from cislunar.estimation.kalman.translation_filter import ACCEPTED, OUTSIDE_FIELD, SIZE
from cislunar.estimation.kalman.workspace import (
    FilterConstants,
    covariance_of,
    deviations,
    leave_out,
    make_workspace,
)
from cislunar.estimation.light_curves.batch_settings import SearchSettings
from cislunar.estimation.light_curves.effort import search_until_clear
from cislunar.estimation.light_curves.hypotheses import condense, mixture_points
from cislunar.estimation.light_curves.mixture import (
    make_bodies,
    mixture_moments,
    set_bodies,
    step_points,
    turn_points,
    weighted_deviations,
)
from cislunar.estimation.light_curves.row_blocks import (
    MAGNITUDE,
    RANGE,
    ROTATION,
    SEEN,
    SUN,
    TIME,
    VIEW,
    WEIGHT,
)
from cislunar.estimation.triangular import cholesky
from cislunar.observation.sensor import SensorLimits, extinction, limits_of
from cislunar.observation.sightline import METERS, in_clear_view, lit_directions

_FEWEST_FRESH = 4
"""Number of new rows below which a light curve is not fitted between tasking epochs."""


class BatchConstants(NamedTuple):
    """Constants of the batch estimator: of the orbit filter (`translation`), of the sensors and of
    the search. A light curve is fitted within an interval when it has grown by the share `growth`
    (0 for never). Data are condensed at the age `window_s` and fade by e in `memory_s` (inf for
    never)."""

    translation: FilterConstants
    limits: SensorLimits
    search: SearchSettings
    growth: float
    window_s: float
    memory_s: float
    use_non_detections: bool


class FitState(NamedTuple):
    """State of the fit of each target, arrays of int (target,): `condition` is HEALTHY or the
    reason for which its estimate ended, `points` the number of points of its mixture, `rows` and
    `fitted` the numbers of rows of its light curve, now and at the last fit, `epoch` the time index
    of its initial estimate, from which the times of its light curve count, and `replaced` whether
    another model of its body has replaced the assumed one, which is then not fitted."""

    condition: NDArray[np.int64]
    points: NDArray[np.int64]
    rows: NDArray[np.int64]
    fitted: NDArray[np.int64]
    epoch: NDArray[np.int64]
    replaced: NDArray[np.int64]


@njit_noalloc
def _fill_row(row, elapsed, magnitude, seen, weight, translation, observer, sun, to_inertial):
    """Write one row of a light curve, with the geometry of the estimated position. The magnitude of
    a non-detection is the limit."""
    light, view, distance, _ = lit_directions(translation, observer, sun, to_inertial)
    row[TIME], row[MAGNITUDE], row[SEEN], row[WEIGHT] = elapsed, magnitude, seen, weight
    to_light, to_observer = row[SUN], row[VIEW]
    to_light[0], to_light[1], to_light[2] = light
    to_observer[0], to_observer[1], to_observer[2] = view
    row[RANGE] = distance * METERS


@njit_noalloc
def _carry_points(points, count, bodies, elapsed, model, turn_per_step):
    """Propagate the first points of a mixture over `elapsed` seconds."""
    turn_points(points[0][:count], points[1][:count], bodies, elapsed, model, turn_per_step)


@njit_noalloc
def _refit(hypotheses, data, model, settings, rng, elapsed, points, bodies, turn_per_step):
    """Fit a light curve and compute the mixture's points at a time; returns their number."""
    search_until_clear(hypotheses, data, model, settings, rng)
    count = mixture_points(hypotheses, model, *points)
    set_bodies(bodies, points[3][:count], model)
    _carry_points(points, count, bodies, elapsed, model, turn_per_step)
    return count


@njit_noalloc
def _use(
    records, row, j, k, scene, constants, mixture, translation, root, data, state, counters, work
):
    """Use one record at time k: whether the direction was used, and the rows of the light curve
    now."""
    rows = state.rows[j]
    magnitude, ra, dec = records.value[row]
    observer, sun = records.observer[row], scene.sun_position[k]
    place, limits = scene.observer_position[observer, k], limits_of(constants.limits, observer)
    variance = records.variance[row]
    detected = np.isfinite(magnitude + ra + dec)
    used = False
    if detected:
        observation = ra, dec, variance[1:], place, scene.observer_axes[k]
        given = observation, limits.half_field, k, scene, constants.translation, work
        outcome = use_direction(mixture, j, translation, root, *given)
        used = outcome == ACCEPTED
        if used:
            counters[UPDATES] += 1
        elif outcome == OUTSIDE_FIELD:
            counters[OUT_OF_FIELD] += 1
        else:
            counters[CHOLESKY_FAILURES] += 1
    elif constants.use_non_detections:
        ox, oy, oz = place[0], place[1], place[2]
        dx, dy, dz = translation[0] - ox, translation[1] - oy, translation[2] - oz
        if not in_clear_view(ox, oy, oz, dx, dy, dz, sun, limits, scene.primaries[k]):
            return False, rows
        earth = scene.primaries[k, 0]
        magnitude = limits.limiting_magnitude - extinction(ox, oy, oz, dx, dy, dz, earth, limits)
    if used or (constants.use_non_detections and not detected):
        weight = constants.limits.noise_variance[0, 0] / variance[0]
        seen = 1.0 if used else 0.0
        elapsed, to_inertial = (k - state.epoch[j]) * scene.step_s, scene.frame_axes[k]
        _fill_row(
            data[rows], elapsed, magnitude, seen, weight, translation, place, sun, to_inertial
        )
        rows += 1
    return used, rows


@njit_noalloc
def _advance(j, first, scene, constants, model, records, mixture, own, state, out, scratch, closed):
    """See `advance_target`; `own` has the arrays of target j. Without estimates at the steps, the
    light curve is fitted and the attitude propagated at the end of the interval only."""
    translation, root, counters, hypotheses, points, data, rng = own
    quaternion, omega, weight, point_deviations = points
    work, differences, bodies = scratch
    set_bodies(bodies, point_deviations[: state.points[j]], model)
    offset, settings = records.offset[j], constants.search
    n_steps, reported = offset.shape[0] - 1, out.sigma.shape[1] > 0
    turn, carried = TURN_PER_STEP if reported else TURN_OF_LONG_STEP, 0
    for i in range(n_steps):
        k = first + i
        if state.condition[j] == HEALTHY:
            state.condition[j] = step_orbit(
                mixture, j, translation, root, k - 1, scene, constants.translation, work.filter
            )
            if state.condition[j] == LOST_DEFINITENESS:
                counters[CHOLESKY_FAILURES] += 1
        if state.condition[j] != HEALTHY:
            out.used[offset[i] : offset[i + 1]] = False
            if reported:
                leave_out(out, j, i)
            continue
        if reported:
            _carry_points(points, state.points[j], bodies, scene.step_s, model, turn)
            carried = i + 1
        for row in range(offset[i], offset[i + 1]):
            given = mixture, translation, root, data, state, counters, work
            out.used[row], state.rows[j] = _use(records, row, j, k, scene, constants, *given)
        fresh = state.rows[j] - state.fitted[j]
        grown = (
            reported
            and constants.growth > 0.0
            and fresh >= max(constants.growth * state.fitted[j], _FEWEST_FRESH)
        )
        due = grown or (closed > 0 and i == n_steps - 1)
        if due and fresh > 0 and not state.replaced[j]:
            elapsed = (k - state.epoch[j]) * scene.step_s
            state.points[j] = _refit(
                hypotheses, data[: state.rows[j]], model, settings, rng, elapsed, points, bodies,
                turn,
            )  # fmt: skip
            state.fitted[j], carried = state.rows[j], i + 1
        if not reported:
            continue
        n, sigma = state.points[j], out.sigma[j, i]
        mean_q, mean_omega = out.quaternion[j, i], out.angular_velocity[j, i]
        mixture_moments(quaternion[:n], omega[:n], weight[:n], mean_q, mean_omega, differences)
        weighted_deviations(differences[:n], weight[:n], sigma[:ROTATION])
        copy_into(out.translation[j, i], translation)
        deviations(root, sigma[ROTATION:])
        if i < out.covariance.shape[1]:
            covariance_of(root, out.covariance[j, i])
    if carried < n_steps and state.condition[j] == HEALTHY:
        elapsed = (n_steps - carried) * scene.step_s
        _carry_points(points, state.points[j], bodies, elapsed, model, turn)
    if closed > 0 and state.condition[j] == HEALTHY:
        memory = np.exp(-closed * scene.step_s / constants.memory_s)
        end = (first + n_steps - 1 - state.epoch[j]) * scene.step_s
        _forget(hypotheses, data, model, state, j, end - constants.window_s, memory)
        if memory < 1.0:  # the information has faded, whether or not there are new data
            state.points[j] = _refit(
                hypotheses, data[: state.rows[j]], model, settings, rng, end, points, bodies, turn
            )


@njit(cache=True, error_model="numpy", nogil=True)
def advance_target(j, first, scene, constants, model, records, mixture, own, state, out, closed):
    """Process an interval that begins at time `first` for target j. `model` is that of the target,
    `own` are its translation, root, counters, hypotheses, points, rows and generator; the other
    arrays are those of all targets. `closed` is the number of steps since the last tasking epoch if
    the interval ends at the next one, else 0."""
    room = own[4][2].shape[0]  # of the mixture's points
    differences, bodies = np.empty((room, ROTATION)), make_bodies(room, model)
    scratch = make_split_work(mixture.weight.shape[1]), differences, bodies
    _advance(j, first, scene, constants, model, records, mixture, own, state, out, scratch, closed)


@njit_noalloc
def _forget(hypotheses, data, model, state, j, before, memory):
    """Condense the rows of target j older than a time."""
    old = 0
    while old < state.fitted[j] and data[old, TIME] < before:
        old += 1
    if old == 0 and memory == 1.0:
        return
    condense(hypotheses, data[:old], model, memory)
    for i in range(old, state.rows[j]):
        copy_into(data[i - old], data[i])
    state.rows[j] -= old
    state.fitted[j] -= old


@njit_alloc
def predict_target(
    j, k, scene, constants, model, mixture, translation, root, points, count, mean, rate, joint
):
    """Propagate copies of target j's estimate over the step from time k. Outputs are mean attitude
    and rate, and the joint root."""
    work = make_workspace(SIZE, 2)
    health = step_orbit(mixture, j, translation, root, k, scene, constants.translation, work)
    joint[:, :] = 0.0
    if health != HEALTHY:
        translation[:] = np.nan
        return
    step_points(points[0][:count], points[1][:count], points[3][:count], scene.step_s, model)
    quaternion, omega, weight = points[0][:count], points[1][:count], points[2][:count]
    differences = np.empty((count, ROTATION))
    mixture_moments(quaternion, omega, weight, mean, rate, differences)
    covariance = np.zeros((ROTATION, ROTATION))
    for i in range(weight.shape[0]):
        for a in range(ROTATION):
            for b in range(ROTATION):
                covariance[a, b] += weight[i] * differences[i, a] * differences[i, b]
    # relative to the deviations, so that rounding cannot make it indefinite
    for a in range(ROTATION):
        covariance[a, a] *= 1.0 + 1e-12
    joint[6:, 6:] = root
    if cholesky(covariance):
        joint[:6, :6] = covariance
    else:  # the points lie in fewer dimensions: take their deviation along each axis
        for a in range(ROTATION):
            for i in range(weight.shape[0]):
                joint[a, a] += weight[i] * differences[i, a] ** 2
            joint[a, a] = np.sqrt(joint[a, a])
