"""Covariance intersection against optimized weights, catalogs against single observers."""

import numpy as np
import pytest
from measured import draw_truth
from scipy.optimize import minimize

from cislunar.dynamics.cr3bp import EARTH_MOON
from cislunar.errors import ConfigurationError
from cislunar.estimation.fusion.catalogs import catalogs
from cislunar.estimation.fusion.intersection import intersect
from cislunar.estimation.fusion.methods import FUSIONS
from cislunar.estimation.registry import estimator_named
from cislunar.observation.measurement import measure
from cislunar.observation.records import pointed_schedule, rows_of
from cislunar.observation.sensor import Sensor
from cislunar.tasking.closed_loop import run_closed_loop
from cislunar.tasking.demonstration import tracking_problem
from cislunar.tasking.initial_conditions import initial_estimate

BRIGHT = Sensor(limiting_magnitude=22.0)


def _random(rng, count, n=6):
    roots = rng.normal(size=(count, n, n)) * 10.0 ** rng.uniform(-3.0, 0.0, (count, n, 1))
    return rng.normal(size=(count, n)), roots @ np.swapaxes(roots, 1, 2)


def covariance_intersection(mean, covariance):
    """Fused mean, covariance and weights of estimates, from equal weights."""
    means, covariances = np.array(mean, dtype=float), np.array(covariance, dtype=float)
    count, n = means.shape
    weight, fused, spread = np.full(count, 1.0 / count), np.empty(n), np.empty((n, n))
    assert intersect(means, covariances, np.ones(count, dtype=bool), weight, fused, spread)
    return fused, spread, weight


def test_equal_estimates_have_equal_weights():
    covariance = np.array([np.diag([1.0, 4.0]), np.diag([4.0, 1.0])])
    weight = covariance_intersection(np.zeros((2, 2)), covariance)[2]
    np.testing.assert_allclose(weight, 0.5, atol=0.005)


def test_weights_are_those_of_the_smallest_determinant():
    rng = np.random.default_rng(1)
    for count in (1, 2, 3, 5):
        mean, covariance = _random(rng, count)
        fused, combined, weight = covariance_intersection(mean, covariance)
        inverse = np.linalg.inv(covariance)
        assert weight.sum() == pytest.approx(1.0) and np.all(weight >= 0.0)
        total = np.einsum("i,iab->ab", weight, inverse)
        np.testing.assert_allclose(combined @ total, np.eye(6), atol=1e-6)
        expected = combined @ np.einsum("i,iab,ib->a", weight, inverse, mean)
        np.testing.assert_allclose(fused, expected, rtol=1e-6, atol=1e-8)

        def cost(free, inverse=inverse):
            share = np.exp(free - free.max())
            total = np.einsum("i,iab->ab", share / share.sum(), inverse)
            return -np.linalg.slogdet(total)[1]

        best = minimize(cost, np.zeros(count), method="BFGS").fun
        assert np.linalg.slogdet(combined)[1] <= best + 0.06
        assert np.linalg.slogdet(combined)[1] <= np.linalg.slogdet(covariance)[1].min() + 0.06


def test_no_correlation_makes_the_intersection_overconfident():
    """Errors of all estimates are as correlated as their covariances allow."""
    rng = np.random.default_rng(2)
    _, covariance = _random(rng, 3)
    roots = np.linalg.cholesky(covariance)
    draws = rng.normal(size=(4000, 6))
    errors = np.einsum("iab,sb->sia", roots, draws)
    combined, weight = covariance_intersection(np.zeros((3, 6)), covariance)[1:]
    gains = np.einsum("ab,i,ibc->iac", combined, weight, np.linalg.inv(covariance))
    fused = np.einsum("iab,sib->sa", gains, errors)
    excess = np.linalg.eigvals(np.linalg.solve(combined, np.cov(fused.T))).real.max()
    assert excess < 1.1


