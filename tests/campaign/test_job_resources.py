"""Memory and time asked of a cluster follow from the benchmarks of a campaign."""

import re

import pandas as pd
import pytest
import yaml
from campaign_folder import ROOT

from cislunar.errors import InputFileError
from workflow.documents.job_resources import (
    BEGIN,
    measured_resources,
    requested,
    with_requests,
)

RULES = ROOT / "workflow/rules"
PROFILE = (ROOT / "profiles/slurm/config.yaml").read_text(encoding="utf-8")
MEASURED = ROOT / "profiles/slurm/measured.csv"


def test_profile_asks_for_what_was_measured():
    assert with_requests(PROFILE, pd.read_csv(MEASURED)) == PROFILE


def test_profile_names_rules_that_there_are():
    text = "\n".join(path.read_text(encoding="utf-8") for path in RULES.glob("*.smk"))
    profile = yaml.safe_load(PROFILE)
    for rule in [*profile["set-resources"], *profile["set-threads"]]:
        assert re.search(rf"^(rule {rule}|use rule \w+ as {rule} with):$", text, re.MULTILINE), rule


@pytest.mark.parametrize("path", sorted(RULES.glob("*.smk")), ids=lambda path: path.stem)
def test_benchmarks_begin_with_the_rule_that_wrote_them(path):
    head = re.compile(r"^(?:use rule \w+ as |rule )(\w+)(?: with)?:$", flags=re.MULTILINE)
    parts = head.split(path.read_text(encoding="utf-8"))
    for rule, text in zip(parts[1::2], parts[2::2], strict=True):
        jobs = re.findall(r'benchmark_of\(\s*f?"([^"]+)"', text)
        assert all(job.split("/")[0] == rule for job in jobs)
        assert jobs or not rule.startswith("tracking_cell")  # none is lent by another rule


def test_requests_are_rounded_up(tmp_path):
    folder = tmp_path / "visibility"
    folder.mkdir()
    for name, seconds, megabytes in (("A", 10.0, 300.0), ("B", 100.0, 126.0)):
        (folder / f"{name}.tsv").write_text(f"s\tmax_rss\n{seconds}\t{megabytes}\n")
    measured = measured_resources(tmp_path)
    assert measured.values.tolist() == [["visibility", 2, 300.0, 100.0]]
    # twice 300 MB, four times 100 s
    assert yaml.safe_load(requested(measured)) == {
        "set-resources": {"visibility": {"mem_mb": 750, "runtime": 10}}
    }


def test_profile_without_its_marks_is_refused():
    with pytest.raises(InputFileError, match="lacks the line"):
        with_requests(PROFILE.replace(BEGIN, ""), pd.read_csv(MEASURED))
