"""Propagation between UTC dates under an ephemeris force model.

from cislunar.dynamics.ephemeris import propagate_utc
propagate_utc(state, "2024-10-01T00:00:00", "2024-10-08T00:00:00", center="moon")
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from cislunar.constants import EARTH_RADIUS_KM, LENGTH_UNIT_KM, MOON_RADIUS_KM, TIME_UNIT_S
from cislunar.dynamics.bounds import require_kilometers, state_vector
from cislunar.dynamics.ephemeris_forces import EphemerisForces, ephemeris_forces
from cislunar.dynamics.frames import BARYCENTER, recenter
from cislunar.dynamics.propagation import propagate
from cislunar.dynamics.radiation import SUN_RADIUS_KM
from cislunar.ephemeris.bodies import require_within, tabulate_bodies
from cislunar.ephemeris.kernel import DEFAULT_KERNEL
from cislunar.ephemeris.time_scales import tdb_seconds
from cislunar.errors import ConfigurationError
from cislunar.quantities import in_kilometers
from cislunar.runtime.arguments import Array, require_kind

UNITS = np.repeat([LENGTH_UNIT_KM, LENGTH_UNIT_KM / TIME_UNIT_S], 3)
"""Units of a state, shape (6,): km and km/s."""

_RADII_KM = {"earth": EARTH_RADIUS_KM, "moon": MOON_RADIUS_KM, "sun": SUN_RADIUS_KM}


def forces_between(
    start: str | float,
    stop: str | float,
    *,
    area_to_mass: ArrayLike | None = None,
    reflectivity: ArrayLike = 1.3,
    figure: bool = True,
    kernel: str | Path = DEFAULT_KERNEL,
) -> EphemerisForces:
    """Ephemeris force model that covers a span; its time zero is `start`.

    Parameters
    ----------
    start, stop : str or float
        UTC, as ISO 8601 dates or Julian dates.
    area_to_mass, reflectivity, figure
        See `cislunar.dynamics.ephemeris_forces.ephemeris_forces`.
    kernel : str or Path
        ``"de421"``, ``"de440"``, or the path of an SPK file.

    Returns
    -------
    EphemerisForces

    Raises
    ------
    ConfigurationError
        If a date is none or lies before 1972, or the area-to-mass ratio or the reflectivity is
        impossible.
    InputFileError
        If the kernel is missing, lacks a body, or does not cover the span.
    """
    first, last = tdb_seconds(start), tdb_seconds(stop)
    table = tabulate_bodies(first, last, kernel)
    given = {"area_to_mass": area_to_mass, "reflectivity": reflectivity, "figure": figure}
    return ephemeris_forces(table, first, **given)


def propagate_utc(
    state: ArrayLike,
    start: str | float,
    stop: str | float | Sequence[str | float],
    *,
    forces: EphemerisForces | None = None,
    center: str = BARYCENTER,
    method: str = "dop853",
    rtol: float | None = None,
    atol: float | None = None,
) -> Array:
    """Propagate a state from one date to one or several others.

    Parameters
    ----------
    state : array_like, shape (6,)
        State at `start`, J2000 axes, relative to `center`, km and km/s.
    start : str or float
        UTC, as ISO 8601 date or Julian date.
    stop : str, float or a sequence of these
        UTC, before or after the start.
    forces : EphemerisForces, optional
        From `forces_between`, covering these dates. By default the point masses of Earth, Moon and
        Sun with the Moon's J2 and C22, from the DE421 ephemeris.
    center : {"barycenter", "earth", "moon", "sun"}
        Origin of the state and of the result.
    method, rtol, atol
        See `cislunar.dynamics.propagation.propagate`.

    Returns
    -------
    ndarray, shape (6,) or (m, 6)
        J2000 axes, relative to `center`, km and km/s.

    Raises
    ------
    ConfigurationError
        If the state lies inside a body or is evidently in other units than km and km/s, the force
        model does not cover the dates, or another argument is impossible.
    InputFileError
        If DE421 is missing or does not cover the dates.
    ConvergenceError
        If the step size underflows, as on a collision with a body's center, or too many steps are
        needed.
    """
    require_kind("center", center, str, "give 'barycenter', 'earth', 'moon' or 'sun'")
    stops = [stop] if isinstance(stop, str) or np.ndim(stop) == 0 else [*stop]
    if not stops:
        raise ConfigurationError("stop = [] must be a date, or a sequence of at least one")
    first, ends = tdb_seconds(start), np.array([tdb_seconds(each) for each in stops])
    reached = min(first, *ends), max(first, *ends)
    if forces is None:
        forces = ephemeris_forces(tabulate_bodies(*reached), first)
    elif not isinstance(forces, EphemerisForces):
        raise ConfigurationError(
            f"forces = {type(forces).__name__} is not an ephemeris force model: use forces_between"
        )
    table = forces.table
    require_within(table, *reached)
    begin = recenter(
        state_vector(in_kilometers("state", state)), table, first, old=center, new=BARYCENTER
    )
    require_kilometers("state", begin)
    for body, radius in _RADII_KM.items():
        distance = np.linalg.norm(recenter(begin, table, first, old=BARYCENTER, new=body)[..., :3])
        if distance < radius:
            raise ConfigurationError(
                f"the state lies inside the {body.capitalize()}: {distance:.3f} km from its center "
                f"but the radius is {radius} km; check center = {center!r}, and give km and km/s"
            )
    end = propagate(
        begin / UNITS,
        (ends - first) / TIME_UNIT_S,
        forces=forces,
        start=(first - forces.epoch) / TIME_UNIT_S,
        method=method,
        rtol=rtol,
        atol=atol,
    )
    end = recenter(end * UNITS, table, ends, old=BARYCENTER, new=center)
    return end[0] if len(stops) == 1 and stops[0] is stop else end
