"""The command prints the results of the library, and reports an error in one line."""

import csv
import io
import os
import re
import subprocess
import sys
from pathlib import Path

import click
import numpy as np
import pytest
from campaign_folder import QUICK, ROOT, run
from click.testing import CliRunner
from snakemake.persistence.file import FilePersistence

import cislunar as package
from cislunar.command.base import FAILED
from cislunar.command.main import cislunar
from cislunar.constants import EARTH_RADIUS_KM, LENGTH_UNIT_KM, SECONDS_PER_DAY, TIME_UNIT_S
from cislunar.dynamics.propagation import propagate
from cislunar.orbits.catalog import CATALOG, periodic_orbits
from cislunar.targets.tables import load_target_states
from cislunar.tasking.initial_conditions import epoch_states

HALO = "Halo_L2_S,jacobi=3.05,member=2"
HEAVY = {"numpy", "numba", "matplotlib", "hyperopt", "xarray", "scipy", "snakemake"}


def call(*arguments):
    """Run the command in this process."""
    return CliRunner().invoke(cislunar, [*map(str, arguments)])


def table(*arguments):
    """Rows of its CSV output."""
    done = call(*arguments, "--quiet", "--output", "-")
    assert (done.exit_code, done.stderr) == (0, "")
    return [*csv.DictReader(io.StringIO(done.stdout))]


def numbers(rows, *names):
    """Columns of a table as an array."""
    return np.array([[float(row[name]) for name in names] for row in rows])


def commands(command=cislunar, path=()):
    """All commands with the words that lead to them."""
    yield path, command
    if isinstance(command, click.Group):
        for name, inner in command.commands.items():
            yield from commands(inner, (*path, name))


COMMANDS = [*commands()]


@pytest.mark.parametrize(("path", "command"), COMMANDS, ids=[" ".join(p) for p, _ in COMMANDS])
def test_help_teaches_by_examples_that_can_be_typed(path, command):
    text = call(*path, "--help").output
    assert "--quiet" in text and "--verbose" in text
    assert "None" not in text
    assert not (path and command.get_short_help_str(66).endswith("..."))
    examples = [line.split() for line in text.splitlines() if line.startswith("    cislunar ")]
    assert examples
    for _, *words in examples:
        inner = cislunar
        while isinstance(inner, click.Group):
            inner, words = inner.commands[words[0]], words[1:]
        inner.make_context("example", words)


