"""Claims, verdicts, differences and times on the pages of results."""

from xml.etree import ElementTree

import numpy as np
import pandas as pd
from small_tables import MATERIAL, lines_of

from cislunar.campaign.readings.photometry import RETURNED, photometry_table
from workflow.documents.blocks import BLOCKS
from workflow.documents.claims.judges import VERDICTS
from workflow.documents.results_page import COLORS, results_page, verdict_counts, verdicts_svg
from workflow.documents.run_times import run_times


def test_every_claim_and_every_verdict_is_on_the_page(tables):
    page = BLOCKS["results"](tables)
    for row in tables["paper_vs_ours"].itertuples():
        assert row.claim.replace("|", "\\|") in page
    assert "| all | 1 | 1 | 1 | 0 | 0 | 1 |" in verdict_counts(tables["paper_vs_ours"])
    order = [
        page.index(heading)
        for heading in ("## Section 3", "## Section 5.1", "## Further comparisons\n")
    ]
    assert order == sorted(order)
    assert "0.25 [0.20, 0.30]" in page
    assert "Halo L1 N (1), Lyap L3 (4)" in page


def test_diagram_has_a_square_for_each_claim(tables):
    claims = tables["paper_vs_ours"]
    drawn = ElementTree.fromstring(verdicts_svg(claims))
    squares = drawn.findall(".//{*}rect[@rx]")
    assert len(squares) == len(claims) + len(VERDICTS)  # and the legend
    for row in claims.itertuples():
        own = [s for s in squares if s[0].text == f"{row.claim}: {row.verdict}"]
        assert [s.get("fill") for s in own] == [COLORS[row.verdict]]
    texts = [each.text for each in drawn.findall(".//{*}text")]
    assert "not reproduced (1)" in texts and "Section 5.1" in texts
    assert verdicts_svg(claims) == verdicts_svg(claims)


def test_page_tells_version_revision_and_settings(tables):
    dataset = pd.DataFrame({"x": [1]}).to_xarray()
    dataset.attrs = {"source": "cislunar 9.9", "git_revision": "abc+", "seed": 7}
    page = results_page(tables, [dataset, dataset], {"seed": 7, "task2": {"seeds": 3}})
    assert "cislunar 9.9 made at revision abc+ with seed 7." in " ".join(page.split())
    assert "task2:\n  seeds: 3\n" in page


def test_only_significant_differences_are_marked(tables):
    lines = lines_of("readings-tracking", tables)
    sure = next(line for line in lines if "process-noise" in line)
    unsure = next(line for line in lines if "fresnel" in line)
    assert "2.00*" in sure
    assert "*" not in unsure
    assert lines[0].startswith("| default settings | 20 | 1.000 |")


def test_times_of_the_readme_are_those_of_the_benchmarks(tables):
    # Twenty minutes of searches on two cores.
    assert "| `figures/fig03_tpe_orbits.png` | 10 min |" in BLOCKS["files"](tables)


def test_benchmarks_are_added_up(tmp_path):
    for name, seconds in (("visibility/A", 10), ("visibility/B", 20), ("odd/one", 5)):
        path = tmp_path / f"{name}.tsv"
        path.parent.mkdir(exist_ok=True)
        path.write_text(f"s\tmax_rss\n{seconds}\t100\n", encoding="utf-8")
    table = run_times(tmp_path).set_index("jobs")
    assert table.loc["visibility", ["count", "total_s", "longest_s"]].tolist() == [2, 30, 20]
    assert table.loc["others", "count"] == 1
    assert table.loc["all", "total_s"] == 35


def test_a_diffuse_facet_returns_its_albedo():
    table = photometry_table(MATERIAL | {"specular_weight": 0.0}, 18.0, 1)
    share = table.loc[table["quantity"] == RETURNED, "value"]
    np.testing.assert_allclose(share, 0.5 * 0.5, rtol=1e-3)
