"""The report: every figure and table has a caption that refers to the paper and to the result."""

import re

import pytest
from campaign_folder import ROOT

RULES = sorted(set((ROOT / "workflow/rules").glob("*.smk")) - {ROOT / "workflow/rules/common.smk"})
USERS = [ROOT / "Snakefile", *RULES]
CAPTIONS = sorted((ROOT / "workflow/report").glob("*.rst"))
SHOWN = re.compile(r'results\(\s*"((?:figures/[^"]+\.(?:png|html))|(?:tables/[^"]+\.csv))"')
MADE = re.compile(r'\b(figure_files|table_file)\("([^"]+)"(?:, "(\w+)")?\)')
"""Calls of the functions of ``common.smk`` that put a figure or a table into the report."""
COLLECTED = re.compile(r"tables/(\{extent\})?claims_\w+\.csv")
"""Parts of a table that the report contains as a whole."""
LONG = {"tables/tracking.csv", "tables/paper/tracking.csv"}
"""Tables that are too long for the report."""


def calls(text, name):
    """Spans of the calls of a function, parentheses matched."""
    for match in re.finditer(rf"\b{name}\(", text):
        depth = 0
        for end in range(match.end() - 1, len(text)):
            depth += {"(": 1, ")": -1}.get(text[end], 0)
            if not depth:
                yield match.start(), end + 1
                break


def outputs(text):
    """Spans of the output sections of all rules."""
    pattern = r"^    output:\n(?:^(?:        .*|\s*)\n)+"
    return [match.span() for match in re.finditer(pattern, text, flags=re.MULTILINE)]


def captions(text):
    """Names of the captions of all figures and tables."""
    for kind, name, caption in MADE.findall(text):
        yield f"figure_{caption}" if kind == "figure_files" else caption or name
    for start, stop in calls(text, "report"):
        yield re.search(r'caption="\.\./report/(\w+)\.rst"', text[start:stop])[1]


def inside(position, spans):
    return any(start <= position < stop for start, stop in spans)


@pytest.mark.parametrize("path", RULES, ids=lambda path: path.stem)
def test_every_figure_and_table_is_in_the_report_with_a_caption(path):
    text = path.read_text(encoding="utf-8")
    spans, reported = outputs(text), list(calls(text, "report"))
    for match in SHOWN.finditer(text):
        named = match[1] in LONG or COLLECTED.fullmatch(match[1])
        if inside(match.start(), spans) and not named:
            assert inside(match.start(), reported), f"{match[1]} is not in the report"
    for start, stop in reported:
        assert re.search(r'category="(Figures|Tables)"', text[start:stop])
    for name in captions(text):
        assert (ROOT / f"workflow/report/{name}.rst").is_file(), name


def test_outputs_are_found():
    """A change of the format would make the test above pass without any output."""
    text = (ROOT / "workflow/rules/figures.smk").read_text(encoding="utf-8")
    spans = outputs(text)
    found = [match[1] for match in SHOWN.finditer(text) if inside(match.start(), spans)]
    assert "figure_orbit_library" in captions(text)
    assert "figures/orbits_3d.html" in found


@pytest.mark.parametrize("path", CAPTIONS, ids=lambda path: path.stem)
def test_caption_describes_the_paper_and_the_result(path):
    text = " ".join(path.read_text(encoding="utf-8").split())
    assert re.search(r"\bpaper(?:'s)?\b", text), "the caption does not speak of the paper"
    assert len(re.findall(r"[.?](?: |$)", text)) >= 2
    texts = [user.read_text(encoding="utf-8") for user in USERS]
    used = any(f"report/{path.name}" in text or path.stem in captions(text) for text in texts)
    assert used, "no rule uses this caption"
