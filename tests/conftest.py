"""Fixtures shared by the test modules."""

from collections import Counter

import pytest
from campaign_folder import QUICK, copy_workflow, snakemake

from cislunar.campaign.operation.kernels import drop_stale_kernels
from cislunar.orbits.families import observer_library


def pytest_configure(config):
    """Kernels whose sources have changed are compiled anew; it is said, for it takes a while."""
    config.stash[STALE] = drop_stale_kernels()


def pytest_report_header(config):
    """A line on top of the run, if there is anything to compile."""
    count = len(config.stash[STALE])
    return f"kernels of {count} files will be compiled when first needed" if count else None


STALE = pytest.StashKey[list[str]]()


def pytest_addoption(parser):
    parser.addoption(
        "--fill-output", action="store_true", help="write what the documents' code prints into them"
    )


LONGEST = "test_faults.py", "finished"
"""Groups of tests that take minutes though they are few: begun first, so that no worker is idle."""


def pytest_collection_modifyitems(items):
    """With several workers, one of them runs what needs the finished campaign, made once."""
    groups = {
        item: "finished" if "finished" in item.fixturenames else item.path.name for item in items
    }
    sizes = Counter(groups.values())
    for item, group in groups.items():
        item.add_marker(pytest.mark.xdist_group(group))
    items.sort(key=lambda item: (groups[item] not in LONGEST, -sizes[groups[item]], groups[item]))


@pytest.fixture(scope="session")
def library():
    """The 302 candidate observer orbits at the default settings."""
    return observer_library()


@pytest.fixture(scope="session")
def finished(tmp_path_factory):
    """A copy of the workflow in which the small configuration has been run; leave it as it is."""
    folder = copy_workflow(tmp_path_factory.mktemp("finished"))
    output, code = snakemake(folder, "--cores", "2", *QUICK)
    assert code == 0, output[-6000:]
    return folder
