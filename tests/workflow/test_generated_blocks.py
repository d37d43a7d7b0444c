"""Tables in Markdown, and generated blocks in documents."""

import pytest
from campaign_folder import ROOT

from cislunar.errors import InputFileError
from workflow.documents import update as documents
from workflow.documents.blocks import BLOCKS
from workflow.documents.markdown import (
    fill_blocks,
    generated_block,
    generated_blocks,
    markdown_table,
)
from workflow.documents.settings_tables import SETTINGS_BLOCKS


def test_markdown_tables_keep_their_columns():
    text = markdown_table(["a", "b"], [("x|y", 1), ("two\nlines", 2)])
    assert text.splitlines() == [
        "| a | b |", "| --- | --- |", "| x\\|y | 1 |", "| two lines | 2 |",
    ]  # fmt: skip


def test_blocks_are_replaced_and_nothing_else():
    text = "a\n<!-- begin generated: one -->\nold\n<!-- end generated -->\nb\n"
    filled = fill_blocks(text, {"one": lambda: "new\n"}, "x.md")
    assert filled == "a\n<!-- begin generated: one -->\n\nnew\n\n<!-- end generated -->\nb\n"
    assert fill_blocks(filled, {"one": lambda: "new"}, "x.md") == filled


def test_a_block_may_stand_in_any_document_and_twice_in_one():
    block = generated_block("one", "[a](/docs/a.md) ![b](/docs/images/b.png) [c](https://c.org)")
    text = block + "between\n" + block
    for document, prefix in (
        ("README.md", "docs/"),
        ("docs/x.md", ""),
        ("docs/results/x.md", "../"),
    ):
        makers = {"one": lambda: "[a](/docs/a.md) ![b](/docs/images/b.png) [c](https://c.org)"}
        filled = fill_blocks(text, makers | {"unused": str}, document)
        assert filled.count(f"[a]({prefix}a.md) ![b]({prefix}images/b.png) [c](https://c.org)") == 2
        assert filled.count("between") == 1


@pytest.mark.parametrize(
    "text, message",
    [
        ("<!-- begin generated: other -->\n<!-- end generated -->\n", "no such generated block"),
        ("<!-- begin generated: one -->\nno end\n", "x.md: a generated block lacks its line"),
    ],
)
def test_ill_formed_blocks_are_refused(text, message):
    with pytest.raises(InputFileError, match=message):
        fill_blocks(text, {"one": str}, "x.md")


def test_blocks_of_the_repository_are_known():
    found = [
        name
        for path in documents.documents(ROOT)
        for name in generated_blocks(path.read_text(encoding="utf-8"))
    ]
    assert set(found) <= {*BLOCKS, *SETTINGS_BLOCKS, "rule-graph"}
    assert {"verdicts", "files", "readings-tracking", "labels", "photometry"} <= set(found)
