"""Whatever is fed as configuration, mission table or shape: accepted, or one clear message.

Property-based: Hypothesis makes the inputs, the same ones in every run. A refusal names the key or
the file on one line, and no other exception escapes.
"""

import copy
import datetime
import math

import pytest
import yaml
from campaign_folder import ROOT, read_campaign, snakemake
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from cislunar.campaign.settings.cell_settings import cell_files, cell_settings
from cislunar.campaign.settings.cells import campaign_cells
from cislunar.campaign.settings.checks import check_campaign
from cislunar.campaign.settings.families import with_families
from cislunar.campaign.settings.preflight import check_inputs
from cislunar.campaign.settings.reading import with_types
from cislunar.campaign.settings.scenarios import in_study
from cislunar.errors import CislunarError, ConfigurationError
from cislunar.figures.tracking.choice import (
    figure_architectures,
    high_load_cells,
    interval_cells,
    selected_cell,
    target_count_cells,
    tasking_variants,
)
from cislunar.photometry.mesh_files import load_mesh
from cislunar.targets.missions import load_missions

MISSIONS = (ROOT / "config/missions.csv").read_bytes()
MOST_CELLS = 100_000
LONGEST_LINE = 500

reproducible = settings(
    derandomize=True,
    database=None,
    deadline=None,
    max_examples=300,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)


def read_config():
    config = read_campaign()
    config["targets"]["missions"] = str(ROOT / config["targets"]["missions"])
    return config


CONFIG = read_config()


def places(value, above=()):
    """The place of every value in a configuration, at any depth."""
    inner = value.items() if isinstance(value, dict) else enumerate(value)
    for key, part in inner:
        yield (*above, key)
        if isinstance(part, dict | list):
            yield from places(part, (*above, key))


PLACES = list(places(CONFIG))

numbers = st.one_of(
    st.integers(),
    st.sampled_from([0, -1, 1, 2, 10**9, 2**63, 10**30, -(10**30)]),
    st.floats(),
    st.sampled_from([math.nan, math.inf, -math.inf, 0.0, -0.0, 1.0, 2.5, 5e-324, 1e308, 1e-9]),
)
scalars = st.one_of(
    st.none(),
    st.booleans(),
    numbers,
    st.text(max_size=30),
    st.sampled_from(
        ["", " ", "null", "{", "[1", "a: b: c", "&a", "*a", "!!x", "\0", "\n", "é/ü", "{x}"]
    ),
    st.sampled_from(
        ["~", "~nobody/x", "/dev/null", "/proc/self/mem", "../..", "x" * 5000, "x.obj"]
    ),
    st.dates(),
    st.just(datetime.datetime(2024, 10, 1)),
)
keys = st.one_of(st.text(max_size=8), st.integers(), st.none(), st.booleans(), st.just("seeds\n"))
values = st.recursive(
    scalars,
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(keys, inner, max_size=3)),
    max_leaves=5,
)
changes = st.one_of(
    st.tuples(st.just("replace"), st.sampled_from(PLACES), values),
    st.tuples(st.just("replace"), st.sampled_from(PLACES), numbers),
    st.tuples(st.just("remove"), st.sampled_from(PLACES), st.none()),
    st.tuples(st.just("add"), st.sampled_from(PLACES), st.tuples(keys, values)),
)


def changed(config, change):
    """A configuration with one value replaced, removed or put beside another."""
    kind, place, value = change
    config = copy.deepcopy(config)
    above = config
    try:
        for key in place[:-1]:
            above = above[key]
        if kind == "remove":
            del above[place[-1]]
        elif kind == "replace":
            above[place[-1]] = value
        elif isinstance(above, dict):
            above[value[0]] = value[1]
        else:
            above.append(value[1])
    except (AttributeError, KeyError, IndexError, TypeError):
        pass  # an earlier change has done away with the place
    return config


def assert_clear(error, *names):
    """Each fault has its line, of readable length, and names the key or the file."""
    assert str(error)
    for line in str(error).split("\n"):
        assert len(line) < LONGEST_LINE, line
        assert line.isprintable(), line
        assert any(name in line for name in names), line


def assert_workflow_can_use(config):
    """What the rules make of an accepted configuration before any job starts."""
    config = with_families(in_study(config))
    task2, architecture = config["task2"], config["architecture"]
    for number in ("runs", "slots", "max_satellites"):
        assert type(architecture[number]) is int
        assert architecture[number] <= 10_000
    for number in ("seeds", "interval_minutes"):
        assert type(task2[number]) is int
    assert all(isinstance(name, str) for name in config["scenarios"])
    cells = campaign_cells(task2)
    assert len(cells) < MOST_CELLS
    for variant in {cell.variant for cell in cells}:
        chosen = cell_settings(task2, variant)
        assert len(cell_files(chosen)) < 2
        assert 3600.0 * chosen["duration_hours"] / chosen["step_s"] < 1e7
    for name in figure_architectures(task2):
        for made in (target_count_cells, selected_cell, interval_cells, high_load_cells):
            made(task2, name)
    tasking_variants(task2)


def judge(config):
    """Check a configuration as the workflow does."""
    try:
        config = check_campaign(with_types(config))
        check_inputs(config)
    except CislunarError as error:
        assert_clear(error, "configuration key", "'task2.", ".csv", ".bsp", "kernel", "mission")
    else:
        assert_workflow_can_use(config)


