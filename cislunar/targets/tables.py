"""Tables of user-defined targets: moving ones with states at the epoch, static ones with positions.

The tables are comma-separated, UTF-8, with one target per row. Positions and velocities are in the
rotating barycentric frame (x from the Earth to the Moon, z along the angular momentum). The header
determines the unit:

==================  ==============================  ==========================================
quantity            nondimensional                  in kilometers and seconds
==================  ==============================  ==========================================
name of the target  ``id``                          ``id``
position            ``x, y, z``                     ``x_km, y_km, z_km``
velocity            ``vx, vy, vz``                  ``vx_km_s, vy_km_s, vz_km_s``
period, optional    ``period``                      ``period_days``
class, optional     ``family``                      ``family``
==================  ==============================  ==========================================

Velocities are relative to the rotating frame. A target without a period is at its state at the
epoch. A target with a period starts at a random point of its orbit, like the paper's targets.
Columns ``frame`` and ``center``, as `cislunar orbits` writes them, must be rotating and EARTH
BARYCENTER, and dates are refused. Other columns are ignored.

Moving targets may also be rows of JPL's catalog (`cislunar.exchange.catalog`), each at a random
point of its orbit, or a CCSDS OEM, a file named ``*.oem`` (`cislunar.exchange.oem`), with each
object at its state at the epoch.
"""

import csv
import io
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cislunar.errors import ConfigurationError, InputFileError
from cislunar.exchange import (
    CATALOG_COLUMNS,
    DATE_COLUMNS,
    EARTH_MOON_CENTER,
    ORIGINS,
    Epoch,
    is_catalog,
    read_catalog,
    rotating_state_at,
)
from cislunar.exchange.oem import objects_of
from cislunar.exchange.table_rows import (
    OWN_FAMILY,
    PERIOD,
    POSITION,
    VELOCITY,
    Row,
    check_closed,
    check_state,
    named_rows,
    quantity_columns,
    read_lines,
    row_names,
    row_period,
    row_position,
    row_state,
)
from cislunar.runtime import Array, number_of, require_path

_DATED = ("time_scale", *DATE_COLUMNS)
"""Columns of tables whose states belong to dates."""


class TargetStates(NamedTuple):
    """Moving targets.

    Attributes
    ----------
    name, family : list of str
        Name and class of each target.
    state : ndarray, shape (target, 6)
        State at the epoch, nondimensional, rotating frame.
    period : ndarray, shape (target,)
        Nondimensional; 0 for a target that starts at its state.
    """

    name: list[str]
    family: list[str]
    state: Array
    period: Array

    def __len__(self) -> int:
        return len(self.name)


def is_message(path: str | Path) -> bool:
    """Whether a file of moving targets is an OEM, whose states depend on the epoch."""
    require_path("path", path)
    return Path(path).suffix.lower() == ".oem"


