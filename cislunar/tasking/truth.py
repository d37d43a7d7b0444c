"""Truth of the targets: bodies and motion, and the errors of the estimates."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.attitude import grp
from cislunar.attitude.inertia import rigid_bodies
from cislunar.attitude.quaternion import compose, multiply_components, normalize
from cislunar.attitude.rigid_body import propagate_attitudes
from cislunar.attitude.torque_model import TorqueModel
from cislunar.attitude.varying_torque import RandomTorque, SunPressure, propagate_varying
from cislunar.compiled import njit_noalloc
from cislunar.dynamics.cr3bp import EARTH_MOON
from cislunar.dynamics.forces import of_targets, require_span
from cislunar.dynamics.maneuvers import (
    VELOCITY_UNIT_M_S,
    Impulses,
    local_axes,
    propagate_with_impulses,
)
from cislunar.estimation.estimator import Estimates, InitialEstimate
from cislunar.estimation.navigation.errors import ObserverErrorSigma
from cislunar.estimation.navigation.rates import frame_rotation
from cislunar.observation.body_parameters import BodyParameterPrior, require_freedom
from cislunar.observation.body_sampling import sample_rotations, sample_surfaces
from cislunar.observation.scene import Scene
from cislunar.observation.sensor import Sensors
from cislunar.observation.target_surfaces import TargetSurfaces
from cislunar.runtime.arguments import Array, require_kind
from cislunar.targets.maneuver_model import DrawnManeuvers
from cislunar.targets.maneuvers import (
    NO_MANEUVERS,
    Maneuvers,
    draw_maneuvers,
    joined_maneuvers,
)
from cislunar.tasking.initial_conditions import (
    BODY,
    INITIAL_ERROR,
    MANEUVER,
    MEASUREMENT,
    PRESSURE,
    TORQUE,
    stream,
)

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
    parameter_freedom : float or None
        Degrees of freedom, above 2, of Student's t distribution of the body-parameter deviations,
        which keep their standard deviations; None for the normal distribution.
    torque : TorqueModel
        Torques that vary, in addition to the constant one.
    observer_sigma : ObserverErrorSigma
        Standard deviations of the errors of the observers in each realization.
    observer_errors : ndarray, shape (observer, 6), or None
        Constant errors of the observers in all realizations; m, arcsec and s, see
        `cislunar.estimation.navigation.errors`.
    maneuvers : Maneuvers
        Maneuvers in all realizations.
    drawn_maneuvers : tuple of DrawnManeuvers
        Maneuvers drawn in each realization, in addition.
    start : InitialEstimate or None
        Distribution of the true states at the start, if it is not that of the initial estimates;
        standard deviations of 0 state the truth itself.
    """

    surfaces: TargetSurfaces
    noise: Array
    angular_acceleration: Array
    forces: tuple = EARTH_MOON
    parameter_sigma: BodyParameterPrior = BodyParameterPrior()
    sensor: Sensors | None = None
    parameter_freedom: float | None = None
    torque: TorqueModel = TorqueModel()
    observer_sigma: ObserverErrorSigma = ObserverErrorSigma()
    observer_errors: Array | None = None
    maneuvers: Maneuvers = NO_MANEUVERS
    drawn_maneuvers: tuple[DrawnManeuvers, ...] = ()
    start: InitialEstimate | None = None

    def all_maneuvers(
        self, seed: int, target_ids: NDArray[np.int64], duration_hours: float
    ) -> Maneuvers:
        """Maneuvers of one realization of a run, of which identity of a target and seed select the
        random numbers. ConfigurationError if they do not fit into the run."""

        def generator(j: int, number: int) -> np.random.Generator:
            return stream(MANEUVER, seed, target_ids[j], number)

        drawn = draw_maneuvers(self.drawn_maneuvers, target_ids.size, duration_hours, generator)
        return joined_maneuvers([self.maneuvers, drawn])

    def sampled(self, seed: int, target_ids: ArrayLike) -> "TruthModel":
        """The truth of one realization, with its body-parameter deviations sampled; the same
        object, if there is no `parameter_sigma`. The identity of each target, `target_ids`
        (target,), selects its random numbers with the seed. ConfigurationError if
        `parameter_freedom` is impossible."""
        require_freedom(self.parameter_sigma, self.parameter_freedom)
        if not self.parameter_sigma:
            return self
        ids = np.asarray(target_ids)

        def generator(j: int, number: int) -> np.random.Generator:
            return stream(BODY, seed, ids[j], number)

        given = self.parameter_sigma, generator, self.parameter_freedom
        surfaces = sample_surfaces(self.surfaces, *given)
        inertia, forced = sample_rotations(surfaces.inertia, *given)
        return self._replace(
            surfaces=surfaces._replace(inertia=inertia),
            angular_acceleration=self.angular_acceleration + forced,
            parameter_sigma=BodyParameterPrior(),
            parameter_freedom=None,
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
        Mean and covariances at the start, from which the true states are drawn.
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
    torque : TorqueModel, optional
        Torques that vary; none if omitted.
    surfaces : TargetSurfaces, optional
        True bodies, for the torque of sunlight.
    observations : int
        Largest number of observations of a target at a time; a larger number does not change the
        errors of the first ones.
    maneuvers : Maneuvers
        Maneuvers of the targets; none if omitted.

    Attributes
    ----------
    maneuvers : Maneuvers
        As given.
    velocity_changes_m_s : ndarray, shape (maneuver, 3)
        Changes of velocity by the maneuvers up to the last time so far, propagation frame, m/s.

    Raises
    ------
    ConfigurationError
        If the force model does not cover the scene, an inertia is not physical, or `torque` is
        given without `surfaces`.
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
        torque: TorqueModel | None = None,
        surfaces: TargetSurfaces | None = None,
        observations: int = 1,
        maneuvers: Maneuvers = NO_MANEUVERS,
    ) -> None:
        ids = np.asarray(target_ids)
        require_span(forces, 0.0, scene.step * (scene.sun_position.shape[0] - 1))
        normals = [stream(INITIAL_ERROR, seed, j).standard_normal(12) for j in ids]
        error = np.array(normals)
        if initial.covariance is None:
            error *= initial.sigma
        else:
            error = np.sum(initial.roots() * error[:, None], axis=2)
        self._scene, self._forces = scene, forces
        self._noise = np.asarray(noise, dtype=float)
        spherical = np.tile(np.eye(3), (ids.size, 1, 1))
        self._bodies = rigid_bodies(spherical if inertia is None else inertia)
        forced = np.broadcast_to(angular_acceleration, (ids.size, 3))
        self._forced = np.array(forced, dtype=float, order="C")
        self._translation = initial.translation + error[:, 6:]
        self._attitude = compose(grp.to_quaternion(error[:, :3]), initial.quaternion)
        self._rate = initial.angular_velocity + error[:, 3:6]
        self._varying = None
        if torque:
            require_kind("surfaces", surfaces, TargetSurfaces, "give those of the truth")
            streams = [stream(TORQUE, seed, j) for j in ids]
            sigma = np.deg2rad(torque.random_deg_h2) / 3600.0**2
            random = RandomTorque(sigma, 3600.0 * torque.random_hours / scene.step_s, streams)
            streams = [stream(PRESSURE, seed, j) for j in ids]
            self._varying = random, _sun_pressure(torque, surfaces, streams)
        integrated = ~self._bodies.spherical | np.any(self._forced, axis=1) | bool(torque)
        self._attitude[integrated] = normalize(self._attitude[integrated])
        keys = [()] + [(observation,) for observation in range(1, observations)]
        self._streams = [[stream(MEASUREMENT, seed, j, *key) for key in keys] for j in ids]
        self._last = self._draw(1)
        self._index = 0
        self.maneuvers = maneuvers
        self._impulses, self._maneuver_of = maneuvers.impulses(scene.step_s / scene.step)
        self.velocity_changes_m_s = np.zeros_like(maneuvers.velocity_m_s)

    def _draw(self, n_times: int) -> Array:
        """Measurement errors of the next times, shape (target, time, observation, 3)."""
        draws = [[each.standard_normal((n_times, 3)) for each in own] for own in self._streams]
        return np.moveaxis(draws, 1, 2) * self._noise

    def _change(self, impulse: int, time: float, state: Array) -> Array:
        """Change of velocity by an impulse in the propagation frame."""
        number = self._maneuver_of[impulse]
        change, body = self._impulses.velocity[impulse], self.maneuvers.axes[number] - 1
        if body >= 0:
            scene = self._scene
            k = min(int(time / scene.step), scene.primaries.shape[0] - 2)
            before, after = scene.primaries[k : k + 2, body]
            velocity = (after - before) / scene.step
            center = before + velocity * (time - k * scene.step)
            change = change @ local_axes(state, center, velocity, frame_rotation(scene))
        return change

    def _resolve(self, impulse: int, time: float, state: Array) -> Array:
        """Change of velocity by an impulse in the propagation frame, which is noted."""
        change = self._change(impulse, time, state)
        self.velocity_changes_m_s[self._maneuver_of[impulse]] += VELOCITY_UNIT_M_S * change
        return change

    def advance(self, n_steps: int) -> Truth:
        """Motion at the last time so far and over the next `n_steps` steps, n_steps + 1 times."""
        first, scene, n_targets = self._index, self._scene, self._attitude.shape[0]
        translation = propagate_with_impulses(
            self._translation,
            scene.step,
            n_steps,
            self._impulses,
            forces=self._forces,
            start=first * scene.step,
            resolve=self._resolve,
        )
        elapsed = scene.step_s * np.arange(first, first + n_steps + 1)
        quaternion, omega = (np.empty((n_targets, n_steps + 1, n)) for n in (4, 3))
        moved = self._attitude, self._rate, quaternion, omega
        if self._varying is None:
            propagate_attitudes(elapsed, self._bodies, self._forced, _TOLERANCE, *moved)
        else:
            random, pressure = self._varying
            forced = self._forced[:, None] + random.next(n_steps)
            here = slice(first, first + n_steps + 1)
            away = scene.sun_position[here] - translation[..., :3]
            sun = np.einsum("tij,btj->bti", scene.frame_axes[here], away)
            sun /= np.linalg.norm(sun, axis=-1, keepdims=True)
            propagate_varying(elapsed, self._bodies, forced, sun, pressure, _TOLERANCE, *moved)
        noise = np.concatenate([self._last, self._draw(n_steps)], axis=1)
        self._translation, self._last = translation[:, -1].copy(), noise[:, -1:].copy()
        self._index += n_steps
        return Truth(translation, quaternion, omega, noise)

    def again(self, state: Array, targets: NDArray[np.int64], first: int, n_steps: int) -> Array:
        """Translation of some targets over an interval that `advance` has passed.

        Parameters
        ----------
        state : ndarray, shape (target, 6)
            Of these targets at the first time, nondimensional, propagation frame.
        targets : ndarray of int, shape (target,)
            Rows of the targets, in increasing order.
        first, n_steps : int
            Index of the first time, and number of steps. If they are those of a call of `advance`,
            the states are the same bit for bit.

        Returns
        -------
        ndarray, shape (target, n_steps + 1, 6)
        """
        given = self._impulses
        own = np.flatnonzero(np.isin(given.index, targets))
        index = np.searchsorted(targets, given.index[own])
        return propagate_with_impulses(
            state,
            self._scene.step,
            n_steps,
            Impulses(index, given.time[own], given.velocity[own]),
            forces=of_targets(self._forces, targets),
            start=first * self._scene.step,
            resolve=lambda impulse, time, before: self._change(own[impulse], time, before),
        )


