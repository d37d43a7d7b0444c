"""Time of an action, as all benchmarks take it."""

from collections.abc import Callable
from time import perf_counter


def best_time(action: Callable[[], object], repeats: int = 3) -> float:
    """Least wall time of an action after a first, uncounted call, s."""
    action()
    times = []
    for _ in range(repeats):
        start = perf_counter()
        action()
        times.append(perf_counter() - start)
    return min(times)
