"""CCSDS Orbit Ephemeris Messages (CCSDS 502.0-B, section 5) in keyword-value notation.

Versions 1 to 3 are read: header (5.2.2), metadata (5.2.3), ephemeris data lines (5.2.4) and
covariance matrices (5.2.5). Accelerations, interpolation hints and comments are ignored.
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.interpolate import KroghInterpolator

from cislunar.constants import DATE_SYSTEM
from cislunar.ephemeris.time_scales import clock_text
from cislunar.errors import ConfigurationError, InputFileError
from cislunar.exchange import key_values as kvn
from cislunar.exchange.table_rows import read_number
from cislunar.runtime.arguments import Array, array_of

_REQUIRED = (
    *("OBJECT_NAME", "OBJECT_ID", "CENTER_NAME", "REF_FRAME", "TIME_SYSTEM", "START_TIME"),
    "STOP_TIME",
)
_PARTS = slice(3), slice(3, 6)
USEABLE = ("USEABLE_START_TIME", "USEABLE_STOP_TIME")


class Segment(NamedTuple):
    """An arc of an object, in the ICRF.

    Attributes
    ----------
    name, object_id : str
        OBJECT_NAME and OBJECT_ID.
    center : str
        Origin, one of `cislunar.exchange.CENTERS`.
    tdb_s : ndarray, shape (time,)
        TDB seconds past J2000, increasing.
    state : ndarray, shape (time, 6)
        km and km/s.
    covariance_tdb_s : ndarray, shape (matrix,)
        Times of the covariances, TDB seconds past J2000.
    covariance : ndarray, shape (matrix, 6, 6)
        km^2, km^2/s and km^2/s^2.
    useable_tdb_s : tuple of float, optional
        First and last time at which the arc holds, TDB seconds past J2000; states outside of it
        serve its interpolation alone. None: from the first to the last state.
    """

    name: str
    object_id: str
    center: str
    tdb_s: Array
    state: Array
    covariance_tdb_s: Array = np.empty(0)
    covariance: Array = np.empty((0, 6, 6))
    useable_tdb_s: tuple[float, float] | None = None

    @property
    def span(self) -> tuple[float, float]:
        """First and last time at which the arc holds, TDB seconds past J2000."""
        return self.useable_tdb_s or (float(self.tdb_s[0]), float(self.tdb_s[-1]))


def oem_text(
    segments: Iterable[Segment],
    *,
    created: str,
    comments: Sequence[str] = (),
    originator: str = "CISLUNAR",
    time_system: str = DATE_SYSTEM,
) -> str:
    """Text of a message, version 2.0; its numbers have 17 digits and are read back unchanged.

    Parameters
    ----------
    segments : iterable of Segment
        Arcs, in order.
    created : str
        CREATION_DATE, ISO 8601, UTC.
    comments : sequence of str
        Lines of the header, such as the dynamical model and the axes of the states.
    originator : str
        ORIGINATOR.
    time_system : {"UTC", "TAI", "TT", "TDB"}
        Time scale of the dates, which are written to the microsecond.

    Returns
    -------
    str

    Raises
    ------
    ConfigurationError
        If `created` is no date, the time scale is unknown, a UTC date lies before 1972, a name is
        not a printable text of one line, there is no segment, or one cannot be written (see
        `require_segment`).
    """
    lines = kvn.header("OEM", "2.0", created, comments, originator)
    if not (given := list(segments)):
        raise ConfigurationError("segments is empty; give at least one")
    for segment in given:
        require_segment(segment)
        dated = kvn.dates(segment.tdb_s, time_system)
        values = segment.name, segment.object_id, segment.center, kvn.FRAMES[0], time_system
        meta = dict(zip(_REQUIRED, (*values, dated[0], dated[-1]), strict=True))
        if segment.useable_tdb_s:
            stop = meta.pop("STOP_TIME")
            meta |= dict(zip(USEABLE, kvn.dates(segment.span, time_system), strict=True))
            meta["STOP_TIME"] = stop
        data = kvn.dated_rows(segment.tdb_s, time_system, segment.state)
        lines += ["", *kvn.block("META", meta), "", *data]
        if len(segment.covariance):
            matrices = []
            for date, matrix in zip(
                kvn.dates(segment.covariance_tdb_s, time_system), segment.covariance, strict=True
            ):
                rows = [kvn.number_row(matrix[row, : row + 1]) for row in range(6)]
                matrices += [f"EPOCH = {date}", *rows]
            lines += ["", *kvn.block("COVARIANCE", {}, matrices)]
    return "\n".join(lines) + "\n"


def require_segment(segment: Segment) -> None:
    """Raise a `ConfigurationError` if a segment has no state, times that do not increase, values
    that are not finite, or arrays of the wrong shape."""
    of = f"of {segment.name}"
    state = array_of(f"state {of}", segment.state, ("time", 6))
    kvn.require_times(f"tdb_s {of}", segment.tdb_s, len(state))
    if len(segment.covariance):
        matrices = array_of(f"covariance {of}", segment.covariance, ("time", 6, 6))
        kvn.require_times(f"covariance_tdb_s {of}", segment.covariance_tdb_s, len(matrices))


def read_oem(path: str | Path) -> list[Segment]:
    """Read a message in keyword-value notation.

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    list of Segment
        In the order of the file.

    Raises
    ------
    ConfigurationError
        If `path` is not a path.
    InputFileError
        If the file is not such a message, is truncated, or has a frame, center, time scale or unit
        that cannot be converted. The message names file and line.
    """
    lines = kvn.message_lines(path, "OEM", ("1.0", "2.0", "3.0"))
    return [_segment(path, each) for each in kvn.segments_of(path, lines)]


def objects_of(path: str | Path) -> dict[str, list[Segment]]:
    """Segments of the objects of a message by name; by identifier if the name is unknown, and by
    both if several objects have the name. See `read_oem` for the errors raised."""
    segments = read_oem(path)
    labels = {(each.name, each.object_id) for each in segments}
    names = [name for name, _ in labels]
    found: dict[str, list[Segment]] = {}
    for each in segments:
        name = each.name
        if name == kvn.UNKNOWN:
            name = each.object_id
        elif names.count(name) > 1:
            name = f"{name} {each.object_id}"
        found.setdefault(name, []).append(each._replace(name=name))
    return found


def _segment(path: str | Path, lines: kvn.Lines) -> Segment:
    """A segment from its META_START to the line before the next one."""
    metadata, rest = kvn.cut(path, lines, "META")
    meta = kvn.assignments(
        path, lines[0][0], metadata, _REQUIRED, {"REF_FRAME": kvn.FRAMES, **kvn.KNOWN}
    )
    system = meta["TIME_SYSTEM"]
    words = [line for _, line in rest]
    end = words.index("COVARIANCE_START") if "COVARIANCE_START" in words else len(rest)
    row = "a state has 6 (km and km/s without units, or 9 with accelerations)"
    tdb, state = kvn.timed_rows(path, rest[:end], system, (6, 9), row)
    kvn.require_stop(path, rest[:end] or lines, meta, tdb, "states")
    require_units(f"{path}, line {rest[0][0]}", tdb, state)
    covariances = _covariances(path, rest[end:], system)
    center, names = kvn.ORIGINS[meta["CENTER_NAME"]], (meta["OBJECT_NAME"], meta["OBJECT_ID"])
    found = Segment(*names, center, tdb, state, *covariances)
    return with_useable_span(f"{path}, line {lines[0][0]}", found, meta, system)


def with_useable_span(
    place: str,
    arc: Segment,
    meta: Mapping[str, str],
    system: str,
    zero_tdb_s: float | None = None,
) -> Segment:
    """An arc with the useable span that its metadata state, if they do; for `system` and
    `zero_tdb_s` see `cislunar.exchange.key_values.read_date`."""
    if not any(key in meta for key in USEABLE):
        return arc
    first, last = (
        kvn.read_date(f"{place}, {key}", meta[key], system, zero_tdb_s) if key in meta else end
        for key, end in zip(USEABLE, arc.span, strict=True)
    )
    if not arc.span[0] - kvn.SAME_TIME_S <= first <= last <= arc.span[1] + kvn.SAME_TIME_S:
        raise InputFileError(
            f"{place}: {' and '.join(USEABLE)} must be in order and within the states; correct them"
        )
    return arc._replace(useable_tdb_s=(first, last))


def _covariances(path: str | Path, lines: kvn.Lines, system: str) -> tuple[Array, Array]:
    """Times and matrices of the covariance section, which is optional."""
    if not lines:
        return np.empty(0), np.empty((0, 6, 6))
    inside, after = kvn.cut(path, lines, "COVARIANCE")
    if after:
        raise InputFileError(
            f"{path}, line {after[0][0]}: {after[0][1][:40]!r} after COVARIANCE_STOP; give the "
            "covariances of a segment in one section"
        )
    times, matrices, rows = [], [], []
    for number, line in inside:
        place, found = f"{path}, line {number}", kvn.assignment(line)
        if found and found[0] == "EPOCH":
            times.append(kvn.read_date(place, found[1], system))
        elif found and (found[0] != "COV_REF_FRAME" or found[1].upper() not in kvn.FRAMES):
            raise InputFileError(
                f"{place}: {line[:40]} cannot be used; give covariances in {kvn.FRAMES[0]}"
            )
        elif not found:
            rows.append([read_number(place, field) for field in line.split()])
            if len(rows[-1]) != len(rows) or not times:
                raise InputFileError(
                    f"{place}: {len(rows[-1])} numbers in row {len(rows)} of a lower triangle"
                )
            if len(rows) == 6:
                matrices.append(kvn.from_lower_triangle(np.concatenate(rows)))
                rows = []
    if rows or len(times) != len(matrices):
        raise InputFileError(
            f"{path}, line {lines[-1][0]}: a covariance matrix lacks rows or its EPOCH; "
            "get the complete file"
        )
    return np.array(times), np.array(matrices)


def require_units(place: str, tdb: Array, state: Array) -> None:
    """Refuse positions whose displacements contradict the velocities, as in other units."""
    if len(tdb) < 2:
        return
    moved = np.linalg.norm(np.diff(state[:, :3], axis=0), axis=1)
    expected = np.diff(tdb) * np.linalg.norm(state[1:, 3:] + state[:-1, 3:], axis=1) / 2.0
    distance, speed = (np.linalg.norm(state[:-1, part], axis=1) for part in _PARTS)
    # steps of a large part of a revolution, or of several, say nothing
    long = (np.diff(tdb) * speed > 0.5 * distance) & (distance > 1e3) & (speed < 20.0)
    if long.all():
        return
    ratio = float(np.median(moved[~long]) / max(np.median(expected[~long]), 1e-300))
    if not 0.01 < ratio < 30.0:
        raise InputFileError(
            f"{place}: positions move {ratio:.3g} times as far as their velocities imply; an OEM "
            "has km and km/s, convert the file"
        )


def state_at(segments: Sequence[Segment], tdb_s: float) -> tuple[Array, str]:
    """State of an object at a time, from its segments.

    Parameters
    ----------
    segments : sequence of Segment
        Arcs of the object.
    tdb_s : float
        TDB seconds past J2000.

    Returns
    -------
    state : ndarray, shape (6,)
        ICRF, km and km/s; Hermite interpolation of the four nearest states unless one has that
        time.
    center : str
        Its origin.

    Raises
    ------
    InputFileError
        If no segment covers the time.
    """
    same = kvn.SAME_TIME_S
    covering = [each for each in segments if each.span[0] - same <= tdb_s <= each.span[1] + same]
    if covering:
        each = max(covering, key=lambda segment: segment.span[0])  # after a maneuver, not before it
        nearest = int(np.argmin(np.abs(each.tdb_s - tdb_s)))
        if abs(each.tdb_s[nearest] - tdb_s) <= same:
            return each.state[nearest], each.center
        if each.tdb_s.size > 1:
            low = max(0, min(int(np.searchsorted(each.tdb_s, tdb_s)) - 2, each.tdb_s.size - 4))
            near = slice(low, low + 4)
            since, states = each.tdb_s[near] - tdb_s, each.state[near]
            span = since[-1] - since[0]  # of order one, for the divided differences
            path = KroghInterpolator(
                np.repeat(since / span, 2),
                np.stack([states[:, :3], states[:, 3:] * span], axis=1).reshape(-1, 3),
            )
            return np.concatenate([path(0.0), path.derivative(0.0) / span]), each.center
    name = segments[0].name
    spans = ", ".join(" to ".join(map(clock_text, each.span)) for each in segments)
    raise InputFileError(
        f"object {name}: {clock_text(tdb_s)} (TDB) is not within {spans}; choose another epoch"
    )
