"""Numbers in the documents come from tables; their language is that of the field."""

import re
import shutil
from itertools import product
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from campaign_folder import ROOT
from test_docs import BLOCK

from cislunar.campaign.readings.photometry import RETURNED, photometry_table
from cislunar.errors import InputFileError
from cislunar.evaluation.intervals import interval_of
from workflow.documents import objectives_block
from workflow.documents import update as documents
from workflow.documents.blocks import BLOCKS
from workflow.documents.claims.judges import (
    BEYOND,
    NOT_REPRODUCED,
    PARTLY,
    REPRODUCED,
    VERDICTS,
    Claim,
)
from workflow.documents.columns import COLUMNS
from workflow.documents.markdown import (
    fill_blocks,
    generated_block,
    generated_blocks,
    markdown_table,
)
from workflow.documents.real_block import SHOWN
from workflow.documents.results_page import (
    COLORS,
    LISTED,
    results_page,
    shown_quantities,
    verdict_counts,
    verdicts_svg,
)
from workflow.documents.run_times import run_times
from workflow.documents.settings_tables import SETTINGS_BLOCKS
from workflow.documents.studies import STUDIES

MATERIAL = {
    "diffuse_weight": 0.5,
    "specular_weight": 0.5,
    "diffuse_albedo": 0.5,
    "rms_slope": 0.3,
    "normal_reflectance": 0.5,
}


def cell_rows(values, **more):
    """Every quantity of the lists of cells, and one that they do not show."""
    cell = {"scenario": "A", "architecture": "tpe", "estimator": "mukf", "targets": 20}
    rows = [
        cell | {"variant": None, "interval_minutes": 60, "quantity": quantity, "part": part or None}
        | {"unit": unit} | values | more
        for quantity, part, unit in [*(c.measure for c in LISTED.values()), ("failed", "", "1")]
    ]  # fmt: skip
    return pd.DataFrame(rows)


def small_tables():
    """Tables as the campaign writes them, with few rows."""
    claims = [
        ("section 3", "orbits", "302", "302", "equal", REPRODUCED, "302", "evidence", "-"),
        (
            "section 5.1",
            "J | A",
            "1.5e-4",
            "7e-5",
            "within a factor 10",
            PARTLY,
            "7e-5",
            "evidence",
            "10 evaluations",
        ),
        ("section 5.1", "satellites", "20", "44", "equal", NOT_REPRODUCED, "44", "evidence", "-"),
        ("-", "optimum", "-", "1e-3", "bound", BEYOND, "1e-3", "beyond", "-"),
    ]
    reading = {"usual": 1.0, "changed": 2.0, "difference": 1.0, "low": 0.5, "high": 1.5, "seeds": 9}
    return {
        "paper_vs_ours": pd.DataFrame(
            claims, columns=Claim._fields
        ),
        "architecture": pd.DataFrame(
            {
                "scenario": "A", "optimizer": "tpe", "family": ["Halo_L1_N", "Lyap_L3"],
                "satellites": [1, 4], "total_satellites": 5, "J": 1.5e-4,
                "union_coverage": 0.5, "never_seen": 2,
            }
        ),
        "label_comparison": pd.DataFrame({"labels": "index", "J": [1e-5, 2e-5, 4e-5]}),
        "readings_architecture": pd.DataFrame(
            {"reading": ["as configured"], "J_published": [1.5e-4], "J_random": [1e-5],
             "J_coordinate_search": [1e-3]}
        ),
        "readings_tracking": pd.concat(
            [
                cell_rows(reading, variant="process-noise"),
                cell_rows(reading | {"low": -0.5}, variant="fresnel"),
            ]
        ),
        "tracking": cell_rows(
            {"mean": 0.25, "low": 0.2, "high": 0.3, "largest": 0.75, "average": "arithmetic"}
        ),
        "model_error": pd.DataFrame({"variant": ["torque"]}),
        "photometry": photometry_table(MATERIAL, 18.0, 1),
        "run_times": pd.DataFrame(
            {"jobs": ["searches by TPE", "all"], "count": 4, "total_s": [1200.0, 2400.0],
             "median_s": 300.0, "longest_s": 400.0, "largest_mb": 350.0}
        ),
    }  # fmt: skip


@pytest.fixture(scope="module")
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


