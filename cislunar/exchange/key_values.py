"""Keyword-value notation of CCSDS messages: lines, metadata, dates and numbers.

Used by the orbit ephemeris, orbit comprehensive, tracking data and attitude ephemeris messages of
this package. Lines of comments are skipped. Frames are the ICRF and those within 0.024 arcsec of
it. Truncated files are refused in one line that names the place, unlike by the readers on PyPI (oem
0.4.5, ccsds-ndm 3.1.1).
"""

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from cislunar.dynamics.frames import BARYCENTER
from cislunar.ephemeris.time_scales import (
    TIME_SYSTEMS,
    clock_seconds,
    clock_text,
    clock_to_tdb,
    tdb_after,
    tdb_to_clock,
)
from cislunar.errors import ConfigurationError, InputFileError, placed
from cislunar.exchange.table_rows import read_number
from cislunar.runtime.arguments import Array, array_of, require_path

Lines = list[tuple[int, str]]
"""Lines of a message without blanks and comments, with their numbers."""

FRAMES = ("ICRF", "GCRF", "EME2000", "J2000")
"""Names of frames that are treated as the ICRF."""

EARTH_MOON_CENTER = "EARTH BARYCENTER"
"""CENTER_NAME of the barycenter of Earth and Moon."""

CENTERS = {"EARTH": "earth", "MOON": "moon", EARTH_MOON_CENTER: BARYCENTER}
"""Origins of states by CENTER_NAME, and their names in `cislunar.dynamics.frames`."""

ORIGINS = {name: name for name in CENTERS} | {
    "EARTH-MOON BARYCENTER": EARTH_MOON_CENTER,
    "EMB": EARTH_MOON_CENTER,
}
"""Values of CENTER_NAME that are read, and their names in `CENTERS`."""

SAME_TIME_S = 2e-6
"""Dates closer than this are equal, because they are written to the microsecond."""

UNKNOWN = "UNKNOWN"
"""Name of an object without a name."""

KNOWN = {"CENTER_NAME": ORIGINS, "TIME_SYSTEM": TIME_SYSTEMS}
"""Keywords of metadata of which only some values can be used."""

_KEY = re.compile(r"([A-Z][A-Z0-9_]*)\s*=\s*(.*)")
_LOWER = np.tril_indices(6)


def header(
    kind: str, version: str, created: str, comments: Sequence[str], originator: str
) -> list[str]:
    """Lines of the header of a message of a `kind` such as "OEM"."""
    clock_seconds(created)
    return [
        f"CCSDS_{kind}_VERS = {version}",
        *(f"COMMENT {line}" for line in comments),
        f"CREATION_DATE = {created}",
        f"ORIGINATOR = {originator}",
    ]


def block(name: str, values: Mapping[str, object], lines: Iterable[str] = ()) -> list[str]:
    """A section ``NAME_START`` to ``NAME_STOP`` with assignments and lines of data."""
    for key, value in values.items():
        # a value that begins a new line would become a keyword of its own
        if not str(value).strip() or not str(value).isprintable():
            raise ConfigurationError(f"{key} = {str(value)!r} must be a printable text of one line")
    given = [f"{key} = {value}" for key, value in values.items()]
    return [f"{name}_START", *given, *lines, f"{name}_STOP"]


def number_row(values: Iterable[float]) -> str:
    """Numbers with 17 digits, which are read back unchanged."""
    return " ".join(f"{value:.16e}" for value in values)


def dates(tdb_s: ArrayLike, time_system: str) -> list[str]:
    """ISO 8601 dates in a time scale, to the microsecond, at TDB seconds past J2000.

    Raises
    ------
    ConfigurationError
        If the time scale is unknown, or a UTC date lies before 1972.
    """
    return [clock_text(each) for each in tdb_to_clock(tdb_s, time_system).tolist()]


def dated_rows(tdb_s: ArrayLike, time_system: str, rows: Iterable[Iterable[float]]) -> list[str]:
    """Lines of data with a date and numbers."""
    dated = zip(dates(tdb_s, time_system), rows, strict=True)
    return [f"{date} {number_row(row)}" for date, row in dated]


def lower_triangle(matrix: Array) -> Array:
    """The 21 elements of the lower triangle of a covariance (6, 6), row by row."""
    return matrix[_LOWER]


def from_lower_triangle(elements: ArrayLike) -> Array:
    """The symmetric matrix (6, 6) of `lower_triangle`."""
    matrix = np.zeros((6, 6))
    matrix[_LOWER] = elements
    return matrix + np.tril(matrix, -1).T


def require_times(name: str, tdb_s: ArrayLike, rows: int) -> None:
    """Raise a `ConfigurationError` if times `name` are not finite, do not increase, or are not as
    many as `rows`."""
    if np.any(np.diff(array_of(name, tdb_s, (rows,))) <= 0.0):
        raise ConfigurationError(f"{name} does not increase; sort the rows by time")


def read_text(path: str | Path, what: str) -> str:
    """Text of a file in UTF-8; raises an `InputFileError` if there is none, and a
    `ConfigurationError` if `path` is not a path."""
    require_path("path", path)
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except FileNotFoundError as error:
        raise InputFileError(f"{path}: no such file; give the path of {what}") from error
    except (OSError, ValueError) as error:
        raise InputFileError(f"{path}: cannot be read as text ({error})") from error


