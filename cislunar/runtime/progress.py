"""Progress of long computations on the terminal or in a log, with the remaining time."""

import logging
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager, nullcontext
from typing import Any, TypeVar

logger = logging.getLogger("cislunar")

Progress = Callable[[int, int], None]
_UPPER_LIMITS = ("evaluations", "iterations", "kernels")
"""Endings of the names of work that may end before its total."""
_Item = TypeVar("Item")


def clock(seconds: float) -> str:
    """A duration as minutes and seconds, with hours if there are any."""
    minutes, second = divmod(round(seconds), 60)
    hours, minute = divmod(minutes, 60)
    return f"{hours}:{minute:02d}:{second:02d}" if hours else f"{minute}:{second:02d}"


_compiled_s = [0.0]
"""Time that this process has spent on compilation, s."""


def note_compilation(seconds: float) -> None:
    """Exclude a time spent on compilation from the rates of what is under way."""
    _compiled_s[0] += seconds


def progress_log(name: str, interval_s: float = 5.0, *, work_s: Callable[[], float] | None = None
                 ) -> Progress:  # fmt: skip
    """A callback (done, total) that logs at intervals: share done, elapsed time, remaining time.
    The remaining time follows from the rate since the first item, per second of `work_s`, which is
    the time without compilation if omitted; before the second item it is an upper limit."""
    begin = last = time.monotonic()
    worked = work_s or (lambda: time.monotonic() - _compiled_s[0])
    start = worked()
    first: tuple[int, float] | None = None

    def report(done: int, total: int) -> None:
        nonlocal first, last
        now, spent = time.monotonic(), worked()
        if first is None and done > 0:
            first = done, spent
        if now - last < interval_s and done < total:
            return
        last = now
        share = 100.0 * done / total if total else 100.0
        remaining, at_most = "unknown left", name.endswith(_UPPER_LIMITS)
        if first is not None:
            counted, since = (0, start) if done == first[0] else first
            left = (spent - since) * (total - done) / (done - counted)
            at_most = (at_most or counted == 0) and done < total
            remaining = f"{clock(left)} left{' at most' if at_most else ''}"
        logger.info(
            "%s: %d of %d (%.0f %%), %s elapsed, %s",
            name,
            done,
            total,
            share,
            clock(now - begin),
            remaining,
        )

    return report


def counted(items: Collection[_Item], progress: Progress | None) -> Iterator[_Item]:
    """Iterate over items; `progress`, if any, is called after each with (done, all)."""
    for done, item in enumerate(items, start=1):
        yield item
        if progress is not None:
            progress(done, len(items))


def each(items: Collection[_Item], name: str) -> Iterator[_Item]:
    """Iterate over items and log the progress after each."""
    return counted(items, progress_log(name))


@contextmanager
def on_terminal(level: int = logging.INFO) -> Iterator[None]:
    """Log messages of the library from this level on to the terminal."""
    handler, before = logging.StreamHandler(), logger.level
    logger.addHandler(handler)
    logger.setLevel(level)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(before)


@contextmanager
def shown() -> Iterator[None]:
    """Log to the terminal if no logging is configured, as in a notebook."""
    with nullcontext() if logger.hasHandlers() else on_terminal():
        yield


def say(text: str, *values: Any) -> None:
    """Log a line, to the terminal if no logging is configured."""
    with shown():
        logger.info(text, *values)
