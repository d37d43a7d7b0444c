"""Tables of observations from files in any of the formats that are read, or from a data frame."""

from pathlib import Path

import pandas as pd

from cislunar.errors import CislunarError, ConfigurationError, InputFileError
from cislunar.exchange.ades import read_ades
from cislunar.exchange.observations import OBJECT_NAMES
from cislunar.exchange.tdm import read_tdm

_READERS = {".psv": read_ades, ".tdm": read_tdm}
"""Readers by the ending of a file's name; other files are comma-separated."""

_TEXT = (
    *("stn", "obsID", "expID", "trkSub", "obsSubID", "sys", "ctr"),
    *("mode", "band", "astCat", "remarks"),
)
"""Columns of a comma-separated table that are text, beside the names of objects."""


def observation_table(
    source: str | Path | pd.DataFrame, what: str = "observations"
) -> tuple[pd.DataFrame, str, type[CislunarError]]:
    """A table of observations, without checks of its columns.

    Parameters
    ----------
    source : str, Path or DataFrame
        Path of an ADES file (``*.psv``), a Tracking Data Message (``*.tdm``) or a comma-separated
        table, or a table.
    what : str
        Content of the table, for messages.

    Returns
    -------
    table : DataFrame
        See `cislunar.exchange.observations`.
    place : str
        Name of the table, for messages.
    fault : type
        Class of errors of the table.

    Raises
    ------
    ConfigurationError, InputFileError
        If `source` is neither a table nor a path, or the file cannot be read.
    """
    if isinstance(source, pd.DataFrame):
        return source.reset_index(drop=True), what, ConfigurationError
    if not isinstance(source, str | Path):
        raise ConfigurationError(f"{what}: give a table (DataFrame) or the path of a file")
    reader = _READERS.get(Path(source).suffix.lower())
    if reader:
        return reader(source), str(source), InputFileError
    try:
        # as text, since names and codes may look like numbers with leading zeros
        names = dict.fromkeys((*_TEXT, *OBJECT_NAMES), str)
        table = pd.read_csv(source, dtype=names, skipinitialspace=True)
    except (OSError, UnicodeDecodeError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise InputFileError(f"{source}: no readable table ({reason})") from error
    return table, str(source), InputFileError
