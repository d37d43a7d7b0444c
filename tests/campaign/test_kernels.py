"""Compiled kernels: dropped where sources have changed, and compiled in sight."""

import logging
import re

import numba
import pytest
from numba.core import event

from cislunar.attitude.rigid_body import propagate_spherical
from cislunar.compiled import njit
from cislunar.estimation.kalman import mukf_kernels
from cislunar.photometry import facets
from cislunar.runtime import compilation, kernels
from cislunar.runtime.compilation import announced
from cislunar.runtime.progress import logger, progress_log

KERNEL = "from numba import njit\n{}\n\n@njit(cache=True)\ndef kernel(x):\n    return x\n"
SOURCES = {
    "first.py": KERNEL.format("from cislunar.room import (\n    constant,\n    other,\n)"),
    "second.py": KERNEL.format("from cislunar.room.other import value"),
    "third.py": KERNEL.format("from cislunar.room import public"),
    "room/__init__.py": 'attach(__name__, submod_attrs={"inner": ["more",\n    "public"]})',
    "room/inner/__init__.py": 'attach(__name__, submod_attrs={"deep": ["public"]})',
    "room/inner/deep.py": "public = 3\n",
    "room/constant.py": "value = 1\n",
    "room/other.py": "value = 2\n",
    "room/chosen.py": "@implements(function, Model)\ndef body(x):\n    return x\n",
    "tables.py": "from cislunar.first import kernel\n",
}


@pytest.fixture
def library(tmp_path, monkeypatch):
    """A library of two kernels, both cached."""
    folder = tmp_path / "cislunar"
    (folder / "room/inner").mkdir(parents=True)
    for name, text in SOURCES.items():
        (folder / name).write_text(text, encoding="utf-8")
    monkeypatch.setattr(kernels, "_PACKAGE", folder)
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    assert kernels.drop_stale_kernels() == ["first.py", "second.py", "third.py"]
    for name in ("first", "second", "third"):
        for ending in ("nbi", "1.nbc"):
            (folder / f"__pycache__/{name}.kernel-4.py311.{ending}").touch()
    return folder


def cached(folder):
    return sorted({path.name.split(".")[0] for path in folder.glob("__pycache__/*.nb[ic]")})


@pytest.mark.parametrize(
    "name, kept",
    [
        ("first.py", ["second", "third"]),
        ("room/constant.py", ["second", "third"]),
        ("room/other.py", ["third"]),
        ("room/inner/deep.py", ["first", "second"]),
        ("room/chosen.py", []),
        ("tables.py", ["first", "second", "third"]),
    ],
)
def test_kernels_of_changed_sources_are_dropped(library, name, kept):
    assert kernels.drop_stale_kernels() == []
    assert cached(library) == ["first", "second", "third"]
    path = library / name
    path.write_text(path.read_text(encoding="utf-8") + "more = 1\n", encoding="utf-8")
    kernels.drop_stale_kernels()
    assert cached(library) == kept
    assert kernels.drop_stale_kernels() == []


def test_a_cache_elsewhere_is_kept_apart(library, tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "elsewhere"))
    assert kernels.drop_stale_kernels() == ["first.py", "second.py", "third.py"]
    assert kernels.drop_stale_kernels() == []
    assert cached(library) == ["first", "second", "third"]


def test_every_file_a_kernel_calls_into_counts():
    """As the globals of the kernels say, of which the imports know nothing."""
    found = kernels._closure(
        [kernels.Path(mukf_kernels.__file__)],
        lambda path: filter(
            kernels.Path.is_file, kernels._imports(path.read_text(encoding="utf-8"))
        ),
    )
    assert kernels.Path(facets.__file__) in found


def test_compilation_is_announced(caplog):
    caplog.set_level(logging.INFO, "cislunar")
    with announced():
        pass
    assert caplog.messages == []

    @numba.njit
    def half(x):
        return 0.5 * x

    with announced():
        assert half(1.0) == 0.5
    assert caplog.messages[0] == "compiling kernels; they are cached, so that it is done once"
    assert re.search(r"^compiled \d+ kernels in 0:\d\d$", caplog.messages[-1])


def test_compilation_within_a_command_is_announced_once(caplog):
    caplog.set_level(logging.INFO, "cislunar")

    @njit(cache=False)
    def quarter(x):
        return 0.25 * x

    with announced(), announced():
        assert quarter(1.0) == 0.25
    assert [message.split()[0] for message in caplog.messages] == ["compiling", "compiled"]


@njit(cache=False)
def spin(quaternion, omega, t):
    return propagate_spherical(quaternion, omega, t)


def test_a_call_has_a_total_and_the_time_left(caplog, monkeypatch):
    caplog.set_level(logging.INFO, "cislunar")
    monkeypatch.setattr(
        compilation, "progress_log", lambda name, **more: progress_log(name, 0.0, **more)
    )

    @njit(cache=False)
    def third(x):
        return x / 3.0

    @njit(cache=False)
    def ninth(x):
        return third(third(x))

    assert {*compilation.kernels_within(ninth)} == {third, ninth}
    with announced():
        ninth(1.0)
    assert third.overloads and ninth.overloads
    told = [line for line in caplog.messages if line.startswith("kernels: ")]
    assert told
    expected = r": [01] of 2 \(\d+ %\), \d+:\d\d elapsed, .* left"
    assert all(re.search(expected, line) for line in told)


def test_kernels_that_are_called_within_a_kernel_are_found():
    within = {kernel.__name__ for kernel in compilation.kernels_within(spin)}
    inlined = {"rotation_vector_components", "multiply_components"}
    assert within == {"spin", "propagate_spherical", *inlined}


def test_kernels_of_implementations_count_as_within_a_call():
    names = {kernel.__name__ for kernel in compilation.kernels_within(mukf_kernels.advance)}
    assert {"block_magnitudes", "_runge_kutta_step", "add_mixed_facet"} <= names
    assert "integrate" not in names


def test_a_notebook_without_logging_sees_compilation(monkeypatch, capsys):
    for earlier in compilation._standing:
        event.unregister("numba:compile", earlier)
    monkeypatch.setattr(compilation, "_standing", [])
    monkeypatch.setattr(logger, "propagate", False)
    compilation.announce_always()
    compilation.announce_always()

    def third(x):
        return x / 3.0

    assert numba.njit(third)(3.0) == 1.0
    assert capsys.readouterr().err.count("compiling kernels;") == 1
    with announced():  # which tells itself
        assert numba.njit(third)(3.0) == 1.0
    assert capsys.readouterr().err.count("compil") == 2
    event.unregister("numba:compile", compilation._standing[0])
