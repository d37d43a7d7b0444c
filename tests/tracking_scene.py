"""A small tracking problem: a few observers and targets over a day, without any file."""

import numpy as np

from cislunar.constants import TIME_UNIT_S
from cislunar.observation.scene import make_scene, target_surfaces
from cislunar.photometry.materials import Material
from cislunar.photometry.shapes import icosahedron
from cislunar.tasking.settings import LoopSettings
from cislunar.tasking.simulation import epoch_states

# Near-periodic orbits: two distant retrograde, two L2 halos, one L1 halo; (x, z, vy, period).
ORBITS = np.array(
    [
        [0.920026, 0.0, 0.501040, 0.898841],
        [0.817843, 0.0, 0.505839, 2.962608],
        [1.145831, 0.154015, -0.220793, 3.159410],
        [1.125424, -0.181700, -0.225458, 2.960571],
        [0.847229, 0.171882, 0.263971, 2.598230],
    ]
)


def sun_track(elapsed_s):
    """Sun in the ecliptic, taken as the plane of the primaries, at 389 units."""
    sidereal_year_s = 365.256 * 86_400.0
    angle = 2.0 * np.pi * elapsed_s / sidereal_year_s - elapsed_s / TIME_UNIT_S + 3.0
    zeros = np.zeros_like(angle)
    return 389.0 * np.stack([np.cos(angle), np.sin(angle), zeros], axis=-1)


def observer_tracks(n_observers, elapsed_s):
    """Observers that drift about the far sides of the Moon and of the Earth."""
    number = np.arange(n_observers)[:, None]
    phase = 2.4 * number + elapsed_s / TIME_UNIT_S
    center = np.where(number % 2 == 0, 1.15, -0.85)
    return np.stack(
        [
            center + 0.05 * np.cos(phase),
            0.3 * np.sin(phase),
            0.25 * np.cos(phase + number),
        ],
        axis=-1,
    )


def make_problem(n_observers=4, n_targets=5, **settings):
    """Scene, surfaces, epoch states, identities and settings of a run."""
    loop = LoopSettings(**settings)
    elapsed = loop.elapsed_s
    scene = make_scene(observer_tracks(n_observers, elapsed), sun_track(elapsed), loop.step_s)
    rows = ORBITS[np.arange(n_targets) % len(ORBITS)]
    states = np.zeros((n_targets, 6))
    states[:, 0], states[:, 2], states[:, 4] = rows[:, 0], rows[:, 1], rows[:, 2]
    epoch = epoch_states(states, rows[:, 3], seed=1)
    surfaces = target_surfaces(icosahedron(), Material(), n_targets)
    return scene, surfaces, epoch, np.arange(n_targets), loop
