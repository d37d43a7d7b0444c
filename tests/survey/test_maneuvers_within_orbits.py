"""Maneuvers within the detections of a single orbit."""

import numpy as np
import pytest
from maneuvered_arcs import MANEUVER, PROBLEM, SETTINGS, SIGMA, STEP, WHOLE, moved
from scipy.special import chdtri
from scipy.stats import multivariate_normal

from cislunar.constants import SECONDS_PER_DAY, TIME_UNIT_S
from cislunar.dynamics import EARTH_MOON, VELOCITY_UNIT_M_S, propagate, propagate_many
from cislunar.orbit_determination import fit_orbits, make_angles
from cislunar.survey import LineageSettings
from cislunar.survey.maneuvers import maneuvers_within
from cislunar.survey.maneuvers import within as module


def whole_arc(change_m_s, seed, maneuver=MANEUVER, minutes=WHOLE):
    """Orbit fitted to the angles of the first object, which changes its velocity once or more."""
    rng, scene = np.random.default_rng(seed), PROBLEM.scene
    impulses = np.atleast_2d(change_m_s) / VELOCITY_UNIT_M_S
    begin, state, parts = 0.0, moved(PROBLEM.epoch[0], [0.0])[0], []
    for end, impulse in zip([*np.atleast_1d(maneuver), np.inf], [*impulses, None], strict=True):
        own = minutes[(minutes >= begin) & (minutes < end)]
        parts.append(propagate(state, (own - begin) * STEP, method="dop853"))
        if impulse is not None:
            state = propagate(state, [(end - begin) * STEP], method="dop853")[0]
            state, begin = state + np.concatenate([np.zeros(3), impulse]), end
    states = np.concatenate(parts)
    minute, observer = (each.ravel() for each in np.meshgrid(minutes, range(3), indexing="ij"))
    here = scene.observer_position[observer, minute]
    unit = np.repeat(states[:, :3], 3, axis=0) - here
    unit /= np.linalg.norm(unit, axis=1)[:, None]
    unit += SIGMA * rng.standard_normal(unit.shape)
    angles = make_angles(minute * STEP, observer, here, unit, SIGMA)
    rows = [np.arange(minute.size)]
    fits = fit_orbits(angles, rows, states[-1:], minutes[-1] * STEP, forces=EARTH_MOON)
    return angles, fits, states[-1]


def test_sums_over_detections_give_what_derivatives_by_impulses_give():
    """With derivatives by other parameters, their priors, and detections at equal times."""
    rng, count, width = np.random.default_rng(3), 12, 0.3
    time = np.sort(rng.integers(0, 9, count)).astype(float)
    design, residual = rng.standard_normal((2 * count + 4, 10)), rng.standard_normal(2 * count + 4)
    design[2 * count :, :6] = 0.0
    q = np.linalg.qr(design)[0]
    left = residual - q @ (q.T @ residual)
    search = module._Search.__new__(module._Search)
    search.time, search.rate, search.scales = time, 2.0, np.array([[0.1], [1.0], [30.0]])
    at, by_velocity = np.array([0.5, 3.0, 3.5, 9.0]), rng.standard_normal((4, 6, 3))
    found = search._integrand(search._sums(q, left), q.T @ design[:, :6], at, by_velocity, width)
    for k, own in enumerate(by_velocity):
        impulse = -design[:, :6] @ own
        impulse[: 2 * count][np.repeat(time >= at[k], 2)] = 0.0
        free = impulse - q @ (q.T @ impulse)
        np.testing.assert_allclose(found[3][k], q.T @ impulse, atol=1e-12)
        for i, scale in enumerate(search.scales[:, 0]):
            spread = np.linalg.inv(free.T @ free + np.eye(3) / scale**2)
            change = spread @ free.T @ residual
            whole = np.linalg.slogdet(np.eye(3) + scale**2 * free.T @ free)[1]
            part = 0.5 * (residual @ free @ change - whole) + np.log(2.0 * width / 3.0)
            np.testing.assert_allclose(found[0][i, k], part, rtol=1e-10)
            np.testing.assert_allclose(found[1][i, k], change, atol=1e-10)
            np.testing.assert_allclose(found[2][i, k], spread, rtol=1e-8, atol=1e-10)


