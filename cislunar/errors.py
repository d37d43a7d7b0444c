"""Errors a user can act on: each message says what is wrong, where, and the mend."""

import difflib
from collections.abc import Iterable


class CislunarError(Exception):
    """Base class of every error this library raises on purpose."""


class ConfigurationError(CislunarError, ValueError):
    """A setting is unknown, ill-typed or impossible; the message names its key."""


class InputFileError(CislunarError, ValueError):
    """A file is missing or holds something unusable; the message names the file and the place."""


class ConvergenceError(CislunarError, RuntimeError):
    """An iteration (corrector, continuation) did not reach its tolerance."""


def did_you_mean(name: str, known: Iterable[str], likeness: float = 0.6) -> str:
    """A question for the known names like one that is not known, or nothing if none is.

    `likeness` is that of `difflib.get_close_matches`; case does not count.
    """
    folded = {each.casefold(): each for each in known}
    close = difflib.get_close_matches(name.casefold(), folded, n=2, cutoff=likeness)
    return f"did you mean {' or '.join(repr(folded[each]) for each in close)}?" if close else ""
