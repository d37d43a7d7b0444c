"""Table of cislunar missions whose zero-velocity surfaces contain the static targets.

Paul & Fan (section 3) use 64 past and planned missions from public sources, with Jacobi constants
from 2.91 (Artemis I) to 5.49 (lunar landers), and do not publish the list. The table in
``config/missions.csv`` is therefore a different one: it names 64 missions with the source, the
basis and a confidence of each value. Only the columns `mission` and `jacobi` are required; the
others document them.
"""

from math import nan
from pathlib import Path

import pandas as pd

from cislunar.constants import LENGTH_UNIT_KM, MOON_RADIUS_KM, MU
from cislunar.dynamics.cr3bp import pseudo_potential
from cislunar.errors import InputFileError
from cislunar.exchange.table_rows import named_rows, read_number, row_names

_NUMERIC_COLUMNS = (
    "year",
    "perilune_alt_km",
    "apolune_alt_km",
    "inclination_deg",
    "jacobi_min",
    "jacobi_max",
    "jacobi_recomputed",
)


def highest_lunar_jacobi() -> float:
    """Jacobi constant above which the zero-velocity surface around the Moon lies inside the Moon.
    It is the largest 2U on the Moon's surface, at the Earth-Moon axis (8.4 for the Earth and Moon).
    """
    radius = MOON_RADIUS_KM / LENGTH_UNIT_KM
    ends = [[1.0 - MU - radius, 0.0, 0.0], [1.0 - MU + radius, 0.0, 0.0]]
    return float(2.0 * pseudo_potential(ends).max())


def load_missions(path: str | Path) -> pd.DataFrame:
    """Read and check a table of missions.

    Parameters
    ----------
    path : str or Path
        Comma-separated table in UTF-8 with a header; the columns `mission` and `jacobi` are
        required.

    Returns
    -------
    DataFrame
        One row per mission, in the order of the file, with every column of the file: `jacobi` and
        the numeric columns as floats (NaN where empty), the others as text.

    Raises
    ------
    ConfigurationError
        If `path` is not a path.
    InputFileError
        If the table or a row is unusable, or a Jacobi constant has no zero-velocity surface outside
        of the Moon; the message names the file, the row (the header is row 1) and the mission.
    """
    header, rows = named_rows(path, "mission", "mission", ("jacobi",), short=True)
    row_names(rows, "mission", "mission")
    highest = highest_lunar_jacobi()
    numeric = [name for name in _NUMERIC_COLUMNS if name in header]
    records = [
        row
        | {name: read_number(place, row[name], name) if row[name] else nan for name in numeric}
        | {"jacobi": _jacobi(place, row["jacobi"], highest)}
        for place, row in rows
    ]
    return pd.DataFrame.from_records(records)


def _jacobi(place: str, text: str, highest: float) -> float:
    """A Jacobi constant with a zero-velocity surface around the Moon."""
    if text == "":
        raise InputFileError(f"{place}: no Jacobi constant; fill in the column jacobi")
    value = read_number(place, text, "jacobi")
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
