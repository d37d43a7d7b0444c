"""Fixtures shared by the test modules, and the order in which several workers run them."""

import ast
import gc
import os
import re
from collections import Counter
from functools import cache
from pathlib import Path

import pytest
from campaign_folder import QUICK, ROOT, copy_workflow, read_campaign, read_settings, snakemake

from cislunar.campaign.kernels import kernel_set
from cislunar.campaign.settings.families import with_families
from cislunar.campaign.settings.reading import merged
from cislunar.estimation import ESTIMATORS
from cislunar.orbits.families import observer_library
from cislunar.runtime.kernels import compile_kernels, drop_stale_kernels

STALE = pytest.StashKey[list[str]]()
FINISHED = "finished"
TOGETHER = ("benchmark",)
"""Folders whose modules share results that take long, so that one worker runs them."""

USING_ESTIMATORS = re.compile(
    r"closed_loop|cell_dataset|light_curve|estimation\.(kalman|registry|unscented)"
)
"""Names in modules whose tests run an estimator, whose kernels take minutes to compile."""

LONG = (
    "test_faults.py",
    "test_site.py",
    "test_workflow.py",
    "test_hostile_input.py",
    "test_ephemeris_cells.py",
    "test_splitting.py",
    "test_tracks.py",
    "test_light_curve.py",
    "test_replay_page.py",
    "test_parameter_states.py",
    "test_own_study.py",
    "test_model_selection.py",
    "test_tracking_campaign.py",
    "test_tasking_comparison.py",
)
"""Modules that take longest of those that run estimators, by their measured times: if one of them
were the last, one worker would have nothing to do meanwhile."""


def pytest_configure(config):
    """Drop outdated kernels; they are compiled when they are first needed."""
    config.stash[STALE] = drop_stale_kernels()


def pytest_report_header(config):
    """Report what has to be compiled: it takes minutes."""
    count = len(config.stash[STALE])
    text = "kernels of {} files will be compiled when first needed, which takes minutes"
    return text.format(count) if count else None


def pytest_addoption(parser):
    parser.addoption(
        "--fill-output", action="store_true", help="write what the documents' code prints into them"
    )


def pytest_runtest_setup(item):
    """Of several workers one compiles the kernels of the estimators before its first test that may
    need them. Until then, others run tests without an estimator; they wait before the first one
    with an estimator, and load the kernels."""
    if "PYTEST_XDIST_WORKER" in os.environ and may_run_estimators(item):
        load_estimators()


@cache
def load_estimators():
    """Compile or load the kernels of all estimators."""
    for name in ESTIMATORS:
        compile_kernels(kernel_set(f"tracking-{name}"))


def may_run_estimators(item):
    """Whether a test may run an estimator: by itself, or by Snakemake."""
    return runs_estimators(item.path) or item.get_closest_marker("workflow") is not None


@cache
def runs_estimators(path):
    """Whether the tests of a module run an estimator."""
    return USING_ESTIMATORS.search(path.read_text(encoding="utf-8")) is not None


@cache
def users_of_the_campaign(path):
    """Names of the tests and fixtures of a module that need the finished campaign."""
    functions = {
        node.name: {argument.arg for argument in node.args.args}
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef)
    }
    found = {FINISHED}
    while more := {name for name, arguments in functions.items() if arguments & found} - found:
        found |= more
    return found


def group_of(nodeid):
    """The group of a test, which one worker runs: those that need the campaign, else its module, or
    its folder if the modules of the folder share results."""
    module, _, name = nodeid.partition("::")
    if name.partition("[")[0] in users_of_the_campaign(ROOT / module):
        return FINISHED
    path = Path(module)
    return path.parent.name if path.parent.name in TOGETHER else path.name


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Several workers share the groups of `group_of`."""
    from xdist.scheduler import LoadScopeScheduling

    class Groups(LoadScopeScheduling):
        def _split_scope(self, nodeid):
            return group_of(nodeid)

    return Groups(config, log)


def pytest_collection_modifyitems(items):
    """Sort the groups of tests.

    The campaign whose results many tests read is run once, first. Tests without an estimator come
    next. The remaining groups follow, the longest modules first and then those of most tests.
    """
    groups = {item: group_of(item.nodeid) for item in items}
    sizes = Counter(groups.values())
    late = {groups[item] for item in items if may_run_estimators(item)}
    stage = {group: 3 if group in late else 1 for group in sizes}
    stage[FINISHED] = 0
    order = {group: (stage[group], -size, group) for group, size in sizes.items()}
    order |= {group: (2, place, group) for place, group in enumerate(LONG)}
    items.sort(key=lambda item: order[groups[item]])


def pytest_collection_finish():
    """Search less for garbage: it took 7 % of the time of tests that compile kernels, and the
    objects of the collection are never garbage."""
    gc.freeze()
    gc.set_threshold(20_000, 20, 20)


@pytest.fixture(scope="session")
def library():
    """The 302 candidate observer orbits at the default settings."""
    return observer_library()


@pytest.fixture(scope="session")
def finished(tmp_path_factory):
    """A copy of the workflow with the results of the small configuration; do not change it."""
    folder = copy_workflow(tmp_path_factory.mktemp("finished"))
    output, code = snakemake(folder, "--cores", "2", *QUICK)
    assert code == 0, output[-6000:]
    return folder


@pytest.fixture
def paper(tmp_path):
    """The configuration of the full campaign."""
    return read_campaign() | {"results": str(tmp_path)}


@pytest.fixture
def task2(paper):
    """Its key `task2`, with every variant that its families make."""
    return with_families(paper)["task2"]


@pytest.fixture
def study(paper, monkeypatch):
    """The example, read from the repository's root as its command does."""
    monkeypatch.chdir(ROOT)
    example = read_settings("examples/own_study.yaml")
    return merged(paper, example | {"results": paper["results"]})
