"""Kernels with object code for those only that Python calls, and their cache on disk."""

import os
import subprocess
import sys

import pytest

KERNELS = """
import os

import numba
import numpy as np

from cislunar import compiled
from cislunar.compiled import njit, njit_alloc, njit_noalloc

SCALE, TABLE = 3.0, np.arange(5.0)


@njit(cache=True)
def inner(x):
    if x > 4.0:
        raise ValueError("above the limit", x)
    print("inner", x, "of", SCALE)
    return SCALE * x + TABLE[2]


@njit_alloc
def middle(x):
    return inner(x) + np.sum(np.array([x, 2.0 * x]))


@njit(cache=True)
def first(x):
    return middle(x) - inner(2.0 * x)


@njit_alloc
def second(x):
    return middle(x) + 1.0


@numba.njit(cache=bool(os.environ["NUMBA_CACHE_DIR"]))
def foreign(x):
    return middle(x) + first(x)


@njit_alloc
def factorial(n):
    return 1.0 if n < 2 else n * factorial(n - 1)


@njit(cache=True)
def of_factorial(n):
    return factorial(n) + 1.0


@njit(cache=True, parallel=True)
def many(n):
    out = np.zeros(n)
    for i in numba.prange(n):
        out[i] = factorial(float(i))
    return out


@njit(cache=True)
def of_many(n):
    return np.sum(many(int(n)))


@njit(cache=True)
def applied(function, x):
    return function(x) + 1.0


def of_applied(x):
    return applied(middle, x) + applied(inner, x)
"""
"""Inner kernels that print, raise and read globals. They find what they print by a pointer."""

MAIN = """
import faulthandler
import sys

import kernels

faulthandler.enable()
called = [getattr(kernels, name) for name in sys.argv[1:]]
for kernel in called:
    for x in (1, 1.0, 1.5, 3.0, 5.0):
        try:
            print(kernel.__name__, x, kernel(x))
        except ValueError as error:
            print(kernel.__name__, x, *error.args)
hits = sum(sum(each.stats.cache_hits.values()) for each in called if hasattr(each, "stats"))
print(type(kernels.first).__name__, hits, file=sys.stderr)
"""


