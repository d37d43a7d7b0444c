"""Compilation of kernels in sight: a line when it begins, how far it is, and how long it took."""

import sys
import time
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from typing import Any

from cislunar.campaign.data.progress import clock, progress_log, say

_KIND = "numba:compile"
_INTERVAL_S = 5.0
_active: list[Any] = []
"""Listeners of `announced` that are at work; while there are any the standing one is silent."""
_standing: list[Any] = []
"""The listener of `announce_always`, if it was called."""


@contextmanager
def announced(files: Collection[str] | None = None) -> Iterator[None]:
    """Say that kernels of the library are compiled, how far that is, and the time it took.

    All kernels in these `files` are taken for those to compile; some may not be needed. Without
    files it is not known how many there are to come.
    """
    from numba.core import event

    listener = _listener(files)
    event.register(_KIND, listener)
    _active.append(listener)
    try:
        yield
    finally:
        _active.remove(listener)
        event.unregister(_KIND, listener)
        if listener.spent:
            say("compiled %d kernels in %s", listener.count(), clock(listener.spent))


def announce_always() -> None:
    """Do so from now on, in a process that calls the library as it goes, such as a notebook."""
    from numba.core import event

    if not _standing:
        _standing.append(_listener(None))
        event.register(_KIND, _standing[0])


def _listener(files: Collection[str] | None) -> Any:
    from numba.core import event

    class Listener(event.Listener):
        """Hears of every compilation; one may cause others."""

        depth = 0
        began = spent = told = 0.0

        def on_start(self, _: Any) -> None:
            if self in _standing and _active:
                return
            if self.depth == 0:
                self.began = time.monotonic()
            if not self.spent and self.depth == 0:
                say("compiling kernels; they are cached, so that it is done once")
                self.report = progress_log("kernels")
                self.before = _counted(files)[0]
                self.told = self.began
            self.depth += 1

        def on_end(self, _: Any) -> None:
            if self in _standing and _active:
                return
            self.depth -= 1
            now = time.monotonic()
            if self.depth == 0:
                self.spent += now - self.began
            if files is not None:
                self.report(*_counted(files))
            elif now - self.told > _INTERVAL_S:
                self.told = now
                say("compiled %d kernels so far", self.count())

        def count(self) -> int:
            return _counted(files)[0] - self.before

    return Listener()


def _counted(files: Collection[str] | None) -> tuple[int, int]:
    """Kernels that are ready, and all of them; those that are always inlined do not count."""
    from numba.core.dispatcher import Dispatcher

    loaded = [module for name, module in list(sys.modules.items()) if name.startswith("cislunar.")]
    kernels = {
        id(each): each
        for module in loaded
        for each in list(vars(module).values())
        if isinstance(each, Dispatcher)
        and each.targetoptions.get("inline") != "always"
        and (files is None or each.py_func.__code__.co_filename in files)
    }
    return sum(bool(each.overloads) for each in kernels.values()), len(kernels)
