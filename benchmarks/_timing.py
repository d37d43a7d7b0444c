"""Measure the time of an action, in the same way for all benchmarks."""

from collections.abc import Callable
from time import perf_counter, process_time


def best_time(action: Callable[[], object], repeats: int = 3) -> float:
    """Least wall time of an action, s; a first call is not counted."""
    action()
    times = []
    for _ in range(repeats):
        start = perf_counter()
        action()
        times.append(perf_counter() - start)
    return min(times)


def alternated(actions: dict[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Least processor time of each action, s; every round runs all actions in turn.

    Other load on the machine then affects all actions alike. A first round is not counted.
    """
    times = dict.fromkeys(actions, float("inf"))
    for counted in range(rounds + 1):
        for name, action in actions.items():
            start = process_time()
            action()
            if counted:
                times[name] = min(times[name], process_time() - start)
    return times
