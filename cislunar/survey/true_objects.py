"""True objects of a survey: their motion, and the detections of exposures with their origins.

Only the states of the last block, and those at the start of every twelfth block, are kept.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from cislunar.detection import FALSE_ALARM, DetectionProcess, Detections, Exposures, expose
from cislunar.estimation.estimator import InitialEstimate
from cislunar.observation import Scene, Sensors, dimming
from cislunar.runtime.arguments import Array, Indices, array_of
from cislunar.runtime.seeds import generator
from cislunar.survey.results import BlockRecord
from cislunar.targets import Maneuvers
from cislunar.tasking import TrueMotion, TruthModel, draw_observer_errors

_BLOCKS_KEPT = 12
"""Blocks between two times whose true states are kept."""

_SPIN_SIGMA = np.deg2rad(30.0) / 3600.0
"""Standard deviation of each component of the angular velocity at the start, rad/s."""


class TrueObjects:
    """The truth of a survey, of which the estimation side gets detections alone.

    Parameters
    ----------
    scene : Scene
        With the assumed positions of the observers.
    truth : TruthModel
    states : ndarray, shape (object, 6)
        At the start, nondimensional, propagation frame.
    ids : ndarray of int, shape (object,)
        Identities, which with the seed select the random numbers of bodies, maneuvers and noise;
        those of attitudes, rotations and missed detections depend on the row.
    seed : int
    duration_hours : float
        Of the survey.
    process : DetectionProcess
    sensor : Sensor or sequence of Sensor
        Assumed telescopes; those of `truth` make the noise if it has any.
    appears_hours : array_like, shape (object,), or None
        Hours after the start from which each object exists; None: all from the start.
    eclipse : bool
        Whether shadows dim objects.

    Attributes
    ----------
    first_attitude, first_rate : ndarray, shapes (object, 4) and (object, 3)
        Attitudes, inertial frame to body frame, and angular velocities (rad/s, body frame) at the
        start.

    Raises
    ------
    ConfigurationError
        If `appears_hours` or the errors of the observers have another shape or are not finite, or
        the force model of `truth` does not cover the scene.
    """

    def __init__(
        self,
        scene: Scene,
        truth: TruthModel,
        states: Array,
        ids: Indices,
        seed: int,
        duration_hours: float,
        process: DetectionProcess,
        sensor: Sensors,
        appears_hours: ArrayLike | None,
        eclipse: bool,
    ) -> None:
        self.seed, self.process, self.sensor, self.eclipse = seed, process, sensor, eclipse
        hours = np.zeros(ids.size) if appears_hours is None else appears_hours
        self.appears_s = 3600.0 * array_of("appears_hours", hours, (ids.size,))
        self.truth = truth.sampled(seed, ids)
        self.observers = draw_observer_errors(
            truth.observer_sigma, truth.observer_errors, scene, seed
        )
        self.scene = scene if self.observers is None else self.observers.scene(scene)
        # an object has no maneuver before it exists
        drawn = truth.all_maneuvers(seed, ids, duration_hours)
        exists = drawn.start_s >= self.appears_s[drawn.target]
        # attitudes are uniform, and unknown to the estimation side
        turns = Rotation.random(ids.size, random_state=generator(seed, "attitude")).as_quat()
        spin = generator(seed, "spin").standard_normal((ids.size, 3)) * _SPIN_SIGMA
        self.first_attitude, self.first_rate = turns, spin
        self.motion = TrueMotion(
            InitialEstimate(turns, spin, states, np.zeros(12)),
            self.scene,
            np.ones(3) if truth.sensor is not None else truth.noise,
            seed,
            ids,
            forces=truth.forces,
            inertia=self.truth.surfaces.inertia,
            angular_acceleration=self.truth.angular_acceleration,
            torque=self.truth.torque,
            surfaces=self.truth.surfaces,
            observations=scene.observer_position.shape[0],
            maneuvers=Maneuvers(*(each[exists] for each in drawn)),
        )
        self._attitudes: list[Array] = []
        self._states = np.empty((ids.size, 0, 6))
        self._kept: list[Array] = []
        self._n_blocks, self._n_steps = 0, 1

    def states(self, objects: ArrayLike, steps: ArrayLike) -> Array:
        """True states at times so far.

        They are propagated again from states that are kept every twelve blocks, over the
        same blocks and therefore with the same rounding.

        Parameters
        ----------
        objects, steps : array_like of int, shape (row,)
            Objects, and indices of the times.

        Returns
        -------
        ndarray, shape (row, 6)
            Nondimensional, propagation frame.
        """
        of, at = (np.asarray(each, dtype=np.int64) for each in (objects, steps))
        out, n = np.empty((of.size, 6)), self._n_steps
        block = np.minimum(at // n, self._n_blocks - 1)
        for piece in np.unique(block // _BLOCKS_KEPT).tolist():
            rows = np.flatnonzero(block // _BLOCKS_KEPT == piece)
            own = np.unique(of[rows])
            state = self._kept[piece][own]
            for number in range(piece * _BLOCKS_KEPT, int(block[rows].max()) + 1):
                path = self.motion.again(state, own, number * n, n)
                here = rows[block[rows] == number]
                out[here] = path[np.searchsorted(own, of[here]), at[here] - number * n]
                state = path[:, -1]
        return out

    def attitudes(self) -> Array:
        """True attitude (row, 4) at each detection so far, inertial frame to body frame; NaN for
        false alarms."""
        return np.concatenate([np.empty((0, 4)), *self._attitudes])

    def maneuvered(self, elapsed_s: float) -> NDArray[np.bool_]:
        """Which objects have begun a maneuver by a time since the start, s."""
        given, out = self.motion.maneuvers, np.zeros(self.appears_s.size, dtype=bool)
        out[given.target[given.start_s < elapsed_s]] = True
        return out

    def observe(
        self, block: int, start: int, n_steps: int, exposures: Exposures
    ) -> tuple[Detections, Indices]:
        """Detections of the exposures of a block, and their origins. `start` is the index of the
        time before the first step of the block."""
        scene, moved = self.scene, self.motion.advance(n_steps)
        if block % _BLOCKS_KEPT == 0:
            self._kept.append(moved.translation[:, 0].copy())
        self._states, self._n_blocks, self._n_steps = moved.translation, block + 1, n_steps
        n_objects, n_observers = len(moved.translation), scene.observer_position.shape[0]
        loss = generator(self.seed, "loss", block).random((n_objects, n_steps, n_observers))
        times = np.arange(start, start + n_steps + 1)
        exists = scene.step_s * times[1:] >= self.appears_s[:, None]
        dimmed = None
        if self.eclipse:
            sky = scene.sun_position[times], scene.primaries[times]
            dimmed = dimming(moved.translation[..., :3], *sky)
        detections, origin, _ = expose(
            start + 1,
            exposures,
            self.process,
            scene,
            self.truth.surfaces,
            self.sensor,
            moved.translation,
            moved.quaternion,
            moved.noise,
            generator(self.seed, "alarms", block),
            n_steps=n_steps,
            command=np.full((n_steps, n_observers), -1),
            kept=(loss >= self.process.detection_loss) & exists[..., None],
            origin=start,
            true=self.truth.sensor,
            dimmed=dimmed,
        )
        attitude = np.full((origin.size, 4), np.nan)
        real = np.flatnonzero(origin != FALSE_ALARM)
        at = exposures.step[detections.exposure[real]] + 1
        attitude[real] = moved.quaternion[origin[real], at]
        self._attitudes.append(attitude)
        if self.observers is None:
            return detections, origin
        given = scene, start, moved.translation, exposures, detections, origin
        return self.observers.measured(*given)

    def record(
        self, first: int, exposures: Exposures, detections: Detections, origin: Indices
    ) -> BlockRecord:
        """The record of the last block."""
        return BlockRecord(
            first, exposures, detections, origin, self._states, self.motion.maneuvers,
            self.motion.velocity_changes_m_s,
        )  # fmt: skip
