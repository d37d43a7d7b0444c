"""Rows of user-defined tables: names, states in either unit, and their validation.

The readers of targets and of observers share the columns of positions, velocities and periods, the
checks of their numbers, and the naming of rows in messages.
"""

import csv
from collections.abc import Sequence
from math import isfinite
from pathlib import Path

import numpy as np

from cislunar.constants import (
    EARTH_RADIUS_KM,
    LENGTH_UNIT_KM,
    MOON_RADIUS_KM,
    MU,
    SECONDS_PER_DAY,
    TIME_UNIT_S,
)
from cislunar.dynamics.bounds import check_period, check_position, check_velocity
from cislunar.errors import ConvergenceError, InputFileError
from cislunar.runtime.arguments import Array, require_path

Quantity = tuple[tuple[str, ...], tuple[str, ...], float]
"""Columns of a quantity, nondimensional and practical, and its unit in the practical one."""
Columns = tuple[tuple[str, ...], float]
"""Columns of a quantity, and the size of its nondimensional unit in their unit."""
Row = dict[str, str]

POSITION = (("x", "y", "z"), ("x_km", "y_km", "z_km"), LENGTH_UNIT_KM)
VELOCITY = (("vx", "vy", "vz"), ("vx_km_s", "vy_km_s", "vz_km_s"), LENGTH_UNIT_KM / TIME_UNIT_S)
PERIOD = (("period",), ("period_days",), TIME_UNIT_S / SECONDS_PER_DAY)

OWN_FAMILY = "own"
"""Family of an object that is given by its state, or whose row gives none."""

_LARGEST_GAP_KM = 100.0
"""Largest distance between the ends of a closed orbit, km."""

BODIES = (("Earth", -MU, EARTH_RADIUS_KM), ("Moon", 1.0 - MU, MOON_RADIUS_KM))
"""Name, position on the x axis (nondimensional) and radius (km)."""


def read_lines(path: str | Path, what: str) -> list[tuple[int, list[str]]]:
    """Fields of every line of a table in UTF-8, with the line number; a row has a `what`.

    Blank lines are empty lists. A quoted field may contain line breaks; its row has the number of
    its last line. An `InputFileError` if the file cannot be read, and a `ConfigurationError` if
    `path` is not a path.
    """
    require_path("path", path)
    try:
        with Path(path).open(newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file, skipinitialspace=True)
            return [(reader.line_num, fields) for fields in reader]
    except FileNotFoundError as error:
        remedy = f"give the path of a table with a row per {what}"
        raise InputFileError(f"{path}: no such file; {remedy}") from error
    except (OSError, ValueError, csv.Error) as error:
        raise InputFileError(f"{path}: cannot be read as a table in UTF-8 ({error})") from error


def listed(header: list[str]) -> str:
    """Column names as text for an error message; a substitute if they are not printable."""
    text = ", ".join(header) or "no columns"
    return text if text.isprintable() and len(text) < 200 else "no readable names"


def read_number(place: str, text: str, name: str = "") -> float:
    """A finite number; raises an `InputFileError` with the place, and the name if there is one."""
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not isfinite(value):
        named = f"{name} = " if name else ""
        raise InputFileError(f"{place}: {named}{text!r} must be a finite number")
    return value


def named_rows(
    path: str | Path,
    what: str,
    key: str = "id",
    others: Sequence[str] = (),
    *,
    remedy: str = "",
    short: bool = False,
) -> tuple[list[str], list[tuple[str, Row]]]:
    """Header of a table, and its rows, which are not blank: place for messages, and text by column.

    The column `key` names a row, `others` are required too, and `what` is the content of a row. The
    fields at the end of a row may be left out if `short`. An `InputFileError` if the file cannot be
    read, a column is missing, which adds the `remedy`, or occurs twice, or a row has another number
    of fields than the header.
    """
    lines = read_lines(path, what)
    header = [name.strip() for name in lines[0][1]] if lines else []
    twice = [name for name in header if name and header.count(name) > 1]
    if twice:
        raise InputFileError(f"{path}, row 1: column {twice[0]} occurs twice; remove one of them")
    lacking = ", ".join(name for name in (key, *others) if name not in header)
    if lacking:
        raise InputFileError(
            f"{path}, row 1: no column {lacking}{remedy}; the header has {listed(header)}"
        )
    rows = []
    for number, fields in lines[1:]:
        if not any(field.strip() for field in fields):
            continue
        place = f"{path}, row {number}"
        if short:
            fields = fields + [""] * (len(header) - len(fields))
        if len(fields) != len(header):
            raise InputFileError(
                f"{place}: {len(fields)} fields where the header has {len(header)}; complete the "
                "row, and quote fields that contain commas"
            )
        row = {name: field.strip() for name, field in zip(header, fields, strict=True)}
        rows.append((f"{place}, {what} {row[key]!r}" if row.get(key) else place, row))
    if not rows:
        raise InputFileError(f"{path}: contains no {what}; add a row per {what}")
    return header, rows


