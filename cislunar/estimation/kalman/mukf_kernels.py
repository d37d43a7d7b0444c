"""Compiled steps of the error-state multiplicative unscented filter (Paul & Fan, section 2.4).

The error state of a target is (attitude error, angular velocity, position, velocity): generalized
Rodrigues parameters, rad/s in the body frame, and nondimensional in the rotating frame. Carried
along are the attitude quaternion, the other means, and the lower Cholesky factor of the covariance.

That factor being triangular, the sigma points 6 .. 11 of either sign leave the attitude alone; it
is computed for the first six only.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cislunar.attitude.grp import GRP_A, GRP_F, quaternion_from_grp_components
from cislunar.attitude.quaternion import multiply_components, rotation_vector_components
from cislunar.dynamics.bundle import step_bundle
from cislunar.dynamics.tableau import STAGES8
from cislunar.estimation.kalman.attitude_spread import general_differences, spherical_differences
from cislunar.estimation.kalman.translation_filter import (
    HEALTHY,
    LOST_DEFINITENESS,
    NOT_FINITE,
    translation_condition,
)
from cislunar.estimation.triangular import cholesky
from cislunar.estimation.unscented import (
    UnscentedWeights,
    difference_moments,
    innovation_moments,
    square_root_update,
    unscented_weights,
)
from cislunar.observation.measurement import direction_angles, target_magnitude, wrap_angle
from cislunar.photometry.facets import FLOOR_MAGNITUDE

Array = NDArray[np.float64]

SIZE = 12
POINTS = 2 * SIZE + 1
WEIGHTS = unscented_weights(SIZE)

# Counters kept per target.
UPDATES, OUT_OF_FIELD, FLOOR_HITS, CHOLESKY_FAILURES = range(4)
N_COUNTERS = 4


class FilterConstants(NamedTuple):
    """Numbers the filter's kernels need.

    Attributes
    ----------
    forces : NamedTuple
        Force model, see `cislunar.dynamics.forces`.
    process_variance : ndarray, shape (12,)
        Added to the covariance's diagonal at each step.
    noise_variance : ndarray, shape (3,)
        Of magnitude, right ascension and declination.
    half_field : float
        Half the field of view, rad.
    use_magnitude : bool
        False leaves the magnitude out of the update.
    weights : UnscentedWeights
        For 12 states.
    """

    forces: tuple
    process_variance: Array
    noise_variance: Array
    half_field: float
    use_magnitude: bool
    weights: UnscentedWeights


class Workspace(NamedTuple):
    """Scratch arrays of one target's filter, reused over targets and steps."""

    bundle: Array
    slopes: Array
    stage: Array
    differences: Array
    shift: Array
    covariance: Array
    predicted: Array
    measured_shift: Array
    cross: Array
    even: Array
    innovation: Array
    correction: Array


@njit(cache=True)
def make_workspace(measured):
    """Scratch arrays for `measured` measurement components, 2 or 3 (compiled)."""
    return Workspace(
        np.empty((6, POINTS)),
        np.empty((STAGES8, 6, POINTS)),
        np.empty((6, POINTS)),
        np.empty((POINTS - 1, SIZE)),
        np.empty(SIZE),
        np.empty((SIZE, SIZE)),
        np.empty((POINTS - 1, measured)),
        np.empty(measured),
        np.empty((SIZE, measured)),
        np.empty((measured, measured)),
        np.empty(measured),
        np.empty(SIZE),
    )


@njit(cache=True, error_model="numpy")
def spread_translation(translation, root, spread, bundle):
    """Sigma points of position and velocity, shape (6, 25), into `bundle` (compiled)."""
    for c in range(6):
        mean = translation[c]
        bundle[c, 0] = mean
        for i in range(SIZE):
            delta = spread * root[6 + c, i]
            bundle[c, 1 + i] = mean + delta
            bundle[c, 1 + SIZE + i] = mean - delta


