"""Maneuvers of true targets: tables, random draws, and the impulses that represent them.

A table is comma-separated, UTF-8, a maneuver to a row:

==================  ================================================================================
column              content
==================  ================================================================================
``target``          name or number of the target
``time_utc``        start of the maneuver, an ISO 8601 date (UTC); or
``time_hours``      start of the maneuver, hours since the start of the run
``dv_1_m_s``        change of velocity along the three axes, m/s
``dv_2_m_s``
``dv_3_m_s``
``axes``            optional, `MANEUVER_AXES`: ``propagation`` (x, y, z of the propagation frame,
                    also for an empty field), ``rtn-earth`` or ``rtn-moon`` (radial, transverse and
                    normal about the body)
``duration_min``    optional, duration of the maneuver, min; 0 or empty: an impulse
==================  ================================================================================

During a burn the thrust acceleration is constant along the axes, and radial, transverse and normal
axes follow the target.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.constants import MU
from cislunar.dynamics.maneuvers import VELOCITY_UNIT_M_S, Impulses, burn_times
from cislunar.ephemeris.time_scales import tdb_seconds, tdb_since
from cislunar.errors import ConfigurationError, InputFileError, did_you_mean, placed
from cislunar.exchange.table_rows import listed, named_rows, row_numbers
from cislunar.runtime import Array, count_of, number_of
from cislunar.targets.maneuver_model import DrawnManeuvers

MANEUVER_AXES = ("propagation", "rtn-earth", "rtn-moon")
"""Axes of a maneuver: of the propagation frame, or radial, transverse, normal about a body."""

_VELOCITY = ("dv_1_m_s", "dv_2_m_s", "dv_3_m_s")
_TIMES = ("time_utc", "time_hours")
_COLUMNS = ("target", *_TIMES, *_VELOCITY, "axes", "duration_min")


class Maneuvers(NamedTuple):
    """Maneuvers of some targets.

    Attributes
    ----------
    target : ndarray of int, shape (maneuver,)
        Index of the target.
    start_s, duration_s : ndarray, shape (maneuver,)
        Start since the start of the run, and duration; s. A duration of 0 is an impulse.
    velocity_m_s : ndarray, shape (maneuver, 3)
        Change of velocity along the axes, m/s.
    axes : ndarray of int, shape (maneuver,)
        Index into `MANEUVER_AXES`.
    """

    target: NDArray[np.int64]
    start_s: Array
    duration_s: Array
    velocity_m_s: Array
    axes: NDArray[np.int64]

    def impulses(self, time_unit_s: float) -> tuple[Impulses, NDArray[np.int64]]:
        """Impulses that represent the maneuvers, with their changes of velocity along the axes of
        the maneuvers, and the maneuver to which each impulse belongs, shape (impulse,)."""
        each = [burn_times(*span) for span in zip(self.start_s, self.duration_s, strict=True)]
        counts = np.array([times.size for times in each], dtype=np.int64)
        of = np.repeat(np.arange(counts.size), counts)
        times = np.concatenate([*each, np.empty(0)])
        order = np.argsort(times, kind="stable")
        of = of[order]
        velocity = self.velocity_m_s[of] / (VELOCITY_UNIT_M_S * counts[of][:, None])
        return Impulses(self.target[of], times[order] / time_unit_s, velocity), of


NO_MANEUVERS = Maneuvers(
    np.empty(0, dtype=np.int64),
    np.empty(0),
    np.empty(0),
    np.empty((0, 3)),
    np.empty(0, dtype=np.int64),
)


def joined_maneuvers(several: Sequence[Maneuvers]) -> Maneuvers:
    """Several sets of maneuvers as one."""
    return Maneuvers(*map(np.concatenate, zip(NO_MANEUVERS, *several, strict=True)))


class ManeuverTable(NamedTuple):
    """Maneuvers by a table.

    Attributes
    ----------
    name : list of str
        Target of each maneuver, as the table names it.
    place : list of str
        File and row of each maneuver, for messages.
    maneuvers : Maneuvers
        Their `target` is the position in `name`.
    """

    name: list[str]
    place: list[str]
    maneuvers: Maneuvers

    def require_known(self, known: Collection[str], which: str) -> None:
        """Raise an `InputFileError` for a target that is not among `known`; `which` says of what
        the known targets are."""
        for name, place in zip(self.name, self.place, strict=True):
            if name not in known:
                remedy = did_you_mean(name, known) or "give its name, or its number from 0 on"
                raise InputFileError(f"{place}: there is no such target of {which}; {remedy}")

    def of_targets(self, names: Sequence[Sequence[str]]) -> "ManeuverTable":
        """The maneuvers of some targets, given by all the names of each. Raises an `InputFileError`
        if burns of a target, which the table may name differently, overlap."""
        index = {name: j for j, own in enumerate(names) for name in own}
        rows = [k for k, name in enumerate(self.name) if name in index]
        target = np.array([index[self.name[k]] for k in rows], dtype=np.int64)
        given = Maneuvers(*(column[rows] for column in self.maneuvers))._replace(target=target)
        name, place = ([column[k] for k in rows] for column in (self.name, self.place))
        found = ManeuverTable(name, place, given)
        found.require_separate()
        return found

    def require_separate(self) -> None:
        """Raise an `InputFileError` if burns of a target overlap, or impulses coincide."""
        start, duration = self.maneuvers.start_s, self.maneuvers.duration_s
        last: dict[int, int] = {}
        for k in np.argsort(start, kind="stable"):
            before = last.get(self.maneuvers.target[k])
            if before is not None and (
                start[k] < start[before] + duration[before] or start[k] == start[before]
            ):
                raise InputFileError(
                    f"{self.place[k]}: overlaps the maneuver of {self.place[before]}; shorten or "
                    "move one of them, or join them"
                )
            last[self.maneuvers.target[k]] = k

    def require_bound(self, step_s: float, position: Array, primaries: Array) -> None:
        """Refuse changes of velocity that exceed the escape speed at the target.

        Parameters
        ----------
        step_s : float
            Time between positions, s.
        position : ndarray, shape (maneuver, time, 3)
            Expected positions of the target of each maneuver since the start of the run,
            nondimensional, propagation frame.
        primaries : ndarray, shape (time, 2, 3)
            Centers of Earth and Moon, nondimensional, propagation frame.

        Raises
        ------
        InputFileError
            If a change of velocity is at least as large as the escape speed from Earth and Moon,
            ``sqrt(2 (1 - mu) / r_1 + 2 mu / r_2)``, at the expected position at its start.
        """
        for k, place in enumerate(self.place):
            at = min(round(self.maneuvers.start_s[k] / step_s), position.shape[1] - 1)
            r1, r2 = np.linalg.norm(position[k, at] - primaries[at], axis=1)
            escape = VELOCITY_UNIT_M_S * np.sqrt(2.0 * ((1.0 - MU) / r1 + MU / r2))
            size = np.linalg.norm(self.maneuvers.velocity_m_s[k])
            if not size < escape:
                raise InputFileError(
                    f"{place}: a change of velocity of {size:,.0f} m/s exceeds the escape speed "
                    f"of {escape:,.0f} m/s from where the target is; the columns are in m/s"
                )


def load_maneuvers(
    path: str | Path, duration_hours: float, start_tdb_s: float | None = None
) -> ManeuverTable:
    """Read and check a table of maneuvers; the module describes its columns.

    Parameters
    ----------
    path : str or Path
    duration_hours : float
        Duration of the run, h.
    start_tdb_s : float, optional
        Start of the run, TDB seconds past J2000; needed for dates.

    Returns
    -------
    ManeuverTable
        In the order of the file.

    Raises
    ------
    ConfigurationError
        If `path` is not a path.
    InputFileError
        If the table is faulty, or a maneuver is not within the run or overlaps another one of its
        target. The message names the file and the row as an editor numbers it.
    """
    header, rows = named_rows(path, "maneuver", "target")
    _check_header(path, header)
    names, places, values = [], [], []
    for place, row in rows:
        if not row["target"]:
            raise InputFileError(f"{place}: the maneuver has no target; give its name")
        start_s = _start_s(place, row, start_tdb_s)
        velocity = row_numbers(place, row, (_VELOCITY, 1.0))
        minutes = (
            row_numbers(place, row, (("duration_min",), 1.0))[0] if row.get("duration_min") else 0.0
        )
        axes = row.get("axes") or MANEUVER_AXES[0]
        if axes not in MANEUVER_AXES:
            raise InputFileError(f"{place}: axes = {axes!r} is none of {', '.join(MANEUVER_AXES)}")
        if minutes < 0.0:
            raise InputFileError(f"{place}: duration_min = {minutes:g} must not be negative")
        if not np.any(velocity):
            raise InputFileError(f"{place}: its change of velocity is zero; remove the row")
        end_s, run_s = start_s + 60.0 * minutes, 3600.0 * duration_hours
        if start_s < 0.0 or start_s >= run_s or end_s > run_s * (1.0 + 1e-12):
            raise InputFileError(
                f"{place}: the maneuver, from hour {start_s / 3600.0:g} to {end_s / 3600.0:g}, is "
                f"not within the run of {duration_hours:g} h"
            )
        names.append(row["target"])
        places.append(place)
        values.append((start_s, 60.0 * minutes, velocity, MANEUVER_AXES.index(axes)))
    start, duration, velocity, axes = zip(*values, strict=True)
    number = {name: k for k, name in reversed([*enumerate(names)])}
    target = np.array([number[name] for name in names], dtype=np.int64)
    columns = np.array(start), np.array(duration), np.array(velocity), np.array(axes)
    ManeuverTable(names, places, found := Maneuvers(target, *columns)).require_separate()
    return ManeuverTable(names, places, found._replace(target=np.arange(len(names))))


def _check_header(path: str | Path, header: list[str]) -> None:
    """Refuse missing and unknown columns, and times in two columns."""
    for column in header:
        if column not in _COLUMNS:
            remedy = did_you_mean(column, _COLUMNS) or f"use {', '.join(_COLUMNS)}"
            raise InputFileError(f"{path}, row 1: column {column!r} is unknown; {remedy}")
    lacking = [column for column in _VELOCITY if column not in header]
    if lacking:
        raise InputFileError(f"{path}, row 1: no column {lacking[0]}; it has {listed(header)}")
    if len([column for column in _TIMES if column in header]) != 1:
        raise InputFileError(f"{path}, row 1: give one of the columns {' and '.join(_TIMES)}")


def _start_s(place: str, row: Mapping[str, str], start_tdb_s: float | None) -> float:
    """Start of the maneuver of a row since the start of the run, s."""
    if "time_hours" in row:
        return 3600.0 * row_numbers(place, row, (("time_hours",), 1.0))[0]
    if start_tdb_s is None:
        raise InputFileError(f"{place}: a date needs the start of the run; use time_hours")
    with placed(place, ConfigurationError, InputFileError):
        # to the millisecond: seconds past J2000 are rounded to about a microsecond
        return round(float(tdb_since(start_tdb_s, tdb_seconds(row["time_utc"]))), 3)


def draw_maneuvers(
    kinds: Sequence[DrawnManeuvers],
    n_targets: int,
    duration_hours: float,
    generator: Callable[[int, int], np.random.Generator],
) -> Maneuvers:
    """Draw maneuvers of one realization.

    Parameters
    ----------
    kinds : sequence of DrawnManeuvers
    n_targets : int
    duration_hours : float
        Duration of the run, h.
    generator : callable
        Returns the generator of a target and a kind, given their indices. The maneuvers of a target
        therefore do not depend on other targets and kinds, and a larger share adds targets.

    Returns
    -------
    Maneuvers

    Raises
    ------
    ConfigurationError
        If a maneuver that starts in the window of a kind may end after the run, the duration is
        not a positive number, or the number of targets is impossible.
    """
    number_of("duration_hours", duration_hours, positive=True)
    count_of("n_targets", n_targets, least=0)
    found = []
    for number, kind in enumerate(kinds):
        first, last = kind.window(duration_hours)
        for j in range(n_targets):
            rng = generator(j, number)
            chosen, phase = rng.random(2)
            if chosen >= kind.share:
                continue
            if kind.interval_hours is None:
                start = np.array([first + phase * (last - first)])
            else:
                begin = first + phase * kind.interval_hours
                start = np.arange(begin, last, kind.interval_hours)
            # row by row, so that a longer run keeps the maneuvers of a shorter one
            draw, axial, azimuth = rng.random((start.size, 3)).T * [[1.0], [2.0], [2.0 * np.pi]]
            size = kind.smallest_m_s * (kind.largest_m_s / kind.smallest_m_s) ** draw
            z = axial - 1.0
            across = np.sqrt(1.0 - z * z)
            way = np.stack([across * np.cos(azimuth), across * np.sin(azimuth), z], axis=1)
            found.append(
                Maneuvers(
                    np.full(start.size, j),
                    3600.0 * start,
                    np.full(start.size, 60.0 * kind.duration_minutes),
                    size[:, None] * way,
                    np.zeros(start.size, dtype=np.int64),
                )
            )
    return joined_maneuvers(found)
