"""Small surveys from an empty catalog, and what the estimation side is given."""

import numpy as np
import pytest

from cislunar.detection import Detections
from cislunar.dynamics import EARTH_MOON, propagate_bundle
from cislunar.errors import ConfigurationError
from cislunar.observation import Sensor
from cislunar.orbit_determination import make_angles
from cislunar.survey import (
    DensityPrior,
    ObjectDensity,
    Predictions,
    PriorSources,
    SearchSettings,
    SurveyCatalog,
    SurveySettings,
    run_survey,
    sample_prior,
    true_objects,
)
from cislunar.tasking import TruthModel, tracking_problem

HOURS = 6
N_OBSERVERS, N_OBJECTS = 6, 6
PROBLEM = tracking_problem(n_observers=N_OBSERVERS, n_targets=N_OBJECTS, duration_hours=HOURS)
SENSOR = Sensor(limiting_magnitude=20)
TRUTH = TruthModel(PROBLEM.surfaces, SENSOR.noise, np.zeros(3))
SETTINGS = SurveySettings(
    duration_days=HOURS / 24, link_hours=2, process={"false_alarms_deg2": 0.02}
)


def density(expected=10.0, seed=1):
    """Neighborhoods of the objects' orbits at other phases, which are not the objects."""
    rng = np.random.default_rng(seed)
    other = propagate_bundle(PROBLEM.epoch, 0.05, 60)[:, rng.integers(60, size=60)].reshape(-1, 6)
    prior = DensityPrior(
        families=0, zero_velocity=0, table=0.8, uniform=0.2, particles=600,
        expected_objects=expected,
    )  # fmt: skip
    state, size = sample_prior(prior, PriorSources(table=other), rng)
    return ObjectDensity(state, size, expected)


def surveyed(states=PROBLEM.epoch, seed=3, settings=SETTINGS, truth=TRUTH, **given):
    return run_survey(
        PROBLEM.scene, truth, states, PROBLEM.ids, seed, density(), settings, sensor=SENSOR,
        forces=EARTH_MOON, **given,
    )  # fmt: skip


@pytest.fixture(scope="module")
def result():
    return surveyed()


def test_objects_are_found_and_their_orbits_are_consistent(result):
    end = result.states.iloc[-1]
    assert result.states["day"].tolist() == pytest.approx([2 / 24, 4 / 24, 6 / 24])
    assert end["objects"] == N_OBJECTS and end["findable"] >= 3
    assert end["right"] >= 3 and end["completeness"] >= 0.75
    assert end["wrong"] == end["false"] == 0 and end["purity"] == 1.0
    assert end["false_alarms"] > 50
    orbits = result.orbits[(result.orbits["day"] == end["day"]) & result.orbits["confirmed"]]
    # chi squared with six degrees of freedom
    assert orbits["nees"].max() < 30.0 and 2.0 < orbits["nees"].mean() < 12.0
    assert orbits["error_km"].max() < 50.0
    assert np.all(np.diff(result.states["undetected"]) < 0.0)
    objects = result.objects
    found = np.isfinite(objects["cataloged"])
    assert np.count_nonzero(found) == end["right"]
    assert np.all(objects["cataloged"][found] > objects["detected"][found])
    assert np.all(objects["tracklets"][found] >= 3)


def test_a_survey_is_repeatable(result):
    again = surveyed()
    assert again.states.equals(result.states) and again.orbits.equals(result.orbits)


