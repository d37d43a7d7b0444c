"""Finds results that are damaged although Snakemake considers them complete.

Snakemake judges a result by its date alone and does not notice a file that was truncated by hand,
by a copy or by a faulty disk. ``cislunar verify`` reads every result to its end and lists those
that cannot be used. With ``--delete`` it removes those that a rule of the workflow has made, as
Snakemake has recorded in the working folder or in a folder above the file. Other files are a
user's own, or results that no rule makes again.
"""

import os
import time
from base64 import urlsafe_b64encode
from collections.abc import Callable, Iterator
from pathlib import Path

from cislunar.errors import CislunarError, InputFileError
from cislunar.runtime import each, read_dataset

_WRITING_S = 600.0
_REMAINDER = ".part"


def _check_dataset(path: Path) -> None:
    if not read_dataset(path).variables:
        raise InputFileError("contains no variable")


def _check_table(path: Path) -> None:
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise InputFileError(f"is no text in UTF-8 ({error})") from error
    if not text.endswith("\n"):
        raise InputFileError("is empty or does not end with its last line")


def _check_end(path: Path) -> None:
    end, kind = (b"IEND\xaeB`\x82", "PNG") if path.suffix == ".png" else (b"%%EOF", "PDF")
    content = path.read_bytes()
    if not (content if kind == "PNG" else content.rstrip()).endswith(end):
        raise InputFileError(f"does not end as a {kind} file does")


_CHECKS: dict[str, Callable[[Path], None]] = {
    ".nc": _check_dataset, ".csv": _check_table, ".png": _check_end, ".pdf": _check_end
}  # fmt: skip
"""Check of a result by the suffix of its name."""


def damaged_results(folder: str | Path) -> Iterator[tuple[Path, str]]:
    """Read every result below a folder to its end; yields those that cannot be used, with the
    reason.

    Raises `InputFileError` if there is no such folder, or nothing in it that is a result or the
    remainder of one.
    """
    folder = Path(folder)
    if not folder.is_dir():
        reason = "is a file, not a folder" if folder.exists() else "no such folder"
        raise InputFileError(f"{folder}: {reason}; give the results folder of a campaign")
    paths = sorted(folder.rglob("*"))
    if not any(path.suffix in (*_CHECKS, _REMAINDER) for path in paths):
        raise InputFileError(
            f"{folder}: contains no result ({', '.join(_CHECKS)}); give the results folder of a "
            "campaign"
        )
    for path in each(paths, "files"):
        check = _CHECKS.get(path.suffix)
        if check is None or not path.is_file():
            continue
        try:
            check(path)
        except (CislunarError, OSError) as error:
            yield path, str(error).removeprefix(f"data set {path} ")


def _leftovers(folder: str | Path) -> list[Path]:
    """Temporary files of jobs that were killed while writing, unchanged for ten minutes."""
    now = time.time()
    found = Path(folder).rglob(f".*.[0-9]*{_REMAINDER}")  # with the number of the process
    return sorted(path for path in found if now - path.stat().st_mtime > _WRITING_S)


def _recorded(path: Path) -> bool:
    """Whether Snakemake has recorded that a rule has made a file; its record has the encoded name
    of the file, in pieces that the file system allows."""
    path = path.absolute()
    for folder in (Path.cwd(), *path.parents):
        own = os.path.relpath(path, folder)
        for name in (str(path), own, f"./{own}"):
            text = urlsafe_b64encode(name.encode()).decode()
            *begin, end = (text[k : k + 254] for k in range(0, len(text), 254))
            record = Path(folder, ".snakemake/metadata", *(f"@{each}" for each in begin), end)
            if record.is_file():
                return True
    return False


def check_results(folder: str | Path, *, delete: bool = False) -> bool:
    """Print which results cannot be used and what killed jobs have left.

    Parameters
    ----------
    folder : str or Path
        Results folder of a campaign.
    delete : bool
        Whether these files are deleted, except damaged files of which Snakemake has no record that
        a rule has made them.

    Returns
    -------
    bool
        Whether every result can be used.

    Raises
    ------
    InputFileError
        See `damaged_results`.
    """
    damaged, remains = list(damaged_results(folder)), _leftovers(folder)
    for path, reason in damaged:
        print(f"{path}: {reason}")
    for path in remains:
        print(f"{path}: left by a job that was killed while it wrote")
    made = [path for path, _ in damaged if _recorded(path)]
    if delete:
        for path in [*made, *remains]:
            path.unlink(missing_ok=True)
    for line in _summary(damaged, made, delete):
        print(line)
    return not damaged


def _summary(damaged: list[tuple[Path, str]], made: list[Path], deleted: bool) -> Iterator[str]:
    """Lines on what to do; `made` are the damaged results that a rule has made."""
    if not damaged:
        yield "every result can be used"
    elif made and deleted:
        options = "with --configfile or --config as before"
        yield f"removed; make anew, {options}: snakemake --cores 2 -- {' '.join(map(str, made))}"
    elif made:
        yield "damaged; remove them with --delete, then make them anew with snakemake"
    for path in sorted({path for path, _ in damaged} - {*made}):
        yield (
            f"{path}: not removed by --delete, since Snakemake has no record of it: correct it, or "
            "remove it and run what made it again"
        )
