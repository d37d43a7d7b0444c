"""Status of tracks against Bayes' formula by hand."""

import numpy as np
import pytest

from cislunar.association import (
    CONFIRMED,
    DELETED,
    LOST,
    TENTATIVE,
    TRACK_STATUS_NAMES,
    Association,
    TrackStatus,
    Window,
    known_tracks,
)


def window_of(seen, chance):
    none = np.empty(0, dtype=np.int64)
    n = 1 + max((track for _, track in seen), default=0)
    return Window(
        np.tile(np.eye(2), (n, 1, 1)), none, none, none, np.empty((0, 2)), np.empty((0, 2, 2)),
        np.empty((0, 2)), np.empty(0), np.array(seen, dtype=np.int64).reshape(-1, 2),
        np.log1p(-np.asarray(chance, dtype=float)),
    )  # fmt: skip


def taken(*rows):
    """Detections that tracks take: exposure, track and weight of each."""
    exposure, track, weight = (np.array(rows, dtype=float).reshape(-1, 3)).T
    n = len(rows)
    return Association(
        exposure.astype(int), track.astype(int), np.arange(n), weight, np.zeros((n, 2)),
        np.ones((n, 2)),
    )  # fmt: skip


def status_of(*existence):
    n = len(existence)
    return TrackStatus(np.array(existence), np.full(n, CONFIRMED, dtype=np.uint8), np.full(n, -1))


def test_a_miss_is_the_formula_of_bayes():
    """P(exists | not detected) = r (1 - P_D) / (r (1 - P_D) + 1 - r)."""
    tracks = status_of(0.9, 0.4, 0.7)
    window = window_of([(0, 0), (1, 1), (2, 0)], [0.6, 0.9, 0.8])
    tracks.update(window, taken(), 5, np.array([0, 0, 1]), 2)
    # of the misses of a window, that with the largest probability of detection
    expected = [0.9 * 0.2 / (0.9 * 0.2 + 0.1), 0.4 * 0.1 / (0.4 * 0.1 + 0.6), 0.7]
    np.testing.assert_allclose(tracks.existence, expected, rtol=1e-14)
    assert tracks.last.tolist() == [-1, -1, -1]


def test_steps_that_are_not_decided_do_not_count():
    tracks = status_of(0.9)
    step = np.array([0, 2, 3])
    tracks.update(window_of([(1, 0), (2, 0)], [0.5, 0.5]), taken(), 5, step, 2)
    assert tracks.existence[0] == pytest.approx(0.9, rel=1e-14)
    tracks.update(window_of([(1, 0), (2, 0)], [0.5, 0.9]), taken(), 5, step, 3)
    assert tracks.existence[0] == pytest.approx(0.45 / 0.55, rel=1e-14)


def test_a_confirmed_track_without_detections_is_lost_and_comes_back():
    tracks = known_tracks(2)
    miss = window_of([(0, 0)], [0.7])
    history, existence = [], tracks.existence[0]
    for _ in range(30):
        tracks.update(miss, taken(), 0, np.array([0]), 1)
        existence = existence * 0.3 / (1.0 - existence + existence * 0.3)
        assert tracks.existence[0] == pytest.approx(max(existence, 1e-6), rel=1e-9)
        history.append(int(tracks.status[0]))
    # odds of 1e6 fall by 0.3 each: below 1 / 19 after 14; a confirmed track is never deleted
    assert history == [CONFIRMED] * 13 + [LOST] * 17
    assert tracks.status[1] == CONFIRMED and tracks.existence[1] == pytest.approx(1.0 - 1e-6)
    tracks.update(miss, taken((0, 0, 1.0)), 40, np.array([3]), 4)
    assert TRACK_STATUS_NAMES[tracks.status[0]] == "confirmed"
    assert tracks.existence[0] > 0.99
    assert tracks.last.tolist() == [43, -1]


def test_a_detection_is_one_that_the_track_takes_with_more_than_half():
    tracks = status_of(0.3, 0.3, 0.3)
    tracks.status[:] = TENTATIVE
    window = window_of([(0, 0), (0, 1), (0, 2)], [0.5, 0.5, 0.5])
    tracks.update(window, taken((0, 0, 0.4), (0, 1, 0.6)), 10, np.array([0]), 1)
    lower = 0.15 / 0.85
    np.testing.assert_allclose(tracks.existence[[0, 2]], lower, rtol=1e-14)
    assert tracks.existence[1] > 0.99
    assert tracks.status.tolist() == [TENTATIVE, CONFIRMED, TENTATIVE]
    assert tracks.last[1] == 10 and tracks.last[2] == -1


def test_a_tentative_track_is_not_lost_but_deleted():
    tracks = status_of(0.04)
    tracks.status[:] = TENTATIVE
    tracks.update(window_of([(0, 0)], [0.5]), taken(), 0, np.array([0]), 1)
    assert tracks.status[0] == TENTATIVE
    for _ in range(20):
        tracks.update(window_of([(0, 0)], [0.9]), taken(), 0, np.array([0]), 1)
    assert tracks.status[0] == DELETED
