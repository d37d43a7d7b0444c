"""A campaign survives kills, interrupts, damaged files, a full disk and jobs that fail.

Each test breaks a copy of a small campaign, resumes it with the command of the README, and compares
every result with those of an undisturbed campaign. No test has a time limit, which a busy machine
could exceed.
"""

import contextlib
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest
import xarray as xr
from campaign_folder import ROOT, copy_workflow, run

from cislunar.campaign.verify import damaged_results

pytestmark = pytest.mark.workflow

CONFIG = ROOT / "tests/data/tiny.yaml"
CELLS = "task2/A"
SMALL = f"{CELLS}/random/mukf/nt4_dt60.nc"
OTHER = f"{CELLS}/random/mukf/nt5_dt60.nc"
LARGE = f"{CELLS}/random/mukf/nt150_dt60.nc"
EXACT = f"{CELLS}/exact/mukf/nt4_dt60.nc"
ALL = (SMALL, OTHER, LARGE, EXACT)


class Campaign:
    """A copy of the workflow with the results of the small campaign."""

    def __init__(self, folder, results=None):
        self.folder = folder
        self.results = results or folder / "results/tiny"
        self.groups = []
        self.options = [] if results is None else ["--config", f"results={results}"]

    def command(self, *files, cores=2, options=()):
        wanted = [os.path.relpath(self.results / name, self.folder) for name in files]
        if self.options:
            wanted = [str(self.results / name) for name in files]
        configured = ["--configfile", str(CONFIG), *self.options]
        return [
            *(sys.executable, "-m", "snakemake", "--cores", str(cores), *configured, *options),
            *("--", *wanted),
        ]

    def start(self, *files, cores=2):
        """Start Snakemake in a new process group; its output goes to a file."""
        with open(self.folder / "output.txt", "w", encoding="utf-8") as output:
            process = subprocess.Popen(
                self.command(*files, cores=cores),
                cwd=self.folder,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                # a shell lets its background processes ignore interrupts
                preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
            )
        self.groups.append(process.pid)
        return process

    def finish(self, process):
        """Return code and output of a started Snakemake."""
        code = process.wait()
        return (self.folder / "output.txt").read_text(encoding="utf-8"), code

    def run(self, *files, cores=2):
        return self.finish(self.start(*files, cores=cores))

    def unlock(self):
        unlock = [sys.executable, "-m", "snakemake", "--unlock"]
        subprocess.run(unlock, cwd=self.folder, check=True, capture_output=True)

    def verify(self, *options):
        return run("cislunar", "verify", "--quiet", self.results, *options)

    def remove(self, *files):
        for name in files:
            (self.results / name).unlink()
            self.log(name).unlink(missing_ok=True)

    def log(self, name):
        return self.results / "logs" / Path(name).with_suffix(".log")

    def stamps(self):
        """Size and date of every result; logs and benchmarks aside."""
        return {
            str(path.relative_to(self.results)): (path.stat().st_size, path.stat().st_mtime_ns)
            for path in self.results.rglob("*")
            if path.is_file() and not {"logs", "benchmarks"} & set(path.parts)
        }


@pytest.fixture(scope="session")
def undisturbed(tmp_path_factory):
    """The undisturbed campaign."""
    folder = copy_workflow(tmp_path_factory.mktemp("undisturbed"))
    shutil.copytree(ROOT / "profiles", folder / "profiles")
    campaign = Campaign(folder)
    output, code = campaign.run(*ALL)
    assert code == 0, output[-6000:]
    return campaign


@pytest.fixture
def campaign(undisturbed, tmp_path):
    """A copy of the undisturbed campaign; processes that still run at the end are killed."""
    shutil.copytree(undisturbed.folder, tmp_path, dirs_exist_ok=True)
    copy = Campaign(tmp_path)
    yield copy
    for group in copy.groups:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(group, signal.SIGKILL)


def assert_same(campaign, undisturbed):
    """Every result is there, with the same variables and values."""
    expected = undisturbed.stamps()
    assert set(campaign.stamps()) == set(expected)
    for name in expected:
        with (
            xr.open_dataset(campaign.results / name) as found,
            xr.open_dataset(undisturbed.results / name) as wanted,
        ):
            for dataset in (found, wanted):
                dataset.attrs.pop("certificate_seconds", None)
            xr.testing.assert_identical(found, wanted)


def assert_kept(campaign, before, *made):
    """No earlier result has been touched."""
    after = campaign.stamps()
    assert {name: stamp for name, stamp in before.items() if name not in made} == {
        name: stamp for name, stamp in after.items() if name not in made
    }


