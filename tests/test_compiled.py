"""Kernels that create no arrays, and kernels that create some."""

import importlib
import pkgutil
from typing import NamedTuple

import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher
from numba.core.errors import NumbaError

import cislunar
from cislunar.compiled import copy_into, implements, njit, njit_inline, njit_noalloc
from cislunar.kernel_dispatcher import KernelDispatcher


class Line(NamedTuple):
    """A straight line, an implementation of `value_at`."""

    slope: float


def value_at(line, x):
    raise NotImplementedError


@implements(value_at, Line)
@njit_inline
def _value_of_line(line, x):
    return line.slope * x


def _kernels():
    """Every compiled function of the library, by module and name."""
    for found in pkgutil.walk_packages(cislunar.__path__, "cislunar."):
        if found.name != "cislunar.__main__":
            for name, value in vars(importlib.import_module(found.name)).items():
                if isinstance(value, Dispatcher):
                    yield f"{found.name}.{name}", value


def _called(kernel):
    """Compiled functions that a kernel calls, those of what is inlined into it included."""
    for name in kernel.py_func.__code__.co_names:
        value = kernel.py_func.__globals__.get(name)
        if isinstance(value, Dispatcher) and value is not kernel:
            if value.targetoptions.get("inline") == "always":
                yield from _called(value)
            else:
                yield name, value


def test_every_kernel_has_the_dispatcher_of_the_library():
    usual = {name for name, kernel in _kernels() if not isinstance(kernel, KernelDispatcher)}
    assert not usual


def test_kernels_without_arrays_call_kernels_with_a_decorator_only():
    # another would take after the first that calls it, and hang on the order of compilation
    noalloc_kernels = {n: k for n, k in _kernels() if k.targetoptions.get("_nrt") is False}
    assert len(noalloc_kernels) > 100
    silent = {
        f"{name} calls {callee}"
        for name, kernel in noalloc_kernels.items()
        for callee, value in _called(kernel)
        if "_nrt" not in value.targetoptions
    }
    assert not silent


def test_a_kernel_without_arrays_cannot_create_one():
    @njit_noalloc
    def makes(n):
        return np.empty(n).size

    with pytest.raises(NumbaError, match="array passed into the function"):
        makes(3)


@pytest.mark.parametrize("shape", [(4,), (3, 5)])
def test_put_copies_views_of_any_layout(shape):
    @njit_noalloc
    def copy(out, values):
        copy_into(out, values)

    values = np.arange(np.prod(shape), dtype=float).reshape(shape)
    wide = np.zeros(tuple(2 * n for n in shape))
    copy(wide[tuple(slice(None, None, 2) for _ in shape)], values)
    np.testing.assert_array_equal(wide[tuple(slice(None, None, 2) for _ in shape)], values)
    assert np.sum(wide) == np.sum(values)


def test_the_kernel_of_an_implementation_is_compiled_once_for_several_calls():
    @njit(cache=False, error_model="numpy")  # a cached kernel would not compile what it calls
    def of_several(line, x):
        return value_at(line, x) + value_at(line, x + 1.0) * value_at(line, x + 2.0)

    assert of_several(Line(2.0), 3.0) == 6.0 + 8.0 * 10.0
    assert len(_value_of_line.overloads) == 1
    assert _value_of_line(Line(2.0), 3.0) == 6.0
