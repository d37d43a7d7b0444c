"""Arcs of objects as a comma-separated table, for spreadsheets and data frames.

Each row has an object and a time: ``object, object_id, center, frame`` (ICRF), a date in the time
scale that its column names (ISO 8601; ``epoch_utc``, ``epoch_tai``, ``epoch_tt`` or ``epoch_tdb``),
position and velocity ``x_km ... vz_km_s``, and, if there are covariances, their lower triangle row
by row, ``cov_x_x ... cov_vz_vz`` (km^2, km^2/s, km^2/s^2), empty at times without a covariance. If
arcs hold for a part of their states alone, its first and last date are in ``useable_start`` and
``useable_stop`` with the same ending as the date.
"""

import csv
import io
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from cislunar.constants import DATE_SYSTEM
from cislunar.ephemeris.time_scales import TIME_SYSTEMS
from cislunar.errors import InputFileError
from cislunar.exchange.key_values import (
    CENTERS,
    FRAMES,
    SAME_TIME_S,
    dates,
    from_lower_triangle,
    lower_triangle,
    read_date,
)
from cislunar.exchange.oem import USEABLE, Segment, require_segment, with_useable_span
from cislunar.exchange.table_rows import listed, named_rows, row_numbers

_STATE_COLUMNS = ("x_km", "y_km", "z_km", "vx_km_s", "vy_km_s", "vz_km_s")
_USEABLE = ("useable_start", "useable_stop")
_LABELS = ("object", "object_id", "center")
_DATES = {f"epoch_{system.lower()}": system for system in TIME_SYSTEMS}
"""Columns of dates, and their time scales."""
_OLD_DATES = {"epoch": "TDB"}
"""Column of dates in tables of version 0.1, which have no column of the frame."""
DATE_COLUMNS = (*_DATES, *_OLD_DATES)
"""All columns of dates."""
_AXES = ("x", "y", "z", "vx", "vy", "vz")
_ROWS, _COLUMNS = np.tril_indices(6)
_COVARIANCE = tuple(f"cov_{_AXES[i]}_{_AXES[j]}" for i, j in zip(_ROWS, _COLUMNS, strict=True))


def segments_csv(segments: Iterable[Segment], *, time_system: str = DATE_SYSTEM) -> str:
    """Table of segments, as text; numbers are read back unchanged.

    Parameters
    ----------
    segments : iterable of Segment
        Arcs, in order. Covariances at times without a state are omitted.
    time_system : {"UTC", "TAI", "TT", "TDB"}
        Time scale of the dates, which are written to the microsecond.

    Returns
    -------
    str

    Raises
    ------
    ConfigurationError
        If the time scale is unknown, a UTC date lies before 1972, or a segment cannot be written
        (see `cislunar.exchange.oem.require_segment`).
    """
    given = list(segments)
    for each in given:
        require_segment(each)
    covariance = _COVARIANCE if any(len(each.covariance) for each in given) else ()
    file = io.StringIO()
    table = csv.writer(file, lineterminator="\n")
    ending = f"_{time_system.lower()}"
    useable = _USEABLE if any(each.useable_tdb_s for each in given) else ()
    spans = [name + ending for name in useable]
    table.writerow([*_LABELS, "frame", *spans, f"epoch{ending}", *_STATE_COLUMNS, *covariance])
    for each in given:
        span = dates(each.useable_tdb_s, time_system) if each.useable_tdb_s else [""] * len(spans)
        label = each.name, each.object_id, each.center, FRAMES[0], *span
        dated = dates(each.tdb_s, time_system)
        for time, date, state in zip(each.tdb_s, dated, each.state, strict=True):
            at = np.flatnonzero(np.abs(each.covariance_tdb_s - time) <= SAME_TIME_S)
            known = [lower_triangle(each.covariance[k]).tolist() for k in at[:1]]
            table.writerow([*label, date, *state.tolist(), *(known or [[""] * len(covariance)])[0]])
    return file.getvalue()


def read_segments(path: str | Path) -> list[Segment]:
    """Read a table of `segments_csv`.

    Parameters
    ----------
    path : str or Path
        The file. Tables of version 0.1, which do not name a frame, have a column ``epoch`` with
        dates in TDB, and states in the ICRF.

    Returns
    -------
    list of Segment
        One for each object, center and useable span, in the order of the file.

    Raises
    ------
    ConfigurationError
        If `path` is not a path.
    InputFileError
        If a column is missing, the time scale or the frame is not stated, or a row cannot be used.
        The message names file and row.
    """
    hint = "; states are in km and km/s, ICRF"
    columns = (*_LABELS[1:], *_STATE_COLUMNS)
    header, rows = named_rows(path, "state", _LABELS[0], columns, remedy=hint)
    epoch, system = _date_column(path, header)
    arcs: dict[tuple[str, ...], list[list[float]]] = {}
    spans = [name + epoch.removeprefix("epoch") for name in _USEABLE]
    for name in header:
        if name.startswith(_USEABLE) and name not in spans:
            raise InputFileError(
                f"{path}, row 1: the time scale of {name} is not that of {epoch}; give {spans[0]} "
                f"and {spans[1]}"
            )
    for place, row in rows:
        time = read_date(place, row[epoch], system)
        names = (*_STATE_COLUMNS, *(_COVARIANCE if row.get(_COVARIANCE[0]) else ()))
        for name, known in (("center", CENTERS), ("frame", FRAMES)):
            if row.get(name, FRAMES[0]) not in known:
                raise InputFileError(f"{place}: {name} {row[name]!r} is none of {', '.join(known)}")
        earlier = arcs.setdefault(tuple(row.get(name, "") for name in (*_LABELS, *spans)), [])
        if earlier and not time > earlier[-1][0]:
            raise InputFileError(
                f"{place}: the epoch is not later than the one before; sort the rows"
            )
        earlier.append([time, *row_numbers(place, row, (names, 1.0))])
    return [_arc(str(path), label, rows, system) for label, rows in arcs.items()]


def _date_column(path: str | Path, header: list[str]) -> tuple[str, str]:
    """Column of the dates, and their time scale, which the column or an old header determines."""
    known = _DATES if "frame" in header else _OLD_DATES
    found = [name for name in header if name in _DATES | _OLD_DATES]
    if len(found) == 1 and found[0] in known:
        return found[0], known[found[0]]
    raise InputFileError(
        f"{path}, row 1: the time scale or the frame is not stated; give the dates in one column "
        f"{', '.join(_DATES)} and the frame in a column frame; the header has {listed(header)}"
    )


def _arc(path: str, label: tuple[str, ...], rows: list[list[float]], system: str) -> Segment:
    state = np.array([row[:7] for row in rows])
    known = np.array([[row[0], *row[7:]] for row in rows if len(row) > 7]).reshape(-1, 22)
    matrices = np.array([from_lower_triangle(row) for row in known[:, 1:]]).reshape(-1, 6, 6)
    found = Segment(*label[:3], state[:, 0], state[:, 1:], known[:, 0], matrices)
    useable = {key: date for key, date in zip(USEABLE, label[3:], strict=True) if date}
    return with_useable_span(f"{path}, object {label[0]!r}", found, useable, system)
