"""Progress of a job: a log file and the terminal, with the time left."""

import logging
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from cislunar.errors import CislunarError

logger = logging.getLogger("cislunar")

Progress = Callable[[int, int], None]


def _clock(seconds: float) -> str:
    minutes, second = divmod(round(seconds), 60)
    hours, minute = divmod(minutes, 60)
    return f"{hours}:{minute:02d}:{second:02d}" if hours else f"{minute}:{second:02d}"


def progress_log(name: str, interval_s: float = 5.0) -> Progress:
    """A progress callback that logs at intervals: share done, elapsed time, time left.

    Parameters
    ----------
    name : str
        What is going on.
    interval_s : float
        Least time between two lines, s.

    Returns
    -------
    callable
        Takes (done, total).
    """
    start = time.monotonic()
    last = start

    def report(done: int, total: int) -> None:
        nonlocal last
        now = time.monotonic()
        if now - last < interval_s and done < total:
            return
        last = now
        elapsed = now - start
        left = elapsed * (total - done) / done if done else float("nan")
        share = 100.0 * done / total if total else 100.0
        remaining = _clock(left) if done else "unknown"
        logger.info(
            "%s: %d of %d (%.0f %%), %s elapsed, %s left at most"
            if name.endswith("evaluations")
            else "%s: %d of %d (%.0f %%), %s elapsed, %s left",
            name,
            done,
            total,
            share,
            _clock(elapsed),
            remaining,
        )

    return report


@contextmanager
def job(log: str | Path, threads: int = 1) -> Iterator[None]:
    """Run a job of the campaign: log to its file and the terminal, limit its threads.

    An error raised on purpose ends the job with its message alone, not a traceback.

    Parameters
    ----------
    log : str or Path
        The job's log file.
    threads : int
        Threads the compiled kernels may use.
    """
    import numba

    Path(log).parent.mkdir(parents=True, exist_ok=True)
    numba.set_num_threads(max(1, min(threads, numba.config.NUMBA_NUM_THREADS)))
    handlers = [logging.FileHandler(log, mode="w", encoding="utf-8"), logging.StreamHandler()]
    for handler in handlers:
        handler.setFormatter(logging.Formatter("%(asctime)s %(message)s", "%H:%M:%S"))
        logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    start = time.monotonic()
    try:
        yield
        logger.info("done in %s", _clock(time.monotonic() - start))
    except CislunarError as error:
        logger.error("error: %s", error)
        sys.exit(1)
    except Exception:
        logger.exception("unexpected error")
        raise
    finally:
        for handler in handlers:
            logger.removeHandler(handler)
            handler.close()