def message_lines(path: str | Path, kind: str, versions: Sequence[str]) -> Lines:
    """Lines of a message of a `kind` such as "OEM"; raises an `InputFileError` if the file cannot
    be read, or does not begin with one of the `versions`."""
    text = read_text(path, f"an {kind}")
    lines = [(number, line.strip()) for number, line in enumerate(text.splitlines(), 1)]
    lines = [(number, line) for number, line in lines if line and line.split()[0] != "COMMENT"]
    key, _, version = lines[0][1].partition("=") if lines else ("", "", "")
    if key.strip() != f"CCSDS_{kind}_VERS" or version.strip() not in versions:
        raise InputFileError(
            f"{path}, line 1: not an {kind} in keyword-value notation, which begins with "
            f"CCSDS_{kind}_VERS = {' or '.join(versions)}; convert the file"
        )
    return lines


def segments_of(path: str | Path, lines: Lines) -> list[Lines]:
    """Lines of each segment, from its META_START to the line before the next one."""
    starts = [at for at, (_, line) in enumerate(lines) if line == "META_START"]
    if not starts:
        raise InputFileError(f"{path}: no META_START; the file is cut short or empty")
    stops = [*starts[1:], len(lines)]
    return [lines[start:stop] for start, stop in zip(starts, stops, strict=True)]


def cut(path: str | Path, lines: Lines, name: str) -> tuple[Lines, Lines]:
    """Content of the section ``NAME_START`` to ``NAME_STOP`` with which the lines begin, and the
    lines after it."""
    words = [line for _, line in lines]
    if words[:1] != [f"{name}_START"]:
        number, word = lines[0] if lines else ("last", "the end of the file")
        raise InputFileError(f"{path}, line {number}: {word[:40]!r} where {name}_START must stand")
    if f"{name}_STOP" not in words:
        raise InputFileError(f"{path}, line {lines[0][0]}: no {name}_STOP; the file is cut short")
    end = words.index(f"{name}_STOP")
    return lines[1:end], lines[end + 1 :]


def assignments(
    path: str | Path,
    first: int,
    lines: Lines,
    required: Iterable[str],
    known: Mapping[str, Collection[str]],
    owner: str = "segment",
) -> dict[str, str]:
    """Keywords and values of a section that begins at line `first` and describes its `owner`.

    Keywords that are `required` must be there, and those in `known` must have one of these values,
    in capital letters. An `InputFileError` if a line is no assignment, or a keyword occurs twice.
    """
    values, line_of = {}, {}
    for number, line in lines:
        found = _KEY.fullmatch(line)
        if not found or found[1] in values:
            raise InputFileError(
                f"{path}, line {number}: {line[:40]!r} is no keyword, or a second one"
            )
        values[found[1]], line_of[found[1]] = found[2].strip(), number
    for key in required:
        if not values.get(key):
            raise InputFileError(f"{path}, line {first}: the {owner} lacks {key}; add it")
    for key, usable in known.items():
        if key in values:
            values[key] = values[key].upper()
            if values[key] not in usable:
                raise InputFileError(
                    f"{path}, line {line_of[key]}: {key} = {values[key]} cannot be used; convert "
                    f"to one of {', '.join(usable)}"
                )
    return values


def assignment(line: str) -> tuple[str, str] | None:
    """Keyword and value of a line, or None."""
    found = _KEY.fullmatch(line)
    return (found[1], found[2].strip()) if found else None


def read_date(place: str, text: str, system: str, zero_tdb_s: float | None = None) -> float:
    """TDB seconds past J2000 of a date in a time scale, or of a number of SI seconds since
    `zero_tdb_s` if that is given."""
    if zero_tdb_s is not None and re.fullmatch(r"[-+]?[\d.]+([eE][-+]?\d+)?", text):
        return float(tdb_after(zero_tdb_s, read_number(place, text)))
    with placed(place, ConfigurationError, InputFileError):
        return float(clock_to_tdb(clock_seconds(text), system))


def timed_rows(
    path: str | Path,
    lines: Lines,
    system: str,
    counts: Sequence[int],
    row: str,
    zero_tdb_s: float | None = None,
) -> tuple[Array, Array]:
    """Increasing dates, TDB seconds past J2000, and numbers of lines that each have a date first.

    A line has one of the `counts` of numbers, of which those beyond the first count are dropped;
    `row` says so in messages. For `system` and `zero_tdb_s` see `read_date`.
    """
    times: list[float] = []
    values = []
    for number, line in lines:
        place = f"{path}, line {number}"
        date, *fields = line.split()
        if len(fields) not in counts:
            raise InputFileError(
                f"{place}: {len(fields)} numbers after the date where {row}; complete the line"
            )
        times.append(read_date(place, date, system, zero_tdb_s))
        values.append([read_number(place, field) for field in fields[: counts[0]]])
        if len(times) > 1 and not times[-1] > times[-2]:
            raise InputFileError(f"{place}: not later than the line before; sort them")
    return np.array(times), np.array(values).reshape(len(times), counts[0])


def require_stop(
    path: str | Path, lines: Lines, meta: Mapping[str, str], tdb_s: Array, what: str
) -> None:
    """Refuse a section whose last date is before STOP_TIME."""
    stop = read_date(f"{path}, STOP_TIME", meta["STOP_TIME"], meta["TIME_SYSTEM"])
    if not tdb_s.size or tdb_s[-1] < stop - SAME_TIME_S:
        raise InputFileError(
            f"{path}, line {lines[-1][0]}: the {what} of {meta['OBJECT_NAME']} end before "
            f"STOP_TIME = {meta['STOP_TIME']}; the file is cut short; get the complete file"
        )
