"""The page of equations: every number once, and in the docstring of the function it names."""

import re
from importlib import import_module

from campaign_folder import ROOT

NUMBERED = 63
"""Equations of the paper."""

ROW = re.compile(r"^\| ([\d, -]+) \| [^|]+ \| `([\w.]+)` \|$", flags=re.MULTILINE)
CITED = re.compile(r"\bPaul & Fan, eqs?\. ((?:\d+(?:-\d+)?(?:,\s+)?)+)")


def numbers(text):
    """Numbers and ranges of numbers, one by one."""
    found = re.findall(r"(\d+)(?:-(\d+))?", text)
    return [number for first, last in found for number in range(int(first), int(last or first) + 1)]


def rows():
    page = (ROOT / "docs/equations.md").read_text(encoding="utf-8")
    return [(numbers(each[1]), each[2]) for each in ROW.finditer(page)]


def test_every_equation_is_listed_once():
    listed = [number for found, _ in rows() for number in found]
    assert sorted(listed) == list(range(1, NUMBERED + 1))
    names = [name for _, name in rows()]
    assert len(set(names)) == len(names)


def test_functions_name_the_equations_they_evaluate():
    for listed, name in rows():
        module, _, attribute = name.rpartition(".")
        text = " ".join(getattr(import_module(module), attribute).__doc__.split())
        assert numbers(CITED.search(text)[1]) == listed, name