def test_help_imports_no_heavy_library():
    script = (
        "import sys; from cislunar.command.main import cislunar;"
        "cislunar(['--help'], standalone_mode=False);"
        f"sys.exit(', '.join({HEAVY} & set(sys.modules)) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_python_runs_it_as_a_module():
    output, code = run("cislunar", "--version")
    assert (output, code) == (f"cislunar, version {package.__version__}\n", 0)


def test_families_are_listed():
    rows = table("orbits", "list")
    assert tuple(row["family"] for row in rows) == (*CATALOG,)
    assert "halo about L2, southern" in {row["orbits"] for row in rows}
    assert {row["end"] for row in rows if row["family"] == "Vertical_L2"} == {"where it is flat"}


@pytest.mark.parametrize("units", ["km", "nd"])
def test_members_are_those_of_the_library(units):
    rows = table("orbits", "members", "Halo_L2_S", "--jacobi", 3.05, "--units", units)
    members = periodic_orbits("Halo_L2_S", jacobi=3.05)
    length, speed = (LENGTH_UNIT_KM, LENGTH_UNIT_KM / TIME_UNIT_S) if units == "km" else (1.0, 1.0)
    tails = ("_km", "_km_s") if units == "km" else ("_nd", "_nd")
    names = [axis + tails[0] for axis in "xyz"] + [f"v{axis}{tails[1]}" for axis in "xyz"]
    scale = np.repeat([length, speed], 3)
    assert np.array_equal(numbers(rows, *names), members.state * scale)
    assert {(row["frame"], row["center"]) for row in rows} == {("rotating", "EARTH BARYCENTER")}


def test_a_period_in_days_selects_members_of_all_families_that_take_it():
    rows = table("orbits", "members", "Lyap_L3", "Halo_L1_N", "--period", 12)
    assert [row["family"] for row in rows] == ["Halo_L1_N", "Halo_L1_N"]
    assert len({row["id"] for row in rows}) == 2
    assert numbers(rows, "orbit_period_days") == pytest.approx(12.0)


def test_orbits_through_the_earth_are_members_on_request():
    wanted = ("orbits", "members", "Halo_L3_N", "--period", 26.2)
    assert "clear of Earth and Moon has period" in call(*wanted).stderr
    (row,) = table(*wanted, "--through")
    assert float(row["perigee_km"]) < EARTH_RADIUS_KM


def test_exported_members_are_targets_of_a_study(tmp_path):
    """Each target starts at its state, and the rows of several tables can be joined."""
    path, other = tmp_path / "targets.csv", tmp_path / "other.csv"
    done = call("orbits", "members", "Lyap_L1", "--count", 3, "--output", path)
    assert done.exit_code == 0 and f"3 rows in {path}" in done.stderr
    targets = load_target_states(path)
    assert targets.family == ["Lyap_L1"] * 3
    start = epoch_states(targets.state, targets.period, seed=1)
    np.testing.assert_allclose(start, periodic_orbits("Lyap_L1", count=3).state, atol=1e-14)
    call("orbits", "members", "Lyap_L1", "--jacobi", 3.1, "--output", other)
    path.write_text(path.read_text() + "".join(other.read_text().splitlines(True)[1:]))
    assert load_target_states(path).name[0].startswith("Lyap_L1_3.")
    assert len(set(load_target_states(path).name)) == 4


def test_a_periodic_orbit_closes():
    days = periodic_orbits("Halo_L2_S", jacobi=3.05).period[1] * TIME_UNIT_S / SECONDS_PER_DAY
    names = ("x_km", "y_km", "z_km")
    path = numbers(table("propagate", "--orbit", HALO, "--days", days, "--steps", 4), *names)
    assert path.shape == (5, 3)
    assert path[-1] == pytest.approx(path[0], abs=0.1)
    half = numbers(table("propagate", "--orbit", f"{HALO},phase=0.5", "--days", 1), *names)
    assert half[0] == pytest.approx(path[2], abs=0.1)


def test_a_state_is_propagated_as_the_library_does():
    state = [-0.8, 0.1, 0.0, 0.0, -0.3, 0.05]
    text = ",".join(map(str, state))
    rows = table("propagate", "--units", "nd", "--orbit", text, "--days", -3, "--steps", 2)
    times = numbers(rows, "elapsed_days")[:, 0] * SECONDS_PER_DAY / TIME_UNIT_S
    names = ("x_nd", "y_nd", "z_nd", "vx_nd", "vy_nd", "vz_nd")
    assert numbers(rows, *names) == pytest.approx(propagate(state, times), abs=1e-14)


def test_sightings_are_reported_for_every_time():
    orbits = ("--observer", HALO, "--target", "Lyap_L2,period=15", "--hours", 3, "--radius", 2)
    rows = table("see", *orbits, "--epoch", "2024-10-02T12:00:00", "--step", 90)
    assert [row["time_utc"][:16] for row in rows] == [
        f"2024-10-02T{clock}" for clock in ("12:00", "13:30", "15:00")
    ]
    assert all(float(row["moon_angle_deg"]) > 5.0 for row in rows if row["sight"] == "seen")
    small = table("see", *orbits[:-1], 1, "--epoch", "2024-276T12:00:00Z", "--step", 90)
    fainter = numbers(small, "magnitude_mag") - numbers(rows, "magnitude_mag")
    assert fainter == pytest.approx(5.0 * np.log10(2.0))
    assert "of 2 times" in call("see", *orbits[:4], "--hours", 1).stderr
    dynamical = table("see", *orbits, "--epoch", "2024-10-02T12:00:00", "--time-system", "TDB")
    assert dynamical[0]["time_tdb"].startswith("2024-10-02T12:01:09.18")


STATE = "1.12,0,0.18,0,-0.22,0"
HOSTILE = {
    "unknown family": (
        "orbits members Hallo --jacobi 3",
        "unknown orbit family 'Hallo'; the families are",
    ),
    "no such period": ("orbits members Halo_L2_S --period 99", "the family has about 5.92"),
    "none anywhere": (
        "orbits members Lyap_L1 Lyap_L2 --jacobi 9 -q",
        "no member of Lyap_L1, Lyap_L2",
    ),
    "nothing chosen": ("orbits members Halo_L2_S", "give one of --jacobi"),
    "a period of nan": (
        "orbits members Halo_L2_S --period nan",
        "period_days = nan must be a finite",
    ),
    "no count": ("orbits members --count 0", "--count"),
    "no folder": ("orbits list --output /proc/none/a.csv", "/proc/none"),
    "inside the Moon": ("propagate --units nd --orbit 0.98785,0,0,0,0,0 --days 1", "inside the"),
    "nd as km": (
        f"propagate --orbit {STATE} --days 1",
        "in the rotating frame, in km; see --units",
    ),
    "km as nd": ("propagate --units nd --orbit 4e5,0,0,0,1,0 --days 1", "see --units"),
    "five numbers": ("propagate --orbit 1,2,3,4,5 --days 1", "six finite numbers"),
    "words in a state": ("propagate --orbit 1,2,3,4,5,six --days 1", "'six' is not a number"),
    "endless": (
        f"propagate --units nd --orbit {STATE} --days inf",
        "'--days': inf is not a finite number",
    ),
    "several members": (
        "propagate --orbit Halo_L2_S,jacobi=3.05 --days 1",
        "has 2 such members; add",
    ),
    "third of two": ("propagate --orbit Halo_L2_S,jacobi=3.05,member=3 --days 1", "has 2 such"),
    "two values": ("propagate --orbit Halo_L2_S,jacobi=3,period=3 --days 1", "only one"),
    "other key": ("propagate --orbit Halo_L2_S,energy=3 --days 1", "'energy=3' is not one of"),
    "no date": (
        f"see --observer {HALO} --target {HALO} --epoch yesterday",
        "--epoch yesterday: 'yesterday' is not a date",
    ),
    "no such years": (f"see --observer {HALO} --target {HALO} --epoch 2400-01-01", "ephemeris"),
    "centuries of sights": (
        f"see --observer {HALO} --target {HALO} --hours 1e9",
        "--epoch 2024-10-01, --hours 1e+09: ephemeris kernel",
    ),
    "ages of an orbit": (f"propagate --orbit {HALO} --days 1e9", f"--orbit {HALO}, --days 1e+09: "),
    "backwards": (f"see --observer {HALO} --target {HALO} --hours -1", "'--hours'"),
    "flat target": (f"see --observer {HALO} --target {HALO} --radius 0", "'--radius'"),
    "a folder that cannot be made": (
        "orbits list --output /proc/none/a.csv",
        "check that /proc/none is a folder that can be written to",
    ),
    "no results": ("verify no/such/folder", "no/such/folder: no such folder"),
    "a file of results": (f"verify {ROOT}/README.md", "README.md: is a file, not a folder"),
    "nothing to verify": (
        f"verify {ROOT}/workflow/schemas",
        "schemas: contains no result (.nc, .csv",
    ),
    "no results to document": (
        f"docs update --directory {ROOT} --results none",
        f"--results {ROOT}/none: no such folder",
    ),
    "a file to document": (
        f"docs update --directory {ROOT} --results README.md",
        f"--results {ROOT}/README.md: is not a folder",
    ),
    "a folder of settings": (
        f"run --directory {ROOT} --configfile config",
        f"--configfile {ROOT}/config: is not a file",
    ),
    "no settings for Snakemake": (
        f"run --directory {ROOT} -- --dry-run --configfile {QUICK[1]} none.yaml -- task1",
        "none.yaml: no such file",
    ),
    "no equated settings": (
        f"report --directory {ROOT} -- --configfile=none.yaml task1",
        "none.yaml: no such file",
    ),
    "no repository": ("run --directory /proc", "/proc/Snakefile: no such file"),
    "no settings": (f"run --directory {ROOT} --configfile none.yaml", "none.yaml: no such file"),
    "no documents": ("docs update --directory /proc", "needs the folder of the repository"),
    "no such option": ("see --observr x", "see: cislunar see --help"),
    "an option of Snakemake": (
        "run --dry-run",
        "No such option '--dry-run'; options of Snakemake follow --: cislunar run -- --dry-run",
    ),
    "nearly a family": (
        "orbits members halo_l2s --jacobi 3",
        "did you mean 'Halo_L2_S'",
    ),
    "no such command": ("orbit", "No such command 'orbit'"),
}


@pytest.mark.parametrize(("line", "message"), HOSTILE.values(), ids=HOSTILE)
def test_an_error_is_one_line(line, message):
    done = call(*line.split())
    assert (done.exit_code, done.stdout) == (FAILED, "")
    assert done.stderr.startswith("error: ") and done.stderr.count("\n") == 1
    assert message in done.stderr


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", ": a file of settings is a mapping"),
        (b"- a", ": a file of settings is a mapping"),
        (b"seed: \xff", ": cannot be read as text ('utf-8' codec"),
        (b"seed: [", ": no YAML (while parsing"),
        (b"task2:\n  seeds: 1\n  seeds: 2", ", line 3: seeds occurs twice; rename one"),
        (b'{\n\t"seed": 1,\n\t"seed": 2\n}', ", seed occurs twice; rename one"),
    ],
)
def test_a_faulty_file_of_settings_is_named(tmp_path, calls, content, message):
    path = tmp_path / "own.yaml"
    path.write_bytes(content)
    for line in (("--configfile", path), ("--", "--configfile", path)):
        done = call("run", "--directory", ROOT, *line)
        assert done.exit_code == FAILED and not calls
        assert done.stderr.startswith(f"error: {path}{message}") and done.stderr.count("\n") == 1