def within(angles, fits, settings=SETTINGS):
    return maneuvers_within(fits, angles, forces=EARTH_MOON, settings=settings)


def test_an_orbit_whose_detections_hide_a_maneuver_has_the_state_after_it():
    """Against single fits, which are biased by far more than their covariance."""
    settings = LineageSettings(maneuvers_per_day=1.5, scales_m_s=(0.3,))
    rng, squared, given = np.random.default_rng(8), [], []
    for seed in range(40):
        moves = seed % 2 == 0
        change, minute = 0.3 * moves * rng.standard_normal(3), rng.uniform(60.0, 480.0)
        angles, fits, truth = whole_arc(change, seed, minute)
        orbits, _, found = within(angles, fits, settings)
        if not found.before.size:
            continue
        assert moves
        np.testing.assert_array_equal(found.before, found.after)
        for one, out in ((orbits, squared), (fits, given)):
            error = one.state[0] - truth
            out.append(error @ np.linalg.solve(one.covariance[0], error) / 6.0)
        assert abs(found.time[0] - minute * STEP) < 5.0 * found.time_sigma[0]
        off = found.velocity_m_s[0] - change
        assert off @ np.linalg.solve(found.velocity_covariance[0], off) < 25.0
    assert 0.5 < np.mean(squared) < 1.6 and np.mean(given) > 20.0 and len(squared) >= 12


def test_averaged_orbits_are_consistent_where_decisions_are_not():
    """Maneuvers of the assumed rate and size, of which many leave no trace in the angles; the
    arithmetic mean of the normalized error counts."""
    settings = LineageSettings(maneuvers_per_day=12.0, scales_m_s=(3.0,))
    rng, decided, averaged = np.random.default_rng(8), [], []
    for seed in range(200):
        change = 3.0 * (rng.random() < 0.5) * rng.standard_normal(3)
        angles, fits, truth = whole_arc(
            change, seed, rng.uniform(0.0, 120.0), np.arange(0, 121, 20)
        )
        orbits = within(angles, fits, settings)
        for one, out in ((orbits.fits, decided), (orbits.averaged, averaged)):
            error = one.state[0] - truth
            out.append(error @ np.linalg.solve(one.covariance[0], error) / 6.0)
    assert 0.6 < np.mean(averaged) < 1.5 and np.mean(decided) > 20.0
    assert 0.92 < np.mean(np.array(averaged) <= chdtri(6, 0.05) / 6.0) < 0.99


def test_averaged_orbits_count_a_further_maneuver_after_an_uncertain_one():
    """Any number of maneuvers of the assumed rate and size; the first of several are often found
    with a moderate probability. If no further one counts after these, the mean is 2.0."""
    settings = LineageSettings(maneuvers_per_day=12.0, scales_m_s=(0.3,))
    rng, averaged = np.random.default_rng(5), []
    for seed in range(150):
        times = np.sort(rng.uniform(0.0, 240.0, rng.poisson(2.0)))
        change = 0.3 * rng.standard_normal((times.size, 3))
        angles, fits, truth = whole_arc(change, seed, times, np.arange(0, 241, 20))
        one = within(angles, fits, settings).averaged
        error = one.state[0] - truth
        averaged.append(error @ np.linalg.solve(one.covariance[0], error) / 6.0)
    assert 0.6 < np.mean(averaged) < 1.4


def test_averaged_moments_are_those_of_an_orbit_with_a_maneuver_and_of_one_without(monkeypatch):
    monkeypatch.setattr(module, "_MOST", 1)
    angles, fits, _ = whole_arc((0.25, -0.15, 0.2), 3, 300.0)
    settings = SETTINGS.model_copy(update={"scales_m_s": (0.5,)})
    none = within(angles, fits, settings.model_copy(update={"maneuvers_per_day": 0.0}))
    one = within(angles, fits, settings)
    uncertain = settings.model_copy(update={"least_probability": 0.5 + 1e-9})
    p = within(angles, fits, uncertain).lineage.probability[0]
    assert 0.5 < p < settings.least_probability and one.lineage.before.size == 0
    state = p * one.fits.state[0] + (1.0 - p) * none.averaged.state[0]
    second = sum(
        share * (each.covariance[0] + np.outer(each.state[0] - state, each.state[0] - state))
        for share, each in ((p, one.fits), (1.0 - p, none.fits))
    )
    np.testing.assert_allclose(one.averaged.state[0], state, rtol=0.0, atol=2e-9)
    np.testing.assert_allclose(one.averaged.covariance[0], second, rtol=1e-4)


