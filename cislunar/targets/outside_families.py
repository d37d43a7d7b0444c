"""Objects outside of families of periodic orbits: transfers, quasi-periodic and high Earth orbits.

A prior of unknown objects that contains the families of the true objects cannot show how well a
search or an initial orbit determination works for other objects. The objects of this module are on
no orbit of the families that a caller passes. All are generated in the CR3BP:

direct transfer
    An ellipse about the Earth from a low perigee, with its apogee near the Moon at arrival, some
    days after the perigee.
free return
    A circumlunar trajectory that passes the far side of the Moon at right angles to y = 0, and is
    therefore symmetric to that plane, with a low perigee before and after (Miele 1960, J.
    Astronaut. Sci. 7, 33).
low-energy transfer
    A state on the stable or unstable manifold of an unstable periodic orbit, days away from it
    (Koon, Lo, Marsden & Ross 2011, Dynamical Systems, the Three-Body Problem and Space Mission
    Design).
quasi-periodic
    A periodic orbit, displaced by thousands of km along a center direction of its monodromy matrix,
    which to first order is a motion on a torus about the orbit (Gomez & Mondelo 2001, Physica D
    157, 283).
disposal
    A periodic orbit that was left by a maneuver some days ago (Davis, Phillips & McCarthy 2018,
    Trajectory Design for the Gateway, gives 10 m/s to 50 m/s for halo orbits).
resonant
    An inclined ellipse about the Earth with a period in resonance with that of the Moon.
high Earth
    An inclined ellipse about the Earth between the geosynchronous and the lunar distance.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from cislunar.constants import (
    EARTH_RADIUS_KM,
    LENGTH_UNIT_KM,
    MOON_RADIUS_KM,
    MU,
    SECONDS_PER_DAY,
    TIME_UNIT_S,
)
from cislunar.dynamics import (
    UNITS,
    EphemerisForces,
    closest_approaches,
    propagate,
    propagate_stm,
    pulsating_frame,
    to_inertial,
)
from cislunar.ephemeris.bodies import BODY_COLUMNS, read_table
from cislunar.errors import ConfigurationError, ConvergenceError
from cislunar.runtime import Array, array_of, count_of, number_of
from cislunar.targets.tables import TargetStates

_DAY = SECONDS_PER_DAY / TIME_UNIT_S
_KM = 1.0 / LENGTH_UNIT_KM
_M_S = 1e-3 * TIME_UNIT_S / LENGTH_UNIT_KM
_MOON = np.array([1.0 - MU, 0.0, 0.0])

LEAST_ALTITUDE_KM = 100.0
"""Altitude above Earth and Moon below which an object counts as impacting."""

LARGEST_DISTANCE_KM = 700_000.0
"""Distance from the barycenter that no object exceeds."""

OFFSET_KM, OFFSET_M_S = 1000.0, 20.0
"""An object differs from every state of the given orbits by more than one of these, in some
component of position or velocity."""

_PHASES = 400
"""States of a given orbit with which objects are compared."""

_SAMPLES_PER_DAY = 720
"""Times at which the altitude in ephemeris dynamics is checked. An object moves by up to 1300 km in
two minutes near the Earth, so that its least altitude is up to 35 km below the least sampled one.
"""

_QUASI_PERIODIC_RATIO, _QUASI_PERIODIC_DAYS = 2.0, 7.0
"""Largest distance of a quasi-periodic object from its periodic orbit, relative to the displacement
at the epoch, during these days. The displacement along a center direction is not small, so that it
also has components along unstable directions."""

_MOST_DRAWS = 400
"""Draws for each object, after which the generation fails."""

_RESONANCES = ((2, 1), (5, 2), (7, 2), (4, 1), (5, 1), (3, 2), (8, 3))
"""Revolutions of the object, and of the Moon in the same time; without 3:1, a family of the moving
targets."""


class _PeriodicOrbits(NamedTuple):
    """States (orbit, 6) and periods (orbit,) of periodic orbits, nondimensional."""

    state: Array
    period: Array


def objects_outside_families(
    state: ArrayLike,
    period: ArrayLike,
    rng: np.random.Generator,
    *,
    count: int = 210,
    days: float = 7.0,
    forces: EphemerisForces | None = None,
) -> TargetStates:
    """Generate moving targets that are on none of the given periodic orbits.

    Parameters
    ----------
    state : array_like, shape (orbit, 6)
        A state of each orbit of the families, nondimensional, rotating frame, for instance those of
        `cislunar.orbits.tracked_targets`. Quasi-periodic orbits, disposal orbits and low-energy
        transfers begin at some of these orbits.
    period : array_like, shape (orbit,)
        Nondimensional.
    rng : numpy.random.Generator
        For all draws. Each kind has a stream of its own.
    count : int
        Number of objects; kinds are equally frequent.
    days : float
        Time after the epoch within which no object comes nearer than 100 km to the surface of the
        Earth or the Moon, or leaves a sphere of 700,000 km about the barycenter, in the CR3BP.
    forces : EphemerisForces, optional
        Ephemeris dynamics, from whose epoch on the altitudes are checked as well.

    Returns
    -------
    TargetStates
        The class (`family`) is the kind, and the name kind and number, such as "free return 3"; the
        kinds alternate. The period is 0, since no object is periodic.

    Raises
    ------
    ConfigurationError
        If shapes disagree, or the count or the time is impossible.
    ConvergenceError
        If the draws of a kind fail; the message names it.

    Examples
    --------
    A table for ``scenarios.NAME.tracked`` of the 202 moving targets, of which half are replaced:

    >>> orbits = tracked_targets()
    >>> closed = np.isfinite(orbits.stability_index)
    >>> inside = TargetStates(
    ...     [str(k) for k in range(closed.size)],
    ...     list(orbits.family),
    ...     orbits.state,
    ...     np.where(closed, orbits.period, 0.0),
    ... )
    >>> others = objects_outside_families(
    ...     orbits.state[closed], orbits.period[closed], np.random.default_rng(1)
    ... )
    >>> half = replace_targets(inside, others, 0.5, np.random.default_rng(2))
    >>> Path("targets.csv").write_text(target_states_csv(half), encoding="utf-8")
    """
    states = array_of("state", state, ("orbit", 6))
    orbits = _PeriodicOrbits(states, array_of("period", period, (len(states),)))
    count = count_of("count", count)
    days = number_of("days", days, positive=True)
    if np.any(orbits.period <= 0.0):
        raise ConfigurationError(f"period of orbit {np.argmin(orbits.period)} must be positive")
    known = _tree(orbits)
    names, families, found = [], [], []
    kinds = list(_DRAWS.items())
    streams = rng.spawn(len(kinds))
    for number in range(count):
        kind, draw = kinds[number % len(kinds)]
        found.append(
            _accepted(kind, draw, orbits, streams[number % len(kinds)], known, days, forces)
        )
        names.append(f"{kind} {number // len(kinds) + 1}")
        families.append(kind)
    return TargetStates(names, families, np.array(found), np.zeros(count))


def _accepted(kind, draw, orbits, rng, known, days, forces) -> Array:
    """The first drawn state of a kind that satisfies the conditions."""
    for _ in range(_MOST_DRAWS):
        state = draw(rng, orbits)
        if state is None:
            continue
        near = known.query(state * _SCALE, p=np.inf)[0] <= 1.0
        if (
            not near
            and _is_clear(state, days)
            and (forces is None or _is_clear_in(state, days, forces))
        ):
            return state
    raise ConvergenceError(
        f"objects outside of families: {_MOST_DRAWS} draws gave no object of the kind {kind!r}; "
        "give orbits of more families, or a shorter time"
    )


_SCALE = np.repeat([LENGTH_UNIT_KM / OFFSET_KM, 1.0 / (OFFSET_M_S * _M_S)], 3)


def _tree(orbits: _PeriodicOrbits) -> cKDTree:
    """States of the orbits, in the offsets from which on an object differs."""
    share = np.arange(_PHASES) / _PHASES - 0.5
    parts = [
        propagate(state, share * period, method="dop853")
        for state, period in zip(*orbits, strict=True)
    ]
    return cKDTree(np.concatenate(parts) * _SCALE)


def _is_clear(state: Array, days: float) -> bool:
    """Whether an object in the CR3BP meets the conditions on altitude and distance."""
    try:
        perigee, perilune = closest_approaches(state, days * _DAY)
        path = propagate(state, np.linspace(0.0, days * _DAY, 50), method="dop853")
    except ConvergenceError:
        return False
    return bool(
        perigee > (EARTH_RADIUS_KM + LEAST_ALTITUDE_KM) * _KM
        and perilune > (MOON_RADIUS_KM + LEAST_ALTITUDE_KM) * _KM
        and np.linalg.norm(path[:, :3], axis=1).max() < LARGEST_DISTANCE_KM * _KM
    )


def _is_clear_in(state: Array, days: float, forces: EphemerisForces) -> bool:
    """Whether an object that begins at the epoch of ephemeris dynamics meets the condition on
    altitude."""
    elapsed = np.linspace(0.0, days * _DAY, int(np.ceil(days * _SAMPLES_PER_DAY)) + 1)
    start = to_inertial(state, pulsating_frame(forces.table, forces.epoch)) / UNITS
    try:
        path = propagate(start, elapsed, forces=forces, method="dop853")[:, :3] * LENGTH_UNIT_KM
    except ConvergenceError:
        return False
    bodies, *_ = read_table(forces.table, forces.epoch + elapsed * TIME_UNIT_S)
    return all(
        np.linalg.norm(path - bodies[:, BODY_COLUMNS[body]], axis=1).min()
        > radius + LEAST_ALTITUDE_KM
        for body, radius in (("earth", EARTH_RADIUS_KM), ("moon", MOON_RADIUS_KM))
    )


def _after_perigee(perigee_km, apogee_km, angles, elapsed) -> Array | None:
    """State some time after the perigee of an ellipse about the Earth whose orientation at perigee
    is given by node, inclination and argument of perigee, rad."""
    perigee, apogee = perigee_km * _KM, apogee_km * _KM
    speed = np.sqrt(2.0 * (1.0 - MU) * apogee / (perigee * (perigee + apogee)))
    position, velocity = Rotation.from_euler("ZXZ", angles).apply([[perigee, 0, 0], [0, speed, 0]])
    velocity = velocity - np.cross([0.0, 0.0, 1.0], position)
    return _later(np.concatenate([position - [MU, 0.0, 0.0], velocity]), elapsed)


def _later(state: Array, elapsed: float) -> Array | None:
    """A state after some time, or none if it cannot be propagated."""
    try:
        return propagate(state, [elapsed], method="dop853")[0]
    except ConvergenceError:
        return None


def _direct_transfer(rng: np.random.Generator, orbits: _PeriodicOrbits) -> Array | None:
    perigee = EARTH_RADIUS_KM + rng.uniform(200.0, 2000.0)
    apogee = rng.uniform(0.9, 1.3) * LENGTH_UNIT_KM
    half_period = np.pi * (0.5 * (perigee + apogee) * _KM) ** 1.5
    # the Moon is at this angle, from the x axis at the perigee, when the object reaches its apogee
    node, argument = rng.uniform(0.0, 2.0 * np.pi), half_period + rng.normal(scale=0.3) - np.pi
    inclination = rng.uniform(0.0, 0.5)
    return _after_perigee(
        perigee, apogee, [node, inclination, argument - node], rng.uniform(0.3, 0.9) * half_period
    )


def _free_return(rng: np.random.Generator, orbits: _PeriodicOrbits) -> Array | None:
    distance = (MOON_RADIUS_KM + rng.uniform(200.0, 12_000.0)) * _KM
    latitude, perigee = rng.uniform(-0.8, 0.8), (EARTH_RADIUS_KM + rng.uniform(300.0, 5000.0)) * _KM
    elapsed = rng.uniform(-2.5, 2.5) * _DAY
    position = _MOON + distance * np.array([np.cos(latitude), 0.0, np.sin(latitude)])
    escape = np.sqrt(2.0 * MU / distance)

    def excess(speed: float) -> float:
        return closest_approaches([*position, 0.0, -speed, 0.0], 4.5 * _DAY)[0] - perigee

    speeds = escape * np.linspace(1.0, 1.8, 33)
    values = np.array([excess(speed) for speed in speeds])
    for k in np.flatnonzero((values[:-1] > 0.0) != (values[1:] > 0.0))[:1]:
        speed = brentq(excess, speeds[k], speeds[k + 1], xtol=1e-9)
        return _later(np.array([*position, 0.0, -speed, 0.0]), elapsed)
    return None


def _phase_and_monodromy(
    rng: np.random.Generator, orbits: _PeriodicOrbits
) -> tuple[Array, float, Array, Array]:
    """A random state of a random orbit, its period, and eigenvalues and eigenvectors of the
    monodromy matrix."""
    k = int(rng.integers(orbits.period.size))
    share = rng.uniform(-0.5, 0.5)
    state = propagate(orbits.state[k], [share * orbits.period[k]], method="dop853")[0]
    values, vectors = np.linalg.eig(propagate_stm(state, orbits.period[k])[1])
    return state, float(orbits.period[k]), values, vectors


def _low_energy_transfer(rng: np.random.Generator, orbits: _PeriodicOrbits) -> Array | None:
    state, _, values, vectors = _phase_and_monodromy(rng, orbits)
    forward, sign = rng.random() < 0.5, rng.choice([-1.0, 1.0])
    elapsed = rng.uniform(5.0, 30.0) * _DAY * (1.0 if forward else -1.0)
    k = int(np.argmax(np.abs(values)) if forward else np.argmin(np.abs(values)))
    if abs(np.log(np.abs(values[k]))) < np.log(50.0) or abs(values[k].imag) > 0.0:
        return None
    direction = vectors[:, k].real
    # the state of a spacecraft that leaves the orbit, or arrives at it, by a small maneuver
    return _later(state + sign * 100.0 * _KM * direction / np.linalg.norm(direction[:3]), elapsed)


def _quasi_periodic(rng: np.random.Generator, orbits: _PeriodicOrbits) -> Array | None:
    state, period, values, vectors = _phase_and_monodromy(rng, orbits)
    turn, size = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(2000.0, 15_000.0) * _KM
    # the eigenvalues of the family itself are 1
    center = (np.abs(np.abs(values) - 1.0) < 1e-3) & (np.angle(values) > 0.05)
    if not center.any():
        return None
    k = int(rng.choice(np.flatnonzero(center)))
    direction = (np.exp(1j * turn) * vectors[:, k]).real
    displaced = state + size * direction / np.linalg.norm(direction[:3])
    orbit = propagate(state, np.linspace(0.0, period, _PHASES), method="dop853")[:, :3]
    times = np.linspace(0.0, _QUASI_PERIODIC_DAYS * _DAY, 30)
    try:
        path = propagate(displaced, times, method="dop853")[:, :3]
    except ConvergenceError:
        return None
    largest = cKDTree(orbit).query(path)[0].max()
    return displaced if largest <= _QUASI_PERIODIC_RATIO * size else None


def _disposal(rng: np.random.Generator, orbits: _PeriodicOrbits) -> Array | None:
    k, share = int(rng.integers(orbits.period.size)), rng.uniform(-0.5, 0.5)
    state = propagate(orbits.state[k], [share * orbits.period[k]], method="dop853")[0]
    direction, amount = rng.normal(size=3), rng.uniform(10.0, 50.0) * _M_S
    state[3:] += amount * direction / np.linalg.norm(direction)
    return _later(state, rng.uniform(2.0, 20.0) * _DAY)


def _resonant(rng: np.random.Generator, orbits: _PeriodicOrbits) -> Array | None:
    revolutions, months = _RESONANCES[rng.integers(len(_RESONANCES))]
    period = 2.0 * np.pi * months / revolutions
    major = 2.0 * ((1.0 - MU) * (period / (2.0 * np.pi)) ** 2) ** (1.0 / 3.0) * LENGTH_UNIT_KM
    perigee = rng.uniform(20_000.0, min(150_000.0, 0.45 * major))
    return _on_ellipse(rng, perigee, major - perigee, period)


def _high_earth(rng: np.random.Generator, orbits: _PeriodicOrbits) -> Array | None:
    perigee, apogee = np.sort(rng.uniform(45_000.0, 360_000.0, 2))
    period = 2.0 * np.pi * np.sqrt((0.5 * (perigee + apogee) * _KM) ** 3 / (1.0 - MU))
    return _on_ellipse(rng, perigee, apogee, period)


def _on_ellipse(rng, perigee_km, apogee_km, period) -> Array | None:
    """State of random orientation and phase."""
    node, argument, phase = rng.random(3) * [2.0 * np.pi, 2.0 * np.pi, 1.0]
    inclination = np.arccos(rng.uniform(0.5, 1.0))
    return _after_perigee(perigee_km, apogee_km, [node, inclination, argument], phase * period)


_DRAWS: dict[str, Callable[[np.random.Generator, _PeriodicOrbits], Array | None]] = {
    "direct transfer": _direct_transfer,
    "free return": _free_return,
    "low-energy transfer": _low_energy_transfer,
    "quasi-periodic": _quasi_periodic,
    "disposal": _disposal,
    "resonant": _resonant,
    "high Earth": _high_earth,
}
"""Kinds, and the functions that draw a state of each, or none if the draw fails."""
