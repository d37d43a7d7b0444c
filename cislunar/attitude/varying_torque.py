"""Rotation of rigid bodies under torques that vary: of sunlight, and at random.

Sunlight of pressure P exerts on a facet of area A, with N.L > 0, the force (Milani, Nobili &
Farinella 1987, section 5; Vallado, Fundamentals of Astrodynamics, section 8.6.4)

    F = -P A (N.L) ((1 - rho_s) L + 2 (rho_s N.L + rho_d / 3) N),

with rho_s and rho_d the specular and the diffuse share of the reflected light. The forces of all
facets act at one point, the center of pressure c, and T = c x sum F. Shadows of facets on each
other, and eclipses, are omitted.

The random torque is an Ornstein-Uhlenbeck process (Uhlenbeck & Ornstein 1930) about each body axis,
held constant within a step h: ``x' = e^(-h/tau) x + sigma sqrt(1 - e^(-2 h/tau)) n`` with n normal.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.attitude.quaternion import rotate_components
from cislunar.attitude.rigid_body import matrix_times, propagate_kernel
from cislunar.compiled import njit
from cislunar.dynamics.radiation import SOLAR_PRESSURE_N_M2
from cislunar.runtime import Array

_TURN_PER_STEP = 0.02
"""Largest rotation angle of a step within which the torque of sunlight is constant, rad."""


class SunPressure(NamedTuple):
    """Facets of many bodies on which sunlight exerts a torque, in the layout of the kernels.

    Attributes
    ----------
    first : ndarray of int, shape (body + 1,)
        Body j owns the facets ``first[j] : first[j + 1]``.
    areas, normals : ndarray, shapes (facet,) and (facet, 3)
        Areas, m^2, and outward unit normals, body frame.
    diffuse, specular : ndarray, shape (facet,)
        rho_d and rho_s.
    center : ndarray, shape (body, 3)
        Center of pressure relative to the center of mass, body frame, m.
    inverse : ndarray, shape (body, 3, 3)
        Inverse of the inertia, 1 / (kg m^2).
    """

    first: NDArray[np.int64]
    areas: Array
    normals: Array
    diffuse: Array
    specular: Array
    center: Array
    inverse: Array


@njit(cache=True, error_model="numpy")
def sunlight_acceleration(quaternion, sun, j, pressure):
    """Angular acceleration of body j by sunlight, rad/s^2, body frame, as three scalars (compiled).
    `quaternion` (4,) is its attitude, inertial to body, `sun` (3,) the unit vector to the Sun,
    inertial frame."""
    q = quaternion
    lx, ly, lz = rotate_components(q[0], q[1], q[2], q[3], sun[0], sun[1], sun[2])
    fx, fy, fz = 0.0, 0.0, 0.0
    for i in range(pressure.first[j], pressure.first[j + 1]):
        n = pressure.normals[i]
        lit = n[0] * lx + n[1] * ly + n[2] * lz
        if lit <= 0.0:
            continue
        force = SOLAR_PRESSURE_N_M2 * pressure.areas[i] * lit
        along = force * (1.0 - pressure.specular[i])
        back = 2.0 * force * (pressure.specular[i] * lit + pressure.diffuse[i] / 3.0)
        fx -= along * lx + back * n[0]
        fy -= along * ly + back * n[1]
        fz -= along * lz + back * n[2]
    c = pressure.center[j]
    return matrix_times(
        pressure.inverse[j], c[1] * fz - c[2] * fy, c[2] * fx - c[0] * fz, c[0] * fy - c[1] * fx
    )


@njit(cache=True, error_model="numpy")
def propagate_varying(
    elapsed_s, bodies, forced, sun, pressure, tolerance, attitude, rate, quaternion, omega
):
    """As `cislunar.attitude.rigid_body.propagate_attitudes`, under a torque that varies (compiled).

    `forced` (body, step, 3) is the angular acceleration by other torques, constant within each
    step; `sun` (body, time, 3) has the unit vectors to the Sun. `attitude` (body, 4) and `rate`
    (body, 3) at the first time are overwritten by those at the last. The torque of sunlight is
    evaluated in the middle of each step, or of parts of it in which the body turns by at most 0.02
    rad; the Sun is where it is at the beginning of the step."""
    middle, spin = np.empty(4), np.empty(3)
    for j in range(attitude.shape[0]):
        q, w = attitude[j], rate[j]
        quaternion[j, 0], omega[j, 0] = q, w
        body = bodies.inertia[j], bodies.inverse[j]
        for i in range(forced.shape[1]):
            h, a = elapsed_s[i + 1] - elapsed_s[i], forced[j, i]
            speed = np.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
            count = max(1, int(np.ceil(speed * h / _TURN_PER_STEP)))
            h /= count
            for _ in range(count):
                x, y, z = sunlight_acceleration(q, sun[j, i], j, pressure)
                x, y, z = a[0] + x, a[1] + y, a[2] + z
                propagate_kernel(q, w, *body, 0.5 * h, tolerance, middle, spin, x, y, z)
                x, y, z = sunlight_acceleration(middle, sun[j, i], j, pressure)
                x, y, z = a[0] + x, a[1] + y, a[2] + z
                propagate_kernel(q, w, *body, h, tolerance, q, w, x, y, z)
            quaternion[j, i + 1], omega[j, i + 1] = q, w


class RandomTorque:
    """Angular acceleration of bodies by a random torque, from step to step.

    Parameters
    ----------
    sigma : float
        Standard deviation about each body axis, rad/s^2.
    steps : float
        Correlation time in steps.
    generators : sequence of numpy.random.Generator, length body
    """

    def __init__(
        self, sigma: float, steps: float, generators: Sequence[np.random.Generator]
    ) -> None:
        self._sigma, self._decay, self._generators = sigma, float(np.exp(-1.0 / steps)), generators
        self._last = sigma * np.array([each.standard_normal(3) for each in generators])

    def next(self, n_steps: int) -> Array:
        """The next steps, shape (body, n_steps, 3), rad/s^2."""
        found = np.empty((len(self._generators), n_steps, 3))
        spread = self._sigma * np.sqrt(1.0 - self._decay**2)
        draws = np.array([each.standard_normal((n_steps, 3)) for each in self._generators])
        for i in range(n_steps):
            found[:, i] = self._last
            self._last = self._decay * self._last + spread * draws[:, i]
        return found
