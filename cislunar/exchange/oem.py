"""CCSDS Orbit Ephemeris Messages (CCSDS 502.0-B, section 5) in keyword-value notation.

Versions 1 to 3 are read: header (5.2.2), metadata (5.2.3), ephemeris data lines (5.2.4) and
covariance matrices (5.2.5). Accelerations, interpolation hints and comments are ignored. Frames are
the ICRF and those within 0.02 arcsec of it. Truncated files are refused, unlike by the readers on
PyPI (oem 0.4.5, ccsds-ndm 3.1.1).
"""

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import KroghInterpolator

from cislunar.constants import DATE_SYSTEM
from cislunar.ephemeris.time_scales import (
    TIME_SYSTEMS,
    clock_seconds,
    clock_text,
    clock_to_tdb,
    tdb_to_clock,
)
from cislunar.errors import ConfigurationError, InputFileError

Array = NDArray[np.float64]

FRAMES = ("ICRF", "GCRF", "EME2000", "J2000")
"""Values of REF_FRAME that are treated as the ICRF."""

_ORIGINS = {
    "EARTH": "EARTH",
    "MOON": "MOON",
    "EARTH BARYCENTER": "EARTH BARYCENTER",
    "EARTH-MOON BARYCENTER": "EARTH BARYCENTER",
    "EMB": "EARTH BARYCENTER",
}
"""Values of CENTER_NAME, and their names in `cislunar.exchange.inertial.CENTERS`."""

SAME_TIME_S = 2e-6
"""Dates closer than this are equal, because they are written to the microsecond."""

_KEY = re.compile(r"([A-Z][A-Z0-9_]*)\s*=\s*(.*)")
_REQUIRED = (
    "OBJECT_NAME",
    "OBJECT_ID",
    "CENTER_NAME",
    "REF_FRAME",
    "TIME_SYSTEM",
    "START_TIME",
    "STOP_TIME",
)
_LOWER = np.tril_indices(6)


class Segment(NamedTuple):
    """An arc of an object, in the ICRF.

    Attributes
    ----------
    name, object_id : str
        OBJECT_NAME and OBJECT_ID.
    center : str
        Origin, one of `cislunar.exchange.inertial.CENTERS`.
    tdb_s : ndarray, shape (time,)
        TDB seconds past J2000, increasing.
    state : ndarray, shape (time, 6)
        km and km/s.
    covariance_tdb_s : ndarray, shape (matrix,)
        Times of the covariances, TDB seconds past J2000.
    covariance : ndarray, shape (matrix, 6, 6)
        km^2, km^2/s and km^2/s^2.
    """

    name: str
    object_id: str
    center: str
    tdb_s: Array
    state: Array
    covariance_tdb_s: Array = np.empty(0)
    covariance: Array = np.empty((0, 6, 6))


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
    """
    clock_seconds(created)
    lines = ["CCSDS_OEM_VERS = 2.0", *(f"COMMENT {line}" for line in comments)]
    lines += [f"CREATION_DATE = {created}", f"ORIGINATOR = {originator}"]
    for segment in segments:
        dates = [clock_text(each) for each in tdb_to_clock(segment.tdb_s, time_system)]
        values = segment.name, segment.object_id, segment.center, "ICRF", time_system
        lines += ["", "META_START"]
        lines += [
            f"{key} = {value}"
            for key, value in zip(_REQUIRED, (*values, dates[0], dates[-1]), strict=True)
        ]
        lines += ["META_STOP", ""]
        lines += [f"{date} {_row(state)}" for date, state in zip(dates, segment.state, strict=True)]
        if len(segment.covariance):
            lines += ["", "COVARIANCE_START"]
            for each, matrix in zip(
                tdb_to_clock(segment.covariance_tdb_s, time_system), segment.covariance, strict=True
            ):
                lines.append(f"EPOCH = {clock_text(each)}")
                lines += [_row(matrix[row, : row + 1]) for row in range(6)]
            lines.append("COVARIANCE_STOP")
    return "\n".join(lines) + "\n"


def _row(values: Array) -> str:
    return " ".join(f"{value:.16e}" for value in values)


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
    InputFileError
        If the file is not such a message, is truncated, or has a frame, center, time scale or unit
        that cannot be converted. The message names file and line.
    """
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except FileNotFoundError as error:
        raise InputFileError(f"{path}: no such file; give the path of an OEM") from error
    except (OSError, ValueError) as error:
        raise InputFileError(f"{path}: cannot be read as text ({error})") from error
    lines = [(number, line.strip()) for number, line in enumerate(text.splitlines(), 1)]
    lines = [(number, line) for number, line in lines if line and not line.startswith("COMMENT")]
    if not lines or not re.fullmatch(r"CCSDS_OEM_VERS\s*=\s*[123]\.0", lines[0][1]):
        raise InputFileError(
            f"{path}, line 1: not an OEM in keyword-value notation, which begins with "
            "CCSDS_OEM_VERS = 1.0, 2.0 or 3.0; convert the file"
        )
    starts = [at for at, (_, line) in enumerate(lines) if line == "META_START"]
    if not starts:
        raise InputFileError(f"{path}: no META_START; the file is cut short or empty")
    stops = [*starts[1:], len(lines)]
    return [_segment(path, lines[start:stop]) for start, stop in zip(starts, stops, strict=True)]


