"""Verdicts on the paper's claims about tracking, from made-up realizations."""

import json

import numpy as np
import pytest
import xarray as xr
from made_up_summaries import COUNTS, GOOD, SEEDS, make_summary, spread

from cislunar.campaign.tracking.comparisons import paired
from cislunar.campaign.tracking.realizations import realizations, select, usual_interval, values_of
from cislunar.campaign.tracking.summary import ERRORS, PER_CELL, PER_PART
from cislunar.evaluation.intervals import Interval, t_interval
from workflow.documents.claims.facts import STATISTICS, unsatisfactory
from workflow.documents.claims.judges import (
    BEYOND,
    CALIBRATED,
    INPUT,
    NOT_REPRODUCED,
    PARTLY,
    REPRODUCED,
    table,
    verdict,
)
from workflow.documents.claims.tracking import (
    estimator_claims,
    set_claims,
    tasking_claims,
    tracking_claims,
)


def _verdict(claims, *words):
    found = [c for c in claims if all(word in c.claim for word in words)]
    assert len(found) == 1, [c.claim for c in found]
    return found[0].verdict


def test_every_claim_of_the_section_has_a_row_with_a_rule():
    claims = tracking_claims(make_summary())
    assert len(claims) >= 30
    assert len({c.claim for c in claims}) == len(claims)
    assert all(c.rule and c.result and c.where and c.paper and c.verdict for c in claims)
    for scenario in "ABC":
        assert _verdict(claims, "translation stays", f"scenario {scenario}") == REPRODUCED
        assert _verdict(claims, "by as many observers", f"scenario {scenario}") == REPRODUCED


def test_nothing_tracked_nothing_claimed():
    summary = make_summary()
    claims = tracking_claims(summary.isel(cell=summary["scenario"].values == "C"))
    assert not any("scenario A" in c.claim or "scenario B" in c.claim for c in claims)


@pytest.mark.parametrize(
    ("counts", "paper", "verdict"),
    [([0, 1, 3], 2, CALIBRATED), ([0, 1, 1], 2, PARTLY), ([5, 6, 7], 2, NOT_REPRODUCED)],
)
def test_counts_are_judged_by_where_one_more_run_lies(counts, paper, verdict):
    summary = make_summary()
    smallest = (summary["scenario"] == "A") & (summary["targets"] == 20)
    values = summary["inconsistent_rotation_only"].where(~smallest, np.resize(counts, SEEDS))
    summary["inconsistent_rotation_only"] = values
    claims = tracking_claims(summary)
    row = next(c for c in claims if "and consistent translation" in c.claim)
    assert (row.paper, row.verdict) == (str(paper), verdict)


def test_translation_that_is_not_satisfactory_is_named():
    def change(scenario, _, targets, minutes):
        return {"translation_outside_share": 0.2} if (scenario, targets) == ("A", 100) else {}

    summary = make_summary(change)
    failing = unsatisfactory(select(realizations(summary), scenario="A", interval_minutes=60))
    assert len(failing) == 1 and failing[0].startswith("100 targets, 60 min: 0.2")
    claims = tracking_claims(summary)
    assert _verdict(claims, "translation stays", "scenario A") == PARTLY
    assert _verdict(claims, "translation stays", "scenario B") == REPRODUCED
    row = next(c for c in claims if "translation stays" in c.claim)
    assert "satisfactory in 2 of 3 cells" in row.result
    assert table()["phrases"]["satisfactory"] in row.rule


def test_the_whole_interval_of_the_share_must_be_low():
    summary = make_summary(lambda s, a, n, t: {"translation_outside_share": 0.0999})
    assert _verdict(tracking_claims(summary), "translation stays", "scenario C") == NOT_REPRODUCED


@pytest.mark.parametrize(
    ("exponent", "verdict"), [(0.5, REPRODUCED), (0.0, None), (-0.5, NOT_REPRODUCED)]
)
def test_trends_of_rotation_need_an_interval_beyond_zero(exponent, verdict):
    def change(scenario, _, targets, minutes):
        rmse = 0.02 * (targets / 20.0) ** exponent
        return {"rmse_median": (rmse, 1e-5, 1e-5, 1e-5), "inconsistent_rotation": 100.0 * rmse}

    claims = tracking_claims(make_summary(change))
    for words in (("attitude RMSE rises",), ("more often", "(count)")):
        found = _verdict(claims, *words, "scenario B")
        assert found == verdict if verdict else found != REPRODUCED
    # constant coverage does not fall
    assert _verdict(claims, "coverage falls", "scenario B") != REPRODUCED


