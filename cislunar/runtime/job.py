"""A job of the campaign: its log, time, memory and threads, and how it ends."""

import logging
import os
import resource
import signal
import socket
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from cislunar.errors import CislunarError
from cislunar.runtime.compilation import announced
from cislunar.runtime.netcdf import write_text
from cislunar.runtime.progress import clock, logger


class _LogFile(logging.FileHandler):
    """A log file that is disabled, after one line on the terminal, when it cannot be written."""

    def handleError(self, record: logging.LogRecord) -> None:
        reason = sys.exception()
        self.setLevel(logging.CRITICAL + 1)
        print(f"warning: cannot write log {self.baseFilename}: {reason}", file=sys.stderr)

    def close(self) -> None:
        try:
            super().close()
        except OSError:  # the rest of the buffer of a log on a full disk
            self.stream = None


def _handlers(log: Path) -> list[logging.Handler]:
    """Terminal and log file; the terminal alone if the file cannot be opened."""
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
    """The job received SIGTERM; only `job` handles this exception."""


@contextmanager
def _sigterm_raises() -> Iterator[None]:
    """Turn SIGTERM into an exception, so that temporary files are removed and the log has it."""
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


def _times(seconds: float) -> str:
    """A table like Snakemake's benchmarks: time and CPU time in s, largest memory in MB. Snakemake
    would measure the process that waits for the job, not the job."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    # in kilobytes, and in bytes on macOS
    megabytes = used.ru_maxrss / (1024.0**2 if sys.platform == "darwin" else 1024.0)
    cpu_s = used.ru_utime + used.ru_stime
    return f"s\tmax_rss\tcpu_time\n{seconds:.4f}\t{megabytes:.2f}\t{cpu_s:.2f}\n"


@contextmanager
def job(files: Sequence[str | Path], threads: int = 1) -> Iterator[None]:
    """Run a job of the campaign: log to its file and the terminal, limit the kernels' threads. The
    `files` are its log and, if there are two, the table of its time and memory, written at the end.
    A `CislunarError` ends the job with its message alone, without a traceback. So do an interrupt
    (SIGINT) and a termination (SIGTERM: the time limit of a cluster, or Snakemake stopping)."""
    from cislunar.runtime.threads import allow_threads

    allow_threads(threads)
    handlers: list[logging.Handler] = []
    start = time.monotonic()
    try:
        with _sigterm_raises(), announced():
            handlers += _handlers(Path(files[0]))
            for handler in handlers:
                logger.addHandler(handler)
            logger.setLevel(logging.INFO)
            logger.info("started on %s, process %d", socket.gethostname(), os.getpid())
            yield
            for path in files[1:]:
                write_text(_times(time.monotonic() - start), path)
        logger.info("done in %s", clock(time.monotonic() - start))
    except CislunarError as error:
        logger.error("error: %s", error)
        sys.exit(1)
    except (KeyboardInterrupt, _Terminated) as stop:
        interrupted = isinstance(stop, KeyboardInterrupt)
        what = "interrupted" if interrupted else "stopped (time limit, or Snakemake stopping)"
        elapsed = clock(time.monotonic() - start)
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
