"""Propagation with impulses, against scipy and against a burn with constant thrust."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cislunar.constants import TIME_UNIT_S
from cislunar.dynamics.bundle import propagate_bundle
from cislunar.dynamics.cr3bp import equations_of_motion
from cislunar.dynamics.maneuvers import (
    VELOCITY_UNIT_M_S,
    Impulses,
    burn_times,
    propagate_with_impulses,
)
from cislunar.errors import ConfigurationError

STATES = np.array(
    [
        [1.02, 0.0, -0.18, 0.0, -0.1, 0.0],
        [0.85, 0.02, 0.1, 0.01, 0.2, 0.0],
        [1.02, 0.01, 0, 0, 0.7, 0],
    ]
)
STEP = 60.0 / TIME_UNIT_S


def reference(state, times, impulses, thrust=lambda t: np.zeros(3)):
    """Propagation by scipy's DOP853 from impulse to impulse."""

    def slope(t, y):
        return equations_of_motion(y) + np.concatenate([np.zeros(3), thrust(t)])

    out, now, here = [], times[0], np.array(state)
    events = [(t, v) for t, v in impulses if t >= times[0]]
    for end in times:
        for t, v in [event for event in events if event[0] < end - 1e-9 * STEP]:
            if t > now:
                here = solve_ivp(slope, (now, t), here, "DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
            here = here + np.concatenate([np.zeros(3), v])
            now = t
            events = [event for event in events if event[0] > t]
        if end > now:
            here = solve_ivp(slope, (now, end), here, "DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
        now = end
        out.append(here)
    return np.array(out)


@pytest.mark.parametrize("start", [0.0, 7 * STEP])
def test_impulses_between_and_on_the_grid(start):
    rng = np.random.default_rng(3)
    n = 30
    # two within one step, one on the grid, one in the last step, and one of another state
    when = start + STEP * np.array([3.2, 3.7, 10.0, 15.5, 29.9])
    changes = rng.normal(0.0, 30.0, (5, 3)) / VELOCITY_UNIT_M_S
    impulses = Impulses(np.array([0, 0, 0, 2, 0]), when, changes)
    found = propagate_with_impulses(STATES, STEP, n, impulses, start=start)
    times = start + STEP * np.arange(n + 1)
    for j in (0, 2):
        own = [(t, v) for i, t, v in zip(*impulses, strict=True) if i == j]
        np.testing.assert_allclose(found[j], reference(STATES[j], times, own), atol=2e-11)
    plain = propagate_bundle(STATES, STEP, n, start=start)
    np.testing.assert_array_equal(found[1], plain[1])
    np.testing.assert_array_equal(found[0, :4], plain[0, :4])


def test_intervals_may_be_split_anywhere():
    when = STEP * np.array([3.25, 10.0, 12.5])
    impulses = Impulses(np.array([0, 0, 2]), when, np.full((3, 3), 0.01))
    whole = propagate_with_impulses(STATES, STEP, 20, impulses)
    first = propagate_with_impulses(STATES, STEP, 10, impulses)
    second = propagate_with_impulses(first[:, -1], STEP, 10, impulses, start=10 * STEP)
    np.testing.assert_allclose(np.concatenate([first, second[:, 1:]], axis=1), whole, atol=1e-14)


def test_a_burn_is_the_limit_of_its_impulses():
    """A burn of 20 minutes and 50 m/s, against scipy with constant thrust acceleration."""
    total, first, duration = np.array([30.0, -40.0, 0.0]) / VELOCITY_UNIT_M_S, 130.0, 1200.0
    times = burn_times(first, duration)
    assert times.size == 120 and times.mean() == pytest.approx(first + duration / 2)
    count = np.full((times.size, 1), 1.0 / times.size)
    impulses = Impulses(np.zeros(times.size, dtype=np.int64), times / TIME_UNIT_S, count * total)
    found = propagate_with_impulses(STATES[:1], STEP, 40, impulses)[0]
    begin, end = first / TIME_UNIT_S, (first + duration) / TIME_UNIT_S
    kinks = [(begin, np.zeros(3)), (end, np.zeros(3))]
    expected = reference(
        STATES[0],
        STEP * np.arange(41),
        kinks,
        lambda t: total / (end - begin) if begin <= t < end else np.zeros(3),
    )
    # 1e-8 is 4 m and 0.01 mm/s
    assert np.abs(found - expected)[25:].max() < 1e-9
    assert burn_times(5.0, 0.0).tolist() == [5.0]


def test_without_impulses_nothing_changes():
    plain = propagate_bundle(STATES, STEP, 5)
    none = Impulses(np.empty(0, dtype=np.int64), np.empty(0), np.empty((0, 3)))
    np.testing.assert_array_equal(propagate_with_impulses(STATES, STEP, 5, none), plain)


@pytest.mark.parametrize(
    "change, message",
    [
        ({"index": np.array([3])}, "impulses.index: 3 must be a whole number"),
        ({"index": np.array([-1])}, "impulses.index: -1 must be a whole number"),
        ({"time": np.array([np.nan])}, "impulses.time is not finite"),
        ({"velocity": np.zeros(3)}, r"impulses.velocity has shape \(3,\)"),
    ],
)
def test_impossible_impulses_are_refused(change, message):
    impulses = Impulses(np.zeros(1, dtype=np.int64), np.zeros(1), np.zeros((1, 3)))
    with pytest.raises(ConfigurationError, match=message):
        propagate_with_impulses(STATES, STEP, 5, impulses._replace(**change))
    with pytest.raises(ConfigurationError, match=r"dt = -0\.1 must be a positive number"):
        propagate_with_impulses(STATES, -0.1, 5, impulses)
    with pytest.raises(ConfigurationError, match="sort the impulses of state 0 by time"):
        two = Impulses(np.zeros(2, dtype=np.int64), np.array([STEP, 0.0]), np.zeros((2, 3)))
        propagate_with_impulses(STATES, STEP, 5, two)
    for wrong in (np.nan, -1.0):
        with pytest.raises(ConfigurationError, match=f"duration_s = {wrong}"):
            burn_times(0.0, wrong)
