"""The campaign by its command: dry runs, the small configuration, bad input, and style."""

import base64
import csv
import hashlib
import re
from collections import Counter
from functools import cache

import pytest
import yaml
from browser import CHROMIUM, probe
from campaign_folder import QUICK, ROOT, copy_workflow, read_campaign, run, snakemake

pytestmark = pytest.mark.workflow


@pytest.fixture(scope="module")
def fresh(tmp_path_factory):
    """A copy of the workflow without results."""
    return copy_workflow(tmp_path_factory.mktemp("fresh"))


def digest(folder):
    """A hash of every result by its path, without logs and benchmarks."""
    results = folder / "results"
    return {
        str(path.relative_to(results)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(results.rglob("*"))
        if path.is_file() and not {"logs", "benchmarks"} & set(path.parts)
    }


@pytest.fixture(scope="module")
def planned(fresh):
    """Files of the campaign by their rule, by target: what a run without results would make."""

    @cache
    def of(*targets):
        output, code = snakemake(fresh, "--summary", *targets)
        assert code == 0, output[-3000:]
        return dict(re.findall(r"^(results/\S+)\t\S+\t(\w+)\t", output, flags=re.MULTILINE))

    return of


def test_the_default_is_the_content_of_the_paper_and_the_rest_is_beyond(planned):
    paper = planned()
    cells = [file for file in paper if re.search(r"/nt\d+_dt", file)]
    assert cells and all(
        re.search(r"/(published|tpe)/mukf/nt\d+_dt\d+[.]nc$", file) for file in cells
    )
    assert {f"results/figures/fig{number:02}" for number in range(1, 9)} == {
        file[: len("results/figures/fig01")] for file in paper if "/figures/" in file
    }
    for name in ("paper_vs_ours.csv", "results.md", "tracking.csv"):
        assert f"results/tables/paper/{name}" in paper and f"results/tables/{name}" not in paper
    beyond_only = {"front", "design", "label_comparison", "readings", "tracking_cell_variant"}
    assert not beyond_only & {*paper.values()}
    everything = planned("everything")
    assert beyond_only < {*everything.values()}
    # what goes beyond needs some results of the paper's part
    assert paper | planned("beyond") == everything


def test_plan_of_the_full_campaign(fresh, planned):
    jobs = Counter(planned("everything").values())  # each of these makes one file
    # Three scenarios with five searches of each kind, and TPE with the other labels in A.
    config = read_campaign()
    runs = config["architecture"]["runs"]
    others = len(config["architecture"]["label_comparison"]["labels"])
    assert jobs["search_run"] == runs * (3 * 2 + others)
    for rule in ("static_targets", "visibility", "exact", "published", "front"):
        assert jobs[rule] == 3
    assert not (fresh / "results").exists()


def test_dry_run_of_parts(fresh):
    targets = "task1", "task2", "figures", "results/architecture/B/exact.nc"
    output, code = snakemake(fresh, "--dry-run", "--cores", "2", *targets)
    assert code == 0, output[-3000:]


def test_small_campaign_produces_every_kind_of_result(finished):
    results = finished / "results" / "quick"
    for name in (
        "ephemeris/sun.nc",
        "orbits/families.nc",
        "orbits/tracked.nc",
        "targets/zvs_points.nc",
        "targets/static_C.nc",
        "visibility/B.nc",
        "architecture/A/tpe.nc",
        "architecture/B/random.nc",
        "architecture/C/exact.nc",
        "architecture/A/published.nc",
        "tables/architecture.csv",
        "tables/paper_vs_ours.csv",
        "tables/model_error.csv",
        "figures/fig18_model_error.png",
        "orbits/paths_A-ephemeris_pair.nc",
        "figures/sweep_bodies.png",
    ):
        assert (results / name).is_file(), name
    assert [path.name for path in (finished / "results").iterdir()] == ["quick"]
    assert not list(results.rglob("*.part"))
    assert list((results / "figures").glob("*.png"))


LONG_JOBS = {
    "targets/zvs_points": "missions",
    "targets/static_C": "first centers",
    "orbits/families": "families",
    "orbits/tracked": "targets",
    "visibility/A": "orbits",
    "architecture/A/random_stability_rank_0": "random evaluations",
    "architecture/A/exact": "restarts",
    "architecture/A/published": "restarts",
    "architecture/A/front": "numbers of satellites",
    "tables/architecture": "architectures",
    "tables/readings_architecture": "readings",
    "task2/A/tpe/mukf/nt20_dt60": "tasking epochs of all seeds",
    "task2/tasking/A_published_nt20": "searches",
    "task2/summary": "cells",
    "figures/orbit_library": "files of the figure",
}
"""Jobs that take more than a few seconds at full size, and the items of their progress."""


@pytest.mark.parametrize("name, counted", LONG_JOBS.items())
def test_small_campaign_logs_its_progress(finished, name, counted):
    log = (finished / f"results/quick/logs/{name}.log").read_text(encoding="utf-8")
    line = rf"{counted}: (\d+) of \1 \(100 %\), \d+:\d\d elapsed, 0:00 left"
    assert re.search(line, log), log
    assert "done in" in log


def test_small_campaign_records_its_times(finished):
    path = finished / "results/quick/benchmarks/visibility/A.tsv"
    with open(path, encoding="utf-8") as file:
        row = next(csv.DictReader(file, delimiter="\t"))
    assert float(row["s"]) > 0.0


OPENED = """
while (!document.querySelector("#app img[src^='data:image/png']"))
  await new Promise(done => setTimeout(done, 100));
return app.state.category;
"""


def test_report_is_one_file(finished, tmp_path):
    output, code = snakemake(finished, *QUICK, "--report", "report.html")
    assert code == 0, output[-3000:]
    report = (finished / "report.html").read_text(encoding="utf-8")
    assert "paper_vs_ours.csv" in report
    assert len(report) < 15e6
    if CHROMIUM is not None:
        assert probe(report, tmp_path, OPENED)[0] == "Figures"
    # The interactive page is included, byte for byte, with its copy of plotly.js.
    page = (finished / "results/quick/figures/orbits_3d.html").read_bytes()
    assert base64.b64encode(page).decode() in report
    replay = (finished / "results/quick/figures/replay.html").read_bytes()
    assert base64.b64encode(replay).decode() in report


def refused(folder, tmp_path, change, *arguments):
    """Message of a run with a changed configuration, which must not touch any result."""
    extra = tmp_path / "changed.yaml"
    extra.write_text(yaml.safe_dump(change), encoding="utf-8")
    before = digest(folder)
    output, code = snakemake(folder, "--cores", "2", *QUICK, extra, *arguments)
    assert code != 0
    assert digest(folder) == before
    assert "Traceback" not in output
    assert "Error in rule" not in output, "a job had started"
    return output


def broken_missions(tmp_path):
    """The mission table without the Jacobi constant of one row."""
    with open(ROOT / "config/missions.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    rows[4]["jacobi"] = ""
    table = tmp_path / "missions.csv"
    with open(table, "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    return table, rows[4]["mission"]


@pytest.mark.parametrize(
    ("change", "messages"),
    [
        (
            {
                "visibilty": {},
                "visibility": {"step_hours": "one"},
                "scenarios": {"A": {"targets": 0}},
                "orbits": {"members": {"Vertical_L1": 3}},
            },
            (
                "unknown configuration key 'visibilty': did you mean 'visibility'?",
                "'visibility.step_hours' = 'one'",
                "'scenarios.A.targets' = 0",
                "'orbits.members.Vertical_L1'",
            ),
        ),
        ({"scenarios": {"A": {"targets": 10**7}}}, ["'scenarios.A.targets' = 10000000: only "]),
        ({"architecture": {"slots": 200}}, ["'architecture.slots' = 200 exceeds the "]),
        ({"results": "config/quick.yaml"}, ["'results' = 'config/quick.yaml'"]),
        ({"targets": {"missions": "nowhere.csv"}}, ["nowhere.csv: no such file"]),
    ],
)
def test_bad_input_stops_at_once(finished, tmp_path, change, messages):
    output = refused(finished, tmp_path, change)
    assert all(message in output for message in messages), output


def test_a_file_of_no_scenario_is_refused_in_a_line(finished):
    asked = "results/quick/task2/Q/tpe/mukf/nt20_dt60.nc"
    output, code = snakemake(finished, "--dry-run", "--cores", "1", *QUICK, "--", asked)
    assert code == 1 and f"error: {asked}: scenario 'Q' is none of this" in output
    assert "Exception" not in output


def test_mission_without_jacobi_constant_stops_at_once(finished, tmp_path):
    table, mission = broken_missions(tmp_path)
    output = refused(finished, tmp_path, {"targets": {"missions": str(table)}})
    assert f"{table}, row 6, mission '{mission}': no Jacobi constant" in output


def test_bad_input_changes_no_result(finished):
    """The campaign is still complete after all refused runs, and a further run makes nothing."""
    output, code = snakemake(finished, "--dry-run", "--cores", "2", *QUICK)
    assert code == 0
    assert "Nothing to be done" in output


STUDY = {"observers": {"eye": "Halo_L2_S,period=6.56"}, "targets": "targets.csv"}


def test_a_faulty_study_is_refused_before_its_results_are_removed(tmp_path):
    folder = copy_workflow(tmp_path)
    own = folder / "config/studies/own.yaml"
    table = folder / "targets.csv"
    table.write_text("id,x,y,z,vx,vy,vz\na,1.1,0,0,0,0.1,0\n", encoding="utf-8")
    made = [folder / f"results/studies/own/{name}" for name in ("study.nc", "summary.csv")]
    made.append(made[0].with_name("estimates.oem"))
    asked = "--rerun-triggers", "mtime", "--cores", "1", "--", "results/studies/own/summary.csv"
    # the first result needs the study to be faultless
    own.write_text(yaml.safe_dump(STUDY), encoding="utf-8")
    made[0].parent.mkdir(parents=True)
    for path in made:
        path.touch()
    output, code = snakemake(folder, "--dry-run", *asked)
    assert code == 0 and "Nothing to be done" in output, output
    table.touch()
    output, code = snakemake(folder, "--dry-run", *asked)
    assert code == 0 and "updated input files: targets.csv" in output.lower(), output
    own.write_text(yaml.safe_dump(STUDY | {"durations": 3}), encoding="utf-8")
    output, code = snakemake(folder, *asked)
    assert code == 1
    assert "error: config/studies/own.yaml: unknown setting 'durations'" in output
    assert "Traceback" not in output and "rule study" not in output
    assert all(path.exists() for path in made)


def test_lint(fresh):
    output, code = snakemake(fresh, "--lint")
    assert code == 0, output


def test_workflow_is_formatted():
    output, code = run("snakefmt", "--check", "Snakefile", "workflow")
    assert code == 0, output


@pytest.mark.parametrize("command", [("check",), ("format", "--check")])
def test_python_style(command):
    output, code = run("ruff", *command, ".")
    assert code == 0, output


def test_readme_commands_are_marked():
    """`.ci/run` and newcomers take the commands from the README."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    for mark in ("test-command", "campaign-command"):
        assert re.search(rf"^<!-- {mark} -->\n```\w*\n.*\S.*\n```$", text, flags=re.MULTILINE), mark
