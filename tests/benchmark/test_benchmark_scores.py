"""Scores of submissions to a small benchmark against closed forms."""

import itertools

import numpy as np
import pandas as pd
import pytest
from small_benchmark import arcs, call

from cislunar.benchmark import (
    SCORE_COLUMNS,
    count_passes,
    read_public_data,
    read_scenario,
    score_submission,
)
from cislunar.benchmark.score import CUTOFF_KM
from cislunar.dynamics import recenter
from cislunar.exchange import ocm_text, oem_text, read_oem, segments_csv


def test_references_need_no_truth_and_find_objects(made, references):
    scores = {name: score_submission(references / name, made).iloc[-1]
              for name in ("survey-catalog", "nearest-neighbor")}  # fmt: skip
    for score in scores.values():
        assert score["findable"] >= 2 and score["assigned"] >= 1
        assert score["purity"] >= 0.9 and 0.0 < score["latency_median_h"] <= 6.0
    linked = scores["survey-catalog"]
    assert linked["completeness"] >= 0.5 and linked["purity"] == 1.0 and linked["false"] == 0
    assert linked["anees_ballistic"] < 4.0  # the references model no maneuvers


def test_a_score_of_the_command_has_a_table_and_a_figure(made, references, tmp_path):
    done = call("score", references / "survey-catalog", "--truth", made, "--output", tmp_path)
    assert done.exit_code == 0, done.stderr
    assert "completeness" in done.stdout and "2027-03-01T06:00:00Z" in done.stdout
    table = pd.read_csv(tmp_path / "score.csv")
    assert tuple(table.columns) == SCORE_COLUMNS and len(table) == 2
    assert (tmp_path / "score.png").read_bytes()[:4] == b"\x89PNG"


def test_scores_are_those_of_a_closed_form(made, truth, tmp_path):
    """Six of eight objects, 5 km and 2 m/s away, a second entry of one, and one far away."""
    scenario = read_scenario(made)
    shift = np.array([3.0, 4.0, 0.0, 0.0, 0.0, 2e-3])
    matrix = np.diag([4.0, 1.0, 1.0, 1e-6, 1e-6, 1e-6])
    own = arcs(scenario, truth, range(6), shift, matrix)
    again = arcs(scenario, truth, [0], 2.0 * shift)[0]._replace(name="again", object_id="again")
    far = arcs(scenario, truth, [7], np.array([99.0, 99.0, 0, 0, 0, 0]))[0]
    text = oem_text([*own, again, far], created=scenario.epoch)
    (tmp_path / "mine.oem").write_text(text)
    last = score_submission(tmp_path / "mine.oem", made).iloc[-1]
    assert (last["objects"], last["catalog"], last["assigned"]) == (8, 8, 6)
    assert (last["missed"], last["false"]) == (2, 2)
    half = 0.5 * CUTOFF_KM**2
    parts = [last[f"gospa_{part}_km2"] for part in ("localization", "missed", "false")]
    assert parts == pytest.approx([6 * 25.0, 2 * half, 2 * half], rel=1e-9)
    assert last["gospa_km"] == pytest.approx(np.sqrt(150.0 + 4 * half))
    assert last["position_median_km"] == pytest.approx(5.0)
    assert last["velocity_95_m_s"] == pytest.approx(2.0, rel=1e-6)
    # 9/4 + 16 + 4, over six components, the same for all
    for name in ("anees", "anees_ballistic"):
        assert last[name] == pytest.approx((9.0 / 4.0 + 16.0 + 4.0) / 6.0, rel=1e-6)
    assert np.isnan(last["purity"]) and np.isnan(last["latency_median_h"])
    origin, public = truth["origin"].values, read_public_data(made, scenario)
    passes = brute_passes(origin, public.angles.observer, public.tdb, 8)
    findable = passes >= 3
    assert last["findable"] == findable.sum()
    expected = findable[:6].sum() / findable.sum()
    assert last["completeness"] == last["custody"] == pytest.approx(expected)
    outside = findable & (truth["outside"].values == 1)
    if outside.any():
        assert last["completeness_outside"] == pytest.approx(outside[:6].sum() / outside.sum())