def _segment(path: str | Path, lines: list[tuple[int, str]]) -> Segment:
    """A segment from its META_START to the line before the next one."""
    words = [line for _, line in lines]
    if "META_STOP" not in words:
        raise InputFileError(f"{path}, line {lines[0][0]}: no META_STOP; the file is cut short")
    end = words.index("META_STOP")
    meta = _metadata(path, lines[0][0], lines[1:end])
    system = meta["TIME_SYSTEM"]
    cut = words.index("COVARIANCE_START") if "COVARIANCE_START" in words else len(words)
    states, dates = [], []
    for number, line in lines[end + 1 : cut]:
        date, *fields = line.split()
        if len(fields) not in (6, 9):
            raise InputFileError(
                f"{path}, line {number}: {len(fields)} numbers after the date where a state has 6 "
                "(km and km/s without units, or 9 with accelerations); complete the line"
            )
        dates.append(_date(f"{path}, line {number}", date, system))
        states.append([_number(f"{path}, line {number}", field) for field in fields[:6]])
        if len(dates) > 1 and not dates[-1] > dates[-2]:
            raise InputFileError(
                f"{path}, line {number}: not later than the line before; sort them"
            )
    stop = _date(f"{path}, STOP_TIME", meta["STOP_TIME"], system)
    if not dates or dates[-1] < stop - SAME_TIME_S:
        raise InputFileError(
            f"{path}, line {lines[cut - 1][0]}: the states of {meta['OBJECT_NAME']} end before "
            f"STOP_TIME = {meta['STOP_TIME']}; the file is cut short; get the complete file"
        )
    tdb, state = np.array(dates), np.array(states)
    _require_units(f"{path}, line {lines[end + 1][0]}", tdb, state)
    covariances = _covariances(path, lines[cut:], system)
    center = _ORIGINS[meta["CENTER_NAME"]]
    return Segment(meta["OBJECT_NAME"], meta["OBJECT_ID"], center, tdb, state, *covariances)


def _metadata(path: str | Path, first: int, lines: list[tuple[int, str]]) -> dict[str, str]:
    """Keywords of a segment, including all required ones, with valid values."""
    meta, line_of = {}, {}
    for number, line in lines:
        found = _KEY.fullmatch(line)
        if not found or found[1] in meta:
            raise InputFileError(
                f"{path}, line {number}: {line[:40]!r} is no keyword, or a second one"
            )
        meta[found[1]], line_of[found[1]] = found[2].strip(), number
    for key in _REQUIRED:
        if not meta.get(key):
            raise InputFileError(f"{path}, line {first}: the segment lacks {key}; add it")
    for key, known in (
        ("REF_FRAME", FRAMES),
        ("CENTER_NAME", _ORIGINS),
        ("TIME_SYSTEM", TIME_SYSTEMS),
    ):
        meta[key] = meta[key].upper()
        if meta[key] not in known:
            raise InputFileError(
                f"{path}, line {line_of[key]}: {key} = {meta[key]} cannot be used; convert to "
                f"one of {', '.join(known)}"
            )
    return meta


def _covariances(
    path: str | Path, lines: list[tuple[int, str]], system: str
) -> tuple[Array, Array]:
    """Times and matrices of the covariance section, which is optional."""
    if not lines:
        return np.empty(0), np.empty((0, 6, 6))
    if lines[-1][1] != "COVARIANCE_STOP":
        raise InputFileError(
            f"{path}, line {lines[-1][0]}: no COVARIANCE_STOP; the file is cut short"
        )
    dates, matrices, rows = [], [], []
    for number, line in lines[1:-1]:
        place, found = f"{path}, line {number}", _KEY.fullmatch(line)
        if found and found[1] == "EPOCH":
            dates.append(_date(place, found[2], system))
        elif found and (found[1] != "COV_REF_FRAME" or found[2].strip().upper() not in FRAMES):
            raise InputFileError(
                f"{place}: {line[:40]} cannot be used; give covariances in {FRAMES[0]}"
            )
        elif not found:
            rows.append([_number(place, field) for field in line.split()])
            if len(rows[-1]) != len(rows) or not dates:
                raise InputFileError(
                    f"{place}: {len(rows[-1])} numbers in row {len(rows)} of a lower triangle"
                )
            if len(rows) == 6:
                matrix = np.zeros((6, 6))
                matrix[_LOWER] = np.concatenate(rows)
                matrices.append(matrix + np.tril(matrix, -1).T)
                rows = []
    if rows or len(dates) != len(matrices):
        raise InputFileError(
            f"{path}, line {lines[-1][0]}: a covariance matrix lacks rows or its EPOCH"
        )
    return np.array(dates), np.array(matrices)


def _date(place: str, text: str, system: str) -> float:
    try:
        return float(clock_to_tdb(clock_seconds(text), system))
    except ConfigurationError as error:
        raise InputFileError(f"{place}: {error}") from error


def _number(place: str, field: str) -> float:
    try:
        value = float(field)
    except ValueError:
        value = float("nan")
    if not np.isfinite(value):
        raise InputFileError(f"{place}: {field!r} must be a finite number")
    return value


def _require_units(place: str, tdb: Array, state: Array) -> None:
    """Refuse positions whose displacements contradict the velocities, as in other units."""
    if len(tdb) < 2:
        return
    moved = np.linalg.norm(np.diff(state[:, :3], axis=0), axis=1)
    expected = np.diff(tdb) * np.linalg.norm(state[1:, 3:] + state[:-1, 3:], axis=1) / 2.0
    ratio = float(np.median(moved) / max(np.median(expected), 1e-300))
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
        Segments of one object.
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
    for each in segments:
        nearest = int(np.argmin(np.abs(each.tdb_s - tdb_s)))
        if abs(each.tdb_s[nearest] - tdb_s) <= SAME_TIME_S:
            return each.state[nearest], each.center
        if each.tdb_s[0] < tdb_s < each.tdb_s[-1]:
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
    spans = ", ".join(f"{clock_text(e.tdb_s[0])} to {clock_text(e.tdb_s[-1])}" for e in segments)
    raise InputFileError(
        f"object {name}: {clock_text(tdb_s)} (TDB) is not within {spans}; choose another epoch"
    )