def read_back(results, tables):
    """Tables as they come back from CSV."""
    return {
        name: pd.read_csv(results / f"tables/{name}.csv", dtype=str if "paper" in name else None)
        for name in tables
        if name != "run_times"
    }


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


@pytest.fixture
def studies(campaign):
    """Tables of the sweeps of each study, in the campaign's folder."""
    root, results = campaign
    for study, sweeps in STUDIES.items():
        rows = [
            {"estimator": "mukf", "targets": count, "mean": 0.875, "low": 0.5, "high": 1.0}
            | {"largest": 0.9375}
            | {"quantity": quantity, "part": part or None, "unit": unit}
            for count, (quantity, part, unit) in product(
                (50, 100), {column.measure: None for column in COLUMNS[study].values()}
            )
        ]
        rows.append(rows[0] | {"quantity": "failed"})
        for name in sweeps:
            value = {"apogee": "real-cr3bp"}.get(name, f"{name}-real")
            table = pd.DataFrame(rows).assign(value=value, sweep=name)
            table.to_csv(results / f"tables/sweep_{name}.csv")
    return root, results


def test_the_study_of_dynamics_fills_its_page_if_it_was_run(studies):
    root, results = studies
    page = root / "docs/results/dynamics.md"
    page.parent.mkdir()
    page.write_text(generated_block("dynamics", ""), encoding="utf-8")
    documents.refresh(root, results)
    assert "has not been run" in page.read_text(encoding="utf-8")
    chosen = ["--root", str(root), "--results", str(results), "--study", "dynamics"]
    assert documents.main(chosen) == 0
    text = page.read_text(encoding="utf-8")
    told = "| apogee | ephemeris | CR3BP | paper's filter (MUKF) | 100 | 0.875 | 0.875 |"
    assert f"{told} 0.875 | 0.938 |" in text
    single = "| ephemeris | ephemeris, one Gaussian for each orbit |"
    assert text.count(single) == text.count("| perigee |") == 2
    assert documents.main(["--check", "--root", str(root)]) == 0


def test_the_study_of_tasking_fills_its_page(studies, capsys):
    root, results = studies
    documents.refresh(root, results)
    page = root / "docs/tasking.md"
    page.write_text(generated_block("tasking-fusion", ""), encoding="utf-8")
    chosen = ["--root", str(root), "--results", str(results), "--study", "tasking"]
    assert documents.main(chosen) == 1
    assert "sweep_tasking.png: no such figure" in capsys.readouterr().err
    (results / "figures").mkdir()
    (results / "figures/sweep_tasking.png").write_bytes(b"drawn")
    assert documents.main(chosen) == 0
    assert (root / "docs/images/tasking.png").read_bytes() == b"drawn"
    told = "0.9 [0.5, 1.0] | 0.88 [0.50, 1.00] | 0.875 [0.5, 1] | \N{EN DASH} | 88% [50%, 100%]"
    assert f"| 100 | `fusion-real` | {told} |" in page.read_text(encoding="utf-8")


def test_the_study_of_the_real_world_has_a_table_and_a_figure(campaign):
    root, results = campaign
    documents.refresh(root, results)
    page = root / "docs/real.md"
    page.write_text(generated_block("real-number", ""), encoding="utf-8")
    cell = {"architecture": "published", "estimator": "mukf", "variant": "paper"}
    cell |= {"observers": 43, "targets": 100, "mean": 0.25, "low": 0.125, "high": 0.5, "seeds": 12}
    cell |= {"largest": 0.5, "days": 2, "by_day": "0.125 0.375"}
    shown = [{"quantity": q, "part": p or None, "unit": u} for q, p, u, *_ in SHOWN.values()]
    pd.DataFrame([cell | each for each in shown]).to_csv(results / "tables/pooled.csv")
    (results / "figures").mkdir()
    (results / "figures/pooled.png").write_bytes(b"drawn")
    (root / "docs/images").mkdir(exist_ok=True)
    chosen = ["--root", str(root), "--results", str(results), "--study", "real"]
    assert documents.main(chosen) == 0
    told = f"paper's pipeline as printed (CR3BP filter) | 43 | 12 |{3 * ' 25 [12, 50] |'} 0.25"
    assert f"| 100 | {told} [0.125, 0.5] |" in page.read_text(encoding="utf-8")
    assert (root / "docs/images/real.png").read_bytes() == b"drawn"
    assert documents.main(["--check", "--root", str(root)]) == 0


