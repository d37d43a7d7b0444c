"""Orbits before and after a maneuver, against quadrature, simulation and brute force."""

import numpy as np
import pytest
from maneuvered_arcs import AFTER, BEFORE, MANEUVER, REGION, SETTINGS, STEP, arcs, linked
from scipy.stats import multivariate_normal
from test_survey import SETTINGS as SURVEY
from test_survey import surveyed

from cislunar.constants import SECONDS_PER_DAY, TIME_UNIT_S
from cislunar.dynamics import EARTH_MOON, VELOCITY_UNIT_M_S, propagate_stm
from cislunar.orbit_determination import LinkingSettings, fit_orbits, refit_at
from cislunar.survey import LineageSettings
from cislunar.survey.maneuvers import (
    CURRENT,
    SUPERSEDED,
    divided,
    find_lineage,
    maneuvered_orbits,
    maneuvers_within,
    orbit_paths,
    overlapping_pairs,
    replaced,
)


def lineage(angles, fits, before=None, after=None, settings=SETTINGS):
    everything = np.ones(fits.epoch.size, dtype=bool)
    paths = orbit_paths(fits, 0.0, AFTER[-1] * STEP, forces=EARTH_MOON)
    return find_lineage(
        fits, angles, everything if before is None else before,
        everything if after is None else after, forces=EARTH_MOON, region=REGION,
        expected_objects=200.0, settings=settings, paths=paths,
    )  # fmt: skip


@pytest.mark.parametrize("change", [(0.3, -0.2, 0.5), (-20.0, 30.0, 5.0), (250.0, 300.0, -200.0)])
def test_a_maneuver_connects_two_orbits_of_one_object(change):
    angles, fits, truth = arcs(change)
    found = lineage(angles, fits, after=np.arange(5) == 3)
    assert (found.before.tolist(), found.after.tolist()) == ([0], [3])
    assert found.probability[0] > 0.999
    assert abs(found.time[0] - MANEUVER * STEP) < 4.0 * found.time_sigma[0]
    error = found.velocity_m_s[0] - change
    assert error @ np.linalg.solve(found.velocity_covariance[0], error) < 20.0
    error = found.state[0] - truth[3]
    assert error @ np.linalg.solve(found.covariance[0], error) < 25.0
    # the orbit before tells where the maneuver was, and so more of the state after it
    share = np.linalg.solve(fits.covariance[3], found.covariance[0])
    assert np.linalg.det(share) < 0.9


def test_the_ratio_of_likelihoods_is_that_of_quadrature_over_impulse_times():
    """Equation (1) by the midpoint rule over impulses every two seconds, each with propagations of
    its own, and the moments of time and change of velocity over them."""
    angles, fits, _ = arcs((-20.0, 30.0, 5.0))
    settings = LineageSettings(maneuvers_per_day=0.3, scales_m_s=(1.0, 40.0))
    found = lineage(angles, fits, np.arange(5) == 0, np.arange(5) == 3, settings)
    width = 2.0 / TIME_UNIT_S
    times = MANEUVER * STEP + width * np.arange(-300, 301)
    assert times[0] > BEFORE[-1] * STEP and times[-1] < AFTER[0] * STEP
    weight, change = [], []
    for t in times:
        z, s = np.zeros(6), np.zeros((6, 6))
        for k, sign in ((0, -1.0), (3, 1.0)):
            state, stm = propagate_stm(fits.state[k], t - fits.epoch[k], start=fits.epoch[k])
            z += sign * state
            s += stm @ fits.covariance[k] @ stm.T
        for scale in settings.scales_m_s:
            prior = np.diag([0.0] * 3 + [(scale / VELOCITY_UNIT_M_S) ** 2] * 3)
            weight.append(0.5 * multivariate_normal.pdf(z, np.zeros(6), s + prior))
            change.append((prior @ np.linalg.solve(s + prior, z))[3:] * VELOCITY_UNIT_M_S)
    weight, change = np.array(weight), np.array(change)
    rate = 0.3 * TIME_UNIT_S / SECONDS_PER_DAY
    expected = np.log(rate * width * weight.sum() / 200.0) - REGION.log_density
    assert found.log_ratio[0] == pytest.approx(expected, abs=0.02)
    share = weight / weight.sum()
    mean = share @ np.repeat(times, 2)
    sigma = np.sqrt(share @ (np.repeat(times, 2) - mean) ** 2)
    assert abs(found.time[0] - mean) < 0.05 * sigma
    assert found.time_sigma[0] == pytest.approx(sigma, rel=0.05)
    spread = np.sqrt(np.diag(found.velocity_covariance[0]))
    assert np.all(np.abs(found.velocity_m_s[0] - share @ change) < 0.05 * spread)


