"""Tables of one's own targets: moving ones with their states at the epoch, static ones in place.

Comma-separated, UTF-8, one target per row, positions and velocities in the rotating barycentric
frame (x from the Earth to the Moon, z along the angular momentum). The header tells the unit:

==================  ==============================  ==========================================
quantity            nondimensional                  in kilometers and seconds
==================  ==============================  ==========================================
name of the target  ``id``                          ``id``
position            ``x, y, z``                     ``x_km, y_km, z_km``
velocity            ``vx, vy, vz``                  ``vx_km_s, vy_km_s, vz_km_s``
period, optional    ``period``                      ``period_days``
class, optional     ``family``                      ``family``
==================  ==============================  ==========================================

Velocities are those seen in the rotating frame. Without a period, or where it is left empty, a
target is at its state at the epoch; with one, it starts at a random point of its orbit as the
paper's targets do. Other columns are ignored.

Moving targets may also come from rows of JPL's catalogue (`cislunar.exchange.catalogue`), each on
its orbit at a random point, or from a CCSDS OEM, a file named ``*.oem`` (`cislunar.exchange.oem`),
each object at its state at the epoch.
"""

from math import isfinite
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.constants import (
    EARTH_RADIUS_KM,
    LENGTH_UNIT_KM,
    MOON_RADIUS_KM,
    MU,
    SECONDS_PER_DAY,
    TIME_UNIT_S,
)
from cislunar.errors import InputFileError
from cislunar.exchange.bounds import check_period, check_position, check_velocity
from cislunar.exchange.catalogue import COLUMNS, is_catalogue, read_catalogue
from cislunar.exchange.csv_lines import listed, read_lines
from cislunar.exchange.inertial import Epoch, rotating_states
from cislunar.exchange.oem import Segment, read_oem, state_at

Array = NDArray[np.float64]

_MESSAGE = ("X", "Y", "Z", "X_DOT", "Y_DOT", "Z_DOT")
"""Components of the states of an OEM, turned to the rotating frame."""

POSITION = (("x", "y", "z"), ("x_km", "y_km", "z_km"), LENGTH_UNIT_KM)
VELOCITY = (
    ("vx", "vy", "vz"),
    ("vx_km_s", "vy_km_s", "vz_km_s"),
    LENGTH_UNIT_KM / TIME_UNIT_S,
)
PERIOD = (("period",), ("period_days",), TIME_UNIT_S / SECONDS_PER_DAY)

Quantity = tuple[tuple[str, ...], tuple[str, ...], float]

BODIES = (("Earth", -MU, EARTH_RADIUS_KM), ("Moon", 1.0 - MU, MOON_RADIUS_KM))
"""Name, place on the x axis (nondimensional) and radius (km)."""

OWN_FAMILY = "own"
"""Class of a target whose row gives none."""


class TargetStates(NamedTuple):
    """Moving targets.

    Attributes
    ----------
    name, family : list of str
        Name and class of each target.
    state : ndarray, shape (target, 6)
        Nondimensional, rotating frame, at the epoch.
    period : ndarray, shape (target,)
        Nondimensional; 0 for a target that starts at its state.
    """

    name: list[str]
    family: list[str]
    state: Array
    period: Array

    def __len__(self) -> int:
        return len(self.name)


class TargetPositions(NamedTuple):
    """Static targets.

    Attributes
    ----------
    name : list of str
        Name of each target.
    position : ndarray, shape (target, 3)
        Nondimensional, rotating frame.
    """

    name: list[str]
    position: Array

    def __len__(self) -> int:
        return len(self.name)


def is_message(path: str | Path) -> bool:
    """Whether a file of moving targets is an OEM, whose states depend on the epoch."""
    return Path(path).suffix.lower() == ".oem"


def load_target_states(path: str | Path, epoch: Epoch | None = None) -> TargetStates:
    """Read and check a table of moving targets, rows of JPL's catalogue, or an OEM.

    Parameters
    ----------
    path : str or Path
        The file.
    epoch : Epoch, optional
        When and in which axes the states of an OEM are wanted; tables need none.

    Returns
    -------
    TargetStates
        In the order of the file.

    Raises
    ------
    InputFileError
        If the file is missing, empty or no such table; if a target has no name or its name occurs
        twice; if a number is missing or not finite, or out of the bounds that tell one unit from
        another (`cislunar.exchange.bounds`); if a target is inside the Earth or the Moon; if an OEM
        does not cover the epoch. The message names the file, the row as an editor numbers it (the
        header is row 1) and the target.
    """
    if is_message(path):
        return _of_message(path, epoch)
    first = read_lines(path, "target")[:1]
    if first and is_catalogue(first[0][1]):
        found = read_catalogue(path)
        for name, state in zip(found.name, found.state, strict=True):
            _plausible(f"{path}, Id {name!r}", COLUMNS, state, "")
        return TargetStates(found.name, [OWN_FAMILY] * len(found.name), found.state, found.period)
    header, rows = _read(Path(path))
    position = _columns(path, header, POSITION)
    velocity = _columns(path, header, VELOCITY)
    period = _columns(path, header, PERIOD, optional=True)
    names = _names(rows)
    states, periods, families = [], [], []
    for place, row in rows:
        state = [*_position(place, row, position), *_numbers(place, row, velocity)]
        check_velocity(place, velocity[0], state, _unit(velocity), _instead(velocity, VELOCITY))
        states.append(state)
        given = [] if period is None or not row[period[0][0]] else _numbers(place, row, period)
        if given:
            check_period(place, period[0][0], given[0], _unit(period))
        periods.append(given[0] if given else 0.0)
        families.append(row.get("family") or OWN_FAMILY)
    return TargetStates(names, families, np.array(states), np.array(periods))