def lines_of(block, tables):
    """The rows of the table of a block."""
    found = [line for line in BLOCKS[block](tables).splitlines() if line.startswith("| ")]
    return found[2:]


def test_the_requirements_on_the_recommended_pipeline_can_fail():
    def cell(way, observers, targets, spread=0.05, **means):
        head = dict(zip(("architecture", "estimator", "variant"), way, strict=True))
        for quantity, part, unit in dict.fromkeys(column.measure for column in SHOWN.values()):
            mean = means.get(quantity, 1.0)
            days = mean * (1.0 + spread * np.linspace(-1.0, 1.0, 10))
            found = interval_of(quantity, days, targets)
            values = {"mean": found.mean, "low": found.low, "high": found.high, "days": 10}
            values |= {"largest": days.max(), "seeds": 10, "by_day": " ".join(map(str, days))}
            measure = {"quantity": quantity, "part": part or None, "unit": unit}
            yield head | {"observers": observers, "targets": targets} | measure | values

    ours, paper = ("information-20", "batch", None), ("published", "mukf", "paper-ephemeris")
    error = "final_error_geometric_all"
    rows = [*cell(paper, 43, 100, **{error: 2.0, "custody_share": 0.5})]
    rows += cell(ours, 20, 100, **{error: 1.0, "custody_share": 0.9})
    told = lines_of("real-verdict", {"real": pd.DataFrame(rows)})
    assert [line.split(" | ")[-1].split(":")[0] for line in told] == [
        "better", *["not worse within the margin"] * 2, *["better"] * 2, *["met |"] * 4,
    ]  # fmt: skip
    assert "at most 3 percentage points fewer with 20 than with 43 satellites" in told[0]
    assert "at most 10 % larger with 20 than with 43 satellites" in told[3]
    assert told[3].endswith("better: ratio 0.5 [0.5, 0.5] |") and "(nominal 0.9973)" in told[6]
    assert told[0].endswith("better: +40.0 [+39.0, +41.0] percentage points |")
    assert "| 1 to 1; worst realization 1.05 |" in told[7]
    # a mean within the limits whose interval is not, and means beyond them
    rows += cell(ours, 43, 50, missed=3.0, coverage=0.97, anees_mean=4.0)
    rows += cell(ours, 33, 50, coverage=0.8)
    rows += cell(paper, 43, 100, **{error: 1.02, "custody_share": 0.95})
    told = lines_of("real-verdict", {"real": pd.DataFrame(rows)})
    assert told[0].split(" | ")[-1].startswith("worse: -5.0 [")
    assert told[3].split(" | ")[-1].startswith("better: ratio 0.98")
    assert told[5].endswith(
        "| 1 to 3 | \N{EN DASH} | not met: targets 3 (43 satellites, 50 targets) |"
    )
    assert told[6].count("0.8 (33") == 3 and "not met: attitude 0.8 (33" in told[6]
    assert told[6].count("0.97 (43") == 3 and "; not decided: attitude 0.97 (43" in told[6]
    assert told[7].count("4 (43") == 3 and "worst realization 4.2" in told[7]


def test_blocks_stay_as_they_are_while_their_table_is_of_an_earlier_version(campaign, capsys):
    root, results = campaign
    documents.refresh(root, results)
    capsys.readouterr()
    page = root / "docs/real.md"
    page.write_text(generated_block("real-number", "numbers of then"), encoding="utf-8")
    old = {"architecture": ["published"], "quantity": "anees_mean", "mean": 3.0}
    pd.DataFrame(old).to_csv(root / "docs/tables/real.csv", index=False)
    assert documents.main(["--check", "--root", str(root)]) == 0
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("docs/tables/real.csv is of an earlier version: the blocks that rest")
    assert documents.main(["--from-tables", "--root", str(root)]) == 0
    assert "numbers of then" in page.read_text(encoding="utf-8")


