"""The wheel and the source distribution are complete, and the wheel works by itself."""

import configparser
import os
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from email.parser import Parser

import pytest
import yaml
from campaign_folder import ROOT

import cislunar

pytest.importorskip("setuptools", minversion="77")

BUILD = (
    "import sys; from setuptools import build_meta; folder = sys.argv[1];"
    "build_meta.build_sdist(folder); build_meta.build_wheel(folder)"
)
FOLDERS = ("benchmarks", "cislunar", "config", "docs", "profiles", "tests", "workflow")
CACHES = shutil.ignore_patterns("__pycache__", "api", "gallery")


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """A folder with both, built from a copy, since old files in `build` would be included."""
    folder = tmp_path_factory.mktemp("built")
    for name in FOLDERS:
        shutil.copytree(ROOT / name, folder / "source" / name, ignore=CACHES)
    for path in ROOT.glob("[!.]*"):
        if path.is_file():
            shutil.copy(path, folder / "source")
    done = subprocess.run(
        [sys.executable, "-c", BUILD, folder], cwd=folder / "source", capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture(scope="module")
def wheel(built):
    """The wheel, opened."""
    (path,) = built.glob("*.whl")
    with zipfile.ZipFile(path) as archive:
        yield archive


def metadata(wheel, name):
    """A file of the wheel's metadata."""
    return wheel.read(f"cislunar-{cislunar.__version__}.dist-info/{name}").decode()


def test_wheel_contains_the_library_and_nothing_else(wheel):
    names = {name for name in wheel.namelist() if ".dist-info/" not in name}
    source = ROOT / "cislunar"
    files = {
        str(path.relative_to(ROOT))
        for path in source.rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    assert names == files
    assert not any(name.startswith("workflow") for name in names)


def test_metadata_of_the_wheel(wheel):
    said = Parser().parsestr(metadata(wheel, "METADATA"))
    assert (said["Name"], said["Version"]) == ("cislunar", cislunar.__version__)
    assert (said["License-Expression"], said["License-File"]) == ("MIT", "LICENSE")
    # what the indexes of packages show
    assert len(said["Summary"]) > 20 and said["Requires-Python"] == ">=3.11"
    assert (
        said["Description-Content-Type"] == "text/markdown" and "light curves" in said["Keywords"]
    )
    kinds = said.get_all("Classifier")
    assert {each for each in kinds if each.startswith("Programming Language :: Python :: 3.")} == {
        f"Programming Language :: Python :: 3.{minor}" for minor in (11, 12, 13)
    }
    assert {"atpe", "benchmarks", "de440", "slurm"} == {*said.get_all("Provides-Extra")}
    assert metadata(wheel, "licenses/LICENSE") == (ROOT / "LICENSE").read_text("utf-8")
    points = configparser.ConfigParser()
    points.read_string(metadata(wheel, "entry_points.txt"))
    assert dict(points["console_scripts"]) == {"cislunar": "cislunar.command.main:cislunar"}


def test_wheel_works_by_itself(wheel, tmp_path):
    wheel.extractall(tmp_path / "site")
    script = (
        "import cislunar;"
        "from cislunar.command.main import cislunar as command;"
        "print(cislunar.__file__);"
        "command(['orbits', 'list'])"
    )
    done = subprocess.run(
        [sys.executable, "-c", script],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(tmp_path / "site")},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(str(tmp_path)) and "Halo_L2_S" in done.stdout


def test_source_distribution_contains_the_campaign(built):
    (path,) = built.glob("*.tar.gz")
    with tarfile.open(path) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    for wanted in ("Snakefile", "environment.txt", "CHANGELOG.md", "CITATION.cff", "LICENSE"):
        assert wanted in names
    for folder in FOLDERS:
        kept = {
            str(each.relative_to(ROOT))
            for each in (ROOT / folder).rglob("*")
            if each.is_file() and not {"__pycache__", "api", "gallery"} & {*each.parts}
        }
        assert kept and kept <= names


def test_the_version_is_written_once():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    assert "version" in project["dynamic"]
    changes = (ROOT / "CHANGELOG.md").read_text("utf-8")
    assert f"\n## [{cislunar.__version__}]" in changes
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    assert "version" not in citation
    assert f"\n## [{cislunar.__version__}] - {citation['date-released']}\n" in changes
