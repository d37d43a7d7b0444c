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
DOCUMENTS = [
    README,
    ROOT / "CONTRIBUTING.md",
    ROOT / "config/README.md",
    *sorted((ROOT / "docs").rglob("*.md")),
]
NOT_RUN = ("not run: ", "campaign-command", "test-command")
"""Marks of what is not run here: why not, or that continuous integration does it."""
OUTPUT = "output"
NEXT_BLOCK = "\x1e"


class Block(NamedTuple):
    """A fenced block of a document with the comment above it, and the output shown below it."""

    language: str
    text: str
    mark: str
    output: str | None = None


def blocks(path):
    """Fenced blocks of a document, outputs with the blocks that print them."""
    found = []
    for each in BLOCK.finditer(path.read_text(encoding="utf-8")):
        if each["mark"] == OUTPUT:
            found[-1] = found[-1]._replace(output=each["text"])
        else:
            found.append(Block(each["language"], each["text"], each["mark"] or ""))
    return found


def scripts(path):
    """What is run of a document: lists of blocks, neighbors in Python in one list."""
    chosen = []
    for block in blocks(path):
        if block.language not in ("bash", "python") or block.mark.startswith(NOT_RUN):
            continue
        if chosen and chosen[-1][0].language == block.language == "python":
            chosen[-1].append(block)
        else:
            chosen.append([block])
    return chosen


def execute(folder, script):
    """Run blocks as one script in a folder; what each prints, the errors, and the exit code."""
    mark = f"\nprint({NEXT_BLOCK!r}, end='')\n"
    text = mark.join(block.text for block in script)
    command = {
        "bash": ["bash", "-o", "errexit", "-o", "nounset", "-o", "pipefail", "-c", text],
        "python": [sys.executable, "-c", text],
    }[script[0].language]
    path = f"{os.path.dirname(sys.executable)}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        command,
        cwd=folder,
        env=os.environ | {"PATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    return done.stdout.split(NEXT_BLOCK), done.stderr, done.returncode


def fill_output(path, block, output):
    """Write below a block of a document what it printed."""
    text = path.read_text(encoding="utf-8")
    fence = f"```{block.language}\n{block.text}```\n"
    shown = "\n<!-- output -->\n```text\n{}```\n"
    old = fence + ("" if block.output is None else shown.format(block.output))
    assert text.count(old) == 1, block.text
    path.write_text(text.replace(old, fence + shown.format(output)), encoding="utf-8")


def test_every_block_of_a_tutorial_says_its_language():
    for path in TUTORIALS:
        for block in blocks(path):
            assert block.language in ("bash", "python", "yaml", "text", "csv"), (path, block)


def test_the_configuration_in_the_tutorial_is_that_of_the_example():
    example = (ROOT / "config/examples/own_study.yaml").read_text(encoding="utf-8")
    shown = [
        b.text for b in blocks(ROOT / "docs/tutorials/own_scenario.md") if b.language == "yaml"
    ]
    assert len(shown) == 4
    assert all(text in example for text in shown)


LINK = re.compile(r"\]\((?!https?:|#)([^)#\s]+)[^)]*\)")
GENERATED = {"docs/results.md"}
"""What only a finished campaign makes."""


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
@pytest.mark.parametrize("path", [*filter(scripts, DOCUMENTS)], ids=lambda path: path.stem)
def test_document_runs(path, finished, tmp_path, pytestconfig):
    """In a copy of a finished small campaign, so that only what a command asks for is made.

    What is made goes to `results`, which git ignores.
    """
    folder = tmp_path / "campaign"
    shutil.copytree(finished, folder, symlinks=True)
    before = {each.name for each in folder.iterdir()}
    for script in scripts(path):
        outputs, errors, code = execute(folder, script)
        said = f"{script[-1].text}\n{outputs[-1][-3000:]}\n{errors[-3000:]}"
        assert code == 0, said
        for block, output in zip(script, outputs, strict=True):
            if pytestconfig.getoption("--fill-output") and block.language == "python" and output:
                fill_output(path, block, output)
            elif block.output is not None:
                assert output == block.output, f"{block.text}\nprinted\n{output}"
    assert {each.name for each in folder.iterdir()} <= before | {".snakemake", "results"}
