"""Least-squares orbits against SciPy, Monte Carlo, light time by iteration, and exact geometry."""

import numpy as np
import pytest
from detected_object import HALO, OBSERVERS, paths
from nights import HOUR, OBJECTS, SIGMA, night
from scipy.optimize import least_squares

from cislunar.constants import LENGTH_UNIT_KM, TIME_UNIT_S
from cislunar.dynamics import propagate, propagate_many
from cislunar.errors import ConfigurationError
from cislunar.orbit_determination import (
    CONVERGED,
    NOT_PROPAGATED,
    SINGULAR,
    AdmissibleRegion,
    attributables,
    fit_orbits,
    make_angles,
    pair_starts,
)

TIMES = np.array([0.0, 1 / 6, 2.0, 2 + 1 / 6, 5.0, 5 + 1 / 6]) * HOUR
OWNERS = np.array([0, 0, 1, 1, 0, 0])


def lines(state, times, owners):
    return propagate(state, times, method="dop853")[:, :3] - paths(OBSERVERS, times, owners)


def noisy(vectors, rng, sigma=SIGMA):
    unit = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return unit + sigma * rng.normal(size=vectors.shape)


def test_the_solution_and_its_covariance_are_those_of_scipy():
    rng = np.random.default_rng(1)
    at, way = paths(OBSERVERS, TIMES, OWNERS), lines(HALO, TIMES, OWNERS)
    angles = make_angles(TIMES, OWNERS, at, noisy(way, rng), SIGMA)

    def residuals(state):
        way = lines(state, TIMES, OWNERS)
        along = np.einsum("ni,ni->n", way, angles.direction)
        return (np.einsum("nai,ni->na", angles.basis, way) / along[:, None]).ravel() / SIGMA

    expected = least_squares(
        residuals, HALO, method="lm", diff_step=1e-6, xtol=1e-14, ftol=1e-14, gtol=1e-14
    )
    found = fit_orbits(angles, [np.arange(6)], HALO[None] + 1e-3, 0.0)
    assert found.status.tolist() == [CONVERGED] and found.degrees.tolist() == [6]
    covariance = np.linalg.inv(expected.jac.T @ expected.jac)
    sigma = np.sqrt(np.diag(covariance))
    assert np.abs((found.state[0] - expected.x) / sigma).max() < 2e-3
    assert found.chi_squared[0] == pytest.approx(2.0 * expected.cost, abs=1e-5)
    np.testing.assert_allclose(
        found.covariance[0] / np.outer(sigma, sigma), covariance / np.outer(sigma, sigma), atol=2e-3
    )


def test_the_covariance_is_that_of_repeated_measurements():
    rng, n = np.random.default_rng(2), 800
    exact, at = lines(HALO, TIMES, OWNERS), paths(OBSERVERS, TIMES, OWNERS)
    errors, chi_squared = [], []
    for _ in range(n):
        angles = make_angles(TIMES, OWNERS, at, noisy(exact, rng), SIGMA)
        fit = fit_orbits(angles, [np.arange(6)], HALO[None], 0.0)
        errors.append(fit.state[0] - HALO)
        chi_squared.append(fit.chi_squared[0])
    root = np.linalg.cholesky(fit.covariance[0])
    white = np.linalg.solve(root, np.transpose(errors))
    # six standard errors of a variance and of a covariance
    assert np.abs(white @ white.T / n - np.eye(6)).max() < 6.0 * np.sqrt(2.0 / n)
    assert np.mean(chi_squared) == pytest.approx(6.0, abs=6.0 * np.sqrt(12.0 / n))