def test_other_objects_are_not_connected():
    """Without the orbit before, the orbit after a maneuver is of a new object."""
    angles, fits, _ = arcs((-20.0, 30.0, 5.0))
    none = lineage(angles, fits, np.array([0, 1, 1, 0, 0], dtype=bool), np.arange(5) == 3)
    assert none.before.size == 0 and none.state.shape == (0, 6)
    assert none.velocity_covariance.shape == (0, 3, 3)


def test_errors_of_time_velocity_and_state_are_those_of_the_covariance():
    squared = []
    for seed in range(20):
        angles, fits, truth = arcs((2.0, -6.0, 4.0), n_observers=2, seed=seed)
        found = lineage(angles, fits, np.arange(5) == 0, np.arange(5) == 3)
        change = found.velocity_m_s[0] - (2.0, -6.0, 4.0)
        state = found.state[0] - truth[3]
        squared.append((
            ((found.time[0] - MANEUVER * STEP) / found.time_sigma[0]) ** 2,
            change @ np.linalg.solve(found.velocity_covariance[0], change) / 3.0,
            state @ np.linalg.solve(found.covariance[0], state) / 6.0,
        ))  # fmt: skip
    # chi squared with 20, 60 and 120 degrees of freedom
    mean = np.mean(squared, axis=0)
    assert np.all(np.abs(mean - 1.0) < 4.0 * np.sqrt(2.0 / np.array([20.0, 60.0, 120.0])))


def test_the_orbit_after_a_maneuver_replaces_the_one_before():
    """A candidate after the maneuver is confirmed, with its state from both orbits."""
    angles, fits, _ = arcs((-20.0, 30.0, 5.0))
    given = {"forces": EARTH_MOON, "region": REGION, "linking": LinkingSettings()}
    sure = [True, True, True, False, True]
    orbits, averaged, status, found = maneuvered_orbits(
        linked(fits, sure), angles, settings=SETTINGS, **given
    )
    assert status[0] == SUPERSEDED and status[3] == CURRENT
    assert not orbits.confirmed[0] and orbits.confirmed[3]
    pair = found.after.tolist().index(3)
    np.testing.assert_array_equal(orbits.fits.state[3], found.state[pair])
    root = orbits.fits.root[3]
    np.testing.assert_allclose(root.T @ root, found.covariance[pair], rtol=1e-9)
    np.testing.assert_array_equal(orbits.fits.state[2], fits.state[2])
    own = maneuvers_within(fits, angles, forces=EARTH_MOON, settings=SETTINGS).averaged
    np.testing.assert_array_equal(averaged.state[2], own.state[2])
    # the object may be another one, or have maneuvered again: then the later orbit alone is right
    days = (fits.epoch[3] - found.time[pair]) * TIME_UNIT_S / SECONDS_PER_DAY
    share = found.probability[pair] * np.exp(-SETTINGS.maneuvers_per_day * days)
    apart = found.state[pair] - own.state[3]
    expected = own.state[3] + share * apart
    np.testing.assert_allclose(averaged.state[3], expected, rtol=1e-12, atol=1e-14)
    expected = share * found.covariance[pair] + (1.0 - share) * own.covariance[3]
    expected += share * (1.0 - share) * np.outer(apart, apart)
    np.testing.assert_allclose(averaged.covariance[3], expected, rtol=1e-9)
    assert 0.9 < share < found.probability[pair]
    # a candidate whose predecessor is not confirmed stays one
    orbits, _, status, found = maneuvered_orbits(
        linked(fits, [False, True, True, False, True]), angles, settings=SETTINGS, **given
    )
    assert not orbits.confirmed[3] and status[0] == CURRENT


def mixed_arcs(taken=slice(-3, None)):
    """Angles and orbits of `arcs` with a small maneuver, the orbit after which has `taken` some
    detections from before it; fits to these, and the true rows before and after it."""
    angles, fits, _ = arcs((0.2, -0.4, 0.1))
    before, after = fits.row[fits.begin[0] : fits.begin[1]], fits.row[fits.begin[3] :]
    after = after[: fits.begin[4] - fits.begin[3]]
    moved_rows = before[taken]
    rows = [np.setdiff1d(before, moved_rows), np.union1d(moved_rows, after)]
    mixed = fit_orbits(angles, rows, fits.state[[0, 3]], fits.epoch[[0, 3]], forces=EARTH_MOON)
    return angles, replaced(fits, (0, 3), mixed), mixed, before, after


