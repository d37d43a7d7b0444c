"""Truth of the targets: initial states, measurement errors, and what has become of the estimate.

Every random draw belongs to a seed and a target, so that cells that share a seed share the truth
and the measurement errors of the targets they share, whatever else differs between them.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from cislunar.attitude import grp
from cislunar.attitude.inertia import is_spherical
from cislunar.attitude.quaternion import compose, multiply_components
from cislunar.attitude.rigid_body import propagate_under_torque
from cislunar.constants import MU
from cislunar.dynamics.bundle import propagate_bundle
from cislunar.dynamics.cr3bp import CR3BP, EARTH_MOON
from cislunar.dynamics.propagation import propagate
from cislunar.errors import ConfigurationError
from cislunar.estimation.estimator import Estimates, InitialEstimate
from cislunar.observation.scene import Scene, TargetSurfaces, constant_rate_attitude

Array = NDArray[np.float64]

INITIAL_QUATERNION = (0.0, 0.0, 0.0, 1.0)
INITIAL_RATE_DEG_H = (-44.723808, -6.6573, -8.514216)
"""Mean attitude and angular velocity of the targets at the epoch (Paul & Fan, table 3)."""

# Independent streams of random numbers; the first entry of a generator's seed.
_PHASE, _SELECTION, _INITIAL_ERROR, _MEASUREMENT, TASKING, ESTIMATOR = range(6)


def stream(*key: int) -> np.random.Generator:
    """Generator of the stream with this key: a purpose, then seed and indices."""
    return np.random.default_rng([int(part) for part in key])


def monitored_targets(n_available: int, n_targets: int, seed: int) -> NDArray[np.int64]:
    """Choose the monitored targets; a larger set holds the smaller ones (Paul & Fan, section 5.2).

    Parameters
    ----------
    n_available : int
        Number of targets to choose from.
    n_targets : int
        Number to choose.
    seed : int
        Of the choice.

    Returns
    -------
    ndarray of int, shape (n_targets,)
        Indices into the available targets. Smaller sets are the first entries of larger ones.

    Raises
    ------
    ConfigurationError
        If fewer than one or more than the available targets are wanted.
    """
    if not 1 <= n_targets <= n_available:
        raise ConfigurationError(f"n_T = {n_targets} must lie between 1 and {n_available}")
    return stream(_SELECTION, seed).permutation(n_available)[:n_targets]


def epoch_states(state: ArrayLike, period: ArrayLike, seed: int, mu: float = MU) -> Array:
    """Mean states of targets at the epoch: a random fraction of the period past y = 0.

    Parameters
    ----------
    state : array_like, shape (target, 6)
        States on y = 0, nondimensional, rotating frame.
    period : array_like, shape (target,)
        Periods, nondimensional.
    seed : int
        Of the fractions, one for each target.
    mu : float
        Mass ratio.

    Returns
    -------
    ndarray, shape (target, 6)
        Nondimensional, rotating frame.
    """
    states, periods = np.asarray(state, dtype=float), np.asarray(period, dtype=float)
    fractions = [stream(_PHASE, seed, j).random() for j in range(periods.size)]
    times = fractions * periods
    return np.array(
        [
            propagate(one, [time], forces=CR3BP(mu), method="dop853")[0]
            for one, time in zip(states, times, strict=True)
        ]
    )


class TruthModel(NamedTuple):
    """What targets and sensors truly are; estimators may believe otherwise.

    Attributes
    ----------
    surfaces : TargetSurfaces
        Shapes, materials and inertia.
    noise : ndarray, shape (3,)
        Standard deviations of the measurements: mag, rad, rad.
    angular_acceleration : ndarray, shape (3,)
        That which a torque constant in the body frame gives every target, rad/s^2.
    forces : NamedTuple
        Force model of the translation, see `cislunar.dynamics.forces`.
    """

    surfaces: TargetSurfaces
    noise: Array
    angular_acceleration: Array
    forces: tuple = EARTH_MOON


class Truth(NamedTuple):
    """True motion of the targets on the grid of measurement times, and their noise.

    Attributes
    ----------
    translation : ndarray, shape (target, time, 6)
        Nondimensional, rotating frame.
    quaternion : ndarray, shape (target, time, 4)
        Inertial to body.
    angular_velocity : ndarray, shape (target, time, 3)
        rad/s, body frame; constant for spherical inertia without torque.
    noise : ndarray, shape (target, time, look, 3)
        Errors of magnitude (mag), right ascension and declination (rad) of the first, second ...
        look at a target at a time.
    """

    translation: Array
    quaternion: Array
    angular_velocity: Array
    noise: Array


def initial_estimate(translation: ArrayLike, sigma: ArrayLike) -> InitialEstimate:
    """The same attitude and angular velocity for all targets, as in the paper.

    Parameters
    ----------
    translation : array_like, shape (target, 6)
        Mean states at the epoch, nondimensional, rotating frame.
    sigma : array_like, shape (12,)
        Standard deviations, see `InitialEstimate`.

    Returns
    -------
    InitialEstimate
    """
    states = np.array(translation, dtype=float)
    rate = np.deg2rad(INITIAL_RATE_DEG_H) / 3600.0
    n_targets = states.shape[0]
    return InitialEstimate(
        np.tile(np.array(INITIAL_QUATERNION), (n_targets, 1)),
        np.tile(rate, (n_targets, 1)),
        states,
        np.array(sigma, dtype=float),
    )


def _rotation(
    quaternion: Array, rate: Array, elapsed_s: Array, inertia: Array, acceleration: Array
) -> tuple[Array, Array]:
    """Attitude and angular velocity of one target at all times, in closed form where there is."""
    if is_spherical(inertia) and not np.any(acceleration):
        rates = np.tile(rate, (elapsed_s.size, 1))
        return constant_rate_attitude(quaternion, rate, elapsed_s), rates
    return propagate_under_torque(quaternion, rate, elapsed_s, inertia, acceleration)


def draw_truth(
    initial: InitialEstimate,
    scene: Scene,
    noise: ArrayLike,
    seed: int,
    target_ids: ArrayLike,
    *,
    forces: tuple = EARTH_MOON,
    inertia: ArrayLike | None = None,
    angular_acceleration: ArrayLike = (0.0, 0.0, 0.0),
    looks: int = 1,
) -> Truth:
    """Sample the true states from the initial distribution and propagate them.

    Parameters
    ----------
    initial : InitialEstimate
        Mean and standard deviations at the epoch.
    scene : Scene
        Gives the grid of times.
    noise : array_like, shape (3,)
        Standard deviations of the measurements: mag, rad, rad.
    seed : int
        Of this realisation.
    target_ids : array_like of int, shape (target,)
        Identity of each target, which with the seed selects its random numbers.
    forces : NamedTuple
        Force model, see `cislunar.dynamics.forces`.
    inertia : array_like, shape (target, 3, 3), optional
        Inertia matrices, body frame; spherical if omitted.
    angular_acceleration : array_like, shape (3,)
        As in `TruthModel`; without torque if omitted.
    looks : int
        Most looks at a target at a time; more leave the errors of the first ones as they are.

    Returns
    -------
    Truth
    """
    ids = np.asarray(target_ids)
    n_times = scene.sun_position.shape[0]
    normals = [stream(_INITIAL_ERROR, seed, j).standard_normal(12) for j in ids]
    error = np.array(normals) * initial.sigma
    start = compose(grp.to_quaternion(error[:, :3]), initial.quaternion)
    omega = initial.angular_velocity + error[:, 3:6]
    elapsed = scene.step_s * np.arange(n_times)
    bodies = np.tile(np.eye(3), (ids.size, 1, 1)) if inertia is None else np.asarray(inertia)
    forced = np.asarray(angular_acceleration, dtype=float)
    keys = [()] + [(look,) for look in range(1, looks)]
    rotations = [
        _rotation(q, w, elapsed, body, forced)
        for q, w, body in zip(start, omega, bodies, strict=True)
    ]
    draws = [
        [stream(_MEASUREMENT, seed, j, *key).standard_normal((n_times, 3)) for key in keys]
        for j in ids
    ]
    return Truth(
        propagate_bundle(
            initial.translation + error[:, 6:], scene.step, n_times - 1, forces=forces
        ),
        np.array([attitude for attitude, _ in rotations]),
        np.array([rate for _, rate in rotations]),
        np.ascontiguousarray(np.moveaxis(draws, 1, 2)) * np.asarray(noise, dtype=float),
    )


@njit(cache=True, error_model="numpy")
def _errors(first, truth, estimates, a, f, out):
    """Errors of an interval (target, step, 12); see `estimation_errors`."""
    for j in range(out.shape[0]):
        for i in range(out.shape[1]):
            t = truth.quaternion[j, first + i]
            e = estimates.quaternion[j, i]
            d1, d2, d3, d4 = multiply_components(t[0], t[1], t[2], t[3], -e[0], -e[1], -e[2], e[3])
            p1, p2, p3 = grp.grp_from_quaternion_components(d1, d2, d3, d4, a, f)
            out[j, i, 0] = p1
            out[j, i, 1] = p2
            out[j, i, 2] = p3
            for c in range(3):
                out[j, i, 3 + c] = (
                    truth.angular_velocity[j, first + i, c] - estimates.angular_velocity[j, i, c]
                )
            for c in range(6):
                out[j, i, 6 + c] = (
                    truth.translation[j, first + i, c] - estimates.translation[j, i, c]
                )


def estimation_errors(first: int, truth: Truth, estimates: Estimates) -> Array:
    """Errors of the estimates of an interval, truth less estimate.

    Parameters
    ----------
    first : int
        Index of the interval's first step on the grid of times.
    truth : Truth
    estimates : Estimates

    Returns
    -------
    ndarray, shape (target, step, 12)
        GRP of the attitude error ``q_true (x) q_estimate^-1``, angular velocity (rad/s), position
        and velocity (nondimensional).
    """
    out = np.empty(estimates.sigma.shape)
    _errors(first, truth, estimates, grp.GRP_A, grp.GRP_F, out)
    return out
