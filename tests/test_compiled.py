"""Kernels that create no arrays, and kernels that create some."""

import importlib
import pkgutil

import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher
from numba.core.errors import NumbaError

import cislunar
from cislunar.compiled import copy_into, njit_noalloc
from cislunar.kernel_dispatcher import KernelDispatcher


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
