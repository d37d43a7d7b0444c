"""Table of cislunar missions whose zero-velocity surfaces contain the static targets.

Paul & Fan (section 3) use 64 past and planned missions from public sources, with Jacobi constants
from 2.91 (Artemis I) to 5.49 (lunar landers), and do not publish the list. The table in
``config/missions.csv`` is therefore a different one: it names 64 missions with the source, the
basis and a confidence of each value. Only the columns `mission` and `jacobi` are required; the
others document them.
"""

from math import isfinite
from pathlib import Path

import pandas as pd

from cislunar.constants import LENGTH_UNIT_KM, MOON_RADIUS_KM, MU
from cislunar.dynamics.cr3bp import pseudo_potential
from cislunar.errors import InputFileError
from cislunar.exchange.csv_lines import listed, read_lines

_REQUIRED_COLUMNS = ("mission", "jacobi")
_NUMERIC_COLUMNS = (
    "year",
    "perilune_alt_km",
    "apolune_alt_km",
    "inclination_deg",
    "jacobi_min",
    "jacobi_max",
    "jacobi_recomputed",
)


def highest_lunar_jacobi(mu: float = MU) -> float:
    """Jacobi constant above which the zero-velocity surface around the Moon lies inside the Moon.
    It is the largest 2U on the Moon's surface, at the Earth-Moon axis (8.4 for the Earth and Moon).
    """
    radius = MOON_RADIUS_KM / LENGTH_UNIT_KM
    ends = [[1.0 - mu - radius, 0.0, 0.0], [1.0 - mu + radius, 0.0, 0.0]]
    return float(2.0 * pseudo_potential(ends, mu).max())


def load_missions(path: str | Path, mu: float = MU) -> pd.DataFrame:
    """Read and check a table of missions.

    Parameters
    ----------
    path : str or Path
        Comma-separated table in UTF-8 with a header; the columns `mission` and `jacobi` are
        required.
    mu : float
        Mass ratio, for the possible range of Jacobi constants.

    Returns
    -------
    DataFrame
        One row per mission, in the order of the file, with every column of the file: `jacobi` and
        the numeric columns as floats (NaN where empty), the others as text.

    Raises
    ------
    InputFileError
        If the table or a row is unusable, or a Jacobi constant has no zero-velocity surface outside
        of the Moon; the message names the file, the row (the header is row 1) and the mission.
    """
    path = Path(path)
    header, rows = _read(path)
    highest = highest_lunar_jacobi(mu)
    first_seen: dict[str, int] = {}
    records = []
    for line, fields in rows:
        record: dict[str, object] = dict.fromkeys(header, "")
        record.update(zip(header, map(str.strip, fields), strict=False))
        name = record["mission"]
        place = f"{path}, row {line}"
        if not name:
            raise InputFileError(f"{place}: the mission has no name; give it one")
        place = f"{place}, mission {name!r}"
        if len(fields) > len(header):
            raise InputFileError(
                f"{place}: more fields than the header; quote fields that contain commas"
            )
        if name in first_seen:
            raise InputFileError(
                f"{place}: the mission is already in row {first_seen[name]}; remove one of them"
            )
        first_seen[name] = line
        record["jacobi"] = _jacobi(record["jacobi"], place, highest)
        for column in _NUMERIC_COLUMNS:
            if column in record:
                record[column] = _number(record[column], column, place)
        records.append(record)
    return pd.DataFrame.from_records(records)


def _read(path: Path) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """Header of a table, and its rows with the line on which each one ends."""
    lines = read_lines(path, "mission")
    header = lines[0][1] if lines else []
    missing = [column for column in _REQUIRED_COLUMNS if column not in header]
    if missing:
        raise InputFileError(
            f"{path}, row 1: no column {', '.join(missing)}; the header has {listed(header)}"
        )
    twice = [column for column in _REQUIRED_COLUMNS if header.count(column) > 1]
    if twice:
        raise InputFileError(
            f"{path}, row 1: the column {twice[0]} occurs twice; remove one of them"
        )
    rows = [(number, fields) for number, fields in lines[1:] if fields]
    if not rows:
        raise InputFileError(f"{path}: contains no mission; add a row per mission")
    return header, rows


def _jacobi(text: object, place: str, highest: float) -> float:
    """A Jacobi constant with a zero-velocity surface around the Moon."""
    if text == "":
        raise InputFileError(f"{place}: no Jacobi constant; fill in the column jacobi")
    value = _number(text, "jacobi", place)
    if not isfinite(value):
        raise InputFileError(f"{place}: jacobi = {text} must be a finite number")
    if value <= 0.0:
        raise InputFileError(
            f"{place}: jacobi = {text} leaves no zero-velocity surface, since 2U > 0 everywhere; "
            "it must be above 0 (JC = 2U - v^2, nondimensional)"
        )
    if value >= highest:
        raise InputFileError(
            f"{place}: jacobi = {text} puts the zero-velocity surface inside the Moon; it must be "
            f"below {highest:.3f} (JC = 2U - v^2, nondimensional)"
        )
    return value


def _number(text: object, column: str, place: str) -> float:
    """A float, or NaN for an empty field."""
    if text == "":
        return float("nan")
    try:
        return float(str(text))
    except ValueError as error:
        raise InputFileError(f"{place}: {column} = {text!r} is not a number") from error
