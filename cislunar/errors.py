"""Errors that a user can resolve: each message names the fault, its location and the remedy."""

import difflib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager


class CislunarError(Exception):
    """Base class of every error that this library raises deliberately."""


class ConfigurationError(CislunarError, ValueError):
    """A setting is unknown, ill-typed or impossible; the message names its key."""


class InputFileError(CislunarError, ValueError):
    """A file is missing or has unusable content; the message names the file and the location."""


class ConvergenceError(CislunarError, RuntimeError):
    """An iteration (corrector, continuation) did not reach its tolerance."""


@contextmanager
def placed(
    place: str,
    caught: type[CislunarError] = CislunarError,
    raised: type[CislunarError] | None = None,
) -> Iterator[None]:
    """Put a place before the message of an error of the class `caught`, which is raised again as
    `raised` or else as what it is."""
    try:
        yield
    except caught as error:
        raise (raised or type(error))(f"{place}: {error}") from None


def did_you_mean(name: str, known: Iterable[str], likeness: float = 0.6) -> str:
    """Suggestion of similar known names for an unknown one, or an empty string.

    `likeness` is the cutoff of `difflib.get_close_matches`; case is ignored.
    """
    folded = {each.casefold(): each for each in known}
    close = difflib.get_close_matches(name.casefold(), folded, n=2, cutoff=likeness)
    return f"did you mean {' or '.join(repr(folded[each]) for each in close)}?" if close else ""


def known_keys(known: Iterable[str], most: int = 20) -> str:
    """The first keys that are known, and how many more there are, in the words of a remedy."""
    names = list(known)
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return f"known keys: {', '.join(names[:most])}{more}"
