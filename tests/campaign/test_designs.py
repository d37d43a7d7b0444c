"""Architectures by other objectives than J, from settings to data sets, tables and tracking."""

import re
from itertools import product

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from campaign_folder import copy_workflow, read_campaign, snakemake, with_change

from cislunar.campaign.architectures import objectives
from cislunar.campaign.architectures.designs import design_dataset, objective_front_dataset
from cislunar.campaign.architectures.generalization import generalization_rows
from cislunar.campaign.architectures.moving import MovingTargets
from cislunar.campaign.architectures.objectives import ArchitectureInputs, check_orbit_slots
from cislunar.campaign.architectures.objectives_table import (
    front_architectures,
    objective_row,
    single_architecture,
)
from cislunar.campaign.architectures.visibility import architecture_coverage
from cislunar.campaign.data.inputs import orbit_set_dataset, sun_dataset
from cislunar.campaign.settings.cell_settings import cell_settings
from cislunar.campaign.settings.cells import campaign_cells, most_alike
from cislunar.campaign.settings.checks import check_campaign
from cislunar.campaign.settings.families import with_families
from cislunar.campaign.settings.preflight import crowded_objectives
from cislunar.campaign.settings.reading import merged
from cislunar.campaign.settings.scenarios import in_study, information_of, scenario_settings
from cislunar.campaign.tracking.comparisons import rank_correlation
from cislunar.campaign.tracking.tables import rank_rows
from cislunar.errors import ConfigurationError
from cislunar.figures.search.objectives import objectives_figure, tracking_errors
from cislunar.orbits.families import observer_library
from cislunar.orbits.station_keeping import station_keeping_m_s
from cislunar.runtime.netcdf import read_dataset, write_dataset

WANTED = {"phases": 3, "fold": 1, "max_stability_index": None, "satellites": 3}
WANTED |= {"method": "certified", "evaluations": None}
HORIZON = {"duration_days": 2, "step_hours": 6, "limiting_magnitude": 15}
OBJECTIVES = ("coverage", "target-days", "longest-gap", "mean-gap", "mean-wait", "search",
              "information", "attitude")  # fmt: skip


@pytest.fixture(scope="module")
def paper(tmp_path_factory):
    results = str(tmp_path_factory.mktemp("results"))
    return read_campaign() | {"results": results}


@pytest.fixture(scope="module")
def settings(paper):
    """Settings of a small scenario, as the workflow passes them to jobs."""
    own = scenario_settings(paper, "A")
    few = {"targets": 3, "target_seed": 2, "windows": 2, "window_hours": 12, "step_hours": 4}
    return {
        "epoch_jd": own["epoch_jd"],
        "propagator": "dopri5",
        "visibility": own["visibility"] | HORIZON,
        "slots": 2,
        "max_satellites": 3,
        "information": paper["architecture"]["information"] | few,
        "cell": cell_settings(own["task2"]),
    }


@pytest.fixture(scope="module")
def inputs(settings):
    orbits = observer_library({"Halo_L2_S": 2, "Lyap_L1": 2})
    targets = np.random.default_rng(4).normal([1.0, 0.0, 0.0], 0.15, (9, 3))
    moving = observer_library({"Halo_L1_N": 3, "Halo_L2_N": 2})
    sun = settings | {"ephemeris": {"kernel": "de421", "step_minutes": 60}}
    return ArchitectureInputs(
        orbit_set_dataset(orbits, "orbit", "orbits", {}),
        xr.Dataset({"position": (("target", "axis"), targets)}),
        orbit_set_dataset(moving, "target", "targets", {}),
        sun_dataset({key: sun[key] for key in ("epoch_jd", "ephemeris", "visibility")}),
    )


GIVEN = {"scenario": "A", "name": "mine", "seed": 7}