@njit(cache=True, error_model="numpy")
def _turn_left(quaternion, d1, d2, d3, d4):
    """quaternion <- d (x) quaternion, normalised (compiled)."""
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
    """Inject a mean error state: multiplicative in the attitude, additive else (compiled)."""
    d1, d2, d3, d4 = quaternion_from_grp_components(
        correction[0], correction[1], correction[2], GRP_A, GRP_F
    )
    _turn_left(quaternion, d1, d2, d3, d4)
    for c in range(3):
        omega[c] += correction[3 + c]
    for c in range(6):
        translation[c] += correction[6 + c]


@njit(cache=True, error_model="numpy")
def condition(quaternion, translation, mu):
    """Whether an estimate is usable: HEALTHY, NOT_FINITE or INSIDE_PRIMARY (compiled)."""
    if not np.isfinite(np.sum(quaternion)):
        return NOT_FINITE
    return translation_condition(translation, mu)


@njit(cache=True, error_model="numpy")
def predict(quaternion, omega, translation, root, bodies, j, t, step_s, step, constants, work):
    """Carry one target's estimate over a step (Paul & Fan, eqs. 22, 37, 41; compiled).

    Parameters
    ----------
    quaternion, omega, translation : ndarray, shapes (4,), (3,), (6,)
        Means; updated in place.
    root : ndarray, shape (12, 12)
        Lower Cholesky factor of the covariance; updated in place.
    bodies : RigidBodies
        Of all targets.
    j : int
        Index of the target.
    t : float
        Time at the start of the step, nondimensional, since the epoch.
    step_s, step : float
        The step in seconds and nondimensional.
    constants : FilterConstants
    work : Workspace

    Returns
    -------
    int
        HEALTHY, NOT_FINITE, INSIDE_PRIMARY or LOST_DEFINITENESS.

    Notes
    -----
    The mean attitude error after the step is injected at once, so that the error state is zero
    again; the paper carries it to the update. It is of third order in the spread.
    """
    spread = constants.weights.spread
    bundle, differences = work.bundle, work.differences
    spread_translation(translation, root, spread, bundle)
    step_bundle(constants.forces, t, bundle, step, work.slopes, work.stage)
    if bodies.spherical[j]:
        turn = rotation_vector_components(omega[0] * step_s, omega[1] * step_s, omega[2] * step_s)
        spherical_differences(omega, root, spread, step_s, turn, differences)
    else:
        turn = general_differences(
            omega, root, spread, step_s, bodies.inertia[j], bodies.inverse[j], differences
        )
    for c in range(6):
        center = bundle[c, 0]
        for i in range(POINTS - 1):
            differences[i, 6 + c] = bundle[c, 1 + i] - center
    weights = constants.weights
    difference_moments(differences, weights.outer, weights.mean_shift, work.shift, work.covariance)
    for c in range(SIZE):
        work.covariance[c, c] += constants.process_variance[c]
    _turn_left(quaternion, turn[0], turn[1], turn[2], turn[3])
    for c in range(6):
        translation[c] = bundle[c, 0]
    _apply(quaternion, omega, translation, work.shift)
    health = condition(quaternion, translation, constants.forces.mu)
    if health != HEALTHY:
        return health
    if not cholesky(work.covariance):
        return LOST_DEFINITENESS if np.isfinite(np.sum(work.covariance)) else NOT_FINITE
    root[:, :] = work.covariance
    return HEALTHY