def test_an_unknown_fusion_is_refused():
    with pytest.raises(ConfigurationError, match="fusion = 'best' must be one of"):
        catalogs(estimator_named("mukf"), "best")
    for other in (None, 3, np.nan, ["common"], np.array(["common", "alone"])):
        with pytest.raises(ConfigurationError, match=r"fusion = .* must be one of common"):
            catalogs(estimator_named("mukf"), other)


@pytest.fixture(scope="module")
def problem():
    return tracking_problem(3, 4, duration_hours=3.0, sensor=BRIGHT)


@pytest.mark.parametrize("fusion", ["alone", "covariance-intersection"])
def test_catalogs_are_those_of_observers_alone(problem, fusion):
    scene, surfaces, epoch, ids, loop = problem
    initial = initial_estimate(epoch, loop.initial.components())
    truth = draw_truth(initial, scene, BRIGHT.noise, 3, ids)
    # target 3 is never observed, target 0 by all in turn, target 1 by the second observer only
    pointing = np.array([[0, 1, 2]] * 60 + [[2, 0, -1]] * 60 + [[-1, 1, 0]] * 60)
    states = truth.translation, truth.quaternion, truth.noise
    plan = pointed_schedule(pointing, 4)
    records = measure(1, plan, scene, surfaces, BRIGHT, *states)[0]
    factory = estimator_named("mukf")
    given = scene, surfaces, BRIGHT, initial
    together = catalogs(factory, fusion)(*given, np.random.default_rng(0), EARTH_MOON)
    found = together.advance(records, covariance=True)
    alone = []
    for o in range(3):
        own = factory(*given, np.random.default_rng(0), EARTH_MOON)
        alone.append(own.advance(records.where(records.observer == o), covariance=True))
    np.testing.assert_allclose(found.translation[1], alone[1].translation[1], rtol=1e-12)
    np.testing.assert_allclose(found.sigma[3], alone[0].sigma[3], rtol=1e-12)
    size = np.array([np.linalg.slogdet(each.covariance[0, -1])[1] for each in alone])
    fused = np.linalg.slogdet(found.covariance[0, -1])[1]
    if fusion == "alone":
        assert fused == pytest.approx(size.min())
        best = alone[int(np.argmin(size))]
        np.testing.assert_array_equal(found.translation[0, -1], best.translation[0, -1])
    else:
        assert fused < size.min()
        expected = covariance_intersection(
            [each.translation[0, -1] for each in alone],
            [each.covariance[0, -1] for each in alone],
        )
        # weights start from those of the previous step: as good, not the same
        assert fused == pytest.approx(np.linalg.slogdet(expected[1])[1], abs=0.06)
        away = found.translation[0, -1] - expected[0]
        assert away @ np.linalg.solve(expected[1], away) < 0.1**2
    rows = np.concatenate([each.used for each in alone])
    assert found.used.sum() == rows.sum() and found.used.any()
    counted = np.bincount(rows_of(records)[0][found.used], minlength=4)
    np.testing.assert_array_equal(together.counters[:, 0], counted)
    prediction = together.predict()
    np.testing.assert_array_less(0.0, np.linalg.eigvalsh(prediction.covariance)[:, 0])
    assert np.all(np.isfinite(found.quaternion)) and not together.failed.any()
    with pytest.raises(ConfigurationError, match=r"added with fusion = 'common' only$"):
        together.add(initial, surfaces)
    with pytest.raises(ConfigurationError, match=r"removed with fusion = 'common' only$"):
        together.remove([0])


def test_shared_measurements_reduce_errors():
    problem = tracking_problem(4, 6, duration_hours=8.0, sensor=BRIGHT, record_every=60)
    errors = []
    for fusion in FUSIONS[1:] + FUSIONS[:1]:
        factory = estimator_named("mukf")
        factory = catalogs(factory, fusion)
        result = run_closed_loop(*problem[:4], (0, 1, 2), problem.loop, estimator=factory)
        away = np.linalg.norm(result.error[:, -1, :, 6:9], axis=-1)
        errors.append(np.exp(np.mean(np.log(away))))
    assert errors[0] > 2.0 * max(errors[1:])
