"""Work on independent targets shared among threads; the result does not depend on their number."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from functools import cache

import numba
from threadpoolctl import ThreadpoolController

_PIECES_PER_THREAD = 8
"""Pieces per thread: targets differ in cost, and a thread that is done early takes another piece.
"""


_allowed = 1


def allow_threads(count: int) -> None:
    """Set the number of threads of this process that the library uses, initially one; at most the
    number that Numba has, by default one for each core."""
    global _allowed
    _allowed = max(1, min(count, numba.config.NUMBA_NUM_THREADS))
    numba.set_num_threads(_allowed)


def share_out(work: Callable[[int, int], None], count: int, least: int = 8) -> None:
    """Call ``work(first, stop)`` for consecutive pieces of ``range(count)``.

    Pieces have at least `least` items, and must not depend on each other. The number of threads is
    that of `allow_threads`. They run in parallel only in compiled functions that release Python's
    lock (``nogil``). An exception of a piece is raised again.
    """
    # not Numba's own count: reading it starts OpenMP, after which no process may be forked
    size = max(least, -(-count // (_PIECES_PER_THREAD * _allowed)))
    if _allowed == 1 or count <= size:
        work(0, count)
        return
    pieces = [(first, min(first + size, count)) for first in range(0, count, size)]
    with ThreadPoolExecutor(_allowed) as pool:
        for done in [pool.submit(work, *piece) for piece in pieces]:
            done.result()


def single_threaded_algebra() -> AbstractContextManager:
    """Context in which NumPy and SciPy use one thread. For matrices of some hundred rows several
    threads are slower, and round differently."""
    return _linear_algebra().limit(limits=1)


@cache
def _linear_algebra() -> ThreadpoolController:
    """The libraries of linear algebra that are loaded; to look for them takes milliseconds."""
    import scipy.linalg  # noqa: F401  (has a library of its own)

    return ThreadpoolController()
