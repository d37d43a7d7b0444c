"""Lines of a comma-separated table, for the readers of missions and of targets."""

import csv
from pathlib import Path

from cislunar.errors import InputFileError


def read_lines(path: str | Path, what: str) -> list[tuple[int, list[str]]]:
    """Fields of every line of a table with its number, as an editor counts them.

    Parameters
    ----------
    path : str or Path
        Comma-separated table in UTF-8.
    what : str
        What the table holds, for messages.

    Returns
    -------
    list of (int, list of str)
        Blank lines are empty lists; a field that begins with a quotation mark may hold line
        breaks, and is counted where it ends.

    Raises
    ------
    InputFileError
        If the file is missing or cannot be read as a table.
    """
    try:
        with Path(path).open(newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file, skipinitialspace=True)
            return [(reader.line_num, fields) for fields in reader]
    except FileNotFoundError as error:
        mend = f"give the path of a table with a row per {what}"
        raise InputFileError(f"{path}: no such file; {mend}") from error
    except (OSError, ValueError, csv.Error) as error:
        raise InputFileError(f"{path}: cannot be read as a table in UTF-8 ({error})") from error


def listed(header: list[str]) -> str:
    """Names of columns for a message, unless they are no readable ones."""
    text = ", ".join(header) or "no columns"
    return text if text.isprintable() and len(text) < 200 else "no readable names"
