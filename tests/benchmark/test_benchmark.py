"""A small benchmark: its files, its seal, references and scores, against closed forms."""

import io
import itertools
import json
import shutil

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from cislunar.benchmark import (
    SCORE_COLUMNS,
    SIZES,
    BenchmarkSize,
    count_passes,
    make_benchmark,
    read_public_data,
    read_scenario,
    read_truth,
    score_submission,
    write_reference,
)
from cislunar.benchmark.score import CUTOFF_KM
from cislunar.command.main import cislunar
from cislunar.detection import read_detections
from cislunar.dynamics import propagate_utc, recenter
from cislunar.errors import CislunarError, ConfigurationError
from cislunar.exchange import (
    Segment,
    objects_of,
    observation_dates,
    ocm_text,
    oem_text,
    read_oem,
    segments_csv,
    state_at,
)

SIZE = BenchmarkSize(
    8, (("Halo_L1_S", 1), ("Halo_L2_N", 1), ("Halo_L3_N", 1), ("Halo_L3_S", 1)), 0.25, 3.0
)
PUBLIC = (
    "detections.csv", "detections.psv", "exposures.csv", "manifest.json", "observers.oem",
    "scenario.yaml", "truth",
)  # fmt: skip


def call(*arguments):
    return CliRunner().invoke(cislunar, ["benchmark", *map(str, arguments)])


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A benchmark of eight objects and six hours, by the command; do not change it."""
    folder = tmp_path_factory.mktemp("benchmark") / "made"
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(SIZES, "small", SIZE)
        done = call("make", folder, "--seed", 7)
    assert (done.exit_code, done.stdout) == (0, f"benchmark small: 4 observers, {folder}\n")
    return folder


@pytest.fixture(scope="module")
def truth(made):
    return read_truth(made)


@pytest.fixture
def copy(made, tmp_path):
    return shutil.copytree(made, tmp_path / "copy")


@pytest.fixture(scope="module")
def references(made, tmp_path_factory):
    """Both references, made where there is no truth."""
    folder = tmp_path_factory.mktemp("references")
    public = shutil.copytree(made, folder / "public", ignore=shutil.ignore_patterns("truth"))
    for method in ("survey-catalog", "nearest-neighbor"):
        done = call("reference", public, "--method", method, "--output", folder / method)
        assert done.exit_code == 0, done.stderr
    return folder


def arcs(scenario, truth, which, shift=(0.0,) * 6, covariance=None, rows=None):
    """Segments of objects of the truth at the scoring epochs, shifted; km and km/s."""
    times = scenario.scoring_tdb if rows is None else scenario.scoring_tdb[rows]
    at = [int(np.argmin(np.abs(truth["time"].values - each))) for each in times]
    found = []
    for j in which:
        given = Segment(f"mine {j}", f"mine {j}", "EARTH", times, truth["state"].values[j, at])
        given = given._replace(state=given.state + shift)
        if covariance is not None:
            matrices = np.tile(covariance, (times.size, 1, 1))
            given = given._replace(covariance_tdb_s=times, covariance=matrices)
        found.append(given)
    return found


def test_public_files_tell_what_is_seen_and_not_what_is_true(made, truth):
    assert tuple(sorted(each.name for each in made.iterdir())) == PUBLIC
    exposures = pd.read_csv(made / "exposures.csv")
    detections = pd.read_csv(made / "detections.csv")
    for table in (exposures, detections):
        assert set(table["frame"]) == {"ICRF"} and set(table["timeScale"]) == {"UTC"}
        assert table["obsTime"].str.endswith("Z").all()
    assert set(detections.columns) == {
        *("obsID", "expID", "stn", "obsTime", "ra", "dec", "rmsRA", "rmsDec", "rmsCorr", "mag"),
        *("rmsMag", "sys", "ctr", "pos1", "pos2", "pos3", "frame", "timeScale"),
    }
    origin = truth["origin"].values
    assert origin.size == len(detections)
    # one false alarm per exposure in the mean, within five standard deviations
    alarms = np.count_nonzero(origin < 0)
    assert abs(alarms - len(exposures)) < 5.0 * np.sqrt(len(exposures))
    assert "seed" not in (made / "scenario.yaml").read_text()
    # detections of an exposure are sorted by right ascension, whatever they are of
    scenario = read_scenario(made)
    assert scenario.observers == ["S01", "S02", "S03", "S04"]
    assert truth["outside"].values.tolist() == [0] * 4 + [1] * 4
    assert len(set(truth["family"].values[4:])) == 4


def test_directions_are_those_from_the_observers_to_the_objects(made, truth):
    """Angles between detections and the interpolated truth, in standard deviations; dates of the
    tables are UTC, times of the truth TDB."""
    public = read_public_data(made, read_scenario(made))
    table, origin = public.detections, truth["origin"].values
    segments = [
        Segment("", "", "EARTH", truth["time"].values, each) for each in truth["state"].values
    ]
    squared = []
    for row in np.flatnonzero(origin >= 0):
        own = table.iloc[row]
        state, _ = state_at([segments[origin[row]]], public.tdb[row])
        way = state[:3] - own[["pos1", "pos2", "pos3"]].to_numpy(float)
        ra, dec = np.arctan2(way[1], way[0]), np.arctan2(way[2], np.hypot(way[0], way[1]))
        east = (np.deg2rad(own["ra"]) - ra + np.pi) % (2.0 * np.pi) - np.pi
        off = np.rad2deg([east * np.cos(dec), np.deg2rad(own["dec"]) - dec]) * 3600.0
        squared.append(np.sum((off / own[["rmsRA", "rmsDec"]].to_numpy(float)) ** 2))
    n = len(squared)
    assert n > 50
    # chi squared with 2 n degrees of freedom
    assert abs(np.sum(squared) - 2.0 * n) < 5.0 * np.sqrt(4.0 * n)


def test_the_truth_obeys_the_stated_dynamics_with_its_maneuvers(truth):
    """States of the file, propagated from the begin and from before each maneuver to after it."""
    time, state = truth["time"].values, truth["state"].values
    date = observation_dates(time)

    def moved(start, begin, end):
        return propagate_utc(start, begin, end, center="earth")

    still = np.flatnonzero(truth["maneuvers"].values == 0)
    assert 0 < still.size < len(state)
    for j in still:
        np.testing.assert_allclose(
            moved(state[j, 0], date[0], date[-1])[:3], state[j, -1, :3], rtol=0.0, atol=0.05
        )
    for j, at, change in zip(
        truth["maneuver_object"].values, truth["maneuver_time"].values,
        1e-3 * truth["velocity_change"].values, strict=True,
    ):  # fmt: skip
        k = int(np.searchsorted(time, at))
        (when,) = observation_dates([at])
        before = moved(state[j, k - 1], date[k - 1], when)
        after = moved(before + np.array([0.0, 0.0, 0.0, *change]), when, date[k])
        np.testing.assert_allclose(after[:3], state[j, k, :3], rtol=0.0, atol=1e-3)
        np.testing.assert_allclose(after[3:], state[j, k, 3:], rtol=0.0, atol=1e-6)
        assert np.linalg.norm(change) > 1e-4


def test_the_same_detections_and_observers_are_in_other_formats(made):
    table = pd.read_csv(made / "detections.csv")
    peer = read_detections(made / "detections.psv")
    assert peer["obsID"].tolist() == table["obsID"].tolist()
    for name in ("ra", "dec", "pos1", "pos2", "pos3"):
        np.testing.assert_allclose(peer[name].astype(float), table[name], rtol=0, atol=2e-6)
    observers = objects_of(made / "observers.oem")
    public = read_public_data(made, read_scenario(made))
    for row in range(0, len(table), 97):
        own = table.iloc[row]
        state, center = state_at(observers[own["stn"]], public.tdb[row])
        assert center == "EARTH"
        place = own[["pos1", "pos2", "pos3"]].to_numpy(float)
        np.testing.assert_allclose(state[:3], place, atol=0.01)


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
    (tmp_path / "objects.csv").write_text(f"object,cataloged_utc\nmine {j},2027-03-01T05:30:00Z\n")
    last = score_submission(tmp_path, made).iloc[-1]
    assert last["purity"] == pytest.approx(own.size / (own.size + 2))
    assert last["wrong_assignments"] == 2 and last["false_objects"] == 0
    assert last["fragments"] == 1.0
    first = read_public_data(made, scenario).tdb[own[0]]
    hours = 5.5 - (first - scenario.epoch_tdb) / 3600.0
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


def edited(text, old, new):
    assert old in text
    return text.replace(old, new)


def without(text, name):
    return pd.read_csv(io.StringIO(text)).assign(**{name: np.nan}).to_csv(na_rep="nan", index=False)


BAD_STATES = {
    "wrong frame": (lambda t: edited(t, ",ICRF,", ",TEME,"), "frame 'TEME' is none of ICRF"),
    "no time scale": (lambda t: edited(t, "epoch_utc", "epoch"), "time scale or the frame is not"),
    "not finite": (lambda t: without(t, "x_km"), "x_km = 'nan' must be a finite number"),
    "other dates": (lambda t: edited(t, "2027-", "2028-"), "no state at a scoring epoch"),
    "missing column": (lambda t: edited(t, "vy_km_s", "vy"), "no column vy_km_s"),
}


@pytest.mark.parametrize("name", BAD_STATES)
def test_unusable_tables_of_states_are_refused(name, made, truth, tmp_path):
    change, words = BAD_STATES[name]
    text = segments_csv(arcs(read_scenario(made), truth, [0, 1], covariance=np.eye(6)))
    path = tmp_path / "mine.csv"
    path.write_text(change(text))
    refused(path, made, words)


def refused(path, made, words):
    with pytest.raises(CislunarError, match=words) as caught:
        score_submission(path, made)
    assert "\n" not in str(caught.value) and path.name in str(caught.value)


def test_gaps_repeated_states_and_impossible_covariances_are_refused(made, truth, tmp_path):
    scenario, path = read_scenario(made), tmp_path / "mine.oem"
    times = scenario.scoring_tdb
    (arc,) = arcs(scenario, truth, [0])
    gap = arc._replace(tdb_s=times + np.array([-600.0, 600.0]))
    wrong = np.eye(6)
    wrong[0, 1] = wrong[1, 0] = 1.5
    for segments, words in (
        ([gap], "no state at 2027-03-01T03:00:00Z, a scoring epoch within its arc"),
        ([arc, arc], "two states at 2027-03-01T03:00:00Z"),
        (arcs(scenario, truth, [0], covariance=wrong), "covariance is not positive definite"),
        (arcs(scenario, truth, [0], covariance=-np.eye(6)), "covariance is not positive definite"),
    ):
        text = oem_text(segments, created=scenario.epoch)
        path.write_text(text)
        refused(path, made, words)
    text = oem_text([arc], created=scenario.epoch)
    path.write_text(edited(text, "TIME_SYSTEM = UTC", "TIME_SYSTEM = UT1"))
    refused(path, made, "TIME_SYSTEM = UT1 cannot be used")
    path.write_text(edited(text, "REF_FRAME = ICRF", "REF_FRAME = TEME"))
    refused(path, made, "REF_FRAME = TEME cannot be used")


@pytest.mark.parametrize(
    ("file", "text", "words"),
    [
        ("assignments.csv", "object,obsID\nmine 0,nothing\n", "none of detections.csv"),
        ("assignments.csv", "object,obsID\nother,1-0-0\n", "object 'other' has no state"),
        ("assignments.csv", "object,obsID\nmine 0,1\nmine 0,1\n", "occurs twice"),
        ("assignments.csv", "object\nmine 0\n", "no column obsID"),
        ("objects.csv", "object,cataloged_utc\nmine 0,soon\n", "cataloged_utc"),
        ("objects.csv", "object,cataloged_utc\nmine 0,2027-03-02\n", "not within the benchmark"),
    ],
)
def test_unusable_assignments_and_dates_are_refused(file, text, words, made, truth, tmp_path):
    folder = tmp_path / "mine"
    folder.mkdir()
    (folder / "mine.csv").write_text(segments_csv(arcs(read_scenario(made), truth, [0])))
    (folder / file).write_text(text)
    refused(folder, made, words)


def test_an_empty_submission_is_refused(made, tmp_path):
    refused(tmp_path, made, "has no states")
    refused(tmp_path / "none", made, "no such file or folder")


def test_a_truth_that_was_opened_or_changed_is_noticed(copy, references):
    def wrong(words):
        done = call("score", references / "survey-catalog", "--truth", copy)
        assert done.exit_code == 2 and words in done.stderr
        assert done.stderr.count("\n") <= 1 + done.stderr.count("%")

    sealed = copy / "truth" / "truth.nc"
    (copy / "truth" / "states.txt").write_text("1 2 3")
    wrong("the truth was opened")
    (copy / "truth" / "states.txt").unlink()
    content = bytearray(sealed.read_bytes())
    content[-1] ^= 1
    sealed.write_bytes(content)
    wrong("the seal is broken")
    sealed.unlink()
    wrong("scores need the sealed truth")
    manifest = copy / "manifest.json"
    manifest.write_text(json.dumps({"sha256": {}}))
    wrong("is no manifest")


@pytest.mark.parametrize(
    "name", ["detections.csv", "detections.psv", "exposures.csv", "observers.oem", "scenario.yaml"]
)
def test_changed_public_files_are_noticed(name, copy, tmp_path):
    with (copy / name).open("a") as file:
        file.write("\n")
    with pytest.raises(CislunarError, match=f"{name}: differs from its checksum"):
        write_reference(copy, tmp_path / "out")


def test_impossible_arguments_are_refused(made, tmp_path):
    for given, words in (
        ((tmp_path, "tiny"), "must be one of small, medium, large"),
        ((made, SIZE), "not an empty folder"),
        ((tmp_path / "new", SIZE, -1), "must not be negative"),
    ):
        with pytest.raises(CislunarError, match=words):
            make_benchmark(*given)
    with pytest.raises(ConfigurationError, match="must be one of survey-catalog"):
        write_reference(made, tmp_path / "new", "best")
    with pytest.raises(CislunarError, match="not an empty folder"):
        write_reference(made, made)
    assert call("make", "--size", "huge", "x").exit_code == 2
    assert call("score", made).exit_code == 2
