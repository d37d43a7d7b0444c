"""Numbers in the documents are those of the tables of the campaign."""

import shutil

import pandas as pd
import pytest
from campaign_folder import ROOT
from test_docs import BLOCK

from workflow.documents import update as documents
from workflow.documents.markdown import generated_block
from workflow.documents.results_page import LISTED, shown_quantities


def test_documents_are_brought_up_to_the_campaign(campaign):
    root, results = campaign
    changed = documents.refresh(root, results)
    assert {path.name for path in changed} == {"README.md", "more.md", "results.md", "verdicts.svg"}
    readme = (root / "README.md").read_text(encoding="utf-8")
    told = (
        "3 numbers and claims of the paper that could have failed, 1 are reproduced, 1 are partly"
    )
    assert told in " ".join(readme.split())
    assert readme.endswith("\n\nend\n") and "old" not in readme
    assert documents.refresh(root, results) == []
    assert documents.main(["--check", "--root", str(root)]) == 0
    # Long tables are kept as far as they are shown.
    kept = pd.read_csv(root / "docs/tables/tracking.csv")
    assert len(kept) == len(LISTED) == len(shown_quantities(kept))


def test_blocks_are_filled_from_tables_without_a_campaign(campaign, capsys):
    root, results = campaign
    documents.refresh(root, results)
    shutil.rmtree(results)
    page = root / "docs/results/more.md"
    page.parent.mkdir()
    page.write_text(generated_block("verdicts", ""), encoding="utf-8")
    assert documents.main(["--from-tables", "--root", str(root)]) == 0
    assert capsys.readouterr().out == f"{page}\n"
    assert documents.main(["--check", "--root", str(root)]) == 0


@pytest.mark.parametrize("name, old, new", [
    ("README.md", "1 are partly", "2 are partly"), ("docs/results.md", "302 | 302", "302 | 301"),
])  # fmt: skip
def test_a_number_changed_by_hand_is_found(campaign, capsys, name, old, new):
    root, results = campaign
    documents.refresh(root, results)
    path = root / name
    path.write_text(path.read_text(encoding="utf-8").replace(old, new), encoding="utf-8")
    assert documents.main(["--check", "--root", str(root)]) == 1
    assert name in capsys.readouterr().err


def test_an_unfinished_campaign_changes_nothing(campaign, capsys):
    root, results = campaign
    (results / "tables/tracking.csv").unlink()
    before = (root / "README.md").read_text(encoding="utf-8")
    assert documents.main(["--root", str(root), "--results", str(results)]) == 1
    assert "tracking.csv: no such table; run the whole campaign" in capsys.readouterr().err
    assert (root / "README.md").read_text(encoding="utf-8") == before
    assert not (root / "docs/tables").exists()


@pytest.mark.skipif(
    not (ROOT / "docs/tables").is_dir(), reason="no finished campaign has filled docs/tables yet"
)
def test_documents_of_the_repository_are_those_of_their_tables():
    assert not documents.outdated(ROOT)


@pytest.mark.skipif(
    not (ROOT / "results/tables/results.md").is_file(), reason="no finished campaign in results/"
)
def test_tables_of_the_documents_are_those_of_the_campaign():
    for name, text in documents.campaign_tables(ROOT / "results").items():
        if name == "run_times":  # times differ from run to run
            continue
        kept = (ROOT / f"docs/tables/{name}.csv").read_text(encoding="utf-8")
        assert kept == text, f"docs/tables/{name}.csv: run python -m workflow.documents.update"


@pytest.mark.workflow
def test_small_campaign_fills_the_documents(finished, tmp_path):
    folder = tmp_path / "campaign"
    shutil.copytree(finished, folder, symlinks=True)
    shutil.copytree(ROOT / "docs", folder / "docs")
    shutil.copy(ROOT / "README.md", folder)
    documents.refresh(folder, folder / "results/quick")
    text = (folder / "docs/workflow.md").read_text(encoding="utf-8")
    assert "    families --> visibility\n" in text
    assert not documents.outdated(folder)
    # No block of Markdown has lost its end.
    for path in documents.documents(folder):
        assert path.read_text(encoding="utf-8").count("```") == 2 * len(
            BLOCK.findall(path.read_text(encoding="utf-8"))
        )
