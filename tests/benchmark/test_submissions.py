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
