"""The paper's filter for one target on filterpy's unscented Kalman filter: slow and literal."""

import filterpy.kalman
import numpy as np

from cislunar.attitude import grp
from cislunar.attitude.quaternion import compose, inverse
from cislunar.attitude.rigid_body import propagate_torque_free
from cislunar.constants import LENGTH_UNIT_KM
from cislunar.dynamics.propagation import propagate
from cislunar.photometry.facets import facet_magnitude


def wrap(angle):
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


class ReferenceFilter:
    """Error-state multiplicative UKF with the mean attitude error carried to the update."""

    def __init__(self, scene, facets, material, noise, initial, process_variance, j=0, inertia=1.0):
        self.inertia = inertia
        self.scene, self.facets, self.material = scene, facets, material.as_array()
        points = filterpy.kalman.MerweScaledSigmaPoints(12, alpha=0.5, beta=2.0, kappa=-9.0)
        self.ukf = filterpy.kalman.UnscentedKalmanFilter(
            12, 3, scene.step_s, self.measure, self.move, points, residual_z=self.residual
        )
        self.quaternion = initial.quaternion[j]
        self.ukf.x = np.r_[np.zeros(3), initial.angular_velocity[j], initial.translation[j]]
        full = initial.covariance
        self.ukf.P = np.diag(initial.sigma**2) if full is None else full[j].copy()
        self.ukf.Q = np.diag(process_variance)
        self.ukf.R = np.diag(noise**2)
        self.k, self.observer = 0, 0

    @staticmethod
    def residual(a, b):
        difference = np.subtract(a, b)
        difference[1] = wrap(difference[1])
        return difference

    def move(self, x, dt):
        """Attitude error relative to the propagated mean, and the other states, after a step."""
        turn, rate = self.turn(x[3:6], dt)
        mean_turn, _ = self.turn(self.mean_rate, dt)
        error = compose(compose(turn, grp.to_quaternion(x[:3])), inverse(mean_turn))
        moved = propagate(x[6:], [self.scene.step], method="dop853")[0]
        return np.r_[grp.from_quaternion(error), rate, moved]

    def turn(self, rate, dt):
        """Turn and rate after a step, from the identity attitude."""
        turns, rates = propagate_torque_free([0, 0, 0, 1], rate, [dt], self.inertia)
        return turns[0], rates[0]

    def measure(self, x):
        k, scene = self.k, self.scene
        line = x[6:9] - scene.observer_position[self.observer, k]
        distance = np.linalg.norm(line)
        body = scene.observer_axes[k] @ line
        to_sun = scene.sun_position[k] - x[6:9]
        magnitude = facet_magnitude(
            compose(grp.to_quaternion(x[:3]), self.quaternion),
            scene.frame_axes[k] @ to_sun / np.linalg.norm(to_sun),
            -scene.frame_axes[k] @ line / distance,
            distance * LENGTH_UNIT_KM * 1000.0,
            self.facets.areas,
            self.facets.normals,
            self.material,
            False,
            True,
        )
        return np.array([magnitude, np.arctan2(body[1], body[0]), np.arcsin(body[2] / distance)])

    def predict(self):
        self.k += 1
        self.mean_rate = self.ukf.x[3:6].copy()
        self.ukf.predict()
        turn, _ = self.turn(self.mean_rate, self.scene.step_s)
        self.quaternion = compose(turn, self.quaternion)

    def update(self, measured, observer):
        self.observer = observer
        self.ukf.update(measured)

    def reset(self):
        """Inject the mean attitude error into the quaternion."""
        self.quaternion = compose(grp.to_quaternion(self.ukf.x[:3]), self.quaternion)
        self.ukf.x[:3] = 0.0
