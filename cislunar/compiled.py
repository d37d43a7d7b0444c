"""Choice of a function by the type of its first argument when a kernel is compiled."""

from collections.abc import Callable
from typing import Any

from numba.extending import overload

_WITH_OWN_BODY: dict[Callable, set[type]] = {}


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
        _WITH_OWN_BODY.setdefault(function, set()).add(model)
        return body

    return register


def for_all_others(function: Callable) -> Callable:
    """Decorator: what kernels call, its own body compiled for classes that implement no other."""

    def choose(first: Any, *_: Any) -> Callable | None:
        own = getattr(first, "instance_class", None) in _WITH_OWN_BODY.get(function, ())
        return None if own else function

    overload(function, strict=False, inline="always")(choose)
    return function
