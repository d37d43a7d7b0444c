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

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.errors import InputFileError
from cislunar.exchange.catalogue import COLUMNS, is_catalogue, read_catalogue
from cislunar.exchange.csv_lines import read_lines
from cislunar.exchange.inertial import Epoch, rotating_states
from cislunar.exchange.oem import Segment, read_oem, state_at
from cislunar.exchange.table_rows import (
    PERIOD,
    POSITION,
    VELOCITY,
    check_closed,
    check_state,
    named_rows,
    quantity_columns,
    row_names,
    row_period,
    row_position,
    row_state,
)

Array = NDArray[np.float64]

_MESSAGE = ("X", "Y", "Z", "X_DOT", "Y_DOT", "Z_DOT")
"""Components of the states of an OEM, turned to the rotating frame."""

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
        another (`cislunar.dynamics.bounds`); if a target is inside the Earth or the Moon; if an OEM
        does not cover the epoch. The message names the file, the row as an editor numbers it (the
        header is row 1) and the target.
    """
    if is_message(path):
        return _of_message(path, epoch)
    first = read_lines(path, "target")[:1]
    if first and is_catalogue(first[0][1]):
        found = read_catalogue(path)
        for name, state in zip(found.name, found.state, strict=True):
            check_state(f"{path}, Id {name!r}", COLUMNS, state, "")
        return TargetStates(found.name, [OWN_FAMILY] * len(found.name), found.state, found.period)
    header, rows = named_rows(path, "target")
    position = quantity_columns(path, header, POSITION)
    velocity = quantity_columns(path, header, VELOCITY)
    period = quantity_columns(path, header, PERIOD, optional=True)
    names = row_names(rows, "target")
    states = [row_state(place, row, position, velocity) for place, row in rows]
    periods = [row_period(place, row, period) for place, row in rows]
    families = [row.get("family") or OWN_FAMILY for _, row in rows]
    return TargetStates(names, families, np.array(states), np.array(periods))


def check_closed_targets(path: str | Path, targets: TargetStates) -> None:
    """Refuse targets of a table whose period does not close the orbit through their state.

    Rows of JPL's catalogue are left alone: they are closed at its own mass ratio.

    Parameters
    ----------
    path : str or Path
        The table.
    targets : TargetStates
        From `load_target_states`.

    Raises
    ------
    InputFileError
        If an orbit is not closed, or cannot be followed; the message names file and target.
    """
    if not targets.period.any() or is_catalogue(read_lines(path, "target")[0][1]):
        return
    for name, state, period in zip(targets.name, targets.state, targets.period, strict=True):
        if period:
            check_closed(f"{path}, target {name!r}", state, float(period))


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
        check_state(f"{path}, object {name!r}", _MESSAGE, state, "km")
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
    header, rows = named_rows(path, "target")
    position = quantity_columns(path, header, POSITION)
    names = row_names(rows, "target")
    found = [row_position(place, row, position) for place, row in rows]
    return TargetPositions(names, np.array(found))
