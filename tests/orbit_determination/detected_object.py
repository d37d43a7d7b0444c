"""Simulated detections of one object by two observers in the CR3BP."""

import numpy as np
from nights import HOUR, SIGMA

from cislunar.dynamics import propagate
from cislunar.orbit_determination import make_angles

HALO = np.array([1.125424, 0.0, -0.181700, 0.0, -0.225458, 0.0])
RETROGRADE = np.array([0.920026, 0.0, 0.0, 0.0, 0.501040, 0.0])
OBSERVERS = np.array([[0.92, 0.0, 0.0, 0.0, 0.501, 0.0], [0.85, 0.1, 0.17, 0.0, 0.26, 0.0]])


def paths(states, times, owners):
    return np.array(
        [
            propagate(states[k], [t], method="dop853")[0, :3]
            for k, t in zip(owners, times, strict=True)
        ]
    )


def observed(state, hours, owners, rng, *, visits=(0.0, 10.0), sigma=SIGMA, **given):
    """Tracklets of an object at some hours by observers."""
    times = (np.asarray(hours)[:, None] + np.asarray(visits) / 60.0).ravel() * HOUR
    owners = np.repeat(owners, len(visits))
    place = paths(OBSERVERS, times, owners)
    way = propagate(state, times, method="dop853")[:, :3] - place
    unit = way / np.linalg.norm(way, axis=1, keepdims=True)
    return make_angles(
        times, owners, place, unit + sigma * rng.normal(size=unit.shape), sigma, **given
    )


def turned(vector, angle):
    c, s = np.cos(angle), np.sin(angle)
    x, y, z = np.moveaxis(np.asarray(vector), -1, 0)
    return np.stack([c * x - s * y, s * x + c * y, z], axis=-1)
