"""Compiled steps of the batch estimator: orbit, light curve and modes over an interval."""

import numpy as np
from numba import njit

from cislunar.constants import LENGTH_UNIT_KM
from cislunar.estimation.kalman.mukf_kernels import (
    CHOLESKY_FAILURES,
    HEALTHY,
    LOST_DEFINITENESS,
    OUT_OF_FIELD,
    UPDATES,
)
from cislunar.estimation.kalman.translation_filter import (
    OUTSIDE_FIELD,
    USED,
    make_workspace,
    predict_translation,
    update_translation,
)
from cislunar.estimation.light_curves.hypotheses import condense, mixture_points, search
from cislunar.estimation.light_curves.light_curve import (
    DETECTED,
    MAGNITUDE,
    RANGE,
    SUN,
    TIME,
    UNKNOWNS,
    VIEW,
)
from cislunar.estimation.light_curves.mixture import (
    mixture_moments,
    step_points,
    weighted_deviations,
)
from cislunar.estimation.triangular import cholesky
from cislunar.observation.measurement import occulted, outside_exclusion, rotate

_METRES = 1000.0 * LENGTH_UNIT_KM

FEWEST_FRESH = 4
"""New rows below which a light curve is not fitted between tasking epochs."""

CONDITION, POINTS, ROWS, FITTED = range(4)
"""Entries of a target's state: its condition, points of its mixture, rows of its light curve, and
rows at the last fit."""


@njit(cache=True, error_model="numpy")
def _geometry(row, translation, observer, sun, to_inertial):
    """Directions from the target to Sun and observer, and the range, into a row of data."""
    dx = translation[0] - observer[0]
    dy = translation[1] - observer[1]
    dz = translation[2] - observer[2]
    sx, sy, sz = sun[0] - translation[0], sun[1] - translation[1], sun[2] - translation[2]
    distance = np.sqrt(dx * dx + dy * dy + dz * dz)
    to_sun = np.sqrt(sx * sx + sy * sy + sz * sz)
    to_light, to_observer = row[SUN], row[VIEW]
    to_light[0], to_light[1], to_light[2] = rotate(
        to_inertial, sx / to_sun, sy / to_sun, sz / to_sun
    )
    to_observer[0], to_observer[1], to_observer[2] = rotate(
        to_inertial, -dx / distance, -dy / distance, -dz / distance
    )
    row[RANGE] = distance * _METRES


@njit(cache=True, error_model="numpy")
def _in_clear_view(translation, observer, sun, limits, mu):
    """Whether neither a bright body nor a disc stands in the way of the estimated place."""
    ox, oy, oz = observer[0], observer[1], observer[2]
    dx, dy, dz = translation[0] - ox, translation[1] - oy, translation[2] - oz
    if not outside_exclusion(ox, oy, oz, dx, dy, dz, sun, limits.cosines, mu):
        return False
    return not (limits.occultation and occulted(ox, oy, oz, dx, dy, dz, mu))


@njit(cache=True, error_model="numpy")
def _refit(hypotheses, data, model, settings, rng, elapsed, quaternion, omega, weight):
    """Fit a light curve and lay out the mixture's points at a time; returns their number."""
    search(hypotheses, data, model, settings, rng)
    count = mixture_points(hypotheses, model, quaternion, omega, weight)
    step_points(
        quaternion[:count],
        omega[:count],
        elapsed,
        model.inertia,
        model.inverse_inertia,
        model.spherical,
    )
    return count


