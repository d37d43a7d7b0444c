"""Fixtures of small tables and of a repository with the results of its campaign."""

import pytest
from small_tables import read_back, small_tables

from workflow.documents import update as documents
from workflow.documents.results_page import results_page


@pytest.fixture(scope="session")
def tables():
    return small_tables()


@pytest.fixture
def campaign(tables, tmp_path):
    """A repository and the results of its campaign."""
    results = tmp_path / "results"
    (results / "tables").mkdir(parents=True)
    for name in documents.TABLES[:-1]:
        tables[name].to_csv(results / f"tables/{name}.csv", index=False)
    page = results_page(read_back(results, tables), [], {"seed": 1})
    (results / "tables/results.md").write_text(page, encoding="utf-8")
    (results / "benchmarks/search_run/tpe").mkdir(parents=True)
    line = "s\th:m:s\tmax_rss\n90.0\t0:01:30\t200.5\n"
    (results / "benchmarks/search_run/tpe/A_index_0.tsv").write_text(line, encoding="utf-8")
    root = tmp_path / "root"
    (root / "docs").mkdir(parents=True)
    text = "# Title\n\n<!-- begin generated: {} -->\nold\n<!-- end generated -->\n\nend\n"
    (root / "README.md").write_text(text.format("verdicts"), encoding="utf-8")
    (root / "docs/more.md").write_text(text.format("files"), encoding="utf-8")
    return root, results
