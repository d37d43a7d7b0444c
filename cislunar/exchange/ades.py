"""Optical observations in the Astrometry Data Exchange Standard (ADES 2022), pipe-separated (PSV).

ADES is the format of the IAU and of the Minor Planet Center (Chesley et al. 2017; the schema
``general.xsd`` of version 2022). Its dates are UTC and its directions ICRF. The position of an
observer in space is geocentric (``ctr`` 399), in ICRF axes and km (``sys`` ICRF_KM). The table of
observations is that of `cislunar.exchange.observations`, and columns that the standard does not
have are not written.

The standard limits the digits of numbers, to which they are rounded: 1e-9 deg (4 microarcsec),
6 digits of magnitudes, `rmsRA` and `rmsDec`, 5 of `rmsMag`, and 1e-6 km of positions near the Moon.
What has been read is written unchanged. Leap seconds are not supported.
"""

import itertools
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from cislunar.errors import ConfigurationError, InputFileError
from cislunar.exchange.key_values import read_text
from cislunar.exchange.observations import (
    LINE,
    OBJECT_NAMES,
    POSITION_COLUMNS,
    RANGES,
    REQUIRED,
    checked,
    observation_dates,
    require,
)

VERSIONS = ("2017", "2018", "2022")
"""Versions that are read; 2022 is written."""

_NAMES = (*OBJECT_NAMES, "trkSub")
_TEXT = {
    **dict.fromkeys(OBJECT_NAMES, (r"[^|]{1,25}", "have at most 25 characters")),
    "trkSub": (r"[-\w ?+@./()\\]{1,8}", "have at most 8 letters, digits and signs"),
    "obsSubID": (r"[^|]{1,35}", "have at most 35 characters"),
    "mode": (r"\w{1,3}", "be a code of at most 3 letters or digits, such as CCD"),
    "stn": (r"\w{3,4}", "be the code of an observatory, 3 or 4 letters or digits"),
    "astCat": (r"[.\w]{1,8}", "be the code of a star catalog, at most 8 letters or digits"),
    "band": (r"\w{1,3}", "be the code of a passband, at most 3 letters or digits"),
    "remarks": (r"[^|]{1,300}", "have at most 300 characters"),
    "sys": (r"ICRF_KM|ICRF_AU|WGS84|ITRF|IAU", "be a system of ADES, such as ICRF_KM"),
    "ctr": (r"399", "be 399, the center of the Earth, the only one of the standard"),
}
"""Form of text by column (schema ``general.xsd``), and the rule in words."""

_WIDTH = {"rmsRA": 7, "rmsDec": 7, "mag": 7, "rmsMag": 6, **dict.fromkeys(POSITION_COLUMNS, 13)}
"""Digits and decimal point of numbers, without the sign."""

_COLUMNS = (
    *(*_NAMES, "obsSubID", "mode", "stn", "sys", "ctr", *POSITION_COLUMNS, "obsTime", "ra", "dec"),
    *("rmsRA", "rmsDec", "rmsCorr", "astCat", "mag", "rmsMag", "band", "remarks"),
)
"""Columns that are written, in the order of the standard."""

_CONTEXT = {
    "submitter": ("name",),
    "measurers": ("name",),
    "telescope": ("design", "aperture", "detector"),
}
"""Required header elements, besides that of the observatory, and their required entries."""