@njit(cache=True, error_model="numpy")
def advance_target(
    first,
    scene,
    limits,
    constants,
    model,
    settings,
    growth,
    window,
    memory_s,
    use_non_detections,
    observer,
    measurements,
    translation,
    root,
    hypotheses,
    points,
    data,
    state,
    counters,
    rng,
    out,
):
    """Carry one target through an interval (compiled); see `BatchEstimator.advance`.

    `state` holds its condition, number of points, rows of data and rows at the last fit.
    """
    quaternion, omega, weight = points
    out_quaternion, out_omega, out_translation, out_sigma, used = out
    work = make_workspace()
    differences = np.empty((weight.shape[0], UNKNOWNS))
    n_steps = measurements.shape[0]
    for i in range(n_steps):
        k = first + i
        if state[CONDITION] == HEALTHY:
            state[CONDITION] = predict_translation(
                translation, root, (k - 1) * scene.step, scene.step, constants, work
            )
            if state[CONDITION] == LOST_DEFINITENESS:
                counters[CHOLESKY_FAILURES] += 1
        used[i] = False
        if state[CONDITION] != HEALTHY:
            out_quaternion[i, :] = np.nan
            out_omega[i, :] = np.nan
            out_translation[i, :] = np.nan
            out_sigma[i, :] = np.nan
            continue
        step_points(
            quaternion[: state[POINTS]],
            omega[: state[POINTS]],
            scene.step_s,
            model.inertia,
            model.inverse_inertia,
            model.spherical,
        )
        if observer >= 0:
            place, sun = scene.observer_position[observer, k], scene.sun_position[k]
            magnitude, ra, dec = measurements[i]
            detected = np.isfinite(magnitude + ra + dec)
            if detected:
                outcome = update_translation(
                    translation, root, ra, dec, place, scene.observer_axes[k], constants, work
                )
                used[i] = outcome == USED
                if outcome == USED:
                    counters[UPDATES] += 1
                elif outcome == OUTSIDE_FIELD:
                    counters[OUT_OF_FIELD] += 1
                else:
                    counters[CHOLESKY_FAILURES] += 1
            if used[i] or (
                use_non_detections
                and not detected
                and _in_clear_view(translation, place, sun, limits, constants.forces.mu)
            ):
                row = data[state[ROWS]]
                row[TIME], row[MAGNITUDE] = k * scene.step_s, magnitude
                row[DETECTED] = 1.0 if used[i] else 0.0
                _geometry(row, translation, place, sun, scene.frame_axes[k])
                state[ROWS] += 1
        fresh = state[ROWS] - state[FITTED]
        grown = growth > 0.0 and fresh >= max(growth * state[FITTED], FEWEST_FRESH)
        if fresh > 0 and (i == n_steps - 1 or grown):
            state[POINTS] = _refit(
                hypotheses,
                data[: state[ROWS]],
                model,
                settings,
                rng,
                k * scene.step_s,
                quaternion,
                omega,
                weight,
            )
            state[FITTED] = state[ROWS]
        n = state[POINTS]
        mixture_moments(
            quaternion[:n], omega[:n], weight[:n], out_quaternion[i], out_omega[i], differences
        )
        weighted_deviations(differences[:n], weight[:n], out_sigma[i, :UNKNOWNS])
        out_translation[i] = translation
        for c in range(6):
            total = 0.0
            for d in range(c + 1):
                total += root[c, d] * root[c, d]
            out_sigma[i, 6 + c] = np.sqrt(total)
    if state[CONDITION] == HEALTHY:
        memory = np.exp(-n_steps * scene.step_s / memory_s)
        end = (first + n_steps - 1) * scene.step_s
        _forget(hypotheses, data, model, state, end - window, memory)
        if memory < 1.0:  # what is known has faded, whether or not there are new data
            state[POINTS] = _refit(
                hypotheses,
                data[: state[ROWS]],
                model,
                settings,
                rng,
                end,
                quaternion,
                omega,
                weight,
            )


@njit(cache=True, error_model="numpy")
def _forget(hypotheses, data, model, state, before, memory):
    """Condense the rows older than a time."""
    old = 0
    while old < state[FITTED] and data[old, TIME] < before:
        old += 1
    if old == 0 and memory == 1.0:
        return
    condense(hypotheses, data[:old], model, memory)
    for i in range(old, state[ROWS]):
        data[i - old] = data[i]
    state[ROWS] -= old
    state[FITTED] -= old


@njit(cache=True, error_model="numpy")
def predict_target(
    t, scene, constants, model, translation, root, quaternion, omega, weight, mean, joint
):
    """Carry copies of a target's estimate over a step from time t; fills the joint root."""
    health = predict_translation(translation, root, t, scene.step, constants, make_workspace())
    joint[:, :] = 0.0
    if health != HEALTHY:
        translation[:] = np.nan
        return
    step_points(
        quaternion,
        omega,
        scene.step_s,
        model.inertia,
        model.inverse_inertia,
        model.spherical,
    )
    differences = np.empty((weight.shape[0], UNKNOWNS))
    mean_omega = np.empty(3)
    mixture_moments(quaternion, omega, weight, mean, mean_omega, differences)
    covariance = np.zeros((UNKNOWNS, UNKNOWNS))
    for i in range(weight.shape[0]):
        for a in range(UNKNOWNS):
            for b in range(UNKNOWNS):
                covariance[a, b] += weight[i] * differences[i, a] * differences[i, b]
    # on the scale of the deviations, so that rounding cannot make it indefinite
    for a in range(UNKNOWNS):
        covariance[a, a] *= 1.0 + 1e-12
    joint[6:, 6:] = root
    if cholesky(covariance):
        joint[:6, :6] = covariance
    else:  # the points lie in fewer dimensions: take their spread along each axis
        for a in range(UNKNOWNS):
            for i in range(weight.shape[0]):
                joint[a, a] += weight[i] * differences[i, a] ** 2
            joint[a, a] = np.sqrt(joint[a, a])
