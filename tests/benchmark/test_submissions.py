"""Unusable submissions to a benchmark are refused."""

import io

import numpy as np
import pandas as pd
import pytest
from small_benchmark import arcs

from cislunar.benchmark import read_scenario, score_submission
from cislunar.errors import CislunarError
from cislunar.exchange import oem_text, segments_csv


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
    before = arc._replace(tdb_s=times[0] - np.array([3600.0, 600.0]))
    after = arc._replace(tdb_s=np.array([times[0] + 600.0, times[1]]))
    wrong = np.eye(6)
    wrong[0, 1] = wrong[1, 0] = 1.5
    for segments, words in (
        ([gap], "no state at 2027-03-01T03:00:00Z, a scoring epoch within its arc"),
        ([before, after], "no state at 2027-03-01T03:00:00Z, a scoring epoch within its arc"),
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
        ("objects.csv", "object,cataloged_utc\nmine 0,2027-03-02\n", "is not from 2027-03-01T00"),
        ("objects.csv", "object,cataloged_utc\nmine 0,2027-03-01T03:01\n", "first scored state"),
    ],
)
def test_unusable_assignments_and_dates_are_refused(file, text, words, made, truth, tmp_path):
    folder = tmp_path / "mine"
    folder.mkdir()
    (folder / "mine.csv").write_text(segments_csv(arcs(read_scenario(made), truth, [0])))
    (folder / file).write_text(text)
    refused(folder, made, words)


def test_every_object_needs_a_date_if_one_has_it(made, truth, tmp_path):
    folder = tmp_path / "mine"
    folder.mkdir()
    (folder / "mine.csv").write_text(segments_csv(arcs(read_scenario(made), truth, [0, 1])))
    (folder / "objects.csv").write_text("object,cataloged_utc\nmine 0,2027-03-01T03:00\n")
    refused(folder, made, "object 'mine 1' has no date; give one of each object")


def test_a_later_segment_counts_where_another_one_ends(made, truth, tmp_path):
    scenario, path = read_scenario(made), tmp_path / "mine.oem"
    times = scenario.scoring_tdb
    (arc,) = arcs(scenario, truth, [0])
    whole = score_submission(write_oem(path, [arc], scenario), made)
    wrong = arc.state + np.array([50.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    first = arc._replace(state=np.stack([arc.state[0], wrong[1]]))
    second = arc._replace(tdb_s=times[1:2], state=arc.state[1:2])
    moved = arc.state[1] + np.append(60.0 * arc.state[1, 3:], np.zeros(3))
    later = arc._replace(
        tdb_s=np.append(times[1:2], times[1] + 60.0), state=np.stack([arc.state[1], moved])
    )
    for segments in ([first, later], [later, first]):
        score = score_submission(write_oem(path, segments, scenario), made)
        pd.testing.assert_frame_equal(score, whole)
    write_oem(path, [first, second, second], scenario)
    refused(path, made, "two states at")


def write_oem(path, segments, scenario):
    path.write_text(oem_text(segments, created=scenario.epoch))
    return path


def test_an_empty_submission_is_refused(made, tmp_path):
    refused(tmp_path, made, "has no states")
    refused(tmp_path / "none", made, "no such file or folder")
