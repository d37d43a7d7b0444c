"""Progress of long work on the terminal or in a log, with the time left."""

import logging
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from typing import Any, TypeVar

logger = logging.getLogger("cislunar")

Progress = Callable[[int, int], None]
Item = TypeVar("Item")


def clock(seconds: float) -> str:
    """A time as it is read: minutes and seconds, hours if there are any."""
    minutes, second = divmod(round(seconds), 60)
    hours, minute = divmod(minutes, 60)
    return f"{hours}:{minute:02d}:{second:02d}" if hours else f"{minute}:{second:02d}"


def progress_log(name: str, interval_s: float = 5.0) -> Progress:
    """A callback (done, total) that logs at intervals: share done, elapsed time, time left.

    The time left follows from the pace since the first item, which may have had to wait for
    compilation; until there is a second one it is an upper limit.
    """
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
        remaining, at_most = "unknown left", name.endswith(("evaluations", "iterations"))
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


def each(items: Sequence[Item], name: str) -> Iterator[Item]:
    """Items one after the other, with progress logged as each is done."""
    progress = progress_log(name)
    for done, item in enumerate(items, start=1):
        yield item
        progress(done, len(items))


@contextmanager
def on_terminal(level: int = logging.INFO) -> Iterator[None]:
    """What the library logs from this level on goes to the terminal."""
    handler, before = logging.StreamHandler(), logger.level
    logger.addHandler(handler)
    logger.setLevel(level)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(before)


def say(text: str, *values: Any) -> None:
    """Log a line, to the terminal where no logging is set up, as in a notebook."""
    with nullcontext() if logger.hasHandlers() else on_terminal():
        logger.info(text, *values)
