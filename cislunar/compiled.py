"""Compile-time overloads by the type of the first argument, and decorators of kernels."""

from collections.abc import Callable
from inspect import signature
from types import FunctionType
from typing import Any

import numba
from numba.extending import overload

try:
    from cislunar.kernel_dispatcher import KernelDispatcher
except (ImportError, AttributeError):  # another version of Numba
    KernelDispatcher = None

_WITH_OWN_BODY: dict[Callable, dict[type, Callable]] = {}
_FOR_ALL_OTHERS: set[Callable] = set()


def implements(function: Callable, model: type) -> Callable:
    """Decorator: implementation of a `function`, which kernels call and whose own body is not
    compiled, for a NamedTuple class of first argument. Kernels are cached on disk by the name of
    the class, so that it has to be importable in every process that shares the cache.

    Numba compiles the body anew for each place of a call. The body of a kernel (`njit_inline`) is
    compiled once. Such a kernel must not return arrays, since the caller may count references."""

    def register(body: Callable) -> Callable:
        inlined = body if isinstance(body, FunctionType) else _call_of(body)

        def choose(first: Any, *_: Any) -> Callable | None:
            return inlined if getattr(first, "instance_class", None) is model else None

        overload(function, strict=False, inline="always")(choose)
        _WITH_OWN_BODY.setdefault(function, {})[model] = body
        return body

    return register


def _call_of(kernel: Any) -> Callable:
    """A function that calls a kernel."""
    names = ", ".join(signature(kernel.py_func).parameters)
    space = {"kernel": kernel, "__name__": kernel.py_func.__module__}
    return eval(f"lambda {names}: kernel({names})", space)


def implementations(function: Callable) -> list[Callable]:
    """All functions that may be compiled in place of a function that is chosen by type."""
    own = [function] if function in _FOR_ALL_OTHERS else []
    return [*own, *_WITH_OWN_BODY.get(function, {}).values()]


def for_all_others(function: Callable) -> Callable:
    """Decorator: a function whose own body is compiled for all classes without `implements`."""

    def choose(first: Any, *_: Any) -> Callable | None:
        own = getattr(first, "instance_class", None) in _WITH_OWN_BODY.get(function, ())
        return None if own else function

    overload(function, strict=False, inline="always")(choose)
    _FOR_ALL_OTHERS.add(function)
    return function


def njit(*, cache: bool, **options: Any) -> Callable:
    """As `numba.njit` for kernels of the library: object code is made only for the kernels that
    Python calls, see `cislunar.kernel_dispatcher`, if this version of Numba allows it."""

    options.setdefault("forceinline", False)  # else that of the first caller

    def decorate(function: Callable) -> Callable:
        if KernelDispatcher is None or numba.config.DISABLE_JIT:
            return numba.njit(cache=cache, **options)(function)
        usual = {"nopython": True, "boundscheck": None}
        kernel = KernelDispatcher(function, targetoptions=usual | options)
        if cache:
            kernel.enable_caching()
        return kernel

    return decorate


def njit_noalloc(function: Callable) -> Any:
    """Decorator of kernels that allocate no arrays and return none except their arguments.

    Numba counts references to every array that a kernel takes from a tuple or of which it takes a
    view. In a filter step this took longer than the arithmetic. The caller of such a kernel keeps
    references to the arrays, so that counting is unnecessary. Numba refuses to compile a kernel
    that needs it.
    """
    return njit(cache=True, error_model="numpy", _nrt=False)(function)


def njit_alloc(function: Callable) -> Any:
    """Decorator of kernels that allocate arrays and are called by `njit_noalloc` kernels.

    It has to be explicit, because otherwise a kernel inherits the option of its first caller.
    """
    return njit(cache=True, error_model="numpy", _nrt=True)(function)


def njit_inline(function: Callable) -> Any:
    """Decorator of small kernels that compute scalars from scalars and entries of arrays.

    LLVM inlines them, so that they are as fast as with Numba's ``inline="always"``, which compiles
    a kernel anew for each place of a call.
    """
    return njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)(function)


def copy_into(out: Any, values: Any) -> None:
    """Copy an array with one or two axes into another of its shape (in kernels only). In ``out[...]
    = values`` Numba allocates memory in case the two arrays overlap."""
    raise NotImplementedError


@overload(copy_into, jit_options={"_nrt": False, "error_model": "numpy"})
def _copy_into(out: Any, values: Any) -> Callable:
    def one(out: Any, values: Any) -> None:
        for i in range(out.shape[0]):
            out[i] = values[i]

    def two(out: Any, values: Any) -> None:
        for i in range(out.shape[0]):
            for j in range(out.shape[1]):
                out[i, j] = values[i, j]

    return one if out.ndim == 1 else two
