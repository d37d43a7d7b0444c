"""Surveys of a campaign: small realizations, their table and figure, and impossible settings."""

import numpy as np
import pandas as pd
import pytest
from campaign_folder import ROOT, read_campaign
from small_cells import cell_inputs, settings_of_cell

from cislunar.campaign.settings.checks import check_campaign
from cislunar.campaign.settings.reading import merged
from cislunar.campaign.settings.tree import StatedSurvey
from cislunar.campaign.survey import (
    CATALOG_COLUMNS,
    catalog_rows,
    realization,
    realization_rows,
    survey_realization,
)
from cislunar.constants import TIME_UNIT_S
from cislunar.dynamics import (
    UNITS,
    VELOCITY_UNIT_M_S,
    from_inertial,
    jacobi_constant,
    propagate_many,
    pulsating_frame,
)
from cislunar.errors import ConfigurationError
from cislunar.figures.replay import cell_replay
from cislunar.figures.survey import catalog_figure
from cislunar.survey import SearchSettings, SurveyResult

POINTS = [[0.85, 0.05, 0.0], [1.1, 0.0, 0.02]]
SMALL = {
    "architecture": "mine",
    "targets": 3,
    "realizations": 2,
    "duration_days": 0.125,
    "link_hours": 1,
    "start_days": 4,
    "prior": {"particles": 200, "expected_objects": 5},
    "process": {"false_alarms_deg2": 0.02},
}


@pytest.fixture(scope="module")
def runs():
    """Surveys, rows of their realizations, and the records of these for a replay."""
    surveys, rows, records = {}, {}, {}
    for name, change in (
        ("usual", {}),
        ("ephemeris", {"ephemeris": True, "realizations": 1, "outside_families": 0.67}),
    ):
        survey = surveys[name] = StatedSurvey(**SMALL | change)
        inputs, records[name] = cell_inputs(3, bodies=survey.ephemeris), []
        rows[name] = [
            realization_rows(
                survey_realization(
                    name, survey, number, inputs, POINTS, settings_of_cell({}),
                    propagator="dop853", seed=3, recorded=records[name].append,
                )
            )
            for number in range(survey.realizations)
        ]  # fmt: skip
    return surveys, rows, records


@pytest.fixture(scope="module")
def found(runs):
    return runs[:2]


def test_the_record_of_a_realization_is_replayed(runs):
    surveys, rows, records = runs
    for name, survey in surveys.items():
        assert len(records[name]) == survey.realizations
        for record, own in zip(records[name], rows[name], strict=True):
            replay = cell_replay(record, cell_inputs(3).sun)
            assert replay.time_s.tolist() == [300.0 * k for k in range(1, 37)]
            known = np.isfinite(replay.estimate_km)
            shown = np.where(known, replay.estimate_km + replay.error_km, replay.untracked_km)
            assert np.isfinite(shown[:, :3]).all()
            assert replay.detections.time_s.size == own["detections"].item()
            outside = sum(each.startswith("outside") for each in replay.objects)
            assert outside == (2 if survey.outside_families else 0)
            assert list(replay.observers.values()) == [3.0, 3.0, 3.0]


def test_realizations_have_their_own_day_and_noise(found):
    _, rows = found
    for own in (*rows["usual"], *rows["ephemeris"]):
        assert own["day"].tolist() == [0.125] and own["objects"].tolist() == [3]
        assert own["detected"].item() >= 1 and own["false_alarms"].item() > 0
        assert own["wrong"].item() == own["false"].item() == 0
    first, second = (own["detections"].item() for own in rows["usual"])
    assert first != second


