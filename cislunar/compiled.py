"""Choice of a function by the type of its first argument when a kernel is compiled."""

from collections.abc import Callable
from typing import Any

from numba.extending import overload


def implements(function: Callable, model: type) -> Callable:
    """Decorator: the compiled body of a function for a class of first argument.

    Parameters
    ----------
    function : callable
        What kernels call; its own body is not compiled.
    model : type
        A NamedTuple class. Kernels are cached on disk by its name, so it has to be importable in
        every process that shares the cache.
    """

    def register(body: Callable) -> Callable:
        def choose(first: Any, *_: Any) -> Callable | None:
            return body if getattr(first, "instance_class", None) is model else None

        overload(function, strict=False, inline="always")(choose)
        return body

    return register