@pytest.fixture
def elsewhere(tmp_path, monkeypatch):
    """A folder that relative paths lead to."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@reproducible
@given(change=changes)
@example(change=("replace", ("architecture", "runs"), 2.0))
@example(change=("replace", ("architecture", "runs"), 10**12))
@example(change=("replace", ("visibility", "limiting_magnitude"), math.nan))
@example(change=("replace", ("visibility", "duration_days"), math.inf))
@example(change=("replace", ("visibility", "step_hours"), 5e-324))
@example(change=("replace", ("task2", "step_s"), 5e-324))
@example(change=("replace", ("task2", "seeds"), "{"))
@example(change=("replace", ("results",), "\0"))
@example(change=("replace", ("results",), "x" * 5000))
@example(change=("replace", ("ephemeris", "kernel"), "~nobody/x"))
@example(change=("replace", ("ephemeris", "kernel"), "/dev/null"))
@example(change=("replace", ("epoch_jd",), 1e9))
@example(change=("replace", ("targets", "missions"), "\0"))
@example(change=("add", ("scenarios", "A"), (1, {"targets": 10})))
@example(change=("add", ("task2", "seeds"), ("seeds\n", 3)))
@example(change=("replace", ("task2", "architectures"), []))
@example(change=("replace", ("task2", "variants", "families"), {}))
def test_one_hostile_change(elsewhere, change):
    judge(changed(CONFIG, change))
    assert list(elsewhere.iterdir()) == [], "checking wrote something"


@reproducible
@given(several=st.lists(changes, min_size=2, max_size=6))
def test_several_hostile_changes(elsewhere, several):
    config = CONFIG
    for change in several:
        config = changed(config, change)
    judge(config)


def test_configuration_that_holds_itself():
    config = yaml.safe_load("task2: &a {seeds: *a}")
    with pytest.raises(ConfigurationError, match="contains itself"):
        with_types(config)


@reproducible
@given(config=values)
def test_no_configuration_at_all(elsewhere, config):
    judge(config)


fields = st.one_of(
    st.text(max_size=12),
    st.sampled_from(["3.1", "nan", "inf", "-1", "1e400", "0x10", "", '"', "Gateway", "٣"]),
)
header = st.lists(
    st.sampled_from(["mission", "jacobi", "year", "source", "jacobi_min", "", "mission "]),
    max_size=5,
)
tables = st.one_of(
    st.binary(max_size=200),
    st.text(max_size=200).map(lambda text: text.encode("utf-8", "replace")),
    st.builds(
        lambda names, rows: "\n".join(",".join(row) for row in [names, *rows]).encode(
            "utf-8", "replace"
        ),
        header,
        st.lists(st.lists(fields, max_size=5), max_size=4),
    ),
    st.builds(
        lambda start, length, noise: MISSIONS[:start] + noise + MISSIONS[start + length :],
        st.integers(0, len(MISSIONS)),
        st.integers(0, 200),
        st.binary(max_size=5),
    ),
)


@reproducible
@given(content=tables)
@example(content=b"mission,jacobi,jacobi\nA,3.1,3.2\n")
@example(content=b"mission,jacobi\n\x00,3.1\n")
@example(content=b'mission,jacobi\n"' + b"x" * 200_000 + b'",nan\n')
def test_hostile_mission_table(tmp_path, content):
    path = tmp_path / "table.csv"
    path.write_bytes(content)
    try:
        missions = load_missions(path)
    except CislunarError as error:
        assert_clear(error, str(path))
    else:
        assert len(missions) > 0
        assert missions["mission"].is_unique
        assert missions["jacobi"].between(0.0, 10.0, inclusive="neither").all()
    assert path.read_bytes() == content


cube = st.sampled_from(
    [b"v 0 0 0\n", b"v 1 0 0\n", b"v nan 0 0\n", b"f 1 2 3\n", b"f 1 2 9\n", b"f"]
)


@reproducible
@given(
    content=st.one_of(st.binary(max_size=300), st.lists(cube, max_size=12).map(b"".join)),
    ending=st.sampled_from(["obj", "stl"]),
)
def test_hostile_shape(tmp_path, content, ending):
    path = tmp_path / f"body.{ending}"
    path.write_bytes(content)
    try:
        load_mesh(path)
    except CislunarError as error:
        assert_clear(error, str(path))


@pytest.mark.workflow
@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("task2: [1", "Config file is not valid JSON or YAML"),
        ("- 1", "Config file must be given as JSON or YAML with keys"),
        (
            "seed: 2\ntask2: {}\nseed: 3",
            "error: hostile.yaml, line 3: seed occurs twice; rename one",
        ),
        ("task2: 3", "configuration key 'task2' = 3: must be a mapping"),
        ("scenarios: {1: {targets: 5}}", "unknown configuration key 1 in 'scenarios'"),
        ("visibility: {limiting_magnitude: .nan}", "'visibility.limiting_magnitude' = nan"),
        ("results: a{b}", "'results' = 'a{b}': choose a path without"),
        ("architecture: {runs: 2.0}", None),
    ],
)
def test_hostile_configuration_on_the_command_line(tmp_path, text, message):
    """One line from Snakemake, no traceback, nothing written; None: accepted."""
    for name in ("Snakefile", "workflow", "config"):
        (tmp_path / name).symlink_to(ROOT / name)
    (tmp_path / "hostile.yaml").write_text(text, encoding="utf-8")
    output, code = snakemake(tmp_path, "-n", "--cores", "1", "--configfile", "hostile.yaml")
    assert (code == 0) == (message is None), output[-2000:]
    assert message is None or message in output
    assert "Traceback" not in output
    left = {path.name for path in tmp_path.iterdir()}
    assert left <= {"Snakefile", "workflow", "config", "hostile.yaml", ".snakemake"}