def test_a_share_of_the_objects_is_outside_of_the_families(monkeypatch):
    """True states at the start in both dynamics, and that nothing but the truth differs."""
    given = {}

    def taken(scene, truth, state, ids, seed, density, settings, *, outside, forces, **_):
        given[len(given)] = state, outside, density.state, forces
        raise StopIteration

    monkeypatch.setattr(realization, "run_survey", taken)
    for ephemeris in (False, True):
        inputs = cell_inputs(3, bodies=ephemeris)
        for share in (0, 0.34, 1):
            survey = StatedSurvey(**SMALL | {"outside_families": share, "ephemeris": ephemeris})
            with pytest.raises(StopIteration):
                survey_realization(
                    "mine", survey, 1, inputs, POINTS, settings_of_cell({}), propagator="dop853",
                    seed=3,
                )  # fmt: skip
    for first in (0, 3):
        (inside, none, particles, forces), half, (others, every, _, _) = (
            given[first + k] for k in range(3)
        )
        assert not none.any() and every.all() and half[1].sum() == 1
        for state, outside, density, _ in (half, given[first + 2]):
            np.testing.assert_array_equal(state[~outside], inside[~outside])
            np.testing.assert_array_equal(density, particles)
            assert np.linalg.norm((state - inside)[outside, :3], axis=1).min() > 0.01
        # an object of a smaller share is also there with a larger one
        assert np.isin(half[0][half[1]], others).all()
        if first:
            axes = pulsating_frame(forces.table, forces.epoch)
            back = np.array([from_inertial(state * UNITS, axes) for state in others])
            radius = np.linalg.norm(back[:, :3], axis=1)
            assert np.all(radius < 1.9) and np.all(radius > 0.05)


def test_more_objects_than_target_orbits_have_phases_of_their_own(monkeypatch):
    given = []

    def taken(scene, truth, state, ids, *rest, **_):
        given.append((state, ids))
        raise StopIteration

    monkeypatch.setattr(realization, "run_survey", taken)
    inputs = cell_inputs(3)
    available = inputs.tracked.sizes["target"]
    survey = StatedSurvey(**SMALL | {"targets": 3 * available})
    with pytest.raises(StopIteration):
        survey_realization(
            "mine", survey, 1, inputs, POINTS, settings_of_cell({}), propagator="dop853", seed=3
        )
    ((state, ids),) = given
    assert sorted(ids) == list(range(3 * available))
    energy = jacobi_constant(state)
    for orbit in range(available):
        same = ids % available == orbit
        np.testing.assert_allclose(energy[same], energy[same][0], rtol=1e-9)
        apart = state[same][:, None] - state[same]
        assert np.linalg.norm(apart[~np.eye(3, dtype=bool)], axis=1).min() > 1e-3


EVERYTHING = {
    "ephemeris": True,
    "entering": 1,
    "deployed": 2,
    "latency_minutes": 20,
    "lineage": {"maneuvers_per_day": 1},
    "cell": {
        "eclipse": True,
        "sensor": {"photon_noise": {"aperture_m": 0.15}},
        "observer_errors": {"pointing_arcsec": 3, "position_m": 100, "treatment": "calibrated"},
        "dynamics": {"srp": {"assumed_factor": 1.2}},
        "truth": {
            "maneuvers": {"drawn": [{"smallest_m_s": 1, "largest_m_s": 5, "interval_hours": 1}]},
            "reflection": "lambert-phong",
            "parameter_sigma": {"log_albedo": 0.2},
        },
    },
}
"""Objects that appear and maneuver, late data, errors of observers, and other bodies and forces."""


def test_the_truth_of_a_survey_has_what_its_entry_states(monkeypatch):
    given = {}

    def taken(scene, truth, state, *args, **more):
        given.update(truth=truth, state=state, **more)
        raise StopIteration

    monkeypatch.setattr(realization, "run_survey", taken)
    survey = StatedSurvey(**SMALL | EVERYTHING)
    with pytest.raises(StopIteration):
        survey_realization(
            "mine", survey, 0, cell_inputs(3, bodies=True), POINTS, settings_of_cell({}),
            propagator="dop853", seed=3,
        )  # fmt: skip
    truth, hours = given["truth"], given["appears_hours"]
    assert given["eclipse"] and given["observer_errors"].treatment == "calibrated"
    assert truth.observer_sigma.pointing_arcsec == 3 and truth.sensor is not None
    assert len(truth.drawn_maneuvers) == 1 and truth.parameter_sigma
    assert str(given["forces"].radiation) != str(truth.forces.radiation)
    assert np.all(hours > 0.0) and np.unique(hours).size == 2
    # the two that are deployed together are at one place then, and hardly move from it
    when = next(hour for hour in hours if np.count_nonzero(hours == hour) == 2)
    together = np.flatnonzero(hours == when)
    time = when * 3600.0 / TIME_UNIT_S
    there = propagate_many(given["state"][together], [time], forces=truth.forces)[:, 0]
    apart = there[1] - there[0]
    assert np.linalg.norm(apart[:3]) < 1e-6
    assert 0.05 < np.linalg.norm(apart[3:]) * VELOCITY_UNIT_M_S < 10.0