@pytest.mark.parametrize("objective", OBJECTIVES)
def test_a_design_has_the_value_of_its_objective_and_is_read_back(
    inputs, settings, tmp_path, objective
):
    found = design_dataset(WANTED | {"objective": objective}, inputs, settings, **GIVEN)
    write_dataset(found, tmp_path / "mine.nc")
    read = read_dataset(tmp_path / "mine.nc")
    flown = single_architecture("mine", read)
    assert flown.objective == objective and flown.satellites.tolist() == [1, 1, 1]
    assert set(np.round(3.0 * flown.phase, 12)) <= {0.0, 1.0, 2.0}
    assert flown.measured["bound"] >= flown.measured["value"] >= flown.measured["greedy"] > 0.0
    moving = MovingTargets(inputs.tracked, inputs.sun, settings, scenario="A", seed=7)
    row = objective_row("A", flown, inputs, settings, moving)
    by_name = {"coverage": "union_coverage", "target-days": "target_days"}
    by_name |= {"information": "information_nat", "attitude": "attitude_nat"}
    if objective in by_name:
        assert row[by_name[objective]] == pytest.approx(row["value"], rel=1e-9)
    assert row["satellites"] == 3 and row["J"] > 0.0
    assert row["unit"] == ("nat" if objective in ("information", "attitude") else "1")


def test_a_design_in_slots_has_their_satellites(inputs, settings):
    wanted = WANTED | {"objective": "coverage", "phases": None, "satellites": 5}
    found = design_dataset(wanted, inputs, settings, **GIVEN)
    assert found["satellites"].values.sum() == 5 and found.sizes["slot"] == 2
    assert not found["phase"].values.any()
    ways = found["orbit"].values, found["satellites"].values
    covered = architecture_coverage(*ways, *inputs[:2], inputs.sun, settings)
    assert covered.union_coverage == pytest.approx(float(found["value"]))
    by_J = design_dataset(wanted | {"objective": "J"}, inputs, settings, **GIVEN)
    assert single_architecture("mine", by_J).measured["value"] == pytest.approx(
        float(by_J["J"]), rel=1e-12
    )
    assert float(by_J["bound"]) == float(by_J["value"]) >= float(found["J"])


def test_orbits_of_expensive_station_keeping_are_excluded(inputs, settings):
    wanted = WANTED | {"objective": "coverage", "satellites": 2}
    states = zip(inputs.orbits["state"].values, inputs.orbits["period"].values, strict=True)
    cost = np.array([station_keeping_m_s(*each) for each in states])
    cap = float(np.sort(cost)[1])
    found = design_dataset(wanted | {"max_station_keeping_m_s": cap}, inputs, settings, **GIVEN)
    assert set(found["orbit"].values) <= set(np.flatnonzero(cost <= cap))
    with pytest.raises(ConfigurationError, match="max_station_keeping_m_s = 1e-06 leaves no"):
        design_dataset(wanted | {"max_station_keeping_m_s": 1e-6}, inputs, settings, **GIVEN)


@pytest.mark.parametrize("phases, satellites", [(3, 6), (None, 5)])
def test_random_orbit_slots_differ_and_depend_on_the_name(inputs, settings, phases, satellites):
    wanted = {"objective": None, "method": "chance"}
    wanted = WANTED | wanted | {"phases": phases, "satellites": satellites}
    drawn = [design_dataset(wanted, inputs, settings, **GIVEN | {"name": name}) for name in "aabcd"]
    for one in drawn:
        assert one["satellites"].values.sum() == satellites
        slots = list(zip(one["orbit"].values, one["phase"].values, strict=True))
        assert len(set(slots)) == len(slots) == (2 if phases is None else 6)
        assert "value" not in one and single_architecture("a", one).objective == "chance"
    assert drawn[0].equals(drawn[1])
    assert not all(drawn[0].equals(other) for other in drawn[2:])