def test_a_rise_that_turns_is_no_progressive_rise():
    rmse = {33: 1.0, 50: 3.0, 100: 2.5}

    def change(scenario, _, targets, minutes):
        return {"rmse_median": (rmse.get(targets, 1.0), 1e-5, 1e-5, 1e-5)}

    claims = tracking_claims(make_summary(change))
    assert _verdict(claims, "attitude RMSE rises", "scenario B") == PARTLY


def test_noise_over_seeds_forbids_a_trend():
    summary = make_summary(
        lambda s, a, n, t: {"inconsistent_rotation": float(n) / 50.0} if s == "A" else {}
    )
    claims = tracking_claims(summary)
    assert _verdict(claims, "more often", "(count)", "scenario A") == REPRODUCED
    noisy = summary.copy(deep=True)
    rng = np.random.default_rng(0)
    noisy["inconsistent_rotation"].values += rng.normal(
        0.0, 20.0, noisy["inconsistent_rotation"].shape
    )
    claims = tracking_claims(noisy)
    assert _verdict(claims, "more often", "(count)", "scenario A") != REPRODUCED


def test_tasking_intervals_modest_noticeable_and_flat():
    def change(scenario, _, targets, minutes):
        growth = 1.0 + 0.1 * np.log2(minutes / 30.0)
        rotation = growth if scenario == "B" else 1.0
        return {
            "rmse_median": (0.02 * rotation, 1e-5, 1e-5 * growth, 1e-5),
            "coverage": (0.95 / rotation, 0.95, 0.99, 0.99),
            "anees_median": (rotation, 1.0, 1.0, 1.0),
            "inconsistent_rotation": 3.0 * rotation,
        }

    claims = tracking_claims(make_summary(change))
    assert _verdict(claims, "translation against", "scenario A") == REPRODUCED
    assert _verdict(claims, "translation against", "scenario B") == REPRODUCED
    assert _verdict(claims, "rotation against", "20 targets") == REPRODUCED
    assert _verdict(claims, "rotation from the shortest", "scenario B") == REPRODUCED
    assert _verdict(claims, "inconsistent attitude from", "scenario B") == REPRODUCED
    assert _verdict(claims, "rotation against", "50 targets") == NOT_REPRODUCED
    assert _verdict(claims, "inconsistent rotation over") == CALIBRATED
    flat = tracking_claims(make_summary())
    assert _verdict(flat, "translation against", "scenario A") == PARTLY
    assert _verdict(flat, "rotation from the shortest", "scenario B") == NOT_REPRODUCED
    assert _verdict(flat, "rotation against", "20 targets") == REPRODUCED
    one = make_summary().isel(seed=[0])
    assert _verdict(tracking_claims(one), "rotation against", "20 targets") == NOT_REPRODUCED


@pytest.mark.parametrize(
    ("noise", "rise", "verdict"),
    [(0.01, 0.0, REPRODUCED), (0.01, 0.5, NOT_REPRODUCED), (1.5, 0.0, NOT_REPRODUCED)],
)
def test_no_trend_needs_an_interval_near_zero(noise, rise, verdict):
    """Neither a steep trend nor one that few, wild realizations cannot tell is none."""
    rng = np.random.default_rng(3)

    def change(scenario, _, targets, minutes):
        factor = (minutes / 30.0) ** rise
        return {
            "rmse_median": (0.02 * factor, 1e-5, 1e-5, 1e-5),
            "anees_median": (factor,) * 4,
            "coverage": (0.95 / factor, 0.95, 0.99, 0.99),
        }

    summary = make_summary(change)
    for name in ("rmse_median", "anees_median"):
        summary[name].values *= rng.lognormal(0.0, noise, summary[name].shape)
    summary["coverage"].values += 0.5 * rng.normal(0.0, noise, summary["coverage"].shape)
    assert _verdict(tracking_claims(summary), "rotation against", "20 targets") == verdict


