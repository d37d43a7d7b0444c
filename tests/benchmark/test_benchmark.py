"""Files, truth and seal of a small benchmark."""

import json
import shutil

import numpy as np
import pandas as pd
import pytest
from small_benchmark import SIZE, call

from cislunar.benchmark import make_benchmark, read_public_data, read_scenario, write_reference
from cislunar.detection import read_detections
from cislunar.dynamics import propagate_utc
from cislunar.errors import CislunarError, ConfigurationError
from cislunar.exchange import Segment, objects_of, observation_dates, state_at

PUBLIC = (
    "detections.csv", "detections.psv", "exposures.csv", "manifest.json", "observers.oem",
    "scenario.yaml", "truth",
)  # fmt: skip


@pytest.fixture
def copy(made, tmp_path):
    return shutil.copytree(made, tmp_path / "copy")


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
        ((made / "detections.csv" / "in", SIZE), "cannot be made"),
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
