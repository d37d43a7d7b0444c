"""Truth of the targets: bodies and motion, and the errors of the estimates."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.attitude import grp
from cislunar.attitude.attitude_propagation import propagate_attitudes
from cislunar.attitude.inertia import rigid_bodies
from cislunar.attitude.quaternion import compose, multiply_components, normalize
from cislunar.compiled import njit_noalloc
from cislunar.dynamics.bundle import propagate_bundle
from cislunar.dynamics.cr3bp import EARTH_MOON
from cislunar.dynamics.forces import require_span
from cislunar.estimation.estimator import Estimates, InitialEstimate
from cislunar.estimation.navigation.errors import ObserverErrorSigma
from cislunar.observation.body_parameters import BodyParameterPrior
from cislunar.observation.body_sampling import sample_rotations, sample_surfaces
from cislunar.observation.scene import Scene
from cislunar.observation.sensor import Sensors
from cislunar.observation.target_surfaces import TargetSurfaces
from cislunar.tasking.initial_conditions import BODY, INITIAL_ERROR, MEASUREMENT, stream

Array = NDArray[np.float64]

_TOLERANCE = 1e-13  # of integrated attitudes


class TruthModel(NamedTuple):
    """True bodies, sensors and forces; those that estimator and scheduler assume may differ.

    Attributes
    ----------
    surfaces : TargetSurfaces
        Shapes, materials and inertia.
    noise : ndarray, shape (3,)
        Standard deviations of the measurements: mag, rad, rad; not used with `sensor`.
    angular_acceleration : ndarray, shape (3,) or (target, 3)
        Due to a torque that is constant in the body frame, rad/s^2.
    forces : NamedTuple
        Force model of the translation, see `cislunar.dynamics.forces`.
    parameter_sigma : BodyParameterPrior
        Standard deviations of the body-parameter deviations of the targets in each realization.
    sensor : Sensor, sequence of Sensor, or None
        True sensors, if noise depends on observer or magnitude.
    observer_sigma : ObserverErrorSigma
        Standard deviations of the errors of the observers in each realization.
    observer_errors : ndarray, shape (observer, 6), or None
        Constant errors of the observers in all realizations; m, arcsec and s, see
        `cislunar.estimation.navigation.errors`.
    """

    surfaces: TargetSurfaces
    noise: Array
    angular_acceleration: Array
    forces: tuple = EARTH_MOON
    parameter_sigma: BodyParameterPrior = BodyParameterPrior()
    sensor: Sensors | None = None
    observer_sigma: ObserverErrorSigma = ObserverErrorSigma()
    observer_errors: Array | None = None

    def sampled(self, seed: int, target_ids: ArrayLike) -> "TruthModel":
        """The truth of one realization, with its body-parameter deviations sampled; the same
        object, if there is no `parameter_sigma`. The identity of each target, `target_ids`
        (target,), selects its random numbers with the seed."""
        if not self.parameter_sigma:
            return self
        ids = np.asarray(target_ids)

        def generator(j: int, number: int) -> np.random.Generator:
            return stream(BODY, seed, ids[j], number)

        surfaces = sample_surfaces(self.surfaces, self.parameter_sigma, generator)
        inertia, forced = sample_rotations(surfaces.inertia, self.parameter_sigma, generator)
        return self._replace(
            surfaces=surfaces._replace(inertia=inertia),
            angular_acceleration=self.angular_acceleration + forced,
            parameter_sigma=BodyParameterPrior(),
        )


class Truth(NamedTuple):
    """True motion of the targets on the grid of measurement times, and their measurement errors.
    `translation` (target, time, 6): nondimensional, propagation frame. `quaternion` (target, time,
    4): inertial frame to body frame. `angular_velocity` (target, time, 3): rad/s, body frame.
    `noise` (target, time, observation, 3): errors of the observations of a target at a time: mag,
    rad, rad; with ``TruthModel.sensor`` in standard deviations."""

    translation: Array
    quaternion: Array
    angular_velocity: Array
    noise: Array


class TrueMotion:
    """True motion of the targets, propagated from interval to interval.

    The result does not depend on the ends of the intervals, for time-dependent forces except for
    rounding.

    Parameters
    ----------
    initial : InitialEstimate
        Mean and standard deviations at the start, from which the true states are drawn.
    scene : Scene
        Grid of times.
    noise : array_like, shape (3,)
        Standard deviations of the measurements: mag, rad, rad.
    seed, target_ids : int and array_like of int, shape (target,)
        Seed of this realization, and identity of each target, which select the random numbers.
    forces : NamedTuple
        True force model, see `cislunar.dynamics.forces`.
    inertia : array_like, shape (target, 3, 3), optional
        Inertia matrices, body frame; spherical if omitted.
    angular_acceleration : array_like, shape (3,) or (target, 3)
        See `TruthModel`; without torque if omitted.
    observations : int
        Largest number of observations of a target at a time; a larger number does not change the
        errors of the first ones.
    """

    def __init__(
        self,
        initial: InitialEstimate,
        scene: Scene,
        noise: ArrayLike,
        seed: int,
        target_ids: ArrayLike,
        *,
        forces: tuple = EARTH_MOON,
        inertia: ArrayLike | None = None,
        angular_acceleration: ArrayLike = (0.0, 0.0, 0.0),
        observations: int = 1,
    ) -> None:
        ids = np.asarray(target_ids)
        require_span(forces, 0.0, scene.step * (scene.sun_position.shape[0] - 1))
        normals = [stream(INITIAL_ERROR, seed, j).standard_normal(12) for j in ids]
        error = np.array(normals) * initial.sigma
        self._scene, self._forces = scene, forces
        self._noise = np.asarray(noise, dtype=float)
        spherical = np.tile(np.eye(3), (ids.size, 1, 1))
        self._bodies = rigid_bodies(spherical if inertia is None else inertia)
        self._forced = np.array(np.broadcast_to(angular_acceleration, (ids.size, 3)), dtype=float)
        self._translation = initial.translation + error[:, 6:]
        self._attitude = compose(grp.to_quaternion(error[:, :3]), initial.quaternion)
        self._rate = initial.angular_velocity + error[:, 3:6]
        integrated = ~self._bodies.spherical | np.any(self._forced, axis=1)
        self._attitude[integrated] = normalize(self._attitude[integrated])
        keys = [()] + [(observation,) for observation in range(1, observations)]
        self._streams = [[stream(MEASUREMENT, seed, j, *key) for key in keys] for j in ids]
        self._last = self._draw(1)
        self._index = 0

    def _draw(self, n_times: int) -> Array:
        """Measurement errors of the next times, shape (target, time, observation, 3)."""
        draws = [[each.standard_normal((n_times, 3)) for each in own] for own in self._streams]
        return np.moveaxis(draws, 1, 2) * self._noise

    def advance(self, n_steps: int) -> Truth:
        """Motion at the last time so far and over the next `n_steps` steps, n_steps + 1 times."""
        first, scene, n_targets = self._index, self._scene, self._attitude.shape[0]
        translation = propagate_bundle(
            self._translation, scene.step, n_steps, forces=self._forces, start=first * scene.step
        )
        elapsed = scene.step_s * np.arange(first, first + n_steps + 1)
        quaternion, omega = (np.empty((n_targets, n_steps + 1, n)) for n in (4, 3))
        given = elapsed, self._bodies, self._forced, _TOLERANCE
        propagate_attitudes(*given, self._attitude, self._rate, quaternion, omega)
        noise = np.concatenate([self._last, self._draw(n_steps)], axis=1)
        self._translation, self._last = translation[:, -1].copy(), noise[:, -1:].copy()
        self._index += n_steps
        return Truth(translation, quaternion, omega, noise)


def draw_truth(
    initial: InitialEstimate,
    scene: Scene,
    noise: ArrayLike,
    seed: int,
    target_ids: ArrayLike,
    **model: Any,
) -> Truth:
    """Sample the true states from the initial distribution and propagate them to all times of the
    scene; see `TrueMotion` for the arguments."""
    motion = TrueMotion(initial, scene, noise, seed, target_ids, **model)
    return motion.advance(scene.sun_position.shape[0] - 1)


@njit_noalloc
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
    """Errors of the estimates of an interval, truth less estimate, (target, step, 12): GRP of the
    attitude error ``q_true (x) q_estimate^-1``, angular velocity (rad/s), position and velocity
    (nondimensional). `first` is the index of the interval's first step on the grid of times."""
    out = np.empty(estimates.sigma.shape)
    _errors(first, truth, estimates, grp.GRP_A, grp.GRP_F, out)
    return out
