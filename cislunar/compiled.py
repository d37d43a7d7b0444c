"""Choice of a function by the type of its first argument when a kernel is compiled."""

from collections.abc import Callable
from typing import Any

from numba import njit
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


borrowing = njit(cache=True, error_model="numpy", _nrt=False)
"""Decorator of kernels that use arrays of others: they make none and return none but arguments.

Numba counts the references to every array that a kernel takes out of a tuple or views a part of;
in a step of a filter that took longer than its arithmetic. Whoever calls such a kernel holds the
arrays while it runs, so that it need not count. What would need to is refused when it is compiled.
"""


allocating = njit(cache=True, error_model="numpy", _nrt=True)
"""Decorator of kernels that make arrays and are called by `borrowing` ones.

It has to be said, since a kernel takes after the first that calls it.
"""


def put(out: Any, values: Any) -> None:
    """Copy an array into another of its shape, with one or two axes (in kernels only).

    As ``out[...] = values``, for which room is taken in case the two share memory.
    """
    raise NotImplementedError


@overload(put, jit_options={"_nrt": False, "error_model": "numpy"})
def _put(out: Any, values: Any) -> Callable:
    def one(out: Any, values: Any) -> None:
        for i in range(out.shape[0]):
            out[i] = values[i]

    def two(out: Any, values: Any) -> None:
        for i in range(out.shape[0]):
            for j in range(out.shape[1]):
                out[i, j] = values[i, j]

    return one if out.ndim == 1 else two
