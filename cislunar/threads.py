"""Work on independent targets shared among threads, with the same result on any number of them."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from numba import get_num_threads

PIECES_PER_THREAD = 8
"""Targets differ in cost: who is done early takes another piece."""


def share_out(work: Callable[[int, int], None], count: int, least: int = 8) -> None:
    """Do ``work(first, stop)`` for consecutive pieces that make up ``range(count)``.

    There are as many threads as Numba's kernels may use (`numba.set_num_threads`, in the campaign
    the threads of the job). They run at once only in compiled functions without Python's lock
    (``nogil``).

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
    threads = get_num_threads()
    size = max(least, -(-count // (PIECES_PER_THREAD * threads)))
    if threads == 1 or count <= size:
        work(0, count)
        return
    pieces = [(first, min(first + size, count)) for first in range(0, count, size)]
    with ThreadPoolExecutor(threads) as pool:
        for done in [pool.submit(work, *piece) for piece in pieces]:
            done.result()
