import numpy as np
import pytest
from measured import draw_truth, during, observed_by

from cislunar.dynamics.bundle import propagate_bundle
from cislunar.estimation.initial_sigma import ProcessNoise
from cislunar.estimation.kalman.gaussian_mixture import split, split_weights
from cislunar.estimation.kalman.mukf import MultiplicativeUKF
from cislunar.estimation.light_curves.batch import BatchEstimator
from cislunar.observation.records import Measurements, no_measurements, schedule
from cislunar.observation.sensor import Sensor
from cislunar.orbits.tracked import POLAR_ORBITS, polar_state
from cislunar.tasking.demonstration import tracking_problem
from cislunar.tasking.initial_conditions import initial_estimate

GAP, STRIDE = 300, 4
"""Steps of 60 s without a measurement, most of a lunar revolution; steps of a particle."""

ESTIMATORS = {
    "mukf": MultiplicativeUKF,
    "batch": lambda *given, **more: BatchEstimator(*given, np.random.default_rng(1), **more),
}


def test_a_split_keeps_the_moments():
    """Along the axis all moments to the fifth are normal; across it the covariance is kept."""
    rng = np.random.default_rng(2)
    root = np.tril(rng.standard_normal((6, 6))) + 4.0 * np.eye(6)
    mean, means, narrow = rng.standard_normal(6), np.empty((3, 6)), np.empty((6, 6))
    weights = split_weights()
    for axis in range(6):
        split(mean, root, axis, means, narrow)
        np.testing.assert_allclose(weights @ means, mean, rtol=1e-13)
        away = means - mean
        between = (away.T * weights) @ away
        np.testing.assert_allclose(between + narrow @ narrow.T, root @ root.T, rtol=1e-12)
        standard = np.linalg.solve(root, away.T)
        np.testing.assert_allclose(np.delete(standard, axis, axis=0), 0.0, atol=1e-13)
        place, variance = standard[axis], 1.0 - weights @ standard[axis] ** 2
        fourth = weights @ (place**4 + 6.0 * place**2 * variance + 3.0 * variance**2)
        assert fourth == pytest.approx(3.0, rel=1e-13)


def arrays(value):
    """The arrays in nested tuples."""
    if isinstance(value, list | tuple):
        for part in value:
            yield from arrays(part)
    else:
        yield value


@pytest.mark.parametrize("name", ESTIMATORS)
def test_without_a_split_the_estimates_are_the_same_bit_for_bit(name):
    """Halos and distant retrograde orbits, with and without measurements, and over a gap."""
    scene, surfaces, epoch, ids, loop = tracking_problem(5, 5, duration_hours=3.0)
    sensor = Sensor(limiting_magnitude=24.0)
    initial = initial_estimate(epoch, loop.initial.components())
    truth = draw_truth(initial, scene, sensor.noise, 3, ids)
    records, _ = observed_by([0, 1, 2, 3, -1], scene, surfaces, sensor, truth)
    found = []
    for splitting in (False, True):
        given = scene, surfaces, sensor, initial
        estimator = ESTIMATORS[name](*given, splitting=splitting)
        parts = [
            estimator.advance(during(records, 0, 30)),
            estimator.predict(),
            estimator.advance(no_measurements(5, 60)),
            estimator.advance(during(records, 90, 180)),
            estimator.predict(),
        ]
        assert parts[0].used.any() and parts[3].used.any()
        found.append(list(arrays(parts)))
    for alone, able in zip(*found, strict=True):
        np.testing.assert_array_equal(alone, able)