def load_target_states(path: str | Path, epoch: Epoch | None = None) -> TargetStates:
    """Read and check a table of moving targets, rows of JPL's catalog, or an OEM.

    Parameters
    ----------
    path : str or Path
        The file.
    epoch : Epoch, optional
        Epoch and axes for the states of an OEM; tables need none.

    Returns
    -------
    TargetStates
        In the order of the file.

    Raises
    ------
    ConfigurationError
        If `path` is not a path.
    InputFileError
        If the table or a row is unusable: a number in a wrong unit (`cislunar.dynamics.bounds`), a
        target inside the Earth or the Moon, or an OEM that does not cover the epoch. The message
        names the file, the row (the header is row 1) and the target.
    """
    if is_message(path):
        return _of_message(path, epoch)
    first = read_lines(path, "target")[:1]
    if first and is_catalog(first[0][1]):
        found = read_catalog(path)
        for name, state in zip(found.name, found.state, strict=True):
            check_state(f"{path}, Id {name!r}", CATALOG_COLUMNS, state, "")
        return TargetStates(found.name, [OWN_FAMILY] * len(found.name), found.state, found.period)
    header, rows = _rows(path)
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

    Rows of JPL's catalog are not checked, because they are closed at its own mass ratio.

    Parameters
    ----------
    path : str or Path
        The table.
    targets : TargetStates
        From `load_target_states`.

    Raises
    ------
    InputFileError
        If an orbit is not closed, or cannot be propagated; the message names file and target.
    """
    if not targets.period.any() or is_catalog(read_lines(path, "target")[0][1]):
        return
    for name, state, period in zip(targets.name, targets.state, targets.period, strict=True):
        if period:
            check_closed(f"{path}, target {name!r}", state, float(period))


def target_states_csv(targets: TargetStates) -> str:
    """Table of moving targets, as text that `load_target_states` reads back unchanged.

    Parameters
    ----------
    targets : TargetStates

    Returns
    -------
    str
        Columns ``id, family, x, y, z, vx, vy, vz, period``, nondimensional.
    """
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(["id", "family", *POSITION[0], *VELOCITY[0], *PERIOD[0]])
    for name, family, state, period in zip(*targets, strict=True):
        table.writerow([name, family, *state.tolist(), float(period) or ""])
    return text.getvalue()


def replace_targets(
    targets: TargetStates, others: TargetStates, share: float, rng: np.random.Generator
) -> TargetStates:
    """Replace a share of moving targets, chosen at random, by the first of other targets.

    Parameters
    ----------
    targets, others : TargetStates
    share : float
        From 0 to 1; the number of replaced targets is rounded.
    rng : numpy.random.Generator

    Returns
    -------
    TargetStates
        As many as `targets`. The rows that are replaced for a share are also replaced for a larger
        one, if the generator is in the same state.

    Raises
    ------
    ConfigurationError
        If the share is impossible, there are too few other targets, or names occur twice.
    """
    if not 0.0 <= number_of("share", share) <= 1.0:
        raise ConfigurationError(f"share = {share} must be between 0 and 1")
    count = round(share * len(targets))
    if count > len(others):
        raise ConfigurationError(
            f"share = {share} of {len(targets)} targets needs {count} others; {len(others)} given"
        )
    source: list[tuple[TargetStates, int]] = [(targets, k) for k in range(len(targets))]
    for number, k in enumerate(rng.permutation(len(targets))[:count].tolist()):
        source[k] = others, number
    names = [each.name[k] for each, k in source]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ConfigurationError(f"targets: the name {twice[0]!r} occurs twice; rename one")
    return TargetStates(
        names,
        [each.family[k] for each, k in source],
        np.array([each.state[k] for each, k in source]),
        np.array([each.period[k] for each, k in source]),
    )


def _of_message(path: str | Path, epoch: Epoch | None) -> TargetStates:
    """Objects of an OEM at the epoch; segments with the same name belong to one object."""
    if epoch is None:
        raise InputFileError(f"{path}: an OEM has states at many times; give the epoch")
    objects = objects_of(path)
    states = [rotating_state_at(str(path), each, epoch) for each in objects.values()]
    families = [OWN_FAMILY] * len(states)
    return TargetStates(list(objects), families, np.array(states), np.zeros(len(states)))


def _rows(path: str | Path) -> tuple[list[str], list[tuple[str, Row]]]:
    """Header and rows of a table, which must not say that its states are in another frame."""
    header, rows = named_rows(path, "target")
    remedy = "give inertial states as an OEM (*.oem) or as icrf_km of a study"
    for column in header:
        if column.lower() in _DATED:
            raise InputFileError(
                f"{path}, row 1: column {column}: a table has states at the epoch, rotating frame; "
                f"remove the column, or {remedy}"
            )
    for place, row in rows:
        stated = {name.lower(): text for name, text in row.items()}
        frame, center = stated.get("frame", ""), stated.get("center", "")
        if frame.lower() not in ("", "rotating"):
            raise InputFileError(f"{place}: frame = {frame!r} must be rotating; {remedy}")
        if center and ORIGINS.get(center.upper()) != EARTH_MOON_CENTER:
            raise InputFileError(
                f"{place}: center = {center!r} must be {EARTH_MOON_CENTER}; {remedy}"
            )
    return header, rows


def load_target_positions(path: str | Path) -> tuple[list[str], Array]:
    """Names and positions (target, 3) of static targets from a table, in which velocity columns are
    ignored. Positions are nondimensional, in the rotating frame, and in the order of the file. For
    the errors see `load_target_states`."""
    header, rows = _rows(path)
    position = quantity_columns(path, header, POSITION)
    names = row_names(rows, "target")
    found = [row_position(place, row, position) for place, row in rows]
    return names, np.array(found)
