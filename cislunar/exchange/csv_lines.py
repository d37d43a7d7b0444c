"""Lines of comma-separated tables."""

import csv
from pathlib import Path

from cislunar.errors import InputFileError


def read_lines(path: str | Path, what: str) -> list[tuple[int, list[str]]]:
    """Fields of every line of a table, with the line number.

    Parameters
    ----------
    path : str or Path
        Comma-separated table in UTF-8.
    what : str
        Content of a row, for messages.

    Returns
    -------
    list of (int, list of str)
        Blank lines are empty lists. A quoted field may contain line breaks; its row has the number
        of its last line.
    """
    try:
        with Path(path).open(newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file, skipinitialspace=True)
            return [(reader.line_num, fields) for fields in reader]
    except FileNotFoundError as error:
        remedy = f"give the path of a table with a row per {what}"
        raise InputFileError(f"{path}: no such file; {remedy}") from error
    except (OSError, ValueError, csv.Error) as error:
        raise InputFileError(f"{path}: cannot be read as a table in UTF-8 ({error})") from error


def listed(header: list[str]) -> str:
    """Column names as text for an error message; a substitute if they are not printable."""
    text = ", ".join(header) or "no columns"
    return text if text.isprintable() and len(text) < 200 else "no readable names"
