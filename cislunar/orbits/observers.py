"""User-defined observers: their table and their orbits.

The table is comma-separated, UTF-8, with one observer per row and its name in the column ``id``. An
observer is given either by its state at the epoch, in the columns of target tables
(`cislunar.targets.tables`), or by a ``family`` of periodic orbits (`cislunar.orbits.catalog`) and
one of ``jacobi`` and ``period`` (nondimensional) or ``period_days``, which has to determine a
single member. A state with a period is on a closed orbit; a state without one starts an open
trajectory. A ``phase``, a fraction of the period, moves the observer ahead of the state, or of the
catalog's first point of the orbit. `SENSOR_COLUMNS` override the configured sensor. Cells that do
not apply are empty.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cislunar.constants import (
    EARTH_RADIUS_KM,
    LENGTH_UNIT_KM,
    MOON_RADIUS_KM,
    SECONDS_PER_DAY,
    TIME_UNIT_S,
)
from cislunar.dynamics import closest_approaches, jacobi_constant, propagate_periodic
from cislunar.errors import ConfigurationError, ConvergenceError, InputFileError, placed
from cislunar.exchange.table_rows import (
    OWN_FAMILY,
    PERIOD,
    POSITION,
    VELOCITY,
    Columns,
    Row,
    check_closed,
    named_rows,
    quantity_columns,
    row_names,
    row_numbers,
    row_period,
    row_state,
)
from cislunar.orbits.catalog import family_named, periodic_orbits
from cislunar.orbits.families import OrbitSet, concatenate
from cislunar.orbits.stability import stability_index
from cislunar.runtime import Array, counted

_DAYS = TIME_UNIT_S / SECONDS_PER_DAY
_JACOBI: Columns = (("jacobi",), 1.0)
_PHASE: Columns = (("phase",), 1.0)


SENSOR_COLUMNS = {
    "limiting_magnitude": (-np.inf, "any"),
    "magnitude_noise": (0.0, "above 0"),
    "angle_noise_arcsec": (0.0, "above 0"),
    "field_of_view_deg": (0.0, "above 0"),
    "sun_exclusion_deg": (-1e-9, "from 0 on"),
    "moon_exclusion_deg": (-1e-9, "from 0 on"),
    "earth_exclusion_deg": (-1e-9, "from 0 on"),
}
"""Columns of an observer's own sensor, their exclusive lower bounds, and these in words."""


class Observer(NamedTuple):
    """A row of a table of observers: `place` is file, row and name, for messages; `family` is
    `OWN_FAMILY` if the state is given. State at the epoch, Jacobi constant and period (0 if not
    given) are nondimensional, in the rotating frame; `phase` is a fraction of the period, 0 .. 1;
    `sensor` holds the values of `SENSOR_COLUMNS` in the row."""

    place: str
    name: str
    family: str
    state: list[float] | None
    jacobi: float
    period: float
    phase: float
    sensor: dict[str, float]


def load_observers(path: str | Path) -> list[Observer]:
    """Read a table of observers and check what does not require their orbits.

    Parameters
    ----------
    path : str or Path
        The table.

    Returns
    -------
    list of Observer
        In the order of the file.

    Raises
    ------
    ConfigurationError
        If `path` is not a path.
    InputFileError
        If the table or a row is unusable; the message names the file, the row and the observer.
    """
    header, rows = named_rows(path, "observer")
    columns = {name for quantity in (POSITION, VELOCITY) for name in (*quantity[0], *quantity[1])}
    needed = (POSITION, VELOCITY) if columns & set(header) else ()
    states = [quantity_columns(path, header, quantity) for quantity in needed]
    period = quantity_columns(path, header, PERIOD, optional=True)
    of_state = [name for names, _ in states for name in names]
    known = ["id", "family", "jacobi", "phase", *of_state, *(period[0] if period else ())]
    known += SENSOR_COLUMNS
    for column in header:
        if column not in known:
            raise InputFileError(
                f"{path}, row 1: column {column!r} is unknown; columns of a sensor "
                f"are {', '.join(SENSOR_COLUMNS)}"
            )
    observers = []
    for name, (place, row) in zip(row_names(rows, "observer"), rows, strict=True):
        has_state = any(row[column] for column in of_state)
        if has_state == bool(row.get("family")):
            fault = "both a state and a family" if has_state else "neither a state nor a family"
            raise InputFileError(f"{place}: {fault}; give one of the two")
        state = row_state(place, row, *states) if has_state else None
        jacobi = row_numbers(place, row, _JACOBI)[0] if row.get("jacobi") else 0.0
        duration = row_period(place, row, period)
        phase = row_numbers(place, row, _PHASE)[0] if row.get("phase") else 0.0
        family = row.get("family") or OWN_FAMILY
        own = _sensor(place, row)
        found = Observer(place, name, family, state, jacobi, duration, phase, own)
        _check_orbit(found, row)
        observers.append(found)
    return observers


def _sensor(place: str, row: Row) -> dict[str, float]:
    """The observer's own sensor values in a row."""
    found = {}
    for column, (least, words) in SENSOR_COLUMNS.items():
        if row.get(column):
            found[column] = row_numbers(place, row, ((column,), 1.0))[0]
            if not least < found[column] < 180.0:
                raise InputFileError(
                    f"{place}: {column} = {row[column]} must be {words} and below 180"
                )
    return found