def stopped_job(campaign, process, name):
    """Suspend the job that makes a file once its log reports that it runs; its process."""
    log = campaign.log(name)
    while process.poll() is None:
        said = re.search(r"process (\d+)", log.read_text()) if log.is_file() else None
        if said:
            job = psutil.Process(int(said[1]))
            job.suspend()
            assert not (campaign.results / name).exists()
            return job
        time.sleep(0.002)
    raise AssertionError(f"{name} was never made")


def resumed(campaign, *files, cores=2):
    """Resume with the command that was interrupted."""
    output, code = campaign.run(*files, cores=cores)
    assert code == 0, output[-6000:]
    assert "Traceback" not in output
    return output


def test_killed_job_and_interrupt(campaign, undisturbed):
    """The resumed run is interrupted, and resumed again."""
    campaign.remove(LARGE, OTHER)
    before = campaign.stamps()
    process = campaign.start(LARGE, OTHER)
    stopped_job(campaign, process, LARGE).kill()
    output, code = campaign.finish(process)
    assert code == 1
    assert "Error in rule tracking_cell_large" in output
    assert "SIGKILL" in output
    assert "then run the same command again" in output
    assert (campaign.results / OTHER).is_file(), "the other job was to finish"
    assert_kept(campaign, before, OTHER)

    campaign.log(LARGE).unlink()
    before = campaign.stamps()
    process = campaign.start(LARGE, OTHER, cores=1)
    job = stopped_job(campaign, process, LARGE)
    os.killpg(process.pid, signal.SIGINT)
    job.resume()
    output, code = campaign.finish(process)
    assert code != 0
    assert re.search(r"interrupted after [\d:]+; run the same command again", output)
    assert "Traceback" not in output
    assert "Interrupted. What had finished is kept in " in output
    assert re.search(rf"To go on from there:\n  snakemake .*{LARGE}", output)
    assert_kept(campaign, before)
    resumed(campaign, LARGE, OTHER)
    assert_same(campaign, undisturbed)


def test_killed_snakemake_with_and_without_its_jobs(campaign, undisturbed):
    """A job that outlives Snakemake writes a result, which is marked incomplete and made anew."""
    campaign.remove(LARGE, OTHER)
    before = campaign.stamps()
    process = campaign.start(LARGE, OTHER, cores=1)
    stopped_job(campaign, process, LARGE)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    assert_kept(campaign, before)
    output, code = campaign.run(LARGE, OTHER)
    assert code == 1
    assert "--unlock" in output
    campaign.unlock()

    campaign.log(LARGE).unlink()
    process = campaign.start(LARGE, OTHER, cores=1)
    orphan = stopped_job(campaign, process, LARGE)
    process.kill()
    process.wait()
    orphan.resume()
    psutil.wait_procs([orphan])
    assert (campaign.results / LARGE).is_file()
    campaign.unlock()
    assert "Execute 2 jobs" in resumed(campaign, LARGE, OTHER)
    assert_same(campaign, undisturbed)


