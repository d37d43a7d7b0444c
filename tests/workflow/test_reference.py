"""The reference: it is made without a warning, and every public name is in it."""

import importlib
import inspect
import pkgutil
import re
import subprocess
import sys

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

import cislunar
from cislunar.campaign.documents.reference import short_annotation

# `python -m cislunar` has no public name of its own, and pdoc no page for it.
MODULES = sorted(
    each.name
    for each in pkgutil.walk_packages(cislunar.__path__, prefix="cislunar.")
    if each.name != "cislunar.__main__"
)


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    """The folder of the reference; a warning is an error there."""
    folder = tmp_path_factory.mktemp("api")
    done = subprocess.run(
        [
            sys.executable,
            "-W",
            "error",
            "-m",
            "cislunar.campaign.documents.reference",
            "--output",
            folder,
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    assert not done.stderr
    return folder


def public(module):
    """Functions and classes that a module defines for others, compiled ones too."""
    found = {}
    for name, value in vars(module).items():
        function = getattr(value, "py_func", value)
        kind = inspect.isfunction(function) or inspect.isclass(function)
        if kind and not name.startswith("_") and function.__module__ == module.__name__:
            found[name] = function
    return found


@pytest.mark.parametrize("name", MODULES)
def test_every_public_name_is_in_the_reference_with_its_docstring(reference, name):
    module = importlib.import_module(name)
    page = reference / f"{name.replace('.', '/')}.html"
    text = page.read_text(encoding="utf-8")
    for member, value in public(module).items():
        assert re.search(rf'id="{member}"', text), f"{name}.{member} is not in the reference"
        assert inspect.getdoc(value), f"{name}.{member} has no docstring"


def test_sections_of_docstrings_are_rendered(reference):
    text = (reference / "cislunar/dynamics/propagation.html").read_text(encoding="utf-8")
    assert re.search(r"<h6[^>]*>Parameters</h6>", text)
    assert "<strong>state</strong>" in text
    for page in reference.rglob("*.html"):
        assert not re.search(r"(Parameters|Returns|Raises)\s*\n?-{5}", page.read_text("utf-8")), (
            page
        )


@pytest.mark.parametrize(
    "annotation, shown",
    [
        (ArrayLike, "ArrayLike"),
        (ArrayLike | None, "ArrayLike | None"),
        (NDArray[np.float64], "NDArray[float64]"),
        (dict[str, NDArray[np.int64]], "dict[str, NDArray[int64]]"),
        (float, "float"),
    ],
)
def test_array_types_are_shown_shortly(annotation, shown):
    assert repr(short_annotation(annotation)) == shown