@pytest.mark.parametrize(
    "method, evaluations, sampler",
    [("tpe", None, "compiled"), ("tpe", None, "hyperopt"), ("random", 2, "compiled")],
)
def test_the_papers_searches_take_the_objectives_and_stay_below_the_bound(
    inputs, settings, method, evaluations, sampler
):
    search = {"labels": "index", "early_stop": 30, "max_evaluations": 40, "sampler": sampler}
    wanted = WANTED | {"objective": "information"}
    most = float(design_dataset(wanted, inputs, settings, **GIVEN)["bound"])
    wanted |= {"method": method, "evaluations": evaluations}
    found = design_dataset(wanted, inputs, settings | search, **GIVEN)
    assert 0.0 < float(found["value"]) <= most and "bound" not in found
    assert single_architecture("mine", found).measured == {"value": float(found["value"])}
    with pytest.raises(ConfigurationError, match="1 evaluations found no architecture of distinct"):
        design_dataset(
            wanted | {"method": "random", "evaluations": 1, "satellites": 12, "phases": 3},
            inputs, settings | search, **GIVEN,
        )  # fmt: skip


def test_fronts_have_every_number_of_satellites_and_are_drawn(inputs, settings):
    moving = MovingTargets(inputs.tracked, inputs.sun, settings, scenario="A", seed=7)
    rows = []
    for name, objective in (("seen", "coverage"), ("known", "information")):
        wanted = WANTED | {"objective": objective, "satellites": [4, 1, 2], "scenarios": ["A"]}
        front = objective_front_dataset(wanted, inputs, settings, **GIVEN)
        assert front["total"].values.tolist() == [1, 2, 4]
        # static targets that no observer can see do not change coverage
        more = np.diff(front["value"].values)
        assert np.all(more > 0.0 if objective == "information" else more >= 0.0)
        assert np.all(front["bound"].values >= front["value"].values)
        flown = list(front_architectures(name, front))
        assert [each.satellites.sum() for each in flown] == [1, 2, 4]
        rows += [objective_row("A", each, inputs, settings, moving) for each in flown]
    table = pd.DataFrame(rows)
    seen, known = (table[table["front"] == name] for name in ("seen", "known"))
    np.testing.assert_allclose(seen["value"], seen["union_coverage"])
    np.testing.assert_allclose(known["value"], known["information_nat"])
    # for each number, no front is better by the other objective, up to the gap
    assert np.all(known["union_coverage"].to_numpy() <= seen["bound"].to_numpy() * (1 + 1e-12))
    assert np.all(seen["information_nat"].to_numpy() <= known["bound"].to_numpy() * (1 + 1e-12))
    design = design_dataset(WANTED | {"objective": "coverage"}, inputs, settings, **GIVEN)
    rows.append(objective_row("A", single_architecture("mine", design), inputs, settings, moving))
    plain = design.drop_vars(["value", "bound", "greedy", "gap"]).drop_attrs()
    rows.append(objective_row("A", single_architecture("tpe", plain), inputs, settings, moving))
    cell = {"quantity": "rmse_geometric_all", "part": "position", "variant": np.nan, "targets": 50}
    cell |= {"estimator": ["mukf", "mukf", "batch"], "scenario": "A", "interval_minutes": 60}
    cell |= {"architecture": ["mine", "tpe", "tpe"], "mean": [3.0, 30.0, 1.0]}
    both = [pd.DataFrame(cell | {"unit": unit}) for unit in ("1", "km")]
    tracking = pd.concat(both)
    assert tracking_errors(tracking).to_dict() == {("A", "mine"): 3.0, ("A", "tpe"): 30.0}
    tables = {"A": pd.DataFrame(rows), "B": pd.DataFrame(rows)}
    figure = objectives_figure(tables, tracking)
    # the last one is the color bar of the errors
    assert len(figure.axes) - 1 == 6 == len(objectives_figure(tables).axes)
    legend = [text.get_text() for text in figure.legends[0].get_texts()]
    assert legend == [
        "maximum coverage", "maximum orbit information", "up to the proven bound", "TPE"
    ]  # fmt: skip
    dotted = [handle.get_marker() != "none" for handle in figure.legends[0].legend_handles[:2]]
    assert dotted == [True, False], "a design and a front by one objective share an entry"
    bar = figure.axes[-1]
    assert bar.get_xlim()[0] < 3.0 < 30.0 < bar.get_xlim()[1]


