"""Reports on the compilation of kernels: start, progress and duration."""

import sys
import time
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from types import FunctionType, ModuleType
from typing import Any

from cislunar.runtime.progress import clock, note_compilation, progress_log, say, shown

_KIND = "numba:compile"
_active: list[Any] = []
"""Active listeners of `announced`; the last one reports, and the permanent one if there is none."""
_standing: list[Any] = []
"""The permanent listener of `announce_always`, if it was called."""


@contextmanager
def announced(files: Collection[str] | None = None) -> Iterator[None]:
    """Log that kernels of the library are compiled, the progress with the time left, and the
    duration. The total is the number of kernels in these `files`; without files it is the number of
    kernels within the kernel that is being called. Some of them may not be needed."""
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
        began = spent = 0.0

        def on_start(self, started: Any) -> None:
            if self is not [*_standing, *_active][-1]:
                return
            if self.depth == 0:
                self.began = time.monotonic()
                if not self.spent:
                    say("compiling kernels; they are cached, so that it is done once")
                    self.before = len(_compiled(_kernels(files)))
                    self.report = progress_log("kernels", work_s=time.monotonic)
                if files is None:  # each call has its own total
                    self.within = kernels_within(started.data["dispatcher"])
                    self.report = progress_log("kernels", work_s=time.monotonic)
            self.depth += 1

        def on_end(self, _: Any) -> None:
            if self is not [*_standing, *_active][-1]:
                return
            self.depth -= 1
            if self.depth == 0:
                took = time.monotonic() - self.began
                self.spent += took
                note_compilation(took)
            wanted = self.within if files is None else _kernels(files)
            done = len(_compiled(wanted))
            if done < len(wanted):
                with shown():
                    self.report(done, len(wanted))

        def count(self) -> int:
            return len(_compiled(_kernels(files))) - self.before

    return Listener()


def _kernels(files: Collection[str] | None) -> list[Any]:
    """Loaded kernels of the library, all or those in some files, except those that are always
    inlined."""
    from numba.core.dispatcher import Dispatcher

    loaded = [module for name, module in list(sys.modules.items()) if name.startswith("cislunar.")]
    kernels = {
        id(each): each
        for module in loaded
        for each in list(vars(module).values())
        if isinstance(each, Dispatcher)
        and not _inlined(each)
        and (files is None or each.py_func.__code__.co_filename in files)
    }
    return [*kernels.values()]


def _compiled(kernels: Collection[Any]) -> list[Any]:
    return [each for each in kernels if each.overloads]


def _inlined(kernel: Any) -> bool:
    return kernel.targetoptions.get("inline") == "always"


def kernels_within(kernel: Any) -> list[Any]:
    """A kernel and all kernels that it may call, directly or not, except those that are always
    inlined. Of a function with implementations by type, these are the kernels of all of them."""
    from numba.core.dispatcher import Dispatcher

    from cislunar.compiled import implementations

    found, todo = {}, [kernel]
    while todo:
        each = todo.pop()
        if id(each) in found:
            continue
        found[id(each)] = each
        function = getattr(each, "py_func", each)
        names = function.__code__.co_names
        values = [function.__globals__.get(name) for name in names]
        values += [getattr(value, name, None) for value in values for name in names
                   if isinstance(value, ModuleType)]  # fmt: skip
        values += [cell.cell_contents for cell in function.__closure__ or ()]
        for value in values:
            if isinstance(value, Dispatcher):
                todo.append(value)
            elif isinstance(value, FunctionType):
                todo += implementations(value)
    return [each for each in found.values() if isinstance(each, Dispatcher) and not _inlined(each)]
