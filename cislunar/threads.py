"""Work on independent targets shared among threads, with the same result on any number of them."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numba

PIECES_PER_THREAD = 8
"""Targets differ in cost: who is done early takes another piece."""


_allowed = 1


def allow_threads(count: int) -> None:
    """Let the functions of the library use so many threads of this process; at first it is one.

    Parameters
    ----------
    count : int
        At most as many as Numba has, by default one for each core.
    """
    global _allowed
    _allowed = max(1, min(count, numba.config.NUMBA_NUM_THREADS))
    numba.set_num_threads(_allowed)


def share_out(work: Callable[[int, int], None], count: int, least: int = 8) -> None:
    """Do ``work(first, stop)`` for consecutive pieces that make up ``range(count)``.

    There are as many threads as `allow_threads` says, in the campaign those of the job. They run at
    once only in compiled functions without Python's lock (``nogil``).

    Parameters
    ----------
    work : callable
        Must not let one piece depend on another.
    count : int
        Of all.
    least : int
        Smallest piece worth a thread.

    Raises
    ------
    Exception
        The first that a piece raised.
    """
    # not Numba's own count: asked for it, Numba starts OpenMP, and no process may be forked then
    size = max(least, -(-count // (PIECES_PER_THREAD * _allowed)))
    if _allowed == 1 or count <= size:
        work(0, count)
        return
    pieces = [(first, min(first + size, count)) for first in range(0, count, size)]
    with ThreadPoolExecutor(_allowed) as pool:
        for done in [pool.submit(work, *piece) for piece in pieces]:
            done.result()