def ades_text(
    table: pd.DataFrame,
    *,
    context: Mapping[str, Mapping[str, str | Sequence[str]]] | None = None,
    mode: str = "CCD",
    catalog: str = "UNK",
    band: str = "V",
) -> str:
    """Text of a file of observations.

    Parameters
    ----------
    table : DataFrame
        Observations with ``stn`` (a code of 3 or 4 characters), ``obsTime`` (UTC), ``ra``, ``dec``
        (ICRF, deg), at least one of ``permID``, ``provID``, ``artSat`` and ``trkSub``, and if known
        ``rmsRA``, ``rmsDec`` (arcsec), ``rmsCorr``, ``mag``, ``rmsMag``, ``sys``, ``ctr``,
        ``pos1`` to ``pos3``, ``obsID`` (written as ``obsSubID``, since only the Minor Planet Center
        assigns an ``obsID``), ``mode``, ``astCat``, ``band``, ``remarks``, and ``observatory``, the
        name of the station for the header.
    context : mapping, optional
        Header elements and their entries, such as ``{"submitter": {"name": "A. Observer"},
        "measurers": {"name": ["A. Observer"]}, "telescope": {"design": "Reflector", "aperture":
        "0.5", "detector": "CCD"}}``, which a submission needs. Each station then has a header of
        its own. Without it the file has no headers.
    mode, catalog, band : str
        Values of ``mode``, ``astCat`` and ``band`` where the table has none.

    Returns
    -------
    str

    Raises
    ------
    ConfigurationError
        If `table` is not a DataFrame, a column is missing, an observation is not named, a value is
        not allowed by the standard, or the context is incomplete.
    """
    given = checked(table, (*_COLUMNS, "obsID", "observatory"))
    defaults = {"mode": mode, "astCat": catalog, "band": band}
    for name, value in defaults.items():
        given[name] = np.where(given[name] == "", value, given[name])
    given["obsSubID"] = np.where(given["obsSubID"] == "", given["obsID"], given["obsSubID"])
    absent = given["mag"].isna()
    given["band"] = np.where(absent, "", given["band"])
    given["rmsMag"] = given["rmsMag"].mask(absent)
    for name, (form, rule) in _TEXT.items():
        empty = given[name] == ""
        right = [re.fullmatch(form, each, re.ASCII if "w" in form else 0) for each in given[name]]
        require(given, name, empty | np.array([each is not None for each in right]), rule)
    require(given, *_named(given))
    both = (given[["permID", "provID"]] != "").any(axis=1) & (given["artSat"] != "")
    require(given, "artSat", ~both, "be empty where permID or provID is given")
    given["obsTime"] = observation_dates(given["tdb"])
    for name in RANGES:
        given[name] = [_number(name, each) for each in given[name].tolist()]
    used = [
        name
        for name in _COLUMNS
        if name in (*REQUIRED, "mode", "astCat") or (given[name] != "").any()
    ]
    lines = ["# version=2022"]
    if context is None:
        return "\n".join([*lines, *_records(given[used])]) + "\n"
    for station in given["stn"].drop_duplicates():
        own = given[given["stn"] == station]
        named = [each for each in own["observatory"] if each][:1]
        observatory = {"mpcCode": station, **({"name": named[0]} if named else {})}
        lines += _header({"observatory": observatory, **context}) + _records(own[used])
    return "\n".join(lines) + "\n"


def observer_codes(names: Sequence[str]) -> dict[str, str]:
    """Codes for ``stn`` by the names of observers: the name if it has the form of a code, or else
    O001, O002 and so on, which no observatory has."""
    form = _TEXT["stn"][0]
    codes = {name: name for name in names if re.fullmatch(form, name, re.ASCII)}
    free = (code for k in itertools.count(1) if (code := f"O{k:03d}") not in names)
    return {name: codes.get(name) or next(free) for name in names}


def _number(name: str, value: float) -> str:
    """A number with the digits that the standard allows; empty if it is missing."""
    if np.isnan(value):
        return ""
    if name in ("ra", "dec", "rmsCorr"):
        text = f"{value % 360.0 if name == 'ra' else value:.9f}"
        return "0.000000000" if text == "360.000000000" else text
    # a number that is rounded up may have a digit more before its point
    for decimals in range(_WIDTH[name] - 2, -1, -1):
        text = f"{abs(value):.{decimals}f}"
        if len(text) <= _WIDTH[name]:
            break
    if len(text) > _WIDTH[name] or (name.startswith("rms") and float(text) == 0.0):
        raise ConfigurationError(
            f"observations: {name} = {value} has more digits than the standard allows; give values "
            f"that {_WIDTH[name] - 1} digits can state"
        )
    return text if value >= 0.0 else f"-{text}"


def _header(context: Mapping[str, Mapping[str, str | Sequence[str]]]) -> list[str]:
    lines = []
    for element, needed in _CONTEXT.items():
        lacking = [entry for entry in needed if not context.get(element, {}).get(entry)]
        if lacking:
            raise ConfigurationError(f"context: {element} needs {lacking[0]}; give it")
    for element, entries in context.items():
        lines.append(f"# {element}")
        for entry, value in entries.items():
            several = [value] if isinstance(value, str) else [*value]
            lines += [f"! {entry} {each}" for each in several]
    return lines