def test_improvement_at_three_hours():
    def change(scenario, _, targets, minutes):
        value = 0.5 if minutes == 180 else 1.0
        return {"anees_median": (value, value, 1.0, 1.0)}

    assert _verdict(tracking_claims(make_summary(change)), "3 h") == REPRODUCED


def test_both_architectures_count():
    def change(scenario, architecture, targets, minutes):
        return {"never_observed": 9.0 if architecture == "tpe" else 1.0}

    claims = tracking_claims(make_summary(change, ("published", "tpe")))
    row = next(c for c in claims if "never observed" in c.claim)
    assert row.verdict == PARTLY
    assert "(published: reproduced, tpe: not reproduced)" in row.rule
    assert "published: mean 1" in row.result and "tpe: mean 9" in row.result
    claims = tracking_claims(make_summary(change, ("tpe",)))
    assert _verdict(claims, "never observed") == NOT_REPRODUCED


def test_other_architectures_are_put_beside():
    summary = make_summary(architectures=("published", "tpe", "exact"))
    rows = [c for c in tracking_claims(summary) if "by each architecture" in c.claim]
    assert {c.claim for c in rows} >= {
        f"tracking of {n} targets by each architecture, scenario {s}"
        for s, counts in COUNTS.items()
        for n in counts
    }
    assert all("exact (" in c.result and "tpe (" in c.result for c in rows)


def test_intervals_over_target_sets_hold_their_choice():
    parts = [make_summary().isel(cell=[0])]
    for k, name in enumerate(("other-set", "set-2", "set-3", "set-4"), start=3):
        other = make_summary(lambda *cell, k=k: {"inconsistent_rotation": float(k)}).isel(cell=[0])
        parts.append(other.assign_coords(variant=("cell", [name])))
    claims = list(set_claims(realizations(xr.concat(parts, "cell"))))
    assert [c.claim for c in claims] == [
        "choice of the monitored targets, scenario A, published, 20 targets"
    ]
    assert (
        claims[0].value == f"targets with inconsistent rotation {t_interval([2, 3, 4, 5, 6]):.1f}"
    )
    assert "of 5 sets" in claims[0].rule
    assert not list(set_claims(realizations(parts[0])))


def _comparison(share):
    shape = (1, 2, 1, 4, 2)
    information = np.full(shape, 10.0 * share) * (1.0 + 1e-3 * np.arange(4))[:, None]
    information[:, 0, :, :, 1] = np.nan
    direct = np.array([[[10.0], [9.9]]])
    return xr.Dataset(
        {
            "information": (("cell", "search", "epoch", "run", "budget"), information),
            "elapsed": (("cell", "search", "epoch", "run", "budget"), np.ones(shape)),
            "direct_information": (("cell", "direct", "epoch"), direct),
            "direct_elapsed": (("cell", "direct", "epoch"), np.full((1, 2, 1), 1e-5)),
        },
        {
            "search": ["tpe", "random"],
            "direct": ["exact", "greedy"],
            "budget": [100, 5000],
            "targets": ("cell", [20]),
            "observers": ("cell", [20]),
        },
        {"settings": json.dumps({"comparison": {"early_stop": 700}})},
    )


@pytest.mark.parametrize(
    ("share", "verdict"), [(0.99, REPRODUCED), (0.92, PARTLY), (0.6, NOT_REPRODUCED)]
)
def test_tpe_is_judged_at_its_largest_budget_against_the_optimum(share, verdict):
    summary = make_summary()
    claims = tasking_claims(_comparison(share), summary)
    assert _verdict(claims, "near-optimal") == verdict
    assert {c.budget for c in claims if "near-optimal" in c.claim} == {
        "at most 100 evaluations, stop after 700 without improvement"
    }
    assert "after 100 evaluations" in next(c.result for c in claims if "near-optimal" in c.claim)
    assert "0.9900" in next(c.result for c in claims if "other methods" in c.claim)


def test_tracking_by_a_search_names_its_budget():
    usual = make_summary().isel(cell=[0])
    summary = xr.concat([usual, usual.assign_coords(variant=("cell", ["tpe"]))], "cell")
    (claim,) = tasking_claims(None, summary)
    assert claim.budget == "at most 90 evaluations, stop after 700 without improvement"
    assert claim.kind == "beyond"


