"""Other force models in the same integrators: Kepler motion and a force that grows with time."""

import subprocess
import sys
from typing import NamedTuple

import numpy as np
import pytest
from numba.core.caching import NullCache
from numba.core.dispatcher import Dispatcher

from cislunar.compiled import implements
from cislunar.dynamics import bundle, forces
from cislunar.dynamics.adaptive import lanes, runge_kutta
from cislunar.dynamics.bundle import propagate_bundle
from cislunar.dynamics.propagation import propagate, propagate_many, propagate_stm


class Model(NamedTuple):
    """One attracting center in inertial axes, and an acceleration coefficient t^power along y."""

    gm: float
    coefficient: float = 0.0
    power: float = 0.0


class Field(NamedTuple):
    gm: float
    push: float


class Gradient(NamedTuple):
    along: float
    across: float
    x: float
    y: float
    z: float


@implements(forces.at, Model)
def _field_at(forces, t):
    return Field(forces.gm, forces.coefficient * t**forces.power)


@implements(forces.acceleration, Field)
def _acceleration(field, x, y, z, vx, vy, vz):
    r2 = x * x + y * y + z * z
    pull = -field.gm / (r2 * np.sqrt(r2))
    return pull * x, pull * y + field.push, pull * z


@implements(forces.partials, Field)
def _partials(field, x, y, z, vx, vy, vz):
    r2 = x * x + y * y + z * z
    across = -field.gm / (r2 * np.sqrt(r2))
    return Gradient(-3.0 * across / r2, across, x, y, z)


@implements(forces.acceleration_change, Gradient)
def _change(g, dx, dy, dz, dvx, dvy, dvz):
    radial = g.along * (g.x * dx + g.y * dy + g.z * dz)
    return g.across * dx + radial * g.x, g.across * dy + radial * g.y, g.across * dz + radial * g.z


@pytest.fixture(autouse=True)
def _nothing_cached(monkeypatch):
    """Do not cache kernels of these models, which no other process can import."""
    for module in (bundle, lanes, runge_kutta):
        for kernel in vars(module).values():
            if isinstance(kernel, Dispatcher):
                monkeypatch.setattr(kernel, "_cache", NullCache())


KEPLER = Model(1.7)
START = np.array([1.2, -0.3, 0.4, 0.2, 0.9, -0.5])


def kepler(state, t, gm=KEPLER.gm):
    """Position and velocity after a time, by Kepler's equation and Lagrange's coefficients."""
    r0, v0 = state[:3], state[3:]
    distance = np.linalg.norm(r0)
    a = 1.0 / (2.0 / distance - v0 @ v0 / gm)
    n = np.sqrt(gm / a**3)
    cosine, sine = 1.0 - distance / a, r0 @ v0 / np.sqrt(gm * a)  # e cos E0, e sin E0
    change = n * t
    for _ in range(50):
        residual = change - cosine * np.sin(change) + sine * (1.0 - np.cos(change)) - n * t
        change -= residual / (1.0 - cosine * np.cos(change) + sine * np.sin(change))
    f = 1.0 - a / distance * (1.0 - np.cos(change))
    g = t - (change - np.sin(change)) / n
    position = f * r0 + g * v0
    r = np.linalg.norm(position)
    f_dot = -np.sqrt(gm * a) * np.sin(change) / (r * distance)
    g_dot = 1.0 - a / r * (1.0 - np.cos(change))
    return np.concatenate([position, f_dot * r0 + g_dot * v0])


@pytest.mark.parametrize(("method", "tolerance"), [("dopri5", 1e-7), ("dop853", 1e-11)])
def test_kepler_motion_by_the_adaptive_integrator(method, tolerance):
    times = np.linspace(-4.0, 9.0, 27)
    expected = np.array([kepler(START, t) for t in times])
    found = propagate(START, times, forces=KEPLER, method=method)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=tolerance)


def test_kepler_motion_by_fixed_steps():
    others = START + 0.05 * np.arange(5)[:, None] * np.array([1, 0, -1, 0, 1, 1])
    tracks = propagate_bundle(others, 0.01, 300, forces=KEPLER)
    for track, start in zip(tracks, others, strict=True):
        np.testing.assert_allclose(track[-1], kepler(start, 3.0), rtol=0.0, atol=1e-12)


def test_variational_equations_of_kepler_motion():
    """The transition matrix against differences of the closed form."""
    for duration in (2.5, 0.02):
        expected = np.empty((6, 6))
        for k in range(6):
            offset = np.zeros(6)
            offset[k] = 1e-6
            ahead, behind = kepler(START + offset, duration), kepler(START - offset, duration)
            expected[:, k] = (ahead - behind) / 2e-6
        end, stm = propagate_stm(START, duration, forces=KEPLER)
        np.testing.assert_allclose(end, kepler(START, duration), rtol=0.0, atol=1e-11)
        np.testing.assert_allclose(stm, expected, rtol=0.0, atol=2e-8)


@pytest.mark.parametrize("power", range(7))
def test_time_reaches_every_stage(power):
    """A force t^p is integrated exactly up to the order, if all nodes and the start are right."""
    push, start, step = Model(0.0, 3.0, float(power)), 0.4, 0.5

    def moved(t):
        """Position and velocity along y at a time after the start, from START."""
        c, p, end = push.coefficient, power + 1, start + t
        velocity = START[4] + c * (end**p - start**p) / p
        return START[1] + t * START[4] + c * (
            (end ** (p + 1) - start ** (p + 1)) / (p * (p + 1)) - t * start**p / p
        ), velocity

    expected = moved(step)
    track = propagate_bundle(START[None], step / 2, 2, forces=push, start=start)[0, -1]
    np.testing.assert_allclose(track[[1, 4]], expected, rtol=0.0, atol=1e-14)
    times = np.array([step, 0.2, -0.3])
    for method, tolerance in (("dopri5", 1e-9), ("dop853", 1e-12)):
        found = propagate(START, times, forces=push, start=start, method=method)
        wanted = np.array([moved(t) for t in times])
        np.testing.assert_allclose(found[:, [1, 4]], wanted, rtol=0.0, atol=tolerance)


def test_start_times_may_differ_between_states():
    push, times, starts = Model(0.0, 3.0, 2.0), np.array([0.5, 0.2, -0.3]), np.array([0.4, 1.3])
    many = propagate_many([START, -START], times, forces=push, start=starts)
    for state, start, found in zip((START, -START), starts, many, strict=True):
        alone = propagate(state, times, forces=push, start=start)
        np.testing.assert_array_equal(found, alone)


def test_kernels_specialized_for_a_model_are_cached_on_disk():
    """A second process compiles nothing."""
    script = """
import numpy as np
from cislunar.dynamics.cr3bp import CR3BP
from cislunar.dynamics.propagation import propagate
from cislunar.dynamics.adaptive.runge_kutta import integrate
propagate([0.5, 0.1, 0.2, 0.0, 0.3, 0.0], [0.01], forces=CR3BP(0.01))
print(sum(integrate.stats.cache_misses.values()))
"""
    runs = [
        subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
        for _ in range(2)
    ]
    assert runs[1].stdout.strip() == "0"
