"""Progress of a job: a log file and the terminal, with the time left."""

import logging
import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

from cislunar.errors import CislunarError

logger = logging.getLogger("cislunar")

Progress = Callable[[int, int], None]
Item = TypeVar("Item")


def _clock(seconds: float) -> str:
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
            remaining = f"{_clock(left)} left{' at most' if at_most else ''}"
        logger.info(
            "%s: %d of %d (%.0f %%), %s elapsed, %s",
            name,
            done,
            total,
            share,
            _clock(elapsed),
            remaining,
        )

    return report


def each(items: Sequence[Item], name: str) -> Iterator[Item]:
    """Items one after the other, with progress logged as each is done."""
    progress = progress_log(name)
    for done, item in enumerate(items, start=1):
        yield item
        progress(done, len(items))


class _LogFile(logging.FileHandler):
    """A log file that falls silent, after one line on the terminal, when it cannot be written."""

    def handleError(self, record: logging.LogRecord) -> None:
        reason = sys.exception()
        self.setLevel(logging.CRITICAL + 1)
        print(f"warning: cannot write log {self.baseFilename}: {reason}", file=sys.stderr)

    def close(self) -> None:
        try:
            super().close()
        except OSError:  # what is left in the buffer of a log on a full disk
            self.stream = None


def _handlers(log: Path) -> list[logging.Handler]:
    """Terminal and log file; the terminal alone where the file cannot be opened."""
    handlers: list[logging.Handler] = [logging.StreamHandler()]
    try:
        log.parent.mkdir(parents=True, exist_ok=True)
        handlers.append(_LogFile(log, mode="w", encoding="utf-8"))
    except OSError as error:
        print(f"warning: cannot write log {log}: {error.strerror}", file=sys.stderr)
    for handler in handlers:
        handler.setFormatter(logging.Formatter("%(asctime)s %(message)s", "%H:%M:%S"))
    return handlers


class _Terminated(BaseException):
    """The job was sent SIGTERM; past every handler but that of `job`."""


@contextmanager
def _sigterm_raises() -> Iterator[None]:
    """Turn SIGTERM into an exception, so that temporary files go and the log says what happened."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def terminate(number, frame):
        raise _Terminated

    before = signal.signal(signal.SIGTERM, terminate)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def job(log: str | Path, threads: int = 1) -> Iterator[None]:
    """Run a job of the campaign: log to its file and the terminal, limit the kernels' threads.

    An error raised on purpose ends the job with its message alone, not a traceback; so do an
    interrupt (SIGINT) and a termination (SIGTERM: a cluster's time limit, or Snakemake stopping).
    """
    import numba

    numba.set_num_threads(max(1, min(threads, numba.config.NUMBA_NUM_THREADS)))
    handlers: list[logging.Handler] = []
    start = time.monotonic()
    try:
        with _sigterm_raises():
            handlers += _handlers(Path(log))
            for handler in handlers:
                logger.addHandler(handler)
            logger.setLevel(logging.INFO)
            logger.info("started on %s, process %d", socket.gethostname(), os.getpid())
            yield
        logger.info("done in %s", _clock(time.monotonic() - start))
    except CislunarError as error:
        logger.error("error: %s", error)
        sys.exit(1)
    except (KeyboardInterrupt, _Terminated) as stop:
        interrupted = isinstance(stop, KeyboardInterrupt)
        what = "interrupted" if interrupted else "stopped (time limit, or Snakemake stopping)"
        elapsed = _clock(time.monotonic() - start)
        logger.error("%s after %s; run the same command again to make this result", what, elapsed)
        sys.exit(130 if interrupted else 143)
    except MemoryError:
        logger.error("error: out of memory; run fewer jobs at a time (--cores) or a smaller case")
        sys.exit(1)
    except Exception:
        logger.exception("unexpected error")
        raise
    finally:
        for handler in handlers:
            logger.removeHandler(handler)
            handler.close()
