"""Truth of the targets: initial states, measurement errors, and what has become of the estimate.

Every random draw belongs to a seed and a target, so that cells that share a seed share the truth
and the measurement errors of the targets they share, whatever else differs between them.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.attitude import grp
from cislunar.attitude.inertia import rigid_bodies
from cislunar.attitude.quaternion import compose, multiply_components, normalize
from cislunar.attitude.turning import turn_bodies
from cislunar.compiled import borrowing
from cislunar.constants import MU
from cislunar.dynamics.bundle import propagate_bundle
from cislunar.dynamics.cr3bp import CR3BP, EARTH_MOON
from cislunar.dynamics.forces import require_span
from cislunar.dynamics.propagation import propagate
from cislunar.errors import ConfigurationError
from cislunar.estimation.estimator import Estimates, InitialEstimate
from cislunar.observation.body_spread import BodySpread
from cislunar.observation.drawn_bodies import drawn_rotations, drawn_surfaces
from cislunar.observation.scene import Scene, TargetSurfaces
from cislunar.observation.sensor import Sensors

Array = NDArray[np.float64]

INITIAL_QUATERNION = (0.0, 0.0, 0.0, 1.0)
INITIAL_RATE_DEG_H = (-44.723808, -6.6573, -8.514216)
"""Mean attitude and angular velocity of the targets at the epoch (Paul & Fan, table 3)."""

_TOLERANCE = 1e-13  # of the rotation of bodies whose angular velocity changes

# Independent streams of random numbers; the first entry of a generator's seed.
_PHASE, _SELECTION, _INITIAL_ERROR, _MEASUREMENT, TASKING, ESTIMATOR, _BODY = range(7)


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
        Standard deviations of the measurements: mag, rad, rad; unused with `sensor`.
    angular_acceleration : ndarray, shape (3,) or (target, 3)
        That which a torque constant in the body frame gives the targets, rad/s^2.
    forces : NamedTuple
        Force model of the translation, see `cislunar.dynamics.forces`.
    spread : BodySpread
        How far the targets of a realization depart from `surfaces`, each by its own draw.
    sensor : Sensor, sequence of Sensor, or None
        True ones, if noise depends on observer or magnitude.
    """

    surfaces: TargetSurfaces
    noise: Array
    angular_acceleration: Array
    forces: tuple = EARTH_MOON
    spread: BodySpread = BodySpread()
    sensor: Sensors | None = None

    def drawn(self, seed: int, target_ids: ArrayLike) -> "TruthModel":
        """The truth of one realization, with nothing left open.

        Parameters
        ----------
        seed : int
            Of the realization.
        target_ids : array_like of int, shape (target,)
            Identity of each target, which with the seed selects its random numbers.

        Returns
        -------
        TruthModel
            The same object, if there is no spread.
        """
        if not self.spread:
            return self
        ids = np.asarray(target_ids)

        def generator(j: int, number: int) -> np.random.Generator:
            return stream(_BODY, seed, ids[j], number)

        surfaces = drawn_surfaces(self.surfaces, self.spread, generator)
        inertia, forced = drawn_rotations(surfaces.inertia, self.spread, generator)
        return self._replace(
            surfaces=surfaces._replace(inertia=inertia),
            angular_acceleration=self.angular_acceleration + forced,
            spread=BodySpread(),
        )


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
        Errors of the looks at a target at a time: mag, rad, rad; with ``TruthModel.sensor`` in
        standard deviations.
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


class TrueMotion:
    """True motion of the targets, carried on from interval to interval.

    Where the intervals end does not matter, for forces that depend on time except for rounding.

    Parameters
    ----------
    initial : InitialEstimate
        Mean and standard deviations at the epoch, from which the true states are drawn.
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
    angular_acceleration : array_like, shape (3,) or (target, 3)
        As in `TruthModel`; without torque if omitted.
    looks : int
        Most looks at a target at a time; more leave the errors of the first ones as they are.

    Raises
    ------
    ConfigurationError
        If the force model has no data for some of the times, or an inertia is impossible.
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
        looks: int = 1,
    ) -> None:
        ids = np.asarray(target_ids)
        require_span(forces, 0.0, scene.step * (scene.sun_position.shape[0] - 1))
        normals = [stream(_INITIAL_ERROR, seed, j).standard_normal(12) for j in ids]
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
        keys = [()] + [(look,) for look in range(1, looks)]
        self._streams = [[stream(_MEASUREMENT, seed, j, *key) for key in keys] for j in ids]
        self._last = self._draw(1)
        self._index = 0

    def _draw(self, n_times: int) -> Array:
        """Measurement errors of the next times, shape (target, time, look, 3)."""
        draws = [[each.standard_normal((n_times, 3)) for each in own] for own in self._streams]
        return np.moveaxis(draws, 1, 2) * self._noise

    def advance(self, n_steps: int) -> Truth:
        """Motion over the next steps.

        Parameters
        ----------
        n_steps : int

        Returns
        -------
        Truth
            At n_steps + 1 times, the first of which is the last so far.
        """
        first, scene, n_targets = self._index, self._scene, self._attitude.shape[0]
        translation = propagate_bundle(
            self._translation, scene.step, n_steps, forces=self._forces, start=first * scene.step
        )
        elapsed = scene.step_s * np.arange(first, first + n_steps + 1)
        quaternion, omega = (np.empty((n_targets, n_steps + 1, n)) for n in (4, 3))
        given = elapsed, self._bodies, self._forced, _TOLERANCE
        turn_bodies(*given, self._attitude, self._rate, quaternion, omega)
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
    """Sample the true states from the initial distribution and carry them through the scene.

    Parameters
    ----------
    initial, scene, noise, seed, target_ids, **model
        As of `TrueMotion`.

    Returns
    -------
    Truth
        At all times of the scene.
    """
    motion = TrueMotion(initial, scene, noise, seed, target_ids, **model)
    return motion.advance(scene.sun_position.shape[0] - 1)


@borrowing
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
