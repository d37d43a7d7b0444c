"""The documents use the terms of the field."""

import re

import pytest
from campaign_folder import ROOT

PRIVATE = (
    # what the terms of the field have replaced
    *(r"\blooks in vain\b", r"\blooks? under way\b", r"\blooks? at (?:its? |them|targets?)"),
    *(
        r"\ba look\b",
        r"\bof looks\b",
        r"\bfates?\b",
        r"\bdepartures\b",
        r"\bamong the (?:real )?bodies",
    ),
    *(r"\b(?:bodies|Sun) as they are\b", r"\brooms\b", r"\ba room\b", r"\bborrowing\b"),
    *(r"\btrack gate\b", r"\bdark sigma\b", r"\bunder way\b", r"\bgoals?\b", r"\btaken for\b"),
    *(r"\bours\b", r"\bas ever\b", r"\bby chance\b", r"\bbelieved\b", r"\bcounts as held\b"),
    *(r"rotating frame[^.|]{0,60}J2000", r"J2000[^.|]{0,60}rotating frame"),
    # sentences that readers could not understand
    *("bodies taken for known", "looks in vain fall by a third", "commits to one reading"),
    *("a frame that breathes", r"an oracle's 0?\.35 km is not reached", r"Whence\. What\."),
)
"""Expressions that no document has, as patterns."""


@pytest.mark.parametrize(
    "path",
    [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "config/README.md",
     *sorted((ROOT / "docs").rglob("*.md")), *sorted((ROOT / "workflow/report").glob("*.rst"))],
    ids=lambda path: path.relative_to(ROOT).as_posix(),
)  # fmt: skip
def test_documents_use_the_terms_of_the_field(path):
    text = re.sub(r"^```.*?^```$", "", path.read_text(encoding="utf-8"), flags=re.M | re.S)
    text = " ".join(re.sub(r"`[^`\n]*`|\]\([^)]*\)", "", text).split())
    found = [text[max(0, m.start() - 30) : m.end() + 30]
             for pattern in PRIVATE for m in re.finditer(pattern, text, re.I)]  # fmt: skip
    assert not found
