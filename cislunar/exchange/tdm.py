"""CCSDS Tracking Data Messages (CCSDS 503.0-B) of optical observations, in keyword-value notation.

A segment has the right ascensions and declinations (``ANGLE_TYPE = RADEC``; ``ANGLE_1``,
``ANGLE_2``, deg) and magnitudes (``MAG``) of one object from one observer: PARTICIPANT_1 is the
observer, PARTICIPANT_2 the object, and light goes along ``PATH = 2,1``. Dates are those of
reception. The table of observations is that of `cislunar.exchange.observations`.

The standard has no standard deviations: they, and other columns of a table, are not written. An
object without a name is ``UNKNOWN`` (table 3-3), and its tracklet or observation is the TRACK_ID.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from cislunar.constants import DATE_SYSTEM
from cislunar.ephemeris.time_scales import TIME_SYSTEMS
from cislunar.errors import ConfigurationError, InputFileError
from cislunar.exchange import key_values as kvn
from cislunar.exchange.observations import (
    OBJECT_NAMES,
    checked,
    object_of,
    observation_dates,
)
from cislunar.exchange.table_rows import read_number

_KEYS = {"ANGLE_1": "ra", "ANGLE_2": "dec", "MAG": "mag"}
_TEXT = ("stn", "artSat", "trkSub", "ephemeris")
_USABLE = {
    "TIME_SYSTEM": TIME_SYSTEMS,
    "MODE": ("SEQUENTIAL",),
    "ANGLE_TYPE": ("RADEC",),
    "REFERENCE_FRAME": kvn.FRAMES,
    "TIMETAG_REF": ("RECEIVE",),
    "CORRECTIONS_APPLIED": ("YES",),
}
"""Values of keywords that can be used; others would change the meaning of the data."""
_CORRECTIONS = ("CORRECTION_ANGLE_1", "CORRECTION_ANGLE_2", "CORRECTION_MAG")


def tdm_text(
    table: pd.DataFrame,
    *,
    created: str,
    comments: Sequence[str] = (),
    originator: str = "CISLUNAR",
    time_system: str = DATE_SYSTEM,
    ephemerides: Mapping[str, str] | None = None,
) -> str:
    """Text of a message, version 2.0; its numbers have the fewest digits that are read
    back unchanged.

    Parameters
    ----------
    table : DataFrame
        Observations with ``stn``, ``obsTime`` (UTC), ``ra``, ``dec`` (ICRF, deg), and if known
        ``mag``, ``permID``, ``provID`` or ``artSat``, ``trkSub`` and ``obsID``. The rows of a
        segment, which have the same observer, object and tracklet, are in order of time.
    created, comments, originator, time_system
        See `cislunar.exchange.oem.oem_text`.
    ephemerides : mapping of str to str, optional
        Names of the orbit ephemeris messages of observers in space, by ``stn`` (EPHEMERIS_NAME_1).

    Returns
    -------
    str

    Raises
    ------
    ConfigurationError
        If `table` is not a DataFrame, has no row or lacks a column, a value is unusable, an
        observation has neither an object nor a tracklet nor an identifier, or the rows of a segment
        are not in order of time.
    """
    given = checked(table, ("mag", *OBJECT_NAMES, "trkSub", "obsID"))
    if given.empty:
        raise ConfigurationError("observations: the table has no row; give at least one")
    tdb, name = given["tdb"].to_numpy(), object_of(given)
    dated = kvn.dates(tdb, time_system)
    track = given["trkSub"].to_numpy()
    track = np.where((track == "") & (name == ""), given["obsID"], track)
    segments: dict[tuple[str, str, str], list[int]] = {}
    for row, key in enumerate(zip(given["stn"], name, track, strict=True)):
        if not any(key[1:]):
            raise ConfigurationError(
                f"observations, row {row + 1}: names neither an object nor a tracklet; give "
                f"{', '.join(OBJECT_NAMES)}, trkSub or obsID"
            )
        rows = segments.setdefault(key, [])
        if rows and not tdb[row] > tdb[rows[-1]]:
            raise ConfigurationError(
                f"observations, row {row + 1}: not later than row {rows[-1] + 1} of the same "
                "observer, object and tracklet; sort the table by time, or give trkSub"
            )
        rows.append(row)
    values = {key: given[column].tolist() for key, column in _KEYS.items()}
    lines = kvn.header("TDM", "2.0", created, comments, originator)
    for (observer, each, tracklet), rows in segments.items():
        meta = {"TRACK_ID": tracklet} if tracklet else {}
        meta |= {
            "TIME_SYSTEM": time_system,
            "PARTICIPANT_1": observer,
            "PARTICIPANT_2": each or kvn.UNKNOWN,
            "MODE": "SEQUENTIAL",
            "PATH": "2,1",
        }
        if ephemerides and observer in ephemerides:
            meta["EPHEMERIS_NAME_1"] = ephemerides[observer]
        meta |= {"TIMETAG_REF": "RECEIVE", "ANGLE_TYPE": "RADEC", "REFERENCE_FRAME": kvn.FRAMES[0]}
        data = [
            f"{key} = {dated[row]} {column[row]!r}"
            for row in rows
            for key, column in values.items()
            if not np.isnan(column[row])
        ]
        lines += ["", *kvn.block("META", meta), *kvn.block("DATA", {}, data)]
    return "\n".join(lines) + "\n"


def read_tdm(path: str | Path) -> pd.DataFrame:
    """Read the optical observations of a message in keyword-value notation.

    Parameters
    ----------
    path : str or Path
        The file, version 1.0 or 2.0. Data other than angles and magnitudes are ignored.

    Returns
    -------
    DataFrame
        In order of time, with ``stn``, ``artSat`` (the object, empty if it is unknown), ``trkSub``
        (TRACK_ID), ``obsTime`` (UTC), ``ra``, ``dec`` (ICRF, deg), ``mag`` and ``ephemeris``
        (EPHEMERIS_NAME of the observer). Missing numbers are NaN, and missing text is empty.

    Raises
    ------
    ConfigurationError
        If `path` is not a path.
    InputFileError
        If the file is not such a message, is truncated, has no angles or magnitudes, or has angles
        of another type or frame. The message names file and line.
    """
    lines = kvn.message_lines(path, "TDM", ("1.0", "2.0"))
    rows = [row for segment in kvn.segments_of(path, lines) for row in _segment(path, segment)]
    if not rows:
        raise InputFileError(f"{path}: has neither angles nor magnitudes; give optical data")
    table = pd.DataFrame(rows, columns=["tdb", *_TEXT, *_KEYS.values()])
    table = table.sort_values("tdb", kind="stable", ignore_index=True)
    table.insert(3, "obsTime", observation_dates(table.pop("tdb")))
    return table


def _segment(path: str | Path, lines: kvn.Lines) -> list[tuple]:
    """Rows of a segment: time, `_TEXT`, right ascension, declination and magnitude."""
    metadata, rest = kvn.cut(path, lines, "META")
    first = lines[0][0]
    inside, _ = kvn.cut(path, rest, "DATA")
    found: dict[float, dict[str, float]] = {}
    required = ("TIME_SYSTEM", "PARTICIPANT_1")
    meta = kvn.assignments(path, first, metadata, required, {"TIME_SYSTEM": TIME_SYSTEMS})
    for number, line in inside:
        place, pair = f"{path}, line {number}", kvn.assignment(line)
        if not pair or len(fields := pair[1].split()) != 2:
            raise InputFileError(f"{place}: {line[:40]!r} is no keyword with a date and a number")
        if pair[0] in ("CLOCK_BIAS", "CLOCK_DRIFT") and read_number(place, fields[1]) != 0.0:
            raise InputFileError(
                f"{place}: {pair[0]} is not applied to the dates; correct them and remove it"
            )
        if pair[0] in _KEYS:
            row = found.setdefault(kvn.read_date(place, fields[0], meta["TIME_SYSTEM"]), {})
            if pair[0] in row:
                raise InputFileError(f"{place}: a second {pair[0]} at {fields[0]}; remove one")
            row[pair[0]] = read_number(place, fields[1])
            if abs(row.get("ANGLE_2", 0.0)) > 90.0:
                raise InputFileError(f"{place}: a declination beyond 90 degrees; correct it")
    if not found:
        return []
    angles = any("ANGLE_1" in row or "ANGLE_2" in row for row in found.values())
    needed = ("ANGLE_TYPE", "REFERENCE_FRAME") if angles else ()
    kvn.assignments(path, first, metadata, (*needed, "PATH"), _USABLE)
    names = [meta.get(f"PARTICIPANT_{n}", "") for n in meta["PATH"].split(",")[-2:]]
    if len(names) != 2 or not all(names):
        raise InputFileError(
            f"{path}, line {first}: PATH = {meta['PATH']} must end with the numbers of the object "
            "and of the observer, two participants that are named"
        )
    which = meta["PATH"].split(",")[-1]
    delay = f"RECEIVE_DELAY_{which}"
    if read_number(f"{path}, {delay}", meta.get(delay, "0")) != 0.0:
        raise InputFileError(
            f"{path}, line {first}: {delay} is not applied to the dates; correct them and remove it"
        )
    stated = [key for key in _CORRECTIONS if key in meta]
    if stated and "CORRECTIONS_APPLIED" not in meta:
        raise InputFileError(
            f"{path}, line {first}: {stated[0]} without CORRECTIONS_APPLIED; apply the correction "
            "and state CORRECTIONS_APPLIED = YES"
        )
    text = (
        names[1],
        "" if names[0] == kvn.UNKNOWN else names[0],
        meta.get("TRACK_ID", ""),
        meta.get(f"EPHEMERIS_NAME_{which}", ""),
    )
    for row in found.values():
        if ("ANGLE_1" in row) != ("ANGLE_2" in row):
            raise InputFileError(
                f"{path}, line {first}: the segment has dates with only ANGLE_1 or ANGLE_2; "
                "complete the pairs"
            )
    return [(tdb, *text, *(row.get(k, np.nan) for k in _KEYS)) for tdb, row in found.items()]