@njit(cache=True, error_model="numpy")
def predicted_measurements(
    quaternion, translation, root, observer, k, j, scene, surfaces, constants, work
):
    """Measurements expected at the sigma points (Paul & Fan, eqs. 35, 36, 42; compiled).

    Parameters
    ----------
    quaternion, translation, root : ndarray
        The estimate, as in `predict`.
    observer, k, j : int
        Indices of the observer, the time and the target.
    scene, surfaces : Scene, TargetSurfaces
    constants : FilterConstants
    work : Workspace
        ``predicted`` receives the outer points less the central one, with the right ascension
        wrapped; its columns are (magnitude,) right ascension, declination.

    Returns
    -------
    magnitude, right_ascension, declination : float
        Of the central point; the magnitude is 0 if it is not used.
    floor_hits : int
        Sigma points that are dark.
    """
    spread = constants.weights.spread
    spread_translation(translation, root, spread, work.bundle)
    axes, to_inertial = scene.observer_axes[k], scene.frame_axes[k]
    ox = scene.observer_position[observer, k, 0]
    oy = scene.observer_position[observer, k, 1]
    oz = scene.observer_position[observer, k, 2]
    sun = scene.sun_position[k]
    bundle, predicted = work.bundle, work.predicted
    angle = 1 if constants.use_magnitude else 0
    q = (quaternion[0], quaternion[1], quaternion[2], quaternion[3])
    magnitude0, ra0, dec0 = 0.0, 0.0, 0.0
    floor_hits = 0
    for point in range(POINTS):
        x, y, z = bundle[0, point], bundle[1, point], bundle[2, point]
        dx, dy, dz = x - ox, y - oy, z - oz
        ra, dec = direction_angles(dx, dy, dz, axes)
        magnitude = 0.0
        if constants.use_magnitude:
            attitude = q
            column = (point - 1) % SIZE
            if point > 0 and column < 6:
                s = spread if point <= SIZE else -spread
                d1, d2, d3, d4 = quaternion_from_grp_components(
                    s * root[0, column], s * root[1, column], s * root[2, column], GRP_A, GRP_F
                )
                attitude = multiply_components(d1, d2, d3, d4, q[0], q[1], q[2], q[3])
            magnitude = target_magnitude(
                dx, dy, dz, sun[0] - x, sun[1] - y, sun[2] - z, to_inertial, attitude, surfaces, j
            )
            floor_hits += magnitude == FLOOR_MAGNITUDE
        if point == 0:
            magnitude0, ra0, dec0 = magnitude, ra, dec
            continue
        if constants.use_magnitude:
            predicted[point - 1, 0] = magnitude - magnitude0
        predicted[point - 1, angle] = wrap_angle(ra - ra0)
        predicted[point - 1, angle + 1] = dec - dec0
    return magnitude0, ra0, dec0, floor_hits


@njit(cache=True, error_model="numpy")
def update(
    quaternion,
    omega,
    translation,
    root,
    measured,
    observer,
    k,
    j,
    scene,
    surfaces,
    constants,
    work,
    counters,
):
    """Use one measurement of one target (Paul & Fan, eqs. 51, 52; compiled).

    Parameters
    ----------
    quaternion, omega, translation, root : ndarray
        The estimate, as in `predict`; updated in place.
    measured : ndarray, shape (3,)
        mag, rad, rad; NaN if there is none.
    observer, k, j, scene, surfaces, constants, work
        As in `predicted_measurements`.
    counters : ndarray of int, shape (N_COUNTERS,)
        Incremented.

    Returns
    -------
    bool
        Whether the measurement was used. It is not if it lies further than half the field of view
        from the expected direction.
    """
    if not np.isfinite(measured[0] + measured[1] + measured[2]):
        return False
    magnitude, ra, dec, dark = predicted_measurements(
        quaternion, translation, root, observer, k, j, scene, surfaces, constants, work
    )
    counters[FLOOR_HITS] += dark
    off_ra = wrap_angle(measured[1] - ra)
    off_dec = measured[2] - dec
    # Right ascension is compared on the sky: at the pole of the body frame it means nothing.
    if not (
        abs(off_ra) * np.cos(dec) <= constants.half_field and abs(off_dec) <= constants.half_field
    ):
        counters[OUT_OF_FIELD] += 1
        return False
    angle = 1 if constants.use_magnitude else 0
    innovation = work.innovation
    if constants.use_magnitude:
        innovation[0] = measured[0] - magnitude
    innovation[angle] = off_ra
    innovation[angle + 1] = off_dec
    innovation_moments(
        work.predicted,
        constants.noise_variance[1 - angle :],
        constants.weights,
        work.measured_shift,
        work.cross,
        work.even,
    )
    for a in range(innovation.shape[0]):
        innovation[a] -= work.measured_shift[a]
    if not square_root_update(
        root, work.cross, work.even, innovation, work.correction, work.covariance
    ):
        counters[CHOLESKY_FAILURES] += 1
        return False
    _apply(quaternion, omega, translation, work.correction)
    counters[UPDATES] += 1
    return True
