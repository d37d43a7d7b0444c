"""The paper's filter for one target on filterpy's unscented Kalman filter: slow and literal."""

import filterpy.kalman
import numpy as np
import scipy.linalg
import scipy.special
from oracles.rigid_rotation import propagate_rotation

from cislunar.attitude import grp
from cislunar.attitude.quaternion import compose, inverse
from cislunar.constants import LENGTH_UNIT_KM
from cislunar.dynamics.propagation import propagate
from cislunar.photometry.facets import facet_magnitude


def wrap(angle):
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


class ReferenceFilter:
    """Error-state multiplicative UKF with the mean attitude error carried to the update.

    The first states may be body parameters with the standard deviations `parameters`: logarithms of
    the moments of inertia about y and z, of albedo and slope, and logit of the reflectance.
    """

    def __init__(
        self, scene, facets, material, noise, initial, process_variance, j=0, inertia=1.0,
        parameters=(),
    ):  # fmt: skip
        self.inertia, self.first = inertia, len(parameters)
        n = 12 + self.first
        self.scene, self.facets, self.material = scene, facets, material.as_array()
        points = filterpy.kalman.MerweScaledSigmaPoints(n, alpha=0.5, beta=2.0, kappa=3.0 - n)
        self.ukf = filterpy.kalman.UnscentedKalmanFilter(
            n, 3, scene.step_s, self.measure, self.move, points, residual_z=self.residual
        )
        self.quaternion = initial.quaternion[j]
        motion = np.zeros(3), initial.angular_velocity[j], initial.translation[j]
        self.ukf.x = np.concatenate([np.zeros(self.first), *motion])
        full = initial.covariance
        own = np.diag(initial.sigma**2) if full is None else full[j].copy()
        self.ukf.P = scipy.linalg.block_diag(np.diag(np.square(parameters)), own)[-n:, -n:]
        self.ukf.Q = np.diag(np.r_[np.zeros(self.first), process_variance])
        self.ukf.R = np.diag(noise**2)
        self.k, self.observer = 0, 0

    @staticmethod
    def residual(a, b):
        difference = np.subtract(a, b)
        difference[1] = wrap(difference[1])
        return difference

    def move(self, x, dt):
        """Attitude error relative to the propagated mean, and the other states, after a step."""
        body, x = x[: self.first], x[self.first :]
        turn, rate = self.turn(x[3:6], dt, body)
        mean_turn, _ = self.turn(self.mean_rate, dt, self.mean_body)
        error = compose(compose(turn, grp.to_quaternion(x[:3])), inverse(mean_turn))
        moved = propagate(x[6:], [self.scene.step], method="dop853")[0]
        return np.r_[body, grp.from_quaternion(error), rate, moved]

    def turn(self, rate, dt, body):
        """Turn and rate after a step, from the identity attitude."""
        inertia = self.inertia * np.exp([0.0, *body[:2]]) if self.first else self.inertia
        turns, rates = propagate_rotation([0, 0, 0, 1], rate, [dt], inertia)
        return turns[0], rates[0]

    def surface(self, body):
        """Material with the deviations of a sigma point."""
        d, s, albedo, slope, reflectance = self.material
        if self.first:
            albedo, slope = albedo * np.exp(body[2]), slope * np.exp(body[3])
            reflectance = scipy.special.expit(scipy.special.logit(reflectance) + body[4])
        return np.array([d, s, albedo, slope, reflectance])

    def measure(self, x):
        k, scene = self.k, self.scene
        material, x = self.surface(x[: self.first]), x[self.first :]
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
            material,
            False,
            True,
        )
        return np.array([magnitude, np.arctan2(body[1], body[0]), np.arcsin(body[2] / distance)])

    def predict(self):
        self.k += 1
        p = self.first
        self.mean_body, self.mean_rate = self.ukf.x[:p].copy(), self.ukf.x[p + 3 : p + 6].copy()
        self.ukf.predict()
        turn, _ = self.turn(self.mean_rate, self.scene.step_s, self.mean_body)
        self.quaternion = compose(turn, self.quaternion)

    def update(self, measured, observer):
        self.observer = observer
        self.ukf.update(measured)

    def reset(self):
        """Inject the mean attitude error into the quaternion."""
        error = self.ukf.x[self.first : self.first + 3]
        self.quaternion = compose(grp.to_quaternion(error), self.quaternion)
        error[:] = 0.0