def test_a_design_may_have_its_own_information_settings(paper):
    design = {"objective": "information", "satellites": 20, "information": {"window_hours": 12}}
    changed = with_change(paper, "architecture.designs.x", design)
    search = in_study(check_campaign(changed))["architecture"]
    usual = search["information"]
    assert information_of(search["designs"]["x"], search) == usual | {"window_hours": 12}
    assert information_of(search["designs"]["coverage-20"], search) == usual
    assert information_of(search["designs"]["information-20"], search) == usual | {"halvings": 2}
    design["information"] = {"targets": 203}
    with pytest.raises(ConfigurationError, match=r"information\.targets' = 203"):
        check_campaign(with_change(paper, "architecture.designs.x", design))


def test_generalization_to_other_targets(inputs, settings):
    moving = observer_library({"Halo_L1_N": 3, "Lyap_L1": 3})
    other = inputs._replace(tracked=orbit_set_dataset(moving, "target", "targets", {}))
    wanted = {"satellites": [2, 3], "target_seeds": [5], "windows": 1, "least": 3}
    given = settings | {"generalization": wanted}
    table = pd.DataFrame(generalization_rows(other, given, scenario="A", seed=7))
    assert len(table) == 2 * 2 + 2 * 2 * 3 and (table["information_nat"] > 0.0).all()
    assert set(table["targets_of"]) == {5, "Halo", "Lyap"}
    assert set(table.loc[table["targets_by"] == "seed", "windows"]) == {1}
    by = table.set_index(["targets_of", "satellites", "chosen_on"])["information_nat"]
    for of, number in product((5, "Halo", "Lyap"), (2, 3)):
        best = by[of, number, "these"]
        assert best >= 0.98 * by[of, number, "the campaign's"]
        if of != 5:
            assert best >= 0.98 * by[of, number, "others"]


def test_rank_correlations_and_their_intervals():
    rng = np.random.default_rng(3)
    truth = rng.random(40)
    noisy = truth + 0.6 * rng.random(40)
    found = rank_correlation(truth, noisy)
    ranks = [np.argsort(np.argsort(values)) for values in (truth, noisy)]
    assert found.mean == pytest.approx(np.corrcoef(*ranks)[0, 1], rel=1e-12)
    assert found.low < found.mean < found.high <= 1.0 and found.count == 40
    # the interval contains the correlation of the population with its confidence level
    contained = 0
    for _ in range(400):
        one = rng.standard_normal(25)
        other = 0.7 * one + np.sqrt(1.0 - 0.49) * rng.standard_normal(25)
        each = rank_correlation(one, other)
        contained += each.low <= 6.0 / np.pi * np.arcsin(0.35) <= each.high
    assert 0.92 <= contained / 400 <= 0.98
    assert rank_correlation(truth[:12], 1.0 - 1e-12 * truth[:12]).count == 12
    assert np.isnan(rank_correlation(truth[:12], 1.0 - 1e-12 * truth[:12]).mean)  # all ties
    assert np.isnan(rank_correlation(truth[:9], noisy[:9]).mean)
    names = [f"random-{k}" for k in range(13)]
    reached = {"scenario": "A", "front": np.nan, "architecture": names}
    values = dict.fromkeys(("J", "union_coverage", "target_days"), truth[:13])
    values |= {"information_nat": truth[:13], "attitude_nat": -truth[:13]}
    cell = {"scenario": "A", "estimator": "mukf", "variant": np.nan, "targets": 50}
    cell |= {"interval_minutes": 60, "observers": [20] * 12 + [21], "architecture": names}
    error = {"quantity": "rmse_median_all", "part": "position", "unit": "km", "mean": -truth[:13]}
    share = {"quantity": "tracked_share", "part": np.nan, "unit": "1", "mean": truth[:13]}
    tracking = pd.concat([pd.DataFrame(cell | each) for each in (error, share)])
    rows = rank_rows([pd.DataFrame(reached | values)], tracking)
    assert len(rows) == 10 and set(rows["architectures"]) == {12}
    expected = rows["objective"].map(lambda name: -1.0 if name == "attitude_nat" else 1.0)
    np.testing.assert_allclose(rows["correlation"], expected)
    few = tracking[tracking["architecture"].isin(names[:9])]
    assert rank_rows([pd.DataFrame(reached | values)], few).empty


