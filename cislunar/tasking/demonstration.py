"""A tracking problem of any size that needs no file, for demonstrations and benchmarks."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.constants import TIME_UNIT_S
from cislunar.errors import ConfigurationError, did_you_mean
from cislunar.observation.scene import Scene, make_scene
from cislunar.observation.target_surfaces import TargetSurfaces, target_surfaces
from cislunar.photometry import Material, PhotometryModel, icosahedron
from cislunar.runtime import Array, count_of
from cislunar.tasking.initial_conditions import epoch_states
from cislunar.tasking.settings import LoopSettings

_ORBITS = np.array(
    [
        [0.920026, 0.0, 0.501040, 0.898841],
        [0.817843, 0.0, 0.505839, 2.962608],
        [1.145831, 0.154015, -0.220793, 3.159410],
        [1.125424, -0.181700, -0.225458, 2.960571],
        [0.847229, 0.171882, 0.263971, 2.598230],
    ]
)
"""Near-periodic orbits: two distant retrograde, two L2 halos, one L1 halo; (x, z, vy, period)."""


def _sun_track(elapsed_s: Array) -> Array:
    """Sun in the ecliptic, which is the plane of the primaries here, at 389 units."""
    sidereal_year_s = 365.256 * 86_400.0
    angle = 2.0 * np.pi * elapsed_s / sidereal_year_s - elapsed_s / TIME_UNIT_S + 3.0
    zeros = np.zeros_like(angle)
    return 389.0 * np.stack([np.cos(angle), np.sin(angle), zeros], axis=-1)


def _observer_tracks(n_observers: int, elapsed_s: Array) -> Array:
    """Observers that drift about the far sides of the Moon and of the Earth."""
    number = np.arange(n_observers)[:, None]
    phase = 2.4 * number + elapsed_s / TIME_UNIT_S
    center = np.where(number % 2 == 0, 1.15, -0.85)
    return np.stack(
        [center + 0.05 * np.cos(phase), 0.3 * np.sin(phase), 0.25 * np.cos(phase + number)], axis=-1
    )


class TrackingProblem(NamedTuple):
    """Inputs of a closed loop, in the order of its arguments.

    Attributes
    ----------
    scene : Scene
        Observers and Sun at every step.
    surfaces : TargetSurfaces
        Icosahedra of the default material.
    epoch : ndarray, shape (target, 6)
        States at the epoch, nondimensional, rotating frame.
    ids : ndarray of int, shape (target,)
        Identities of the targets.
    loop : LoopSettings
    """

    scene: Scene
    surfaces: TargetSurfaces
    epoch: Array
    ids: NDArray[np.int64]
    loop: LoopSettings


def tracking_problem(
    n_observers: int = 4, n_targets: int = 5, model: PhotometryModel | None = None, **settings: Any
) -> TrackingProblem:
    """Observers near the far sides of Earth and Moon, and targets on near-periodic orbits.

    Parameters
    ----------
    n_observers, n_targets : int
        Size of the problem. The targets take five orbits in turn, each at a phase of its own.
    model : PhotometryModel, optional
        See `cislunar.observation.target_surfaces.target_surfaces`.
    **settings
        Fields of `LoopSettings`.

    Returns
    -------
    TrackingProblem

    Raises
    ------
    ConfigurationError
        If a number is less than 1, the model is of another kind, or a setting is unknown or
        impossible.
    """
    n_observers, n_targets = count_of("n_observers", n_observers), count_of("n_targets", n_targets)
    for key in settings:
        if key not in LoopSettings.__dataclass_fields__:
            known = LoopSettings.__dataclass_fields__
            remedy = did_you_mean(key, known) or f"they are {', '.join(known)}"
            raise ConfigurationError(f"{key} is none of the LoopSettings: {remedy}")
    loop = LoopSettings(**settings)
    elapsed = loop.elapsed_s
    scene = make_scene(_observer_tracks(n_observers, elapsed), _sun_track(elapsed), loop.step_s)
    rows = _ORBITS[np.arange(n_targets) % len(_ORBITS)]
    states = np.zeros((n_targets, 6))
    states[:, 0], states[:, 2], states[:, 4] = rows[:, 0], rows[:, 1], rows[:, 2]
    epoch = epoch_states(states, rows[:, 3], seed=1)
    surfaces = target_surfaces(icosahedron(), Material(), n_targets, model)
    return TrackingProblem(scene, surfaces, epoch, np.arange(n_targets), loop)
