"""A short run whose Cramér-Rao bound tests compare."""

import numpy as np
from measured import draw_truth, during
from oracles.rigid_rotation import propagate_rotation

from cislunar.evaluation.cramer_rao import CramerRaoBound
from cislunar.observation.records import Measurements, schedule
from cislunar.observation.sensor import Sensor
from cislunar.tasking.demonstration import tracking_problem
from cislunar.tasking.initial_conditions import initial_estimate
from cislunar.tasking.truth import Truth

BRIGHT = Sensor(limiting_magnitude=25.0)
UNEVEN = (1.0, 1.8, 2.3)
"""Principal moments of a body whose angular velocity changes."""


class Problem:
    """Truth, observers and settings of a short run; every target is seen at every third step."""

    def __init__(self, n_targets=3, hours=3.0, inertia=1.0):
        made = tracking_problem(3, n_targets, duration_hours=hours, sensor=BRIGHT)
        self.scene, self.surfaces, epoch, ids, self.loop = made
        self.inertia = inertia
        self.surfaces = self.bodies(np.tile(inertia * np.eye(3), (n_targets, 1, 1)))
        self.sigma = self.loop.initial.components()
        initial = initial_estimate(epoch, self.sigma)
        self.truth = draw_truth(initial, self.scene, BRIGHT.noise, 4, ids)
        if inertia != 1.0:
            self.truth = self._tumbling()
        step = np.arange(self.loop.n_steps)
        self.observer = np.where(step % 3 == 1, (step // 30) % 3, -1) * np.ones((n_targets, 1), int)

    def bodies(self, inertia):
        """The targets' surfaces with other inertia."""
        return self.surfaces._replace(inertia=inertia)

    def _tumbling(self) -> Truth:
        truth = self.truth
        moved = [
            propagate_rotation(q[0], w, self.loop.elapsed_s, self.inertia)
            for q, w in zip(truth.quaternion, truth.angular_velocity[:, 0], strict=True)
        ]
        quaternion, rate = (np.array(each) for each in zip(*moved, strict=True))
        return truth._replace(quaternion=quaternion, angular_velocity=rate)

    def bound(
        self, observer=None, sigma=None, surfaces=None, noise=BRIGHT.noise, ends=None, **changes
    ):
        """Bound of one observer, or none, for each target and step; in intervals up to `ends`."""
        observations = used_by(self.observer if observer is None else observer, noise)
        bound = CramerRaoBound(
            self.scene,
            self.surfaces if surfaces is None else surfaces,
            self.sigma if sigma is None else sigma,
            **changes,
        )
        return self.carried(bound, observations, ends)

    def carried(self, bound, observations, ends=None):
        """The bound worked through in intervals that end with these steps."""
        truth, parts, start = self.truth, [], 0
        for end in (observations.offset.shape[1] - 1,) if ends is None else ends:
            some = slice(start, end + 1)
            motion = truth.translation, truth.quaternion, truth.angular_velocity
            states = [each[:, some] for each in motion]
            parts.append(bound.advance(*states, during(observations, start, end)))
            start = end
        return np.concatenate(parts, axis=1)


def used_by(observer, noise=BRIGHT.noise):
    """Records of one observer, or none (-1), for each target and step."""
    target, step = np.nonzero(np.asarray(observer) >= 0)
    observations = schedule(target, step, observer[target, step], *observer.shape)
    variance = np.sign(noise) * np.asarray(noise) ** 2
    return Measurements(
        *observations, np.empty((target.size, 3)), np.tile(variance, (target.size, 1))
    )
