"""The report: every figure and table has a caption that refers to the paper and to the result."""

import re

import pytest
from campaign_folder import ROOT

RULES = sorted((ROOT / "workflow/rules").glob("*.smk"))
USERS = [ROOT / "Snakefile", *RULES]
CAPTIONS = sorted((ROOT / "workflow/report").glob("*.rst"))
SHOWN = re.compile(r'results\(\s*"((?:figures/[^"]+\.(?:png|html))|(?:tables/[^"]+\.csv))"')
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
        call = text[start:stop]
        caption = re.search(r'caption="\.\./report/(\w+\.rst)"', call)
        assert caption, f"no caption: {call}"
        assert (ROOT / "workflow/report" / caption[1]).is_file(), caption[1]
        assert re.search(r'category="(Figures|Tables)"', call), f"no category: {call}"


def test_outputs_are_found():
    """A change of the format would make the test above pass without any output."""
    text = (ROOT / "workflow/rules/figures.smk").read_text(encoding="utf-8")
    spans = outputs(text)
    found = [match[1] for match in SHOWN.finditer(text) if inside(match.start(), spans)]
    assert "figures/fig02_orbit_library.png" in found
    assert "figures/orbits_3d.html" in found


@pytest.mark.parametrize("path", CAPTIONS, ids=lambda path: path.stem)
def test_caption_describes_the_paper_and_the_result(path):
    text = " ".join(path.read_text(encoding="utf-8").split())
    assert re.search(r"\bpaper(?:'s)?\b", text), "the caption does not speak of the paper"
    assert len(re.findall(r"[.?](?: |$)", text)) >= 2
    used = any(f"report/{path.name}" in rules.read_text(encoding="utf-8") for rules in USERS)
    assert used, "no rule uses this caption"
