"""Prior densities of undetected objects, as samples of states.

A sample is drawn from one of four sources, with shares that are settings: periodic orbits at random
phases; points within zero-velocity surfaces, at rest in the rotating frame, and propagated for a
random time; states of a table of the user; and states that are uniform over the phase-space volume
of the admissible region (`cislunar.orbit_determination.admissible_region`). The uniform share
covers objects that no other source resembles.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cislunar.constants import SECONDS_PER_DAY, TIME_UNIT_S
from cislunar.dynamics import (
    EARTH_MOON,
    EphemerisForces,
    inertial_states,
    propagate_bundle,
    propagate_many,
    pseudo_potential,
)
from cislunar.errors import ConfigurationError
from cislunar.orbit_determination import AdmissibleRegion, is_admissible
from cislunar.runtime.arguments import Array, array_of
from cislunar.survey.settings import SOURCES, DensityPrior

_STEP_S = 600.0
"""Step with which samples at rest are propagated."""

_ROUNDS = 20
"""Attempts to replace samples that leave the admissible region."""


class PriorSources(NamedTuple):
    """What samples are drawn from; None for what is not at hand. All in the rotating frame,
    nondimensional.

    Attributes
    ----------
    orbits : ndarray, shape (orbit, 6), or None
        A state of each periodic orbit.
    periods : ndarray, shape (orbit,), or None
    points : ndarray, shape (point, 3), or None
        Within zero-velocity surfaces.
    table : ndarray, shape (state, 6), or None
        States at the start of the run.
    """

    orbits: Array | None = None
    periods: Array | None = None
    points: Array | None = None
    table: Array | None = None


def sample_prior(
    prior: DensityPrior,
    sources: PriorSources,
    rng: np.random.Generator,
    *,
    region: AdmissibleRegion | None = None,
) -> tuple[Array, Array]:
    """Sample states and sizes of undetected objects.

    Parameters
    ----------
    prior : DensityPrior
    sources : PriorSources
    rng : numpy.random.Generator
    region : AdmissibleRegion, optional

    Returns
    -------
    state : ndarray, shape (particle, 6)
        Nondimensional, rotating frame.
    size_m2 : ndarray, shape (particle,)
        Diffuse reflection coefficient times squared radius.

    Raises
    ------
    ConfigurationError
        If a source with a share is not at hand, or gives no state within the admissible region.
    """
    region = AdmissibleRegion() if region is None else region
    shares = list(prior.shares.values())
    ends = np.rint(np.cumsum(shares) * prior.particles).astype(int)
    counts = dict(zip(SOURCES, np.diff(ends, prepend=0).tolist(), strict=True))
    draws = {
        "families": (lambda n: _of_orbits(sources, n, rng), sources.orbits),
        "zero_velocity": (lambda n: _at_rest(sources.points, prior, n, rng), sources.points),
        "table": (lambda n: _chosen(sources.table, n, rng), sources.table),
        "uniform": (lambda n: _uniform(region, n, rng), ()),
    }
    parts = []
    for name, count in counts.items():
        draw, given = draws[name]
        if count == 0:
            continue
        if given is None:
            raise ConfigurationError(
                f"prior.{name} = {getattr(prior, name)} needs states to draw from, and none are "
                "given; give them or set the share to 0"
            )
        parts.append(_within_region(name, draw, count, region))
    state = np.concatenate(parts)
    sigma = 0.4 * np.log(10.0) * prior.size_sigma_mag
    size = prior.median_size_m2 * np.exp(sigma * rng.standard_normal(len(state)))
    return state, size


def _within_region(name, draw, count, region) -> Array:
    """States (count, 6) of a source, drawn until enough are admissible."""
    found = np.empty((0, 6))
    for _ in range(_ROUNDS):
        more = draw(count - len(found))
        more = more[np.all(np.isfinite(more), axis=1)]
        found = np.concatenate([found, more[is_admissible(more, 0.0, EARTH_MOON, region)]])
        if len(found) == count:
            return found
    if len(found) == 0:
        raise ConfigurationError(
            f"prior.{name} gives no state within the admissible region; widen the region or set "
            "the share to 0"
        )
    return found[np.arange(count) % len(found)]


def _of_orbits(sources: PriorSources, count: int, rng) -> Array:
    states = array_of("orbits", sources.orbits, ("orbit", 6))
    which = rng.integers(len(states), size=count)
    times = (rng.random(count) - 0.5) * array_of("periods", sources.periods)[which]
    return propagate_many(states[which], times[:, None], method="dop853")[:, 0]


def _at_rest(points: Array, prior: DensityPrior, count: int, rng) -> Array:
    given = array_of("points", points, ("point", 3))
    state = np.zeros((count, 6))
    state[:, :3] = given[rng.integers(len(given), size=count)]
    a_day = round(SECONDS_PER_DAY / _STEP_S)
    steps = rng.integers(max(1, round(prior.drift_days * a_day)), size=count)
    out = np.empty((count, 6))
    for day in range(int(steps.max(initial=0)) // a_day + 1):
        path = propagate_bundle(state, _STEP_S / TIME_UNIT_S, a_day)
        here = steps // a_day == day
        out[here] = path[here, steps[here] % a_day]
        state = path[:, -1]
    return out


def _chosen(table: Array, count: int, rng) -> Array:
    states = array_of("table", table, ("state", 6))
    return states[rng.integers(len(states), size=count)]


def _uniform(region: AdmissibleRegion, count: int, rng) -> Array:
    """Positions in proportion to the volume of velocities, v^2 <= 2 U - C, and velocities that are
    uniform in it."""
    trials = 50 * count
    position = region.radius * _in_ball(trials, rng)
    fastest2 = np.maximum(2.0 * pseudo_potential(position) - region.least_jacobi, 0.0)
    volume = fastest2**1.5
    if not volume.any():
        return np.empty((0, 6))
    # positions may repeat, since those near a body have much of the volume; velocities do not
    chosen = rng.choice(trials, size=count, p=volume / volume.sum())
    velocity = np.sqrt(fastest2[chosen])[:, None] * _in_ball(count, rng)
    return np.concatenate([position[chosen], velocity], axis=1)


def _in_ball(count: int, rng) -> Array:
    """Points that are uniform in the unit ball, (count, 3)."""
    way = rng.standard_normal((count, 3))
    way /= np.linalg.norm(way, axis=1)[:, None]
    return way * np.cbrt(rng.random(count))[:, None]


def in_propagation_frame(state: ArrayLike, forces: tuple = EARTH_MOON) -> Array:
    """States of the rotating frame at the start of a run in its propagation frame.

    Parameters
    ----------
    state : array_like, shape (n, 6)
        Nondimensional, rotating frame.
    forces : NamedTuple
        CR3BP or ephemeris forces.

    Returns
    -------
    ndarray, shape (n, 6)
        Nondimensional.
    """
    states = np.asarray(state, dtype=float)
    if isinstance(forces, EphemerisForces):
        return inertial_states(states, forces.table, forces.epoch)[0]
    return states