@pytest.fixture
def run(tmp_path):
    """Call kernels with several arguments in a fresh process. Returns the lines that they print,
    the class of their dispatcher, the number of kernels from the cache, and the lines of warning.
    """
    (tmp_path / "kernels.py").write_text(KERNELS, encoding="utf-8")

    def call(*names, before="", **variables):
        environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), **variables}
        environment["PYTHONPATH"] = os.pathsep.join(["", *filter(None, sys.path)])
        done = subprocess.run(
            [sys.executable, "-c", f"{before}\n{MAIN}", *names],
            cwd=tmp_path, env=environment, capture_output=True, text=True,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        *warnings, state = done.stderr.splitlines()
        kind, hits = state.split()
        return done.stdout.splitlines(), kind, int(hits), warnings

    return call


@pytest.fixture
def interpreted(run):
    """The lines that kernels print as Python functions."""

    def call(*names):
        lines, kind, _, _ = run(*names, NUMBA_DISABLE_JIT="1")
        assert kind == "function"
        return lines

    return call


def cached(folder, name):
    return len([*folder.glob(f"**/kernels.{name}-*.nbc")])


def test_entries_alone_are_cached_and_run_in_a_fresh_process(run, interpreted, tmp_path):
    expected = interpreted("first", "second")
    assert "second 5.0 above the limit 5.0" in expected
    assert "inner 1.5 of 3.0" in expected
    assert run("first", "second") == (expected, "KernelDispatcher", 0, [])
    assert [cached(tmp_path, name) for name in ("first", "second")] == [2, 2]
    assert [cached(tmp_path, name) for name in ("inner", "middle")] == [0, 0]
    assert run("first", "second") == (expected, "KernelDispatcher", 4, [])


@pytest.mark.parametrize(
    "names",
    [
        ("second", "inner", "first", "middle"),
        ("foreign", "middle", "of_applied"),
        ("of_factorial", "of_many", "factorial"),
    ],
    ids="-".join,
)
def test_an_inner_kernel_that_python_calls_becomes_an_entry(run, interpreted, names):
    """Whatever is called first, and whatever is in the cache."""
    backward, expected = names[::-1], interpreted(*names)
    assert run(*names[1:])[0] == interpreted(*names[1:])
    assert run(*names)[0] == expected
    assert run(*backward)[0] == interpreted(*backward)
    assert run(*names)[0] == expected


CHANGED = """
import re, sys
from pathlib import Path
from cislunar.runtime import kernels

kernels._PACKAGE = Path.cwd() / "package"
kernels._IMPORTED = re.compile(kernels._IMPORTED.pattern.replace("cislunar", "package"), re.M)
if sys.argv[1] == "drop":
    kernels.drop_stale_kernels()
from package.entry import entry
print(entry(1.0), sum(entry.stats.cache_hits.values()))
"""


def test_a_change_of_an_inner_kernel_reaches_cached_entries(tmp_path):
    """Numba alone does not notice it."""
    kernel = "from cislunar.compiled import njit\n{}\n\n@njit(cache=True)\ndef {}\n"
    (tmp_path / "package").mkdir()

    def write(name, imported, text):
        (tmp_path / f"package/{name}.py").write_text(kernel.format(imported, text), "utf-8")

    def called(drop):
        code = [sys.executable, "-c", CHANGED, drop]
        done = subprocess.run(code, cwd=tmp_path, capture_output=True, text=True, check=True)
        return done.stdout.strip()

    write("inner", "", "inner(x):\n    return 2.0 * x")
    write("middle", "from package.inner import inner", "middle(x):\n    return inner(x) + 1.0")
    write("entry", "from package.middle import middle", "entry(x):\n    return middle(x)")
    assert called("drop") == "3.0 0"
    assert called("drop") == "3.0 1"
    write("inner", "", "inner(x):\n    return 3.0 * x")
    assert called("keep") == "3.0 1"
    assert called("drop") == "4.0 0"


def test_another_numba_has_its_own_dispatcher(run, interpreted):
    names = "first", "middle"
    lines, kind, _, warnings = run(
        *names, before="from numba.core import codegen; del codegen.JITCodeLibrary"
    )
    assert (lines, kind, warnings) == (interpreted(*names), "CPUDispatcher", [])
    flags = "from numba.core import compiler; del compiler.Flags.no_compile"
    code = f"{flags}\nimport cislunar.kernel_dispatcher"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert "ImportError: numba: no flag no_compile" in done.stderr


def test_a_full_folder_of_the_cache(run, interpreted):
    limit = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000))"
    # Python itself would leave a truncated file of bytecode
    lines, _, _, warnings = run("first", "second", before=limit, PYTHONDONTWRITEBYTECODE="1")
    assert lines == interpreted("first", "second")
    assert len(warnings) == 1
    assert warnings[0].startswith("cached kernels cannot be written (File too large: ")


def test_a_folder_of_the_cache_that_cannot_be_written(run, interpreted, tmp_path):
    expected = interpreted("first")
    for hits in (0, 2):
        lines, _, found, warnings = run("first", NUMBA_CACHE_DIR="/proc/cache")
        assert (lines, found, len(warnings)) == (expected, hits, 1)
        assert warnings[0].startswith("the folder NUMBA_CACHE_DIR=/proc/cache cannot be written; ")
    for path in (tmp_path / "__pycache__").iterdir():
        path.unlink()
    (tmp_path / "__pycache__").rmdir()
    (tmp_path / "__pycache__").touch()
    lines, _, _, warnings = run("first", NUMBA_CACHE_DIR="", HOME="/proc", XDG_CACHE_HOME="/proc")
    assert (lines, len(warnings)) == (expected, 1)
    assert warnings[0].startswith("no folder for cached kernels can be written; ")


def test_a_cache_of_another_processor(run, interpreted):
    expected = interpreted("first")
    plain = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
    assert run("first", **plain)[0] == expected
    lines, _, hits, warnings = run("first")
    assert (lines, hits, len(warnings)) == (expected, 0, 1)
    assert warnings[0].startswith("kernels are cached for another processor (generic) and are ")
    assert run("first") == (expected, "KernelDispatcher", 2, [])


@pytest.mark.parametrize("ending", ["nbc", "nbi"])
def test_a_damaged_cache(run, interpreted, tmp_path, ending):
    expected = interpreted("first")
    run("first")
    for path in tmp_path.glob(f"cache/*/*.{ending}"):
        path.write_bytes(path.read_bytes()[:20])
    lines, _, _, warnings = run("first")
    assert (lines, len(warnings)) == (expected, 1)
    assert warnings[0].startswith("cached kernels cannot be read (")