def plain_fit(angles):
    return lambda rows, state, epoch: fit_orbits(angles, rows, state, epoch, forces=EARTH_MOON)


def test_the_detections_of_overlapping_orbits_are_divided_at_the_maneuver():
    angles, both, mixed, before, after = mixed_arcs()
    fit = plain_fit(angles)
    paths = orbit_paths(both, 0.0, AFTER[-1] * STEP, forces=EARTH_MOON)
    assert (0, 3) in overlapping_pairs(both, angles, paths, 300.0)

    parts = divided(both, angles, (0, 3), 1e-4, fit, EARTH_MOON)
    assert parts.chi_squared.sum() <= mixed.chi_squared.sum()
    # no detection from after the maneuver is before it; the few from before may be on either side
    assert angles.time[parts.row[: parts.begin[1]]].max() <= BEFORE[-1] * STEP
    # by brute force over all divisions of the rows next to the ends
    rows, totals = np.union1d(before, after), {}
    for k in range(before.size - 6, before.size + 7):
        one = fit([rows[:k], rows[k:]], both.state[[0, 3]], both.epoch[[0, 3]])
        if angles.time[rows[k]] > angles.time[rows[k - 1]]:
            totals[k] = one.chi_squared.sum()
    assert parts.chi_squared.sum() <= min(totals.values()) * (1.0 + 1e-6)

    # each at the time of its last detection, whatever that of the given orbits
    elsewhere = refit_at(both, angles, both.epoch + 20.0 * STEP)
    parts = divided(elsewhere, angles, (0, 3), 1e-4, fit, EARTH_MOON)
    last = angles.time[parts.row[parts.begin[1:] - 1]]
    np.testing.assert_array_equal(parts.epoch, last)
    assert np.all(np.abs(elsewhere.epoch[[0, 3]] - last) > 5.0 * STEP)


def test_orbits_with_divided_detections_are_searched_again_and_the_others_are_not():
    """Against a search of all orbits with the divided detections."""
    angles, both, *_ = mixed_arcs(slice(-3, -1))  # so that their times overlap
    given = {"forces": EARTH_MOON, "settings": SETTINGS}
    sure = linked(both, [True, True, True, False, True])
    orbits, averaged, status, found = maneuvered_orbits(
        sure, angles, region=REGION, linking=LinkingSettings(), **given
    )
    parts = divided(both, angles, (0, 3), 1e-4, plain_fit(angles), EARTH_MOON)
    fits, own, within = maneuvers_within(replaced(both, (0, 3), parts), angles, **given)
    np.testing.assert_array_equal(orbits.fits.row, fits.row)
    expected = lineage(angles, fits)
    np.testing.assert_array_equal(found.before, [*expected.before, *within.before])
    assert (0, 3) in zip(found.before.tolist(), found.after.tolist(), strict=True)
    ratio = [*expected.log_ratio, *within.log_ratio]
    np.testing.assert_allclose(found.log_ratio, ratio, rtol=1e-6, atol=1e-6)
    np.testing.assert_array_equal(orbits.fits.state[[1, 2, 4]], fits.state[[1, 2, 4]])
    # orbit 3 has the state of both
    np.testing.assert_array_equal(averaged.row, fits.row)
    np.testing.assert_array_equal(averaged.state[[0, 1, 2, 4]], own.state[[0, 1, 2, 4]])
    assert not np.array_equal(averaged.covariance[0], orbits.fits.covariance[0])
    assert status[0] == SUPERSEDED and orbits.confirmed[3]


def test_nothing_but_the_averaged_covariances_changes_for_objects_that_do_not_maneuver():
    """A survey with and without assumed maneuvers."""
    off = surveyed()
    on = surveyed(settings=SURVEY.model_copy(update={"lineage": SETTINGS}))
    for one, other in ((on.states, off.states), (on.orbits, off.orbits)):
        same = [name for name in one if "averaged" not in name]
        assert one[same].equals(other[same])
    assert off.states["confirmed"].iloc[-1] >= 3
    assert off.averaged is off.linked.fits
    spread, least = (
        np.trace(each.covariance[:, :3, :3], axis1=1, axis2=2)
        for each in (on.averaged, on.linked.fits)
    )
    assert np.all(spread >= least * (1.0 - 1e-9)) and np.any(spread > 1.01 * least)