def test_the_average_keeps_the_uncertainty_of_a_certain_maneuver():
    """Its time and size are uncertain, since there are no detections for hours."""
    minutes = np.concatenate([np.arange(0, 121, 10), np.arange(400, 521, 10)])
    angles, fits, _ = whole_arc((0.6, -0.5, 0.4), 5, 250.0, minutes)
    orbits = within(angles, fits, SETTINGS.model_copy(update={"scales_m_s": (1.0,)}))
    assert orbits.lineage.before.size == 1
    root = np.linalg.inv(np.linalg.cholesky(orbits.fits.covariance[0]))
    assert np.linalg.eigvalsh(root @ orbits.averaged.covariance[0] @ root.T)[0] > 1.0 - 1e-6


def test_averaged_covariances_resolve_the_time_next_to_the_last_detection(monkeypatch):
    """Against equal intervals of a second."""
    angles, fits, _ = whole_arc((0.0, 0.0, 0.0), 3)
    found = within(angles, fits).averaged
    monkeypatch.setattr(module, "_FINE_S", 1.0)
    monkeypatch.setattr(module, "_HALVINGS", 0)
    expected = within(angles, fits).averaged
    spread, true = (np.diag(each.covariance[0])[3:].sum() for each in (found, expected))
    assert spread == pytest.approx(true, rel=0.05)
    assert true > 100.0 * np.diag(fits.covariance[0])[3:].sum()


def test_the_ratio_for_a_maneuver_within_an_orbit_is_that_of_normal_distributions():
    """Densities of the residuals with derivatives by differences, and a wide prior of the state."""
    angles, fits, _ = whole_arc((2.0, -1.0, 3.0), 3, 100.3, np.arange(0, 181, 20))
    settings = SETTINGS.model_copy(update={"scales_m_s": (0.5,), "least_probability": 0.5 + 1e-9})
    found = within(angles, fits, settings).lineage
    state, epoch = fits.state[0], float(fits.epoch[0])

    def offsets(start, impulse=None):
        """Standardized offsets of predicted directions; the impulse (time, velocity) undone before
        its time."""
        paths = propagate_many(start[None], angles.time - epoch, method="dop853")[0]
        if impulse is not None:
            met = propagate(start, [impulse[0] - epoch], method="dop853")[0]
            met = met - np.concatenate([np.zeros(3), impulse[1]])
            early = angles.time < impulse[0]
            since = angles.time[early] - impulse[0]
            paths[early] = propagate_many(met[None], since, method="dop853")[0]
        way = paths[:, :3] - angles.observer_position
        along = np.sum(way * angles.direction, axis=1)[:, None]
        return (np.einsum("nac,nc->na", angles.basis, way) / along / SIGMA).ravel()

    base = offsets(state)
    by_state = np.array([
        (offsets(state + h) - offsets(state - h)) / 2e-7 for h in 1e-7 * np.eye(6)
    ]).T  # fmt: skip
    wide = by_state @ np.diag([1e-3] * 3 + [1e-2] * 3) ** 2 @ by_state.T + np.eye(base.size)
    none = multivariate_normal(cov=wide).logpdf(-base)
    span = angles.time[-1] - angles.time[0]
    count = int(np.ceil(span * TIME_UNIT_S / 60.0))
    logs = []
    for time in angles.time[0] + span * (np.arange(count) + 0.5) / count:
        ends = [
            [offsets(state, (time, side * h)) for side in (1.0, -1.0)] for h in 1e-6 * np.eye(3)
        ]
        by_velocity = np.array([(one - other) / 2e-6 for one, other in ends]).T
        more = (0.5 / VELOCITY_UNIT_M_S) ** 2 * by_velocity @ by_velocity.T
        logs.append(multivariate_normal(cov=wide + more).logpdf(-base) - none)
    rate = SETTINGS.maneuvers_per_day * TIME_UNIT_S / SECONDS_PER_DAY
    expected = np.log(rate * span * np.mean(np.exp(logs)))
    assert found.log_ratio[0] == pytest.approx(expected, abs=0.05)