def test_truncated_result(campaign, undisturbed):
    damaged = campaign.results / SMALL
    content = damaged.read_bytes()
    damaged.write_bytes(content[: len(content) // 2])
    leftover = damaged.with_name(f".{OTHER}.1.part".replace("/", "-"))
    leftover.write_bytes(b"half")
    os.utime(leftover, (1.0, 1.0))
    own = damaged.with_name("notes.csv")
    own.write_text("no line break", encoding="utf-8")
    before = campaign.stamps()
    listed, code = campaign.verify()
    assert code == 1
    assert f"{damaged}: cannot be read" in listed
    assert f"{own}: not removed by --delete, since Snakemake has no record" in listed
    assert f"{leftover}: left by a job" in listed
    assert_kept(campaign, before)
    removed, _ = campaign.verify("--delete")
    assert f"as before: snakemake --cores 2 -- {damaged}\n" in removed
    assert f"{own}: not removed" in removed
    assert not leftover.exists()
    assert_kept(campaign, before, SMALL, str(leftover.relative_to(campaign.results)))
    own.unlink()
    resumed(campaign, *ALL)
    assert campaign.verify() == ("every result can be used\n", 0)
    assert_same(campaign, undisturbed)


def test_one_cell_of_many_fails(campaign, undisturbed):
    """A truncated input fails the one cell that reads it; the other cells are made. The numbers do
    not depend on the number of cores."""
    damaged = campaign.results / "architecture/A/exact.nc"
    date = damaged.stat().st_mtime_ns
    damaged.write_bytes(damaged.read_bytes()[:1000])
    os.utime(damaged, ns=(date, date))
    campaign.remove(*ALL)
    before = campaign.stamps()
    output, code = campaign.run(*ALL)
    assert code == 1
    assert re.search(r"error: data set \S*exact\.nc cannot be read .*: it is damaged", output)
    assert "delete it and run snakemake again" in output
    assert "then run the same command again" in output
    assert "Traceback" not in output
    assert_kept(campaign, before, SMALL, OTHER, LARGE)
    damaged.unlink()
    made = campaign.stamps()
    resumed(campaign, *ALL, cores=1)
    assert_kept(campaign, made, "architecture/A/exact.nc", EXACT)
    assert_same(campaign, undisturbed)


BEYOND_THE_LIMIT = """
import resource, sys
import numpy as np, xarray as xr
from cislunar.runtime.netcdf import variable, write_dataset
from cislunar.errors import InputFileError

path = sys.argv[1]
values = np.random.default_rng(1).random(100_000)
write_dataset(xr.Dataset({"a": variable("x", values[:10], "1", "first")}), path)
resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, 50_000))
try:
    write_dataset(xr.Dataset({"a": variable("x", values, "1", "second")}), path)
except InputFileError as error:
    print(error)
"""


def test_write_beyond_the_file_size_limit(tmp_path):
    """As on a full disk: one message, the earlier file unchanged, no other file."""
    path = tmp_path / "result.nc"
    done = subprocess.run(
        [sys.executable, "-c", BEYOND_THE_LIMIT, str(path)], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert re.fullmatch(r"cannot write \S*result\.nc: .*disk not full\n", done.stdout)
    assert [file.name for file in tmp_path.iterdir()] == ["result.nc"]
    with xr.open_dataset(path) as kept:
        assert kept["a"].attrs["long_name"] == "first"


@pytest.mark.parametrize(
    ("name", "whole"),
    [
        ("table.csv", b"a,b\n1,2\n"),
        ("figure.png", b"\x89PNG\r\n...IEND\xaeB`\x82"),
        ("figure.pdf", b"%PDF-1.4 ... %%EOF\n"),
    ],
)
def test_damaged_tables_and_figures_are_named(tmp_path, name, whole):
    (tmp_path / name).write_bytes(whole)
    assert list(damaged_results(tmp_path)) == []
    (tmp_path / name).write_bytes(whole[:-3])
    assert [path.name for path, _ in damaged_results(tmp_path)] == [name]


@pytest.fixture
def small_disk(tmp_path):
    """A file system of a few megabytes for the results."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=8m", "tmpfs", str(disk)]
    if not shutil.which("mount") or subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("no right to mount a file system; see test_write_beyond_the_file_size_limit")
    yield disk
    subprocess.run(["umount", "--lazy", str(disk)], check=True)


def test_full_disk(undisturbed, small_disk, tmp_path):
    folder = tmp_path / "campaign"
    shutil.copytree(undisturbed.folder, folder)
    results = small_disk / "tiny"
    shutil.move(folder / "results/tiny", results)
    campaign = Campaign(folder, results)
    campaign.remove(LARGE, OTHER)
    filler = small_disk / "filler"
    with contextlib.suppress(OSError), open(filler, "wb", buffering=0) as file:
        while True:
            file.write(bytes(4096))
    before = campaign.stamps()
    output, code = campaign.run(LARGE, OTHER)
    assert code == 1
    assert re.search(r"error: cannot write \S*nt150_dt60\.nc: .*disk not full", output)
    assert "Traceback" not in output
    assert_kept(campaign, before)
    filler.unlink()
    resumed(campaign, LARGE, OTHER)
    assert_same(campaign, undisturbed)


def test_two_snakemakes_make_different_cells(campaign, undisturbed):
    """Two may run in one folder if they share finished inputs only; Snakemake locks files."""
    campaign.remove(LARGE, OTHER, EXACT)
    first = campaign.start(LARGE, OTHER, cores=1)
    job = stopped_job(campaign, first, LARGE)
    second = Campaign(campaign.folder)
    refused = subprocess.run(
        second.command(OTHER, EXACT), cwd=campaign.folder, capture_output=True, text=True
    )
    assert refused.returncode == 1
    assert "other Snakemake process" in refused.stderr
    done = subprocess.run(
        second.command(EXACT), cwd=campaign.folder, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    job.resume()
    output, code = campaign.finish(first)
    assert code == 0, output
    assert_same(campaign, undisturbed)


def test_numbers_do_not_depend_on_compilation(campaign, undisturbed, monkeypatch):
    """Of the kernels of orbits, targets, visibility and coverage; those of the filter alone take
    two minutes, and one decorator makes all of them."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(campaign.folder / "compiled"))
    made = [name for name in undisturbed.stamps() if not name.startswith("task2/")]
    assert "architecture/A/exact.nc" in made
    campaign.remove(*made)
    resumed(campaign, *made, cores=1)
    assert list(campaign.folder.glob("compiled/**/*.nbi")), "nothing was compiled"
    assert_same(campaign, undisturbed)