def _sun_pressure(
    torque: TorqueModel, surfaces: TargetSurfaces, streams: list[np.random.Generator]
) -> SunPressure:
    """Facets on which sunlight exerts a torque, with centers of pressure drawn from `streams`, one
    generator per target. A facet reflects d rho diffusely and 4 s F0, or what is left, specularly.
    """
    counts = np.diff(surfaces.first)
    rows = surfaces.rows + np.repeat(surfaces.first_material[:-1], counts)
    d, s, rho, _, f0 = surfaces.material[rows].T
    diffuse = np.minimum(d * rho, 1.0)
    area = np.add.reduceat(surfaces.areas, surfaces.first[:-1])
    # that of a homogeneous sphere, 2/5 m R^2 about each axis on average, with 4 pi R^2 the area
    mean = 0.4 * torque.mass_kg * area / (4.0 * np.pi)
    ratios = surfaces.inertia / np.trace(surfaces.inertia, axis1=1, axis2=2)[:, None, None]
    inverse = np.linalg.inv(3.0 * mean[:, None, None] * ratios)
    center = [torque.center_of_pressure_sigma_m * each.standard_normal(3) for each in streams]
    specular = np.minimum(4.0 * s * f0, 1.0 - diffuse)
    return SunPressure(
        surfaces.first, surfaces.areas, surfaces.normals, diffuse, specular, np.array(center),
        inverse,
    )  # fmt: skip


@njit_noalloc
def _errors(first, truth, estimates, out):
    """Errors of an interval (target, step, 12); see `estimation_errors`."""
    for j in range(out.shape[0]):
        for i in range(out.shape[1]):
            t = truth.quaternion[j, first + i]
            e = estimates.quaternion[j, i]
            d1, d2, d3, d4 = multiply_components(t[0], t[1], t[2], t[3], -e[0], -e[1], -e[2], e[3])
            p1, p2, p3 = grp.grp_from_quaternion_components(d1, d2, d3, d4)
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
    _errors(first, truth, estimates, out)
    return out
