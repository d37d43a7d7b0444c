"""Fixtures of a small benchmark, its truth and its references."""

import shutil

import pytest
from small_benchmark import SIZE, call

from cislunar.benchmark import SIZES, read_truth


@pytest.fixture(scope="session")
def made(tmp_path_factory):
    """A benchmark of eight objects and six hours, by the command; do not change it."""
    folder = tmp_path_factory.mktemp("benchmark") / "made"
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(SIZES, "small", SIZE)
        done = call("make", folder, "--seed", 7)
    assert (done.exit_code, done.stdout) == (0, f"benchmark small: 4 observers, {folder}\n")
    return folder


@pytest.fixture(scope="session")
def truth(made):
    return read_truth(made)


@pytest.fixture(scope="session")
def references(made, tmp_path_factory):
    """Both references, made where there is no truth."""
    folder = tmp_path_factory.mktemp("references")
    public = shutil.copytree(made, folder / "public", ignore=shutil.ignore_patterns("truth"))
    for method in ("survey-catalog", "nearest-neighbor"):
        done = call("reference", public, "--method", method, "--output", folder / method)
        assert done.exit_code == 0, done.stderr
    return folder