def test_cells_that_differ_in_their_architecture_are_counted(paper):
    assert most_alike(with_families(in_study(paper))["task2"]) == 7
    more = {f"random-{k}": {"A": [50]} for k in range(4)}
    changed = merged(paper, {"task2": {"other_architectures": more}})
    assert most_alike(with_families(in_study(changed))["task2"]) == 11


def test_the_study_of_objectives_is_valid_and_ranks_forty_of_each_number(tmp_path):
    study = read_campaign("objectives.yaml")
    checked = in_study(check_campaign(study | {"results": str(tmp_path)}))
    cells = campaign_cells(with_families(checked)["task2"])
    for number in (20, 33):
        drawn = [name for name in checked["architecture"]["designs"] if f"chance{number}-" in name]
        assert drawn == [f"chance{number}-{copy}" for copy in range(1, 41)]
        own = [cell for cell in cells if cell.architecture == drawn[-1]]
        days = {"", *checked["task2"]["variants"]["pooled"]}
        assert {cell.variant for cell in own} == days and len(own) == 2 * len(days) == 20
    assert "copies" not in checked["architecture"]["designs"]["chance20-1"]
    assert most_alike(with_families(checked)["task2"]) >= 92


DESIGN = {"objective": "information", "satellites": 20}


@pytest.mark.parametrize(
    "key, value, message",
    [
        ("designs.tpe", DESIGN, "name 'tpe' is taken"),
        ("generalization.scenario", "Z", "'architecture.generalization.scenario' = 'Z' is none of"),
        ("designs.fronts", DESIGN, "name 'fronts' is taken"),
        ("designs.x", DESIGN | {"phases": None},
         "designs.x.phases' = null: information is defined for"),
        ("designs.x", DESIGN | {"phases": None, "method": "tpe", "objective": "coverage"},
         "phases' = null: tpe does not keep"),
        ("designs.x", DESIGN | {"fold": 2}, "designs.x.fold' = 2"),
        ("designs.x", DESIGN | {"objective": "gap"}, "must be one of coverage, target-days"),
        ("designs.x", DESIGN | {"satellites": 4000}, "4000 must lie in 1 .. 3020"),
        ("designs.x", DESIGN | {"method": "chance"}, "with method chance has none; leave it out"),
        ("designs.x", {"satellites": 20}, "a design with method certified needs one"),
        ("designs.x", DESIGN | {"objective": "J"}, "phases' = 10: J is defined for satellites in"),
        ("designs.x", DESIGN | {"copies": 3}, "copies' = 3: all would be the same"),
        ("designs", {"x": {"satellites": 2, "method": "chance", "copies": 2}, "x-2": DESIGN},
         "'x-2' is a design and a copy"),
        ("objective_fronts.x", {"objective": "coverage", "phases": None, "scenarios": ["A"]},
         "objective_fronts.x.satellites': 5 must lie in 10 .. 100"),
        ("objective_fronts.x", {"objective": "coverage", "scenarios": ["D"]}, "'D' is none of A"),
    ],
)  # fmt: skip
def test_impossible_objectives_name_their_key(paper, key, value, message):
    with pytest.raises(ConfigurationError, match=message):
        check_campaign(with_change(paper, f"architecture.{key}", value))