def test_objects_are_characterized_at_the_end_without_the_truth(result, monkeypatch):
    chosen = {"characterization": {"least_detections": 15, "searches": 1}}
    settings = SurveySettings(**SETTINGS.model_dump() | chosen)
    with pytest.raises(ConfigurationError, match="body is omitted"):
        surveyed(settings=settings)
    assert result.characterized is None and "bright" not in result.states
    reports = []
    found = surveyed(
        settings=settings, body=PROBLEM.surfaces, progress=lambda *each: reports.append(each)
    )
    blocks, orbits = round(3 * HOURS), np.count_nonzero(found.linked.confirmed)
    assert reports[blocks - 1] == (blocks, blocks) and len(reports) == blocks + orbits
    assert reports[-1] == (blocks + orbits, blocks + orbits)
    assert found.orbits.equals(result.orbits)
    same = list(result.states)
    assert found.states[same].equals(result.states)
    end, orbits = found.states.iloc[-1], found.linked
    assert found.states["bright"].isna().tolist() == [True, True, False]
    assert end["bright"] == len(found.characterized) >= 3
    for each in found.characterized:
        assert orbits.confirmed[each.orbit] and each.row.size >= 15
        assert set(each.row) <= set(orbits.detections(each.orbit).tolist())
    assert end["area_albedo_covered"] >= 0.7
    # the truth changes the comparison alone
    nothing = np.full((int(end["detections"]), 4), np.nan)
    monkeypatch.setattr(true_objects.TrueObjects, "attitudes", lambda self: nothing)
    poisoned = surveyed(settings=settings, body=PROBLEM.surfaces)
    for one, other in zip(found.characterized, poisoned.characterized, strict=True):
        np.testing.assert_array_equal(one.light_curve, other.light_curve)
        assert one[4:] == other[4:]
    assert poisoned.states["area_albedo_covered"].iloc[-1] == 0.0


def test_a_search_may_end_before_the_survey():
    """Nothing differs before; afterwards fields without a known orbit are no longer visited."""
    blocks, ends = [], []
    for search in ({}, {"search_days": 4 / 24}):
        blocks.append([])
        change = {"search": SearchSettings(**search), "quality": {"known_days": 2 / 24}}
        settings = SurveySettings(**SETTINGS.model_dump() | change)
        ends.append(surveyed(settings=settings, record=blocks[-1].append).states)
    searching, stopped = ([each.exposures.step.size for each in own] for own in blocks)
    assert searching[:12] == stopped[:12] and sum(stopped[12:]) < 0.5 * sum(searching[12:])
    assert ends[0][:2].equals(ends[1][:2])
    errors = [each["error_known_km"].tolist() for each in ends]
    assert (
        np.isnan(errors[0][0])
        and errors[0][2] != errors[1][2]
        and max(each[2] for each in errors) < 50.0
    )


def test_plans_do_not_depend_on_the_truth(monkeypatch):
    """Without a detection, two truths that have nothing in common give the same plans; the first
    detection makes them differ."""
    simulated, plans = true_objects.expose, []

    def without(first, exposures, *args, **given):
        _, origin, outcome = simulated(first, exposures, *args, **given)
        plans[-1].append((*exposures,))
        nothing = np.empty(0, dtype=np.int64), np.empty((0, 3)), np.empty((0, 3))
        return Detections(*nothing), origin[:0], outcome

    monkeypatch.setattr(true_objects, "expose", without)
    elsewhere = propagate_bundle(PROBLEM.epoch, 0.3, 1)[::-1, -1].copy()
    for states, seed in ((PROBLEM.epoch, 3), (elsewhere, 4)):
        plans.append([])
        found = surveyed(states, seed)
        assert found.states["confirmed"].max() == found.states["detections"].max() == 0
    for one, other in zip(*plans, strict=True):
        for a, b in zip(one, other, strict=True):
            np.testing.assert_array_equal(a, b)
    assert Detections._fields == ("exposure", "value", "variance")


def test_the_catalog_does_not_depend_on_which_objects_are_outside(result):
    mask = np.arange(N_OBJECTS) % 2 == 0
    other = surveyed(outside=mask)
    assert other.orbits.equals(result.orbits)
    changed = {"completeness_inside", "completeness_outside"}
    changed |= {name.replace("completeness", "completeness_all") for name in changed}
    same = [name for name in result.states if name not in changed]
    assert other.states[same].equals(result.states[same])
    # brute force over the objects
    end, held = other.states.iloc[-1], np.isfinite(other.objects["cataloged"].to_numpy())
    findable = other.objects["tracklets"].to_numpy() >= 3
    assert other.objects["outside"].tolist() == mask.tolist()
    for group, name in ((~mask, "inside"), (mask, "outside")):
        assert end[f"completeness_{name}"] == held[group & findable].mean()
        assert end[f"completeness_all_{name}"] == held[group].mean()
    assert result.states["completeness_outside"].isna().all()
    with pytest.raises(ConfigurationError, match="one bool for each of the 6 objects"):
        surveyed(outside=[0.5] * N_OBJECTS)