def test_the_study_of_objectives_has_ratios_by_day_and_realization(tmp_path):
    cells = [("A", "exact"), ("A", "information-10"), ("A", "published"), ("B", "published"),
             ("C", "published")]  # fmt: skip
    days = {"A": ("", "day10", "day20"), "B": ("", "day10-b", "day20-b"),
            "C": ("", "day10-c", "day20-c")}  # fmt: skip
    places = [(*cell, "mukf", day) for cell in cells for day in days[cell[0]]]
    error = np.random.default_rng(1).uniform(1.0, 2.0, (len(places), 2, 4))
    error[3:6] = 0.5 * error[:3]
    keys = ("scenario", "architecture", "estimator", "variant")
    labels = {key: ("cell", [place[k] for place in places]) for k, key in enumerate(keys)}
    by_part = dict.fromkeys(
        ("rmse_geometric_all", "rmse_median"), (("cell", "seed", "part"), error)
    )
    by_cell = dict.fromkeys(
        ("never_observed", "final_attitude_error_median"), (("cell", "seed"), error[..., 0])
    )
    (tmp_path / "task2").mkdir()
    xr.Dataset(by_part | by_cell, coords=labels).to_netcdf(tmp_path / "task2/summary.nc")
    with pytest.raises(InputFileError, match=r"objective_ranks\.csv: no such table; run the study"):
        objectives_block.study_table(tmp_path)
    (tmp_path / "tables").mkdir()
    rank = {"scenario": "A", "estimator": "mukf", "observers": 20, "objective": "J"}
    rank |= {"quantity": "rmse_geometric_all", "low": 0.5, "high": 0.75}
    ranks = [
        rank | {"variant": day, "part": part, "unit": unit, "correlation": found}
        for part, unit in (("position", "km"), ("attitude", "degree"))
        for day, found in ((None, 0.625), ("day10", 0.6875))
    ]
    pd.DataFrame(ranks).to_csv(tmp_path / "tables/objective_ranks.csv")
    design = {"architecture": "information-10", "objective": "information", "satellites": 10}
    design |= {"front": None, "value": 20.0, "bound": 21.0}
    front = design | {"front": "information"}
    pd.DataFrame([design, front]).to_csv(tmp_path / "tables/objectives_A.csv")
    other = {"targets_by": "class", "targets_of": "DRO", "satellites": 20}
    other |= {"chosen_on": "others", "information_nat": 20.5}
    pd.DataFrame([other]).to_csv(tmp_path / "tables/objectives_generalization_A.csv")
    tables = {"objectives": objectives_block.study_table(tmp_path)}
    told = "| class DRO | 20 | \N{EN DASH} | \N{EN DASH} | 20.50 |"
    assert told in BLOCKS["objectives-generalization"](tables)
    own = lines_of("objectives-tracking", tables)[1]
    assert own.startswith("| 10 | maximum orbit information |")
    told = "0.50 [0.50, 0.50]"
    assert own.endswith(f"| {told} | {told} | \N{EN DASH} | \N{EN DASH} |")
    told = "0.62 to 0.69 [0.50, 0.75]"
    assert f"| J | 20 | {told} | {told} |" in BLOCKS["objectives-ranks"](tables)
    line = "| `information-10` | 10 | orbit information (nat) | 20 | 21 | 5.00 |"
    assert BLOCKS["objectives-designs"](tables).count(line) == 1


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


def test_blocks_of_the_repository_are_known():
    found = [
        name
        for path in documents.documents(ROOT)
        for name in generated_blocks(path.read_text(encoding="utf-8"))
    ]
    assert set(found) <= {*BLOCKS, *SETTINGS_BLOCKS, "rule-graph"}
    assert {"verdicts", "files", "readings-tracking", "labels", "photometry"} <= set(found)


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


@pytest.mark.skipif(
    not (ROOT / "docs/tables").is_dir(), reason="no finished campaign has filled docs/tables yet"
)
def test_documents_of_the_repository_are_those_of_their_tables():
    assert not documents.outdated(ROOT)


@pytest.mark.parametrize("columns", ["real", "real_bodies", "real_observers"])
def test_every_column_of_the_study_of_pipelines_has_values(columns):
    """A quantity, part or unit that the table does not have would leave a column empty."""
    table = pd.read_csv(ROOT / "docs/tables/real.csv", keep_default_na=False)
    known = set(table[["quantity", "part", "unit"]].itertuples(index=False, name=None))
    for name, column in COLUMNS[columns].items():
        assert (column.quantity, column.part, column.unit) in known, name


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