@pytest.mark.parametrize(
    "caps, error",
    [
        ({"max_stability_index": None}, None),
        ({"max_stability_index": 1500}, None),
        ({"max_stability_index": 1}, "max_stability_index = 1 leaves no orbit"),
        ({"max_stability_index": 2}, "70 satellites on 40 orbit slots, those on the 1 orbits"),
        ({"max_station_keeping_m_s": 0}, "max_station_keeping_m_s = 0 leaves no orbit"),
    ],
)
def test_more_satellites_than_allowed_orbit_slots_are_refused_early(
    paper, inputs, monkeypatch, caps, error
):
    monkeypatch.setattr(objectives, "families_dataset", lambda settings: inputs.orbits)
    wanted = DESIGN | {"phases": 40, "satellites": 70} | caps
    config = check_campaign(with_change(paper, "architecture.designs.x", wanted))
    crowded = crowded_objectives(config)
    assert crowded == ({} if None in caps.values() else {"designs.x": 70})
    if error is None:
        check_orbit_slots(config, crowded)
        return
    with pytest.raises(ConfigurationError, match=rf"'architecture\.designs\.x': {error}"):
        check_orbit_slots(config, crowded)


@pytest.mark.parametrize(
    "change, message",
    [
        ({"targets": 203}, "information.targets' = 203: scenario A has 202"),
        ({"window_hours": 24.0 * 31}, "window_hours' = 744.0 exceeds"),
        ({"step_hours": 5}, "step_hours' = 5 does not divide"),
    ],
)
def test_impossible_windows_name_their_key(paper, change, message):
    changed = with_change(paper, "architecture.designs.x", DESIGN)
    changed = merged(changed, {"architecture": {"information": change}})
    with pytest.raises(ConfigurationError, match=message):
        check_campaign(changed)
    nobody = paper["architecture"] | {"designs": {}, "objective_fronts": {}, "information": change}
    tracked = paper["task2"] | {"other_architectures": {}}
    check_campaign(paper | {"architecture": nobody, "task2": tracked})


def test_an_unknown_architecture_is_refused_and_a_design_accepted(paper):
    changed = with_change(paper, "task2.architectures", ["mine"])
    with pytest.raises(ConfigurationError, match=r"an objective in 'architecture\.designs'"):
        check_campaign(changed)
    front = {"objective": "coverage", "scenarios": ["A", "B"]}
    changed = with_change(changed, "architecture.designs.mine", DESIGN)
    changed = with_change(changed, "architecture.objective_fronts.seen", front)
    check_campaign(changed)
    left = in_study(check_campaign(merged(changed, {"scenarios": {"A": None}})))
    assert left["architecture"]["objective_fronts"]["seen"]["scenarios"] == ["B"]


@pytest.mark.workflow
def test_the_workflow_plans_designs_and_fronts(tmp_path):
    folder = copy_workflow(tmp_path)
    search = '{"designs": {"mine": {"objective": "information", "satellites": 3}}, '
    search += '"objective_fronts": {"seen": {"objective": "coverage", "scenarios": ["A"]}}}'
    requested = ["task1", "results/quick/figures/objectives.png"]
    requested.append("results/quick/task2/A/mine/mukf/nt20_dt60.nc")
    output, code = snakemake(
        folder, "-n", "--configfile", "config/quick.yaml", "--config", f"architecture={search}",
        "--", *requested,
    )  # fmt: skip
    assert code == 0, output[-3000:]
    planned = {"design": 3, "objective_front": 1, "objectives_table": 3, "objectives_figure": 1}
    for rule, count in planned.items():
        assert re.search(rf"^{rule} +{count}$", output, flags=re.MULTILINE), rule
