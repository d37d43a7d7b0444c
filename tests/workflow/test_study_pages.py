"""Pages of the studies of dynamics, tasking, pipelines and objectives."""

from itertools import product

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from campaign_folder import ROOT
from small_tables import lines_of

from cislunar.benchmark.score import SCORE_COLUMNS
from cislunar.errors import InputFileError
from cislunar.evaluation.intervals import count_interval, interval_of
from workflow.documents import benchmark_block, objectives_block
from workflow.documents import update as documents
from workflow.documents.blocks import BLOCKS
from workflow.documents.columns import COLUMNS
from workflow.documents.markdown import generated_block
from workflow.documents.real_block import SHOWN
from workflow.documents.studies import STUDIES


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
    told = f"paper's pipeline, CR3BP filter | 43 | 12 |{3 * ' 25 [12, 50] |'} 0.25"
    assert f"| 100 | {told} [0.125, 0.5] |" in page.read_text(encoding="utf-8")
    assert (root / "docs/images/real.png").read_bytes() == b"drawn"
    assert documents.main(["--check", "--root", str(root)]) == 0


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
    places = [(*cell, "mukf", day) for cell in cells for day in ("", "day10", "day20")]
    error = np.random.default_rng(1).uniform(1.0, 2.0, (len(places), 2, 4))
    error[3:6] = 0.5 * error[:3]
    keys = ("scenario", "architecture", "estimator", "variant")
    labels = {key: ("cell", [place[k] for place in places]) for k, key in enumerate(keys)}
    by_part = dict.fromkeys(
        ("rmse_geometric_all", "rmse_median"), (("cell", "seed", "part"), error)
    )
    by_cell = dict.fromkeys(
        ("never_observed", "final_attitude_error_median"), (("cell", "seed"), error[..., 0])
    ) | dict.fromkeys(
        ("position_custody_share", "custody_share"), (("cell", "seed"), 0.5 * error[..., 0])
    )  # fmt: skip
    (tmp_path / "task2").mkdir()
    xr.Dataset(by_part | by_cell, coords=labels).to_netcdf(tmp_path / "task2/summary.nc")
    with pytest.raises(InputFileError, match=r"objective_ranks\.csv: no such table; run the study"):
        objectives_block.study_table(tmp_path)
    (tmp_path / "tables").mkdir()
    rank = {"scenario": "A", "variant": None, "observers": 20, "objective": "J"}
    rank |= {"quantity": "rmse_geometric_all", "low": 0.5, "high": 0.75}
    ranks = [
        rank | {"estimator": estimator, "part": part, "unit": unit, "correlation": found}
        for part, unit in (("position", "km"), ("attitude", "degree"))
        for estimator, found in (("mukf", 0.625), ("batch", 0.6875))
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
    told = f"{count_interval(error[3:6, :, 0], np.repeat(range(3), 2)):.1f}"
    assert own.startswith(f"| 10 | maximum orbit information | {told} |")
    told = "0.50 [0.50, 0.50]"
    assert own.endswith(f"| {told} | {told} | \N{EN DASH} | \N{EN DASH} |")
    told = "0.62 to 0.69 [0.50, 0.75]"
    assert f"| J | 20 | {told} | {told} |" in BLOCKS["objectives-ranks"](tables)
    line = "| `information-10` | 10 | orbit information (nat) | 20 | 21 | 5.00 |"
    assert BLOCKS["objectives-designs"](tables).count(line) == 1


def test_the_scores_of_the_benchmark_are_those_of_the_last_epoch(tmp_path):
    with pytest.raises(InputFileError, match=r"score\.csv: no such score; make it as docs/benchm"):
        benchmark_block.study_table(tmp_path)
    for number, (size, method) in enumerate(benchmark_block._REFERENCES):
        last = dict.fromkeys(SCORE_COLUMNS, float(number)) | {"completeness": 0.125 * number}
        last["latency_median_h"] = np.nan
        folder = tmp_path / size / method
        folder.mkdir(parents=True)
        pd.DataFrame([dict.fromkeys(last, 9.0), last]).to_csv(folder / "score.csv", index=False)
    text = BLOCKS["benchmark"]({"benchmark": benchmark_block.study_table(tmp_path)})
    assert "| objects, findable | 0, 0 | 1, 1 | 2, 2 | 3, 3 |" in text
    assert "| completeness (%) | 0 | 12 | 25 | 38 |" in text
    dash = "\N{EN DASH}"
    assert f"| latency, median (h) | {dash} | {dash} | {dash} | {dash} |" in text


@pytest.mark.parametrize("columns", ["real", "real_bodies", "real_observers"])
def test_every_column_of_the_study_of_pipelines_has_values(columns):
    """A quantity, part or unit that the table does not have would leave a column empty."""
    table = pd.read_csv(ROOT / "docs/tables/real.csv", keep_default_na=False)
    known = set(table[["quantity", "part", "unit"]].itertuples(index=False, name=None))
    for name, column in COLUMNS[columns].items():
        assert (column.quantity, column.part, column.unit) in known, name
