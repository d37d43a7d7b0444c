"""Tests for the search for targets that may have left the field of view."""

import numpy as np
import pytest

from cislunar.dynamics.cr3bp import EARTH_MOON
from cislunar.dynamics.maneuvers import VELOCITY_UNIT_M_S, Impulses, propagate_with_impulses
from cislunar.errors import ConfigurationError
from cislunar.estimation.maneuvers import ManeuverDetection, ReachableSearch
from cislunar.observation.records import Measurements
from cislunar.observation.sightline import direction_angles
from cislunar.tasking.demonstration import tracking_problem

NOW, AT = 240, 100
HALF_FIELD = np.deg2rad(1.5)


def trials(n_targets, target, observers, found, n_steps=60):
    """An observation of a target by each of the observers in the first step of an interval."""
    offset = np.zeros((n_targets, n_steps + 1), dtype=np.int64)
    offset[target, 1:] = len(observers)
    offset[target + 1 :] = len(observers)
    value = np.full((len(observers), 3), 0.1 if found else np.nan)
    return Measurements(offset, np.array(observers), value, np.ones_like(value))


def searching(n_targets=3, share=0.05):
    scene, _, epoch, *_ = tracking_problem(6, n_targets, duration_hours=12.0)
    half_field = np.full(6, HALF_FIELD)
    return scene, epoch, ReachableSearch(scene, EARTH_MOON, half_field, n_targets, share, 0.14)


def test_dark_or_gone():
    """Odds by hand; what is often dark has to be missed more often."""
    _, _, search = searching()
    for k in range(10):
        for target, dark in ((0, False), (1, k % 2 == 0)):
            both = trials(3, target, [0, 1], True)
            search.note(both, np.array([True, not dark]), 60 * k + 1)
    for k in (10, 11):
        for target in (0, 1):
            search.note(trials(3, target, [0], False), np.zeros(1, dtype=bool), 60 * k + 1)
    days = (720 - 541) / 1440.0
    hits, misses = np.array([20, 15]), np.array([0, 5])
    odds = 0.14 * days * ((misses + 1.0) / (hits + misses + 2.0)) ** -2.0
    np.testing.assert_allclose(search.odds(720), [*odds, 0.0], rtol=1e-12)
    assert search.gone(720).tolist() == [0]


@pytest.mark.parametrize("size_m_s", [60.0, 400.0])
def test_a_target_is_found_within_the_reachable_set(size_m_s):
    """The pointings of a few intervals contain a target that has left the expected direction."""
    scene, epoch, search = searching()
    step = scene.step
    way = np.array([0.36, -0.8, 0.48]) * size_m_s / VELOCITY_UNIT_M_S
    impulse = Impulses(np.zeros(1, dtype=int), np.array([AT * step]), way[None])
    true = propagate_with_impulses(epoch[:1], step, 700, impulse)[0]
    search.note(trials(3, 0, [0, 1, 2], True), np.ones(3, dtype=bool), 60)
    search.note(trials(3, 0, [0, 1, 2], False), np.zeros(3, dtype=bool), 180)
    search.begin(0, (60, true[60]), NOW)
    assert list(search.lost) == [0]
    for now in range(NOW, 660, 60):
        rows = search.command(now, 60)
        assert 0 < len(rows) <= 0.05 * 6 * 60 and np.all(rows[:, 2] == 0)
        measured = []
        for k, observer, _ in rows.tolist():
            away = true[now + 1 + k, :3] - scene.observer_position[observer, now + 1 + k]
            measured.append([0.0, *direction_angles(*away, scene.observer_axes[now + 1 + k])])
        order = np.lexsort((rows[:, 1], rows[:, 0]))
        offset = np.zeros((3, 61), dtype=np.int64)
        offset[0, 1:] = np.cumsum(np.bincount(rows[:, 0], minlength=60))
        offset[1:] = offset[0, -1]
        value = np.array(measured)[order]
        given = Measurements(offset, rows[order, 1], value, np.ones_like(value))
        of_lost, shown = search.shown(given, now + 1)
        assert of_lost.all()
        nothing = given._replace(value=np.full_like(value, np.nan))
        assert not search.shown(nothing, now + 1)[1].any()
        if shown.any():
            break
    assert shown.any()
    row = np.argmax(shown)
    k = now + 1 + int(rows[order][row, 0])
    ((time, change),) = search.end(0, (k, int(given.observer[row]), value[row, 1:])).items()
    assert 60 <= time < NOW and not search.lost
    assert np.linalg.norm(change) * VELOCITY_UNIT_M_S < 601.0


def test_particles_have_all_sizes_at_all_times():
    _, epoch, search = searching()
    search.note(trials(3, 0, [0, 1], True), np.ones(2, dtype=bool), 60)
    search.begin(0, (60, epoch[0]), NOW)
    found = search.lost[0]
    size = VELOCITY_UNIT_M_S * np.linalg.norm(found.change, axis=1)[:-1]
    for time in np.unique(found.time[:-1]):
        for some in (slice(None), slice(256)):  # all, and those that are centers of fields
            own = np.log(size[some][found.time[:-1][some] == time] / 5.0) / np.log(120.0)
            # the mean of a uniform variable, within four standard deviations
            assert abs(own.mean() - 0.5) < 4.0 / np.sqrt(12.0 * own.size)


def test_settings():
    with pytest.raises(ConfigurationError, match="set recover to true"):
        ManeuverDetection(false_alarms_per_target_day=1e-3, search_share=0.01)
    with pytest.raises(ConfigurationError, match="there is no test"):
        ManeuverDetection(recover=True)
