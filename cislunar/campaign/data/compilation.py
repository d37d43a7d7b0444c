"""Compilation of kernels in sight: a line when it begins, how far it is, and how long it took."""

import sys
import time
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from typing import Any

from cislunar.campaign.data.progress import clock, logger, progress_log


@contextmanager
def announced(files: Collection[str] | None = None) -> Iterator[None]:
    """Log that kernels of the library are compiled, how far that is, and the time it took.

    All kernels in these `files` are taken for those to compile; some may not be needed. Without
    files it is not known how many there are to come.
    """
    from numba.core import event

    class Listener(event.Listener):
        """Hears of every compilation; one may cause others."""

        depth = 0
        began = spent = 0.0

        def on_start(self, _: Any) -> None:
            if self.depth == 0:
                self.began = time.monotonic()
            if not self.spent and self.depth == 0:
                logger.info("compiling kernels; they are cached, so that it is done once")
                self.report = progress_log("kernels")
                self.before = _counted(files)[0]
            self.depth += 1

        def on_end(self, _: Any) -> None:
            self.depth -= 1
            if self.depth == 0:
                self.spent += time.monotonic() - self.began
            if files is not None:
                self.report(*_counted(files))

    listener = Listener()
    event.register("numba:compile", listener)
    try:
        yield
    finally:
        event.unregister("numba:compile", listener)
        if listener.spent:
            count = _counted(files)[0] - listener.before
            logger.info("compiled %d kernels in %s", count, clock(listener.spent))


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
