"""Torques that vary: of sunlight against closed forms and SciPy, and at random."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from cislunar.attitude.inertia import rigid_bodies
from cislunar.attitude.quaternion import attitude_matrix
from cislunar.attitude.varying_torque import (
    RandomTorque,
    SunPressure,
    propagate_varying,
    sunlight_acceleration,
)
from cislunar.dynamics.radiation import SOLAR_PRESSURE_N_M2
from cislunar.photometry.shapes import icosahedron, icosphere

IDENTITY = np.array([0.0, 0.0, 0.0, 1.0])
DEG_H = np.pi / 180.0 / 3600.0


def pressure_on(facets, diffuse, specular, center, inverse):
    """One body of one surface."""
    count = facets.areas.size
    return SunPressure(
        np.array([0, count]), facets.areas, facets.normals, np.full(count, diffuse),
        np.full(count, specular), np.array([center]), np.array([inverse]),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("diffuse", "specular", "factor"),
    [
        (0.0, 0.0, 1.0),
        (0.6, 0.0, 1.0 + 0.6 * 4.0 / 9.0),
        (0.0, 0.7, 1.0),
        (0.2, 0.5, 1.0 + 0.8 / 9.0),
    ],
)
def test_the_force_on_a_sphere(diffuse, specular, factor):
    """A sphere absorbs and mirrors alike, and a Lambertian one has C_R = 1 + 4/9 rho_d."""
    center, sun = np.array([0.3, -0.2, 0.5]), np.array([0.48, 0.6, 0.64])
    pressure = pressure_on(icosphere(5, 1.5), diffuse, specular, center, np.eye(3))
    force = -SOLAR_PRESSURE_N_M2 * np.pi * 1.5**2 * factor * sun
    found = sunlight_acceleration(IDENTITY, sun, 0, pressure)
    np.testing.assert_allclose(found, np.cross(center, force), rtol=2e-3)


def test_motion_under_sunlight_against_scipy():
    """Held constant within 0.02 rad, the torque leaves an error far below its own effect."""
    facets, inertia = icosahedron(), np.diag([80.0, 100.0, 120.0])
    center, sun = np.array([0.002, -0.001, 0.0015]), np.array([0.6, 0.0, 0.8])
    pressure = pressure_on(facets, 0.25, 0.5, center, np.linalg.inv(inertia))
    start, rate = IDENTITY.copy(), np.array([-44.7, -6.7, -8.5]) * DEG_H
    elapsed = np.arange(0.0, 6.0 * 3600.0 + 1.0, 60.0)
    steps = elapsed.size - 1

    def slope(_, y):
        attitude, omega = y[:9].reshape(3, 3), y[9:]  # inertial to body: C' = -omega x C
        light = attitude @ sun
        push = -SOLAR_PRESSURE_N_M2 * facets.areas * np.maximum(facets.normals @ light, 0.0)
        mirrored = 0.5 * facets.normals @ light + 0.25 / 3.0
        force = 0.5 * push.sum() * light + 2.0 * (push * mirrored) @ facets.normals
        torque = np.cross(center, force) - np.cross(omega, inertia @ omega)
        turning = -np.cross(omega, attitude, axisb=0, axisc=0)
        return np.concatenate([turning.ravel(), np.linalg.solve(inertia, torque)])

    given = {"t_eval": elapsed[::60], "rtol": 1e-11, "atol": 1e-13, "max_step": 60.0}
    y0 = np.concatenate([np.eye(3).ravel(), rate])
    exact = solve_ivp(slope, (0.0, elapsed[-1]), y0, **given).y.T

    def moved(pressure):
        q, w = np.empty((1, steps + 1, 4)), np.empty((1, steps + 1, 3))
        propagate_varying(
            elapsed, rigid_bodies(inertia[None]), np.zeros((1, steps, 3)),
            np.tile(sun, (1, steps + 1, 1)), pressure, 1e-13, start[None].copy(), rate[None].copy(),
            q, w,
        )  # fmt: skip
        matrices = np.array([attitude_matrix(each) for each in q[0, ::60]])
        return Rotation.from_matrix(matrices), w[0, ::60]

    with_torque, omega = moved(pressure)
    without, _ = moved(pressure._replace(center=np.zeros((1, 3))))
    effect = (with_torque.inv() * without).magnitude()[-1]
    error = (
        (with_torque.inv() * Rotation.from_matrix(exact[:, :9].reshape(-1, 3, 3))).magnitude().max()
    )
    assert effect > np.radians(0.5)
    assert error < 1e-4 * effect
    np.testing.assert_allclose(omega, exact[:, 9:], atol=1e-4 * abs(exact[-1, 9:] - rate).max())


def test_the_random_torque_has_its_variance_and_correlation():
    streams = [np.random.default_rng(seed) for seed in range(300)]
    torque = RandomTorque(2.0, 20.0, streams)
    found = np.concatenate([torque.next(n) for n in (50, 1, 149)], axis=1)
    assert found.shape == (300, 200, 3)
    # 300 x 3 processes of about 200 / 40 independent values each
    assert found.std() == pytest.approx(2.0, rel=0.05)
    lagged = np.mean(found[:, 20:] * found[:, :-20]) / np.mean(found**2)
    assert lagged == pytest.approx(np.exp(-1.0), abs=0.05)
    again = RandomTorque(2.0, 20.0, [np.random.default_rng(seed) for seed in range(300)])
    np.testing.assert_array_equal(again.next(200), found)