@pytest.fixture(scope="module")
def bent():
    """A lunar orbit observed again after five hours; its uncertainty is curved about the Moon."""
    sensor = Sensor(angle_noise_arcsec=60.0, field_of_view_deg=30.0)
    scene, surfaces, _, ids, loop = tracking_problem(1, 1, duration_hours=(GAP + 20) / 60.0)
    state, _ = polar_state(POLAR_ORBITS[5], 0.3)
    initial = initial_estimate(state[None], loop.initial.components())
    truth = draw_truth(initial, scene, sensor.noise, 8, ids)
    n_steps = scene.sun_position.shape[0] - 1
    steps = np.array([GAP, GAP + 16])
    observations = schedule(np.zeros(2, int), steps - 1, np.zeros(2, int), 1, n_steps)
    away = truth.translation[0, steps, :3] - scene.observer_position[0, steps]
    angles = _angles(away[:, None], scene.observer_axes[steps])[:, 0] + truth.noise[0, steps, 0, 1:]
    value = np.column_stack([np.full(2, 15.0), angles])
    records = Measurements(*observations, value, np.tile(sensor.noise**2, (2, 1)))
    return scene, surfaces, sensor, initial, truth, records, steps


def _angles(away, axes):
    """Right ascension and declination of lines (time, particle, 3) in the body frame."""
    seen = np.einsum("tab,tpb->tpa", axes, away)
    length = np.linalg.norm(seen, axis=-1)
    return np.stack(
        [np.arctan2(seen[..., 1], seen[..., 0]), np.arcsin(seen[..., 2] / length)], axis=-1
    )


def _particles(bent, process, count=200_000):
    """Mean, deviations and effective number of weighted particles after each observation.

    Process noise is added at every stride.
    """
    scene, _, sensor, initial, _, records, steps = bent
    rng = np.random.default_rng(5)
    states = initial.translation[0] + rng.standard_normal((count, 6)) * initial.sigma[6:]
    variance, both = process.covariance(STRIDE * scene.step_s)
    axis = np.array([[variance[6], both], [both, variance[9]]])
    root = np.linalg.cholesky(axis) if axis.any() else axis
    log = np.zeros(count)
    for k in range(STRIDE, steps[-1] + 1, STRIDE):
        states = propagate_bundle(states, STRIDE * scene.step, 1)[:, 1]
        kicks = np.einsum("ab,pbx->pax", root, rng.standard_normal((count, 2, 3)))
        states += kicks.reshape(count, 6)
        for n in np.flatnonzero(steps == k):
            away = states[None, :, :3] - scene.observer_position[0, k]
            off = records.value[n, 1:] - _angles(away, scene.observer_axes[[k]])[0]
            off = np.remainder(off + np.pi, 2.0 * np.pi) - np.pi
            log -= 0.5 * ((off / sensor.noise[1:]) ** 2).sum(axis=-1)
            weight = np.exp(log - log.max())
            weight /= weight.sum()
            mean = weight @ states
            yield mean, np.sqrt(weight @ (states - mean) ** 2), 1.0 / (weight**2).sum()


@pytest.fixture(scope="module", params=[0.0, 1e-5])
def judged(bent, request):
    process = ProcessNoise(acceleration_m2_s3=request.param)
    return process, list(_particles(bent, process))


@pytest.mark.parametrize("name", ESTIMATORS)
def test_a_curved_uncertainty_after_a_gap_is_that_of_particles(name, bent, judged):
    """After both observations, in all six components; the uncertainty is never too small."""
    scene, surfaces, sensor, initial, _, records, steps = bent
    process, by_particles = judged

    def off(splitting):
        estimator = ESTIMATORS[name](
            scene, surfaces, sensor, initial, splitting=splitting, process_noise=process
        )
        out = estimator.advance(records)
        assert out.used.all()
        for (mean, deviation, count), k in zip(by_particles, steps - 1, strict=True):
            assert count > 500
            shift = np.abs(out.translation[0, k] - mean) / deviation
            yield shift.max(), out.sigma[0, k, 6:] / deviation

    for shift, ratio in off(True):
        assert shift < 0.3
        assert ratio.min() > 0.9 and ratio.max() < 1.6
    alone = list(off(False))
    assert max(shift for shift, _ in alone) > 2.0
    assert min(ratio.min() for _, ratio in alone) < 0.8
