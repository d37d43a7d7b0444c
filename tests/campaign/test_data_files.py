"""Data files are complete or not written, and say where they come from."""

import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from cislunar.errors import InputFileError
from cislunar.runtime import provenance as provenance_of
from cislunar.runtime.netcdf import read_dataset, variable, write_dataset, write_text
from cislunar.runtime.provenance import provenance
from cislunar.runtime.seeds import generator


def small_dataset(value=1.0, size=2000):
    """A data set large enough to be compressed."""
    return xr.Dataset(
        {
            "field": variable("x", value * np.arange(size), "km", "a field"),
            "name": variable((), "halo", "1", "a name"),
        },
        attrs={"title": "test"},
    )


def test_dataset_comes_back_as_it_was_written(tmp_path):
    path = tmp_path / "deep" / "er" / "file.nc"
    write_dataset(small_dataset(), path)
    xr.testing.assert_identical(read_dataset(path), small_dataset())
    assert [each.name for each in path.parent.iterdir()] == ["file.nc"]


@pytest.mark.parametrize("lacking", ["units", "long_name"])
def test_variable_without_unit_or_description_is_refused(tmp_path, lacking):
    dataset = small_dataset()
    del dataset["field"].attrs[lacking]
    with pytest.raises(ValueError, match=rf"variable field of file\.nc lacks {lacking}"):
        write_dataset(dataset, tmp_path / "file.nc")
    assert not any(tmp_path.iterdir())


def test_coordinates_are_held_to_the_same_rule(tmp_path):
    dataset = small_dataset().assign_coords(x=np.arange(2000))
    with pytest.raises(ValueError, match="variable x"):
        write_dataset(dataset, tmp_path / "file.nc")


def break_after_writing(monkeypatch, error):
    """Let the NetCDF library fail with half the file on disk."""

    def write_half(self, path, **_):
        Path(path).write_bytes(b"\x89HDF half a file")
        raise error

    monkeypatch.setattr(xr.Dataset, "to_netcdf", write_half)


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), RuntimeError("HDF")])
def test_failed_write_leaves_the_old_file(tmp_path, monkeypatch, error):
    path = tmp_path / "file.nc"
    write_dataset(small_dataset(), path)
    before = path.read_bytes()
    break_after_writing(monkeypatch, error)
    with pytest.raises(InputFileError, match=r"cannot write .*file\.nc: (No space|HDF)"):
        write_dataset(small_dataset(2.0), path)
    assert path.read_bytes() == before
    assert [each.name for each in tmp_path.iterdir()] == ["file.nc"]


def test_interrupted_write_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "file.nc"
    write_dataset(small_dataset(), path)
    before = path.read_bytes()
    break_after_writing(monkeypatch, KeyboardInterrupt())
    with pytest.raises(KeyboardInterrupt):
        write_dataset(small_dataset(2.0), path)
    assert path.read_bytes() == before
    assert [each.name for each in tmp_path.iterdir()] == ["file.nc"]


def test_failed_move_leaves_the_old_text(tmp_path, monkeypatch):
    path = tmp_path / "table.csv"
    write_text("old\n", path)

    def refuse(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "replace", refuse)
    with pytest.raises(InputFileError, match=r"cannot write .*table\.csv: Permission denied"):
        write_text("new\n", path)
    assert path.read_text() == "old\n"
    assert [each.name for each in tmp_path.iterdir()] == ["table.csv"]


@pytest.mark.parametrize(
    "write", [lambda p: write_text("a", p), lambda p: write_dataset(small_dataset(), p)]
)
def test_folder_that_is_a_file_is_named(tmp_path, write):
    (tmp_path / "results").write_text("not a folder")
    with pytest.raises(InputFileError, match=r"cannot write .*results/x"):
        write(tmp_path / "results" / "x")
    assert (tmp_path / "results").read_text() == "not a folder"


@pytest.mark.parametrize("share", [0.0, 0.01, 0.5, 0.999])
def test_truncated_file_is_named(tmp_path, share):
    path = tmp_path / "file.nc"
    write_dataset(small_dataset(), path)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(InputFileError, match=r"file\.nc cannot be read .* delete it and run"):
        read_dataset(path)


def test_missing_file_is_named(tmp_path):
    with pytest.raises(InputFileError, match=r"nowhere\.nc: no such file"):
        read_dataset(tmp_path / "nowhere.nc")


def test_an_installed_package_has_no_revision_of_a_repository_around_it(tmp_path, monkeypatch):
    installed = tmp_path / "provenance.py"
    installed.touch()
    subprocess.run(["git", "init", "--quiet", tmp_path], check=True)
    who = ("-c", "user.name=a", "-c", "user.email=a@b")
    command = ["git", "-C", tmp_path, *who, "commit", "--quiet", "--allow-empty", "-m", "a"]
    subprocess.run(command, check=True)
    monkeypatch.setattr(provenance_of, "__file__", str(installed))
    assert provenance_of.git_revision.__wrapped__() is None


def test_provenance_is_the_same_for_the_same_inputs():
    settings = {"b": [1, 2], "a": {"y": 1.5, "x": "halo"}}
    turned = {"a": {"x": "halo", "y": 1.5}, "b": [1, 2]}
    first = provenance("title", settings=settings, seed=3)
    assert first == provenance("title", settings=turned, seed=3)
    assert json.loads(first["settings"]) == settings
    assert first["seed"] == 3
    assert {"title", "source", "mu", "length_unit_km", "time_unit_s"} <= set(first)


def test_same_data_give_the_same_file(tmp_path):
    for name in ("a.nc", "b.nc"):
        write_dataset(
            small_dataset().assign_attrs(provenance("t", settings={"k": 1})), tmp_path / name
        )
    assert (tmp_path / "a.nc").read_bytes() == (tmp_path / "b.nc").read_bytes()


def test_jobs_draw_independent_random_numbers():
    same = generator(1, "A", "tpe", 0).random(4)
    np.testing.assert_array_equal(same, generator(1, "A", "tpe", 0).random(4))
    others = [(2, "A", "tpe", 0), (1, "At", "pe", 0), (1, "A", "tpe", 1), (1, "A", "tpe0")]
    for other in others:
        assert not np.array_equal(same, generator(*other).random(4))
