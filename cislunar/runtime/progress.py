"""Progress of long computations on the terminal or in a log, with the remaining time."""

import logging
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from typing import Any, TypeVar

logger = logging.getLogger("cislunar")

Progress = Callable[[int, int], None]
_Item = TypeVar("Item")
_AT_MOST = "evaluations", "iterations", "kernels"
"""Endings of the names of work that may end before its total."""


def clock(seconds: float) -> str:
    """A duration as minutes and seconds, with hours if there are any."""
    minutes, second = divmod(round(seconds), 60)
    hours, minute = divmod(minutes, 60)
    return f"{hours}:{minute:02d}:{second:02d}" if hours else f"{minute}:{second:02d}"


def progress_log(name: str, interval_s: float = 5.0) -> Progress:
    """A callback (done, total) that logs at intervals: share done, elapsed time, remaining time.
    The remaining time follows from the rate since the first item, which may include compilation;
    before the second item it is an upper limit."""
    start = time.monotonic()
    last = start
    first: tuple[int, float] | None = None

    def report(done: int, total: int) -> None:
        nonlocal first, last
        now = time.monotonic()
        if first is None and done > 0:
            first = done, now
        if now - last < interval_s and done < total:
            return
        last = now
        elapsed = now - start
        share = 100.0 * done / total if total else 100.0
        remaining, at_most = "unknown left", name.endswith(_AT_MOST)
        if first is not None:
            counted, since = (0, start) if done == first[0] else first
            left = (now - since) * (total - done) / (done - counted)
            at_most = (at_most or counted == 0) and done < total
            remaining = f"{clock(left)} left{' at most' if at_most else ''}"
        logger.info(
            "%s: %d of %d (%.0f %%), %s elapsed, %s",
            name,
            done,
            total,
            share,
            clock(elapsed),
            remaining,
        )

    return report


def each(items: Sequence[_Item], name: str) -> Iterator[_Item]:
    """Iterate over items and log the progress after each."""
    progress = progress_log(name)
    for done, item in enumerate(items, start=1):
        yield item
        progress(done, len(items))


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