def test_false_alarms_alone_give_no_confirmed_orbit():
    """Objects that are too faint for the telescopes, among false alarms."""
    faint = PROBLEM.surfaces._replace(areas=1e-8 * PROBLEM.surfaces.areas)
    settings = SurveySettings(
        duration_days=4 / 24, link_hours=4, process={"false_alarms_deg2": 1 / 9}
    )
    found = surveyed(truth=TRUTH._replace(surfaces=faint), settings=settings)
    end = found.states.iloc[-1]
    assert end["detected"] == 0 and end["false_alarms"] == end["detections"] > 500
    assert end["confirmed"] == 0 and np.isnan(end["completeness"])
    assert not np.isfinite(found.objects["cataloged"]).any()


def test_impossible_times_are_refused():
    for settings, words in (
        (SurveySettings(duration_days=1), "less than the 1441"),
        (SurveySettings(duration_days=0.013), "must be a multiple of search.block_minutes"),
        (SurveySettings(duration_days=0.25, link_hours=0.5), "link_hours = 0.5"),
    ):
        with pytest.raises(ConfigurationError, match=words) as caught:
            surveyed(settings=settings)
        assert "\n" not in str(caught.value)
    assert SearchSettings().strategy == "density"


def test_a_density_that_is_out_of_reach_is_refused():
    far = ObjectDensity([[50.0, 0.0, 0.0, 0.0, 0.0, 0.0]], [1.0], 10.0)
    with pytest.raises(ConfigurationError, match="none of 1 particles") as caught:
        run_survey(PROBLEM.scene, TRUTH, PROBLEM.epoch, PROBLEM.ids, 3, far, SETTINGS,
                   sensor=SENSOR, forces=EARTH_MOON)  # fmt: skip
    assert "\n" not in str(caught.value)


def test_detections_near_a_predicted_position_are_explained():
    place, position = np.zeros(3), np.array([1.0, 0.0, 0.0])
    velocity, time = np.array([0.0, 0.5, 0.0]), 2.0
    covariance = np.zeros((1, 6, 6))
    covariance[0, :3, :3] = np.diag([0.0, 1e-6, 0.0])
    state = np.concatenate([position, velocity])[None]
    now = Predictions(state, covariance, np.ones(1), np.ones(1, dtype=int), covariance)
    later = time + 1e-3
    offsets = np.array([0.0, 0.003, 0.004, 0.1])
    ways = position + 1e-3 * velocity + offsets[:, None] * np.array([0.0, 1.0, 0.0])
    angles = make_angles(np.full(4, later), np.zeros(4, int), np.tile(place, (4, 1)), ways, 1e-5)
    found = SurveyCatalog.explains(None, angles, now, time)
    # three standard deviations are 0.003, and 0.00035 is allowed for the curvature
    assert found.tolist() == [True, True, False, False]
    nothing = Predictions(*(each[:0] for each in now))
    assert not SurveyCatalog.explains(None, angles, nothing, time).any()
    # an open range explains nothing beside the line of sight, or behind the observer
    covariance[0, 0, 0], state[0, 3:] = 1e6, 0.0
    ways = position + offsets[:, None] * np.array([0.0, 1.0, 0.0])
    ways = np.concatenate([ways, -ways[:1]])
    angles = make_angles(np.full(5, time), np.zeros(5, int), np.tile(place, (5, 1)), ways, 1e-5)
    found = SurveyCatalog.explains(None, angles, now, time)
    assert found.tolist() == [True, True, False, False, False]