def test_verbose_shows_the_traceback():
    done = call("orbits", "members", "Halo_L2_S", "--period", 99, "-v")
    assert "Traceback" in done.stderr and done.stderr.splitlines()[-1].startswith("error: ")


LINES = re.findall(r"^cislunar (.+)$", (ROOT / "README.md").read_text("utf-8"), flags=re.MULTILINE)


@pytest.mark.parametrize("line", LINES)
def test_commands_of_the_readme_run(line):
    done = call(*line.split())
    assert done.exit_code == 0 and len(done.stdout.splitlines()) > 2, done.stderr


@pytest.fixture
def calls(monkeypatch):
    """Commands that `cislunar run` and similar ones would start, with the folder."""
    kept, before = [], os.getcwd()

    def started(line, cwd, check):
        kept.append((str(cwd), line))
        return subprocess.CompletedProcess(line, 0)

    monkeypatch.setattr(os, "execv", lambda file, line: kept.append((os.getcwd(), line)))
    monkeypatch.setattr(subprocess, "run", started)
    yield kept
    os.chdir(before)


def test_the_campaign_runs_snakemake_and_the_site_sphinx(calls):
    here = ("--directory", ROOT, "--configfile", QUICK[1])
    quick = " ".join(QUICK)
    call("run", *here, "--", "task1")
    call("run", "--directory", ROOT, "--cores", 3, "--quiet", "--", "--dry-run")
    call("resume", *here, "--verbose")
    call("report", *here, "--output", "/tmp/a.html")
    call("docs", "site", "--directory", ROOT, "--output", "/tmp/site")
    assert {folder for folder, _ in calls} == {str(ROOT)}
    assert [" ".join(line).partition(" -m ")[2] for _, line in calls] == [
        f"snakemake {quick} --cores 2 -- task1",
        "snakemake --cores 3 --quiet all --dry-run",
        f"snakemake {quick} --cores 1 --unlock --verbose",
        f"snakemake {quick} --cores 2 --verbose",
        f"snakemake {quick} --report /tmp/a.html",
        "sphinx -c docs . /tmp/site",
    ]