def test_normalized_errors_of_many_objects_are_consistent():
    """Objects about the libration points and in resonances, in three tracklets of two observers,
    without a first guess: starts through pairs of tracklets, and the solution of least chi
    squared."""
    rng, n = np.random.default_rng(3), 240
    base = np.array(
        [HALO, [0.82, 0.0, 0.05, 0.0, 0.15, 0.0], [0.2, 0.0, 0.0, 0.0, 2.6, 0.0],
         [0.5, 0.8, 0.0, 0.0, 0.0, 0.1], [-0.9, 0.0, 0.1, 0.0, 0.1, 0.0]]
    )  # fmt: skip
    truth = base[np.arange(n) % 5] + rng.normal(scale=0.02, size=(n, 6))
    path = propagate_many(truth, TIMES, method="dop853")[:, :, :3]
    at, errors, region = paths(OBSERVERS, TIMES, OWNERS), [], AdmissibleRegion()
    pairs, chi_squared = np.array([[0, 1], [1, 2]]), []
    for k in range(n):
        angles = make_angles(TIMES, OWNERS, at, noisy(path[k] - at, rng), SIGMA)
        tracklets = attributables(angles, [[0, 1], [2, 3], [4, 5]])
        starts = pair_starts(tracklets, pairs, region)
        fits = fit_orbits(angles, [np.arange(6)] * len(starts.state), starts.state, starts.time)
        good = np.flatnonzero(fits.status == CONVERGED)
        best = good[np.argmin(fits.chi_squared[good])]
        start = propagate(fits.state[best], [-fits.epoch[best]], method="dop853")
        fit = fit_orbits(angles, [np.arange(6)], start, 0.0)
        error = fit.state[0] - truth[k]
        errors.append(error @ np.linalg.solve(fit.covariance[0], error))
        chi_squared.append(fit.chi_squared[0])
    assert len(errors) == n
    assert 5.5 < np.mean(errors) < 7.0 and max(errors) < 40.0
    assert np.mean(chi_squared) == pytest.approx(6.0, abs=5.0 * np.sqrt(12.0 / n))


def test_light_time_is_that_of_an_iteration_in_inertial_axes():
    delay = LENGTH_UNIT_KM / (299_792.458 * TIME_UNIT_S)

    def inertial(vector, t):
        c, s = np.cos(t), np.sin(t)
        return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1], vector[2]])

    at, seen = paths(OBSERVERS, TIMES, OWNERS), []
    for t, place in zip(TIMES, at, strict=True):
        tau = 0.0
        for _ in range(10):
            there = propagate(HALO, [t - tau], method="dop853")[0, :3]
            way = inertial(there, t - tau) - inertial(place, t)
            tau = delay * np.linalg.norm(way)
        seen.append(inertial(way, -t))
    rows = [np.arange(6)]
    with_light = make_angles(TIMES, OWNERS, at, seen, SIGMA, light_time=True)
    exact = fit_orbits(with_light, rows, HALO[None], 0.0)
    late = fit_orbits(with_light._replace(light_delay=0.0), rows, HALO[None], 0.0)
    km = [np.linalg.norm(fit.state[0, :3] - HALO[:3]) * LENGTH_UNIT_KM for fit in (exact, late)]
    assert km[0] < 1e-3 < 0.05 < km[1]


def test_fits_do_not_depend_on_others_and_report_failures():
    rng = np.random.default_rng(4)
    at = paths(OBSERVERS, TIMES, OWNERS)
    angles = make_angles(TIMES, OWNERS, at, noisy(lines(HALO, TIMES, OWNERS), rng), SIGMA)
    behind = HALO.copy()
    behind[:3] = 2.0 * at[0] - HALO[:3]
    starts = np.array([HALO, behind, HALO + 1e-3])
    rows = [np.arange(6), np.arange(6), np.array([0, 2, 3, 5])]
    together = fit_orbits(angles, rows, starts, 0.0)
    assert together.status.tolist() == [CONVERGED, NOT_PROPAGATED, CONVERGED]
    assert np.all(np.isnan(together.covariance[1])) and np.isinf(together.chi_squared[1])
    for k in (0, 2):
        alone = fit_orbits(angles, [rows[k]], starts[k : k + 1], 0.0)
        np.testing.assert_array_equal(alone.state[0], together.state[k])
        np.testing.assert_array_equal(alone.covariance[0], together.covariance[k])
        taken = together.take([k])
        np.testing.assert_array_equal(taken.position, alone.position)
    # three directions of one observer at one time leave the velocity open
    same = make_angles(
        np.zeros(3), np.zeros(3, int), at[[0, 0, 0]], angles.direction[[0, 0, 0]], SIGMA
    )
    assert fit_orbits(same, [np.arange(3)], HALO[None], 0.0).status.tolist() == [SINGULAR]