def quantity_columns(
    path: str | Path, header: list[str], quantity: Quantity, *, optional: bool = False
) -> Columns | None:
    """Columns of a table that have a quantity: `POSITION`, `VELOCITY` or `PERIOD`.

    None if the table lacks an optional quantity. An `InputFileError` if the quantity is missing or
    given in both units.
    """
    plain, practical, unit = quantity
    found = [
        (columns, size)
        for columns, size in ((plain, 1.0), (practical, unit))
        if set(columns) <= set(header)
    ]
    if len(found) == 1 or (optional and not found):
        return found[0] if found else None
    if found:
        raise InputFileError(
            f"{path}, row 1: both {', '.join(plain)} and {', '.join(practical)}; remove one of "
            "the two"
        )
    raise InputFileError(
        f"{path}, row 1: needs the columns {', '.join(plain)} (nondimensional) or "
        f"{', '.join(practical)}; the header has {listed(header)}"
    )


def row_names(rows: list[tuple[str, Row]], what: str, key: str = "id") -> list[str]:
    """Names of the rows; raises `InputFileError` if a row has none or the name of another row."""
    first: dict[str, str] = {}
    for place, row in rows:
        name = row[key]
        if not name:
            raise InputFileError(
                f"{place}: the {what} has no {'name' if key == what else key}; give it one"
            )
        if name in first:
            earlier = first[name].removesuffix(f", {what} {name!r}").rpartition(", ")[2]
            raise InputFileError(
                f"{place}: the {key} is taken already in {earlier}; give every {what} its own"
            )
        first[name] = place
    return list(first)


def row_numbers(place: str, row: Row, columns: Columns) -> list[float]:
    """Numbers of some columns, nondimensional; raises `InputFileError` if one is not finite."""
    names, unit = columns
    return [read_number(place, row.get(name, ""), name) / unit for name in names]


def _unit(columns: Columns) -> str:
    return "" if columns[1] == 1.0 else "km"


def _instead(columns: Columns, quantity: Quantity) -> str:
    """Hint at the columns for km or km/s, if these columns are nondimensional."""
    unit = "km" if quantity is POSITION else "km/s"
    return "" if _unit(columns) else f"; {unit} belong in columns named {', '.join(quantity[1])}"


def row_position(place: str, row: Row, columns: Columns) -> list[float]:
    """Position of a row, nondimensional, rotating frame; raises `InputFileError` if it is far from
    Earth and Moon, or inside one of them."""
    position = row_numbers(place, row, columns)
    check_position(place, columns[0], position, _unit(columns), _instead(columns, POSITION))
    units = f"kilometers in columns named *_km, else in units of {LENGTH_UNIT_KM} km"
    _check_outside(place, position, units)
    return position


def row_state(place: str, row: Row, position: Columns, velocity: Columns) -> list[float]:
    """State of a row, nondimensional, rotating frame; raises `InputFileError` if it is outside of
    the bounds that detect a wrong unit."""
    state = [*row_position(place, row, position), *row_numbers(place, row, velocity)]
    check_velocity(place, velocity[0], state, _unit(velocity), _instead(velocity, VELOCITY))
    return state


def row_period(place: str, row: Row, period: Columns | None) -> float:
    """Period of a row, nondimensional; 0 if the row has none. Raises `InputFileError` if it is no
    number, negative or too long."""
    if period is None or not row[period[0][0]]:
        return 0.0
    (given,) = row_numbers(place, row, period)
    check_period(place, period[0][0], given, _unit(period))
    return given


def check_state(
    place: str, names: Sequence[str], state: Array, unit: str, remedy: str = ""
) -> None:
    """Apply the checks of `row_state` to a state of shape (6,), nondimensional, rotating frame. For
    the arguments see `cislunar.dynamics.bounds.check_position`."""
    check_position(place, names[:3], state[:3], unit, remedy)
    _check_outside(place, state[:3], f"{unit or f'units of {LENGTH_UNIT_KM} km'}{remedy}")
    check_velocity(place, names[3:6], state, unit, remedy)


def check_closed(place: str, state: Array, period: float) -> None:
    """Raise `InputFileError` if the orbit through a state, nondimensional, rotating frame, does not
    close within 100 km after a period, nondimensional."""
    # imported here, because a configuration is checked without compiled modules
    from cislunar.dynamics.propagation import propagate

    try:
        before, after = propagate(state, [-0.5 * period, 0.5 * period], method="dop853")
    except ConvergenceError as error:
        raise InputFileError(f"{place}: its orbit cannot be followed ({error})") from error
    gap = LENGTH_UNIT_KM * float(np.linalg.norm((after - before)[:3]))
    if gap > _LARGEST_GAP_KM:
        raise InputFileError(
            f"{place}: not closed: half a period ahead and half a period back it is {gap:,.0f} km "
            f"apart (at most {_LARGEST_GAP_KM:g}); correct state or period, or leave the period "
            "empty for an open trajectory"
        )


def _check_outside(place: str, position: Sequence[float] | Array, units: str) -> None:
    """Refuse a position inside one of the bodies; `units` says which ones are expected."""
    for body, center, radius in BODIES:
        x, y, z = position
        distance = LENGTH_UNIT_KM * float(np.hypot(np.hypot(x - center, y), z))
        if distance < radius:
            raise InputFileError(
                f"{place}: lies inside the {body}, {distance:.0f} km from its center (radius "
                f"{radius:.0f} km); positions are from the Earth-Moon barycenter, in the rotating "
                f"frame, in {units}"
            )