def test_both_estimators_are_compared_on_the_same_realizations():
    filtered = make_summary()
    fitted = make_summary(lambda *cell: {"inconsistent_rotation": 0.0})
    fitted = fitted.assign_coords(estimator=("cell", ["batch"] * fitted.sizes["cell"]))
    claims = list(estimator_claims(realizations(xr.concat([filtered, fitted], "cell"))))
    counted = [c for c in claims if "scenario A, published, 50 targets" in c.claim]
    assert len(counted) == 1 and counted[0].verdict == BEYOND
    assert "inconsistent targets 0.0 [0.0, 0.5] and " in counted[0].result
    assert not list(estimator_claims(realizations(filtered)))


def test_rows_of_the_table_name_what_there_is():
    keys = {
        "budget",
        "where",
        "claim",
        "paper",
        "result",
        "value",
        "rule",
        "reproduced",
        "partly",
        "each",
    }
    keys |= {"input", "calibrated"}
    cells = {"along", "targets", "beside", "least", "statistics"}
    rows = [row for group in table()["tracking"] for row in group["claims"]]
    for row in rows:
        assert set(row) <= keys | cells, row["claim"]
        assert {what.split()[0] for what in row["statistics"].values()} <= set(STATISTICS)
        measures = {word for what in row["statistics"].values() for word in what.split()[1:2]}
        assert measures <= {*PER_PART, *PER_CELL}
    for part in ("library", "searches", "unstopped", "published", "optimum", "optimizers"):
        assert all(set(row) <= keys for row in table()[part])


@pytest.mark.parametrize(
    ("row", "reached"),
    [
        ({"reproduced": "x.low > 0", "partly": "x.mean > 0"}, PARTLY),
        ({"reproduced": "x.high <= most"}, REPRODUCED),
        ({"reproduced": ["x.mean > 0", "x.mean > 1.5"]}, NOT_REPRODUCED),
        ({"each": ["x.reach <= most", "kind == Halo"]}, REPRODUCED),
        ({"each": ["x.low > 0", "kind == Halo"]}, NOT_REPRODUCED),
        ({"each": ["x.low > 0", "kind == Halo", "x.high > 2"]}, PARTLY),
        ({"reproduced": "x.high > 2", "input": []}, INPUT),
        ({"reproduced": "x.low > 0", "input": []}, NOT_REPRODUCED),
        ({"reproduced": "x.high > 2", "calibrated": ["kind == Halo"]}, CALIBRATED),
        ({"reproduced": "x.high > 2", "calibrated": ["kind == DRO"]}, REPRODUCED),
        ({}, BEYOND),
    ],
)
def test_verdicts_follow_from_conditions(row, reached):
    facts = {"x": Interval(1.0, -1.0, 3.0, 5), "most": 3.0, "kind": "Halo"}
    assert verdict(row, facts) == reached


def test_realizations_are_tidy():
    summary = make_summary()
    frame = realizations(summary)
    units = 4 * len(PER_PART) + 4 * len(ERRORS) + len(PER_CELL)  # errors come in two units
    assert len(frame) == summary.sizes["cell"] * SEEDS * units
    own = select(frame, scenario="A", targets=20)
    assert list(own["interval_minutes"].unique()) == [30, 60, 120, 180, 240]
    grp = values_of(own, "rmse_median", "attitude")
    assert grp.shape == (SEEDS, 5)
    np.testing.assert_array_equal(grp[:, 0], spread(GOOD["rmse_median"][0]))
    degrees = values_of(own, "rmse_median", "attitude", "degree")
    np.testing.assert_allclose(degrees, np.rad2deg(grp))
    assert usual_interval(frame) == 60


def test_pairs_are_compared_over_their_common_realizations():
    found = paired([1.0, 2.0, np.nan], [2.0, 4.0, 9.0])
    assert (found.first, found.other, found.other_largest) == (1.5, 3.0, 4.0)
    assert found.difference == t_interval([1.0, 2.0])
    assert np.isnan(paired([np.nan], [1.0]).first)