def test_a_truth_that_a_survey_cannot_have_is_refused():
    walk = {"observer_errors": {"pointing_walk_arcsec": 1, "treatment": "calibrated"}}
    for change, words in (
        ({"targets": 2, "entering": 2, "deployed": 1}, "entering' = 2 and deployed = 1"),
        ({"cell": walk}, "constant errors of position and pointing alone"),
        ({"cell": {"dynamics": {"truth": "ephemeris"}}}, "set 'ephemeris' to true"),
        ({"cell": {"tasking": {"mode": "paper"}}}, "surveys.mine.cell.tasking"),
    ):
        entry = {"architecture": "published", "targets": 5} | change
        config = merged(read_campaign(), {"surveys": {"mine": entry}})
        with pytest.raises(ConfigurationError, match=words) as caught:
            check_campaign(config)
        assert "\n" not in str(caught.value)


def test_the_table_has_means_over_realizations(found):
    surveys, rows = found
    table = catalog_rows(surveys, rows, 3.0)
    assert tuple(table.columns) == CATALOG_COLUMNS
    assert table["clutter"].unique() == pytest.approx([0.18])
    assert table["prior"].unique().tolist() == ["families 0.4, zero velocity 0.3, uniform 0.3"]
    own = table[table["survey"] == "usual"].set_index("quantity")
    values = [each["detected"].item() for each in rows["usual"]]
    assert own.loc["detected", "mean"] == np.mean(values) and own.loc["detected", "seeds"] == 2
    assert own.loc["detected", "largest"] == max(values)
    kept = [round(each["custody"].item() * each["findable"].item()) for each in rows["usual"]]
    assert own.loc["in_custody", "mean"] == np.mean(kept) > 0
    figure = catalog_figure(table)
    assert len(figure.axes) == 4
    names = [each.get_text() for each in figure.axes[0].get_yticklabels()]
    assert names == ["usual (0.125 d)", "ephemeris (0.125 d)"]
    assert table["label"].unique().tolist() == ["usual", "ephemeris"]


def test_intervals_of_numbers_of_objects_are_possible(found):
    surveys, rows = found
    several = {
        "usual": [each.assign(right=n) for each, n in zip(rows["usual"], (3, 1), strict=True)]
    }
    table = catalog_rows({"usual": surveys["usual"]}, several, 3.0).set_index("quantity")
    assert table.loc["right", ["mean", "low", "high"]].tolist() == [2, 0, 3]


def test_a_label_is_the_name_of_a_survey_in_table_and_figure(found):
    surveys, rows = found
    label = {"label": "all objects, no false alarms"}
    surveys = surveys | {"usual": surveys["usual"].model_copy(update=label)}
    table = catalog_rows(surveys, rows, 3.0)
    assert table.groupby("survey")["label"].unique().map(list).to_dict() == {
        "usual": [label["label"]], "ephemeris": ["ephemeris"],
    }  # fmt: skip
    names = [each.get_text() for each in catalog_figure(table).axes[0].get_yticklabels()]
    assert names == [f"{label['label']} (0.125 d)", "ephemeris (0.125 d)"]


def test_the_difference_to_the_first_survey_is_paired_by_realization(found):
    surveys, rows = found
    search = SearchSettings(information_worth=0)
    surveys = surveys | {"other": surveys["usual"].model_copy(update={"search": search})}
    rows = {name: [each.assign(right=n) for each, n in zip(own, (7, 3), strict=False)]
            for name, own in rows.items()}  # fmt: skip
    rows["other"] = [each.assign(right=n) for each, n in zip(rows["usual"], (5, 2), strict=True)]
    table = catalog_rows(surveys, rows, 3.0)
    own = table[table["quantity"] == "right_difference"]
    assert own["survey"].tolist() == ["other"]  # the survey "ephemeris" has other objects
    assert own["mean"].item() == -1.5 and own["smallest"].item() == -2