def test_a_prior_counts_as_the_angles_that_it_was_fitted_to():
    angles, _ = night(OBJECTS[:3], np.arange(0.0, 30.0, 1.5), 0.0, 31)
    origin = np.arange(angles.time.size) % 3
    every = [np.flatnonzero(origin == k) for k in range(3)]
    early = [rows[angles.time[rows] < 20.0 * HOUR] for rows in every]
    late = [np.setdiff1d(*pair) for pair in zip(every, early, strict=True)]
    epoch = np.full(3, 20.0 * HOUR)
    start = np.array([propagate(state, epoch[:1])[0] for state in OBJECTS[:3]])
    prior = fit_orbits(angles, early, start, epoch)
    assert prior.status.tolist() == [CONVERGED] * 3
    # the third has none, and is fitted to all angles
    prior.status[2] = NOT_PROPAGATED
    found = fit_orbits(angles, [*late[:2], every[2]], prior.state, epoch, prior=prior)
    exact = fit_orbits(angles, every, start, epoch)
    assert found.degrees.tolist() == exact.degrees.tolist()
    np.testing.assert_allclose(found.chi_squared, exact.chi_squared, atol=1e-3)
    for k in range(3):
        sigma = np.sqrt(np.diag(exact.covariance[k]))
        assert np.abs((found.state[k] - exact.state[k]) / sigma).max() < 1e-3
        outer = np.outer(sigma, sigma)
        np.testing.assert_allclose(
            found.covariance[k] / outer, exact.covariance[k] / outer, atol=1e-3
        )
    # one row is enough with a prior
    assert (
        fit_orbits(angles, [late[0][:1]], start[:1], epoch[:1], prior=prior.take([0])).status == 0
    )
    with pytest.raises(ConfigurationError, match="fit 0 has 0 directions; a prior needs one"):
        fit_orbits(angles, [[]], start[:1], epoch[:1], prior=prior.take([0]))
    flat = prior.take([0])._replace(root=np.zeros((1, 6, 6)))
    with pytest.raises(ConfigurationError, match="prior: a covariance is singular"):
        fit_orbits(angles, late[:1], start[:1], epoch[:1], prior=flat)
    with pytest.raises(ConfigurationError, match="prior: 3 fits; give one for each state"):
        fit_orbits(angles, late[:2], start[:2], epoch[:2], prior=prior)
    with pytest.raises(ConfigurationError, match="prior: the epochs of the fits differ"):
        fit_orbits(angles, late[:2], start[:2], epoch[:2] + 1.0, prior=prior.take([0, 1]))


def test_bad_input_is_refused_in_one_line():
    at, way = paths(OBSERVERS, TIMES, OWNERS), lines(HALO, TIMES, OWNERS)
    angles = make_angles(TIMES, OWNERS, at, way, SIGMA)
    nowhere = way.copy()
    nowhere[2] = 0.0
    for call, words in (
        (lambda: fit_orbits(angles, [np.arange(2)], HALO[None], 0.0), "at least three"),
        (lambda: fit_orbits(angles, [], HALO[None], 0.0), "rows: sets 0, states 1"),
        (lambda: fit_orbits(angles, [[0, 1, 6]], HALO[None], 0.0), "rows: 6 must be"),
        (lambda: fit_orbits(angles, [[0, 2, 1]], HALO[None], 0.0), "rows of a fit do not increase"),
        (lambda: fit_orbits(angles, [range(6)], [HALO[:3]] * 2, 0.0), "state has shape"),
        (lambda: fit_orbits(angles, [range(6)], HALO[None], [0.0, 1.0]), "epoch has shape"),
        (lambda: make_angles(TIMES[::-1], OWNERS, at, way, SIGMA), "sort the rows"),
        (lambda: make_angles(TIMES, OWNERS, at, nowhere, SIGMA), "direction of row 2"),
        (lambda: make_angles(TIMES, OWNERS, at, way, 0.0), "sigma_rad of row 0"),
        (lambda: make_angles(TIMES, OWNERS * 0.5, at, way, SIGMA), "whole numbers"),
        (lambda: make_angles(TIMES, OWNERS, at * np.nan, way, SIGMA), "not finite"),
        (lambda: fit_orbits(angles, [np.arange(6)], HALO[None], 0.0, forces=3), "force model"),
    ):
        with pytest.raises(ConfigurationError, match=words) as caught:
            call()
        assert "\n" not in str(caught.value)
