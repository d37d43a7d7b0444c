"""The documents: their commands run, their numbers are those of the tables."""

import os
import re
import shutil
import subprocess
import sys
from importlib.util import find_spec
from typing import NamedTuple

import pytest
from campaign_folder import ROOT

BLOCK = re.compile(
    r"(?:^<!-- (?P<mark>[^\n]*?) -->\n)?^```(?P<language>\w*)\n(?P<text>.*?)^```$",
    flags=re.MULTILINE | re.DOTALL,
)
TUTORIALS = sorted((ROOT / "docs/tutorials").glob("*.md"))
README = ROOT / "README.md"
RUN = "run"
NOT_RUN = "not run: "


class Block(NamedTuple):
    """A fenced block of a document with the comment above it."""

    language: str
    text: str
    mark: str


def blocks(path):
    """Fenced blocks of a document."""
    found = BLOCK.finditer(path.read_text(encoding="utf-8"))
    return [Block(each["language"], each["text"], each["mark"] or "") for each in found]


def scripts(path):
    """What is run of a document: commands, and Python with neighboring blocks joined.

    In a tutorial that is all but what is marked as not run; elsewhere what is marked to be run.
    """
    chosen = []
    for language, text, mark in blocks(path):
        if language not in ("bash", "python") or mark.startswith(NOT_RUN):
            continue
        if path not in TUTORIALS and mark != RUN:
            continue
        if chosen and chosen[-1][0] == language == "python":
            chosen[-1] = (language, chosen[-1][1] + text)
        else:
            chosen.append((language, text))
    return chosen


def execute(folder, language, text):
    """Run a script in a folder; what it says, and its exit code."""
    command = {
        "bash": ["bash", "-o", "errexit", "-o", "nounset", "-o", "pipefail", "-c", text],
        "python": [sys.executable, "-c", text],
    }[language]
    path = f"{os.path.dirname(sys.executable)}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        command,
        cwd=folder,
        env=os.environ | {"PATH": path},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    return done.stdout, done.returncode


def test_every_block_of_a_tutorial_says_its_language():
    for path in TUTORIALS:
        for block in blocks(path):
            assert block.language in ("bash", "python", "yaml", "text", "csv"), (path, block)


def test_the_configuration_in_the_tutorial_is_that_of_the_example():
    example = (ROOT / "config/examples/own_study.yaml").read_text(encoding="utf-8")
    shown = [
        b.text for b in blocks(ROOT / "docs/tutorials/own_scenario.md") if b.language == "yaml"
    ]
    assert len(shown) == 2
    assert all(text in example for text in shown)


LINK = re.compile(r"\]\((?!https?:|#)([^)#\s]+)[^)]*\)")
GENERATED = {"docs/results.md"}
"""What only a finished campaign makes."""
DOCUMENTS = [README, *sorted((ROOT / "docs").rglob("*.md"))]


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.stem)
def test_links_lead_somewhere(path):
    for target in LINK.findall(path.read_text(encoding="utf-8")):
        found = (path.parent / target).resolve()
        assert found.exists() or str(found.relative_to(ROOT)) in GENERATED, target


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.stem)
def test_modules_named_exist(path):
    text = path.read_text(encoding="utf-8")
    for name in re.findall(r"`((?:cislunar|benchmarks|tests)/[\w/]+\.py)`", text):
        assert (ROOT / name).is_file(), name
    for name in re.findall(r"(?:from|-m) (cislunar[\w.]*)", text):
        assert find_spec(name), name


@pytest.mark.workflow
@pytest.mark.parametrize(
    "path", [*filter(scripts, [README, *TUTORIALS])], ids=lambda path: path.stem
)
def test_document_runs(path, finished, tmp_path):
    """In a copy of a finished small campaign, so that only what a command asks for is made."""
    folder = tmp_path / "campaign"
    shutil.copytree(finished, folder, symlinks=True)
    for language, text in scripts(path):
        output, code = execute(folder, language, text)
        assert code == 0, f"{text}\n{output[-3000:]}"