def test_the_cost_of_the_search_is_that_over_the_survey_that_ends_it(found):
    surveys, rows = found
    stopped = surveys["usual"].model_copy(
        update={"search": SearchSettings(search_days=0.1), "label": "search ends"}
    )
    errors = {"usual": (3.0, 4.4), "stopped": (2.0, 4.0), "ephemeris": (5.0,)}
    rows = {
        name: [
            own.assign(error_known_km=value)
            for own, value in zip(rows.get(name, rows["usual"]), values, strict=True)
        ]
        for name, values in errors.items()
    }
    table = catalog_rows(surveys | {"stopped": stopped}, rows, 3.0)
    cost = table[table["quantity"] == "search_cost"]
    assert cost["survey"].tolist() == ["usual"] and cost["seeds"].tolist() == [2]
    assert cost["mean"].item() == pytest.approx((0.5 + 0.1) / 2)


def test_rows_without_a_characterization_are_left_out_of_its_means(found):
    """Rows of realizations that precede it have none of its columns."""
    surveys, rows = found
    first, second = rows["usual"]
    added = {"bright": 80, "determined": 60, "period_determined": 0.75, "period_covered": 0.95}
    table = catalog_rows(surveys, rows | {"usual": [first, second.assign(**added)]}, 3.0)
    own = table[table["quantity"].isin(added)].set_index("quantity")
    assert own.index.tolist() == ["bright", "period_determined", "period_covered"]
    assert (own["survey"] == "usual").all() and (own["seeds"] == 1).all()
    assert own["mean"].tolist() == [80, 0.75, 0.95]
    # of a single realization the exact interval of a share of 60
    assert 0.8 < own.loc["period_covered", "low"] < 0.9 < own.loc["period_covered", "high"] < 1.0
    assert not set(catalog_rows(surveys, rows, 3.0)["quantity"]) & set(added)


def test_rows_are_those_of_the_days_and_of_the_end():
    days = np.arange(1, 9) * 0.5
    states = pd.DataFrame({"day": days, "right": range(8)})
    objects = pd.DataFrame({"cataloged": [1.0, 3.5, np.inf], "detected": [0.5, 0.25, 0.1]})
    rows = realization_rows(SurveyResult(states, states, objects, None, None))
    assert rows["day"].tolist() == [1.0, 3.0, 4.0] and rows["right"].tolist() == [1, 5, 7]
    assert rows["hours_to_catalog"].tolist() == [12.0, 12.0, 45.0]


def test_impossible_surveys_are_refused_before_anything_runs():
    config = read_campaign()
    own = {"D": {"targets": 9, "tracked": str(ROOT / "config/examples/targets.csv")}}
    survey = {"mine": {"architecture": "exact", "scenario": "D", "targets": 13}}
    with pytest.raises(ConfigurationError, match=r"'surveys.mine.targets' = 13 exceeds the 12"):
        check_campaign(merged(config, {"scenarios": own, "surveys": survey}))
    for change, words in (
        ({"scenario": "D"}, "'surveys.mine.scenario' = 'D' is none of A, B, C"),
        ({"duration_days": 20}, "exceed the ephemeris"),
        ({"architecture": "pear"}, "'surveys.mine.architecture' = 'pear'"),
        ({"prior": {"families": 0, "zero_velocity": 0, "uniform": 0}}, "are all zero"),
        ({"outside_families": 1.5}, "surveys.mine.outside_families"),
        (
            {"outside_families": 0.1, "targets": 4},
            "replaces none of 4 objects; give 0, or at least",
        ),
        ({"prior": {"table": 1}}, "'surveys.mine.prior_table'"),
        ({"search": {"strategy": "chance"}}, "surveys.mine.search.strategy"),
        ({"kernel_deg": -1}, "surveys.mine.kernel_deg"),
    ):
        survey = {"architecture": "information-20"} | change
        with pytest.raises(ConfigurationError, match=words) as caught:
            check_campaign(merged(config, {"surveys": {"mine": survey}}))
        assert "\n" not in str(caught.value)
    twice = {"mine": {"architecture": "information-20", "label": "theirs"}}
    theirs = {"theirs": {"architecture": "information-20"}}
    words = r"'surveys\.mine\.label' = 'theirs' is also that of 'surveys\.theirs'"
    with pytest.raises(ConfigurationError, match=words) as caught:
        check_campaign(merged(config, {"surveys": theirs | twice}))
    assert "\n" not in str(caught.value)
