"""Reports on the compilation of kernels: start, progress and duration."""

import sys
import time
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from typing import Any

from cislunar.runtime.progress import clock, note_compilation, progress_log, say

_KIND = "numba:compile"
_INTERVAL_S = 5.0
_active: list[Any] = []
"""Active listeners of `announced`; the last one reports, and the permanent one if there is none."""
_standing: list[Any] = []
"""The permanent listener of `announce_always`, if it was called."""


@contextmanager
def announced(files: Collection[str] | None = None) -> Iterator[None]:
    """Log that kernels of the library are compiled, the progress, and the duration. The total is
    the number of kernels in these `files`, some of which may not be needed; without files it is not
    known."""
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
    """Report from now on, in a process that calls the library interactively, such as a notebook."""
    from numba.core import event

    if not _standing:
        _standing.append(_listener(None))
        event.register(_KIND, _standing[0])


def _listener(files: Collection[str] | None) -> Any:
    from numba.core import event

    class Listener(event.Listener):
        """Receives every compilation; one may cause others."""

        depth = 0
        began = spent = reported = 0.0

        def on_start(self, _: Any) -> None:
            if self is not [*_standing, *_active][-1]:
                return
            if self.depth == 0:
                self.began = time.monotonic()
            if not self.spent and self.depth == 0:
                say("compiling kernels; they are cached, so that it is done once")
                self.report = progress_log("kernels", work_s=time.monotonic)
                self.before = _counted(files)[0]
                self.reported = self.began
            self.depth += 1

        def on_end(self, _: Any) -> None:
            if self is not [*_standing, *_active][-1]:
                return
            self.depth -= 1
            now = time.monotonic()
            if self.depth == 0:
                self.spent += now - self.began
                note_compilation(now - self.began)
            if files is not None:
                self.report(*_counted(files))
            elif now - self.reported > _INTERVAL_S:
                self.reported = now
                say("compiled %d kernels so far", self.count())

        def count(self) -> int:
            return _counted(files)[0] - self.before

    return Listener()


def _counted(files: Collection[str] | None) -> tuple[int, int]:
    """Numbers of compiled kernels and of all kernels, except those that are always inlined."""
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