def _records(table: pd.DataFrame) -> list[str]:
    rows = [[*table.columns], *table.astype(str).values.tolist()]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "|".join(each.ljust(width) for each, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]


def read_ades(path: str | Path) -> pd.DataFrame:
    """Read optical observations from a pipe-separated file.

    Parameters
    ----------
    path : str or Path
        The file, of one of `VERSIONS`.

    Returns
    -------
    DataFrame
        In order of time, with the columns of the file. ``obsTime`` is UTC, to the microsecond;
        directions are ICRF, deg. ``obsID`` is ``obsSubID`` if the file has no ``obsID``.
        ``observatory`` is the name of the station in the header, if one states it. Missing numbers
        are NaN, and missing text is empty.

    Raises
    ------
    ConfigurationError
        If `path` is not a path.
    InputFileError
        If the file is not such a file, a row is incomplete or has an unusable value, or there are
        observations other than directions. The message names file and line.
    """
    lines = [
        (number, line.strip())
        for number, line in enumerate(read_text(path, "an ADES file").splitlines(), 1)
    ]
    lines = [(number, line) for number, line in lines if line]
    found = re.fullmatch(r"#\s*version\s*=\s*(\d+)", lines[0][1]) if lines else None
    if not found or found[1] not in VERSIONS:
        raise InputFileError(
            f"{path}, line 1: not a pipe-separated ADES file, which begins with # version=2022; "
            "convert the file"
        )
    rows: dict[int, dict[str, str]] = {}
    columns: list[str] = []
    element, observatory, in_header = "", {}, True
    for number, line in lines[1:]:
        place = f"{path}, line {number}"
        if line[0] in "#!":
            element = line[1:].strip() if line[0] == "#" else element
            if not in_header or element == line[1:].strip() == "observatory":
                columns, observatory, in_header = [], {}, True
            if line[0] == "!" and element == "observatory":
                entry, _, value = line[1:].strip().partition(" ")
                observatory[entry] = value.strip()
            continue
        in_header = False
        fields = [each.strip() for each in line.split("|")]
        if "obsTime" in fields:
            columns = _column_names(place, fields)
        elif len(fields) > len(columns):
            raise InputFileError(
                f"{place}: {len(fields)} fields where the line of names has {len(columns)}; "
                "correct one of the two"
            )
        else:  # empty fields at the end may be left out
            fields += [""] * (len(columns) - len(fields))
            row = rows[number] = dict(zip(columns, fields, strict=True))
            if observatory.get("mpcCode") == row["stn"] and "name" in observatory:
                row["observatory"] = observatory["name"]
    if not rows:
        raise InputFileError(f"{path}: contains no observation; add a row per observation")
    table = pd.DataFrame([*rows.values()], pd.Index(rows, name=LINE)).fillna("")
    given = checked(table, (*_NAMES, *RANGES), fault=InputFileError, place=str(path))
    require(given, *_named(given), InputFileError, str(path))
    names = [*_COLUMNS, *(name for name in table if name not in _COLUMNS)]
    table = table[[name for name in names if name in table]]
    numbers = {name: given[name] for name in RANGES if name in table}
    table = table.assign(obsTime=observation_dates(given["tdb"]), **numbers)
    table = table.iloc[np.argsort(given["tdb"], kind="stable")].reset_index(drop=True)
    return table if "obsID" in table else table.rename(columns={"obsSubID": "obsID"})


def _named(given: pd.DataFrame) -> tuple[str, pd.Series, str]:
    """The rule that each observation is named, for `require`."""
    rule = f"be given, or one of {', '.join(OBJECT_NAMES)}"
    return "trkSub", (given[[*_NAMES]] != "").any(axis=1), rule


def _column_names(place: str, fields: list[str]) -> list[str]:
    lacking = [name for name in REQUIRED if name not in fields]
    if lacking or len({*fields}) != len(fields):
        reason = f"no column {lacking[0]}" if lacking else "a column occurs twice"
        raise InputFileError(f"{place}: {reason}; give optical observations with ra and dec")
    return fields