def test_damaged_results_are_named(tmp_path):
    (tmp_path / "whole.csv").write_text("a\n1\n")
    assert call("verify", tmp_path).exit_code == 0
    (tmp_path / "cut.csv").write_text("a\n1")
    done = call("verify", tmp_path)
    assert done.exit_code == 1 and "cut.csv" in done.stdout and "whole.csv" not in done.stdout


@pytest.mark.parametrize("name", ["cut.csv", "long" * 50 + ".csv"])
def test_only_files_that_snakemake_has_made_are_deleted(tmp_path, monkeypatch, name):
    """By the records of Snakemake's own class, for relative and absolute names."""
    monkeypatch.chdir(tmp_path)
    paths = [Path("results", each) for each in (name, "whole.csv", "own.csv", "own.pdf", "a.nc")]
    paths[0].parent.mkdir()
    for path in paths:
        path.write_text("a\n1\n" if path.stem == "whole" else "a\n1")
    paths.append(Path("results", "b.nc"))
    paths[-1].write_text("a")
    records = FilePersistence(dag=None, warn_only=True)
    for key in (paths[0], paths[1], paths[4].absolute(), f"./{paths[5]}"):
        records._io_write(records._metadata_path, {"rule": "a"}, str(key))
    monkeypatch.chdir("/")
    assert call("verify", tmp_path / "results").exit_code == 1
    assert all((tmp_path / path).exists() for path in paths)
    done = call("verify", tmp_path / "results", "--delete")
    assert done.exit_code == 1
    assert [path.name for path in paths if (tmp_path / path).exists()] == [
        *("whole.csv", "own.csv", "own.pdf"),
    ]
    for path in paths[2:4]:
        assert f"{tmp_path / path}: not removed by --delete, since Snakemake has" in done.stdout


@pytest.mark.workflow
def test_a_finished_campaign_leaves_nothing_to_do(finished):
    line = ("run", "--directory", finished, "--configfile", QUICK[1], "--", "--dry-run")
    output, code = run("cislunar", *line)
    assert code == 0 and "Nothing to be done" in output, output