def test_gospa_of_a_score_is_that_of_stone_soup(made, truth, references):
    metric = pytest.importorskip("stonesoup.metricgenerator.ospametric")
    from datetime import datetime

    from stonesoup.types.state import State

    scenario, now = read_scenario(made), datetime(2030, 1, 1)
    found = [each.state[-1, :3] for each in read_oem(references / "survey-catalog" / "states.oem")]
    true = truth["state"].values[:, -1, :3]
    peer = metric.GOSPAMetric(p=2, c=CUTOFF_KM)
    states = [[State(each, timestamp=now) for each in group] for group in (found, true)]
    value = peer.compute_gospa_metric(*states)[0].value
    last = score_submission(references / "survey-catalog", made).iloc[-1]
    assert len(found) == last["catalog"] and scenario.scoring_tdb.size == 2
    assert last["gospa_km"] == pytest.approx(value["distance"], rel=1e-6)


def brute_passes(origin, observer, time, n):
    count = np.zeros(n, dtype=int)
    for j, o in itertools.product(range(n), np.unique(observer)):
        own = sorted(t for t, a, b in zip(time, origin, observer, strict=True) if (a, b) == (j, o))
        count[j] += sum(k == 0 or t - own[k - 1] > 1800.002 for k, t in enumerate(own))
    return count


def test_passes_are_those_of_a_plain_count():
    rng = np.random.default_rng(1)
    origin, observer = rng.integers(-1, 4, 200), rng.integers(0, 3, 200)
    time = rng.uniform(0.0, 40_000.0, 200)
    expected = brute_passes(origin, observer, time, 5)
    np.testing.assert_array_equal(count_passes(origin, observer, time, 5), expected)
    assert expected[4] == 0 and expected[:4].min() > 3


def test_purity_and_latency_are_those_of_the_assignments(made, truth, tmp_path):
    scenario = read_scenario(made)
    origin = truth["origin"].values
    names, j = truth["observation"].values, int(np.bincount(origin[origin >= 0]).argmax())
    own = np.flatnonzero(origin == j)
    rows = [*own, *np.flatnonzero(origin < 0)[:2]]
    (tmp_path / "mine.csv").write_text(segments_csv(arcs(scenario, truth, [j])))
    table = pd.DataFrame({"object": f"mine {j}", "obsID": names[rows]})
    table.to_csv(tmp_path / "assignments.csv", index=False)
    (tmp_path / "objects.csv").write_text(f"object,cataloged_utc\nmine {j},2027-03-01T02:30:00Z\n")
    last = score_submission(tmp_path, made).iloc[-1]
    assert last["purity"] == pytest.approx(own.size / (own.size + 2))
    assert last["wrong_assignments"] == 2 and last["false_objects"] == 0
    assert last["fragments"] == 1.0
    first = read_public_data(made, scenario).tdb[own[0]]
    hours = 2.5 - (first - scenario.epoch_tdb) / 3600.0
    assert hours > 0.0
    assert last["latency_median_h"] == pytest.approx(hours, abs=1e-6)


def test_formats_and_centers_of_states_do_not_change_the_score(made, truth, tmp_path):
    scenario = read_scenario(made)
    shift = np.array([3.0, 4.0, 0.0, 0.0, 0.0, 2e-3])
    given = arcs(scenario, truth, [0, 1, 2], shift, np.diag([4.0, 1, 1, 1e-6, 1e-6, 1e-6]))
    times, bodies = scenario.scoring_tdb, scenario.forces().table
    moved = [
        each._replace(center=center, state=recenter(each.state, bodies, times, old="earth", new=to))
        for each, center, to in zip(
            given, ("MOON", "EARTH BARYCENTER", "EARTH"), ("moon", "barycenter", "earth"),
            strict=True,
        )
    ]  # fmt: skip
    created = {"created": scenario.epoch}
    (tmp_path / "ocm").mkdir()
    for each in moved:
        (tmp_path / "ocm" / f"{each.name}.ocm").write_text(ocm_text(each, **created))
    (tmp_path / "mine.csv").write_text(segments_csv(moved, time_system="TDB"))
    (tmp_path / "mine.oem").write_text(oem_text(given, time_system="TT", **created))
    scores = [score_submission(tmp_path / name, made) for name in ("ocm", "mine.csv", "mine.oem")]
    assert scores[0]["assigned"].tolist() == [3, 3]
    for score in scores[1:]:
        pd.testing.assert_frame_equal(score, scores[0], rtol=1e-5)