def _check_orbit(observer: Observer, row: Row) -> None:
    """Check the values that determine the orbit, and the phase."""
    place = observer.place
    if not 0.0 <= observer.phase <= 1.0:
        raise InputFileError(
            f"{place}: phase = {row['phase']} must be within 0 .. 1, a share of the period"
        )
    if observer.state is None:
        with placed(place, ConfigurationError, InputFileError):
            family_named(observer.family)
        if bool(row.get("jacobi")) == (observer.period > 0.0):
            raise InputFileError(
                f"{place}: give one of jacobi and period_days (or period), which chooses the "
                f"member of {observer.family}"
            )
    elif row.get("jacobi"):
        raise InputFileError(f"{place}: a state has its own Jacobi constant; leave jacobi empty")
    elif observer.phase and not observer.period:
        raise InputFileError(
            f"{place}: phase is a share of the period; give period_days (or period), or no phase"
        )


def observer_orbits(
    observers: Sequence[Observer], days: float, progress: Callable[[int, int], None] | None = None
) -> OrbitSet:
    """Orbits of observers, each at its phase.

    Parameters
    ----------
    observers : sequence of Observer
        From `load_observers`.
    days : float
        Duration of open trajectories, days.
    progress : callable, optional
        Called with (observers done, observers in all).

    Returns
    -------
    OrbitSet
        One row per observer. An open trajectory has period 0, stability index NaN, and its least
        distances within `days`.

    Raises
    ------
    InputFileError
        If a family has no such member or several, an orbit intersects the Earth or the Moon, or an
        orbit with a period is not closed; the message names file, row and observer.
    """
    found = []
    for observer in counted(observers, progress):
        try:
            orbit = _member(observer) if observer.state is None else _given(observer, days)
        except ConvergenceError as error:
            raise InputFileError(
                f"{observer.place}: its orbit cannot be followed ({error}); it may meet a body"
            ) from error
        found.append(_at_phase(orbit, observer.phase))
    return concatenate(found)


def _member(observer: Observer) -> OrbitSet:
    """The single member of a family with a value."""
    place, family = observer.place, observer.family
    quantity = "period" if observer.period else "jacobi"
    value = getattr(observer, quantity)
    with placed(place, ConfigurationError, InputFileError):
        found = periodic_orbits(family, clear=False, **{quantity: value})
    if len(found.period) == 1:
        check_clear(observer.place, float(found.perigee_km[0]), float(found.perilune_km[0]))
        return found
    column, other = "period_days", "jacobi"
    if not observer.period:
        column, other = other, column
    members = "; ".join(
        f"jacobi {c:.6g}, period_days {t * _DAYS:.6g}, perilune {low:,.0f} km"
        for c, t, low in zip(found.jacobi, found.period, found.perilune_km, strict=True)
    )
    given = value * _DAYS if observer.period else value
    raise InputFileError(
        f"{place}: {len(found.period)} members of {family} have {column} = {given:.6g}: "
        f"{members}; choose one by its {other} instead, or by its state"
    )


def _given(observer: Observer, days: float) -> OrbitSet:
    """The orbit or trajectory through a given state."""
    state, period = np.array(observer.state), observer.period
    found = orbit_through(observer.family, state, period, days)
    check_clear(observer.place, float(found.perigee_km[0]), float(found.perilune_km[0]))
    if period:
        check_closed(observer.place, state, period)
    return found


def orbit_through(family: str, state: Array, period: float, days: float = 0.0) -> OrbitSet:
    """The orbit through a state (6,) with a period, or the trajectory from it (period 0) over some
    days; both nondimensional, rotating frame.

    Raises
    ------
    ConfigurationError
        If neither the period nor `days` is positive, or the state is not of 6 finite numbers.
    ConvergenceError
        If the trajectory meets the center of a primary.
    """
    least = [LENGTH_UNIT_KM * each for each in closest_approaches(state, period or days / _DAYS)]
    index = stability_index(state, period) if period else np.nan
    values = period, float(jacobi_constant(state)), index, *least[::-1]
    return OrbitSet(np.array([family]), state[None], *(np.array([each]) for each in values))


def check_clear(place: str, perigee_km: float, perilune_km: float) -> None:
    """Raise an `InputFileError` that begins with `place` if an orbit with these least distances
    from the centers of Earth and Moon meets one of them."""
    for body, distance, radius in (
        ("Earth", perigee_km, EARTH_RADIUS_KM),
        ("Moon", perilune_km, MOON_RADIUS_KM),
    ):
        if distance <= radius:
            raise InputFileError(
                f"{place}: its orbit meets the {body}: it comes within {distance:,.0f} km "
                f"of its center (radius {radius:,.0f} km); choose another orbit"
            )


def _at_phase(orbit: OrbitSet, phase: float) -> OrbitSet:
    """The same orbit, started at a later point."""
    if not phase:
        return orbit
    period = float(orbit.period[0])
    later = propagate_periodic(orbit.state[0], period, [phase * period], method="dop853")
    return orbit._replace(state=later)