def _of_message(path: str | Path, epoch: Epoch | None) -> TargetStates:
    """The objects of an OEM at the epoch; segments of the same name are of one object."""
    if epoch is None:
        raise InputFileError(f"{path}: an OEM holds states at many times; give the epoch wanted")
    objects: dict[str, list[Segment]] = {}
    for segment in read_oem(path):
        objects.setdefault(segment.name, []).append(segment)
    states = []
    for name, segments in objects.items():
        try:
            given, center = state_at(segments, epoch.tdb_s)
        except InputFileError as error:
            raise InputFileError(f"{path}: {error}") from error
        state = rotating_states(given[None], [0.0], epoch, center)[0]
        _plausible(f"{path}, object {name!r}", _MESSAGE, state, "km")
        states.append(state)
    families = [OWN_FAMILY] * len(states)
    return TargetStates(list(objects), families, np.array(states), np.zeros(len(states)))


def load_target_positions(path: str | Path) -> TargetPositions:
    """Read and check a table of static targets.

    Parameters
    ----------
    path : str or Path
        The table; columns of velocity are ignored.

    Returns
    -------
    TargetPositions
        In the order of the file.

    Raises
    ------
    InputFileError
        As for `load_target_states`.
    """
    header, rows = _read(Path(path))
    position = _columns(path, header, POSITION)
    names = _names(rows)
    found = [_position(place, row, position) for place, row in rows]
    return TargetPositions(names, np.array(found))


def _read(path: Path) -> tuple[list[str], list[tuple[str, dict[str, str]]]]:
    """Header of a table, and its rows with their place as it is named in messages."""
    lines = read_lines(path, "target")
    header = [name.strip() for name in lines[0][1]] if lines else []
    twice = [name for name in header if name and header.count(name) > 1]
    if twice:
        raise InputFileError(f"{path}, row 1: column {twice[0]} occurs twice; remove one of them")
    rows = []
    for number, fields in lines[1:]:
        if not any(field.strip() for field in fields):
            continue
        place = f"{path}, row {number}"
        if len(fields) != len(header):
            raise InputFileError(
                f"{place}: {len(fields)} fields where the header has {len(header)}; complete the "
                "row, and quote fields that contain commas"
            )
        row = {name: field.strip() for name, field in zip(header, fields, strict=True)}
        rows.append((f"{place}, target {row['id']!r}" if row.get("id") else place, row))
    if "id" not in header:
        raise InputFileError(f"{path}, row 1: no column id; the header has {listed(header)}")
    if not rows:
        raise InputFileError(f"{path}: holds no target; add a row per target")
    return header, rows


def _columns(
    path: str | Path, header: list[str], quantity: Quantity, *, optional: bool = False
) -> tuple[tuple[str, ...], float] | None:
    """Columns that hold a quantity, and the size of its nondimensional unit in theirs."""
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


def _names(rows: list[tuple[str, dict[str, str]]]) -> list[str]:
    """Names of the targets, each of which must be given and occur once."""
    first: dict[str, str] = {}
    for place, row in rows:
        if not row["id"]:
            raise InputFileError(f"{place}: the target has no id; give it one")
        if row["id"] in first:
            raise InputFileError(
                f"{place}: the id is taken already in {first[row['id']].split(', ')[1]}; give "
                "every target an id of its own"
            )
        first[row["id"]] = place
    return list(first)


def _numbers(
    place: str, row: dict[str, str], columns: tuple[tuple[str, ...], float]
) -> list[float]:
    """Finite numbers of some columns, nondimensional."""
    names, unit = columns
    values = []
    for name in names:
        try:
            value = float(row[name])
        except ValueError:
            value = float("nan")
        if not isfinite(value):
            raise InputFileError(f"{place}: {name} = {row[name]!r} must be a finite number")
        values.append(value / unit)
    return values


def _unit(columns: tuple[tuple[str, ...], float]) -> str:
    return "" if columns[1] == 1.0 else "km"


def _instead(columns: tuple[tuple[str, ...], float], quantity: Quantity) -> str:
    """Where numbers in km or km/s belong, if these columns are not theirs."""
    unit = "km" if quantity is POSITION else "km/s"
    return "" if _unit(columns) else f"; {unit} belong in columns named {', '.join(quantity[1])}"


def _position(
    place: str, row: dict[str, str], columns: tuple[tuple[str, ...], float]
) -> list[float]:
    """Position of a row, which must be near Earth and Moon and in neither."""
    position = _numbers(place, row, columns)
    check_position(place, columns[0], position, _unit(columns), _instead(columns, POSITION))
    return _outside(place, position)


def _plausible(place: str, names: tuple[str, ...], state: Array, unit: str) -> None:
    """Refuse a whole state as `_position` and `check_velocity` do."""
    check_position(place, names[:3], state[:3], unit)
    _outside(place, list(state[:3]))
    check_velocity(place, names[3:6], state, unit)


def _outside(place: str, position: list[float]) -> list[float]:
    """A position that is in none of the bodies."""
    for body, center, radius in BODIES:
        x, y, z = position
        distance = LENGTH_UNIT_KM * float(np.hypot(np.hypot(x - center, y), z))
        if distance < radius:
            raise InputFileError(
                f"{place}: lies inside the {body}, {distance:.0f} km from its center (radius "
                f"{radius:.0f} km); positions are from the Earth-Moon barycenter, in the rotating "
                f"frame, in kilometers in columns named *_km, else in units of {LENGTH_UNIT_KM} km"
            )
    return position
