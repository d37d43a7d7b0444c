"""Observers that do not know exactly where they are and point, in the closed loop."""

import numpy as np
import pytest

from cislunar.association.model import AssociationModel
from cislunar.estimation.kalman.mukf import mukf
from cislunar.estimation.light_curves.batch import batch
from cislunar.estimation.navigation.errors import ERROR_UNITS, ObserverErrorSigma
from cislunar.estimation.navigation.factory import navigated
from cislunar.observation.sensor import Sensor
from cislunar.tasking import realization
from cislunar.tasking.closed_loop import run_closed_loop
from cislunar.tasking.communication.model import CommunicationModel
from cislunar.tasking.demonstration import tracking_problem
from cislunar.tasking.observer_truth import ObserverTruth, draw_observer_errors
from cislunar.tasking.truth import TruthModel

BRIGHT = Sensor(limiting_magnitude=25.0, angle_noise_arcsec=1.0)
SIGMA = ObserverErrorSigma(position_m=500, pointing_arcsec=5)
FACTORY = mukf(use_magnitude=False)


def run(sigma=None, constant=None, estimator=FACTORY, sensor=BRIGHT, n=(4, 5), **settings):
    """One realization of a small problem with errors of the observers."""
    settings = {"duration_hours": 3.0, "sensor": sensor} | settings
    scene, surfaces, epoch, ids, loop = tracking_problem(*n, **settings)
    truth = TruthModel(
        surfaces,
        sensor.noise,
        np.zeros(3),
        observer_sigma=ObserverErrorSigma() if sigma is None else sigma,
        observer_errors=constant,
    )
    given = scene, surfaces, epoch, ids, [3], loop
    return run_closed_loop(*given, estimator=estimator, truth=truth), scene


def treated(treatment, factory=FACTORY):
    return navigated(factory, treatment, SIGMA)


def test_measured_directions_are_those_of_the_true_observers():
    """Against positions and directions computed one by one, with hardly any noise."""
    constant = np.array([[900.0, -700, 500, 20, -30, 0.5], [-400.0, 800, 300, -10, 5, -1.0]])
    sharp = Sensor(limiting_magnitude=25.0, angle_noise_arcsec=1e-6)
    result, scene = run(constant=constant, sensor=sharp, n=(2, 2), record=("truth", "measurements"))
    log, true = result.observations, result.true_translation[0]
    seen = np.flatnonzero(np.isfinite(log.value[:, 0]))
    assert seen.size > 100
    believed = np.empty((seen.size, 2))
    for number, row in enumerate(seen):
        o, k = log.observer[row], log.step[row] + 1
        late = constant[o, 5] * scene.step / scene.step_s
        state = true[log.step[row], log.target[row]]
        step = scene.step
        position = scene.observer_position[o]
        near = slice(max(k - 1, 0), k + 2)
        velocity = np.gradient(position[near], step, axis=0)[1 if k > 0 else 0]
        there = state[:3] + late * state[3:]
        here = position[k] + late * velocity + constant[o, :3] * ERROR_UNITS[:3]
        c, s = np.cos(late), np.sin(late)
        way = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ (there - here)
        x, y, z = scene.observer_axes[k] @ way
        offset = constant[o, 3:5] * ERROR_UNITS[3:5]
        believed[number] = np.array([np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))]) + offset
    difference = np.angle(np.exp(1j * (log.value[seen, 1:] - believed)))
    assert np.abs(difference).max() < 1e-2 * ERROR_UNITS[3]  # 0.01 arcsec


def test_random_errors_have_their_sizes_and_streams():
    sigma = ObserverErrorSigma(100, 1000, 3, 6, 0.5)
    scene = tracking_problem(40, 1, duration_hours=24.0).scene
    drawn = draw_observer_errors(sigma, None, scene, 1)
    first, last = drawn.at(0), drawn.at(scene.sun_position.shape[0] - 1)
    np.testing.assert_allclose(first[:, :3].std(), 100, rtol=0.2)
    np.testing.assert_allclose((last - first)[:, :3].std(), 1000, rtol=0.2)
    np.testing.assert_allclose((last - first)[:, 3:5].std(), 6, rtol=0.2)
    np.testing.assert_allclose(first[:, 5].std(), 0.5, rtol=0.4)
    np.testing.assert_array_equal(first[:, 5], last[:, 5])
    few = tracking_problem(3, 1, duration_hours=24.0).scene
    np.testing.assert_array_equal(draw_observer_errors(sigma, None, few, 1).error, drawn.error[:3])
    assert not np.array_equal(draw_observer_errors(sigma, None, few, 2).error, drawn.error[:3])
    assert draw_observer_errors(ObserverErrorSigma(), None, few, 1) is None


@pytest.mark.parametrize("treatment", ["none", "considered", "calibrated"])
def test_estimates_and_tasking_do_not_see_the_truth(monkeypatch, treatment):
    """With the same measurements and a poisoned truth, all decisions and estimates stay."""
    kept = {}
    keep = {"record": ("estimates", "covariance")}
    original = realization._observed

    def watched(inputs, own, start, *rest):
        kept[start] = original(inputs, own, start, *rest)
        return kept[start][0], kept[start][1].copy()

    monkeypatch.setattr(realization, "_observed", watched)
    first, _ = run(SIGMA, estimator=treated(treatment), **keep)
    poisoned = lambda *_: ObserverTruth(np.full((4, 181, 6), np.nan))  # noqa: E731
    monkeypatch.setattr(realization, "draw_observer_errors", poisoned)
    monkeypatch.setattr(
        realization, "_observed", lambda _, own, start, *rest: (kept[start][0], kept[start][1])
    )
    again, _ = run(SIGMA, estimator=treated(treatment), **keep)
    for name in ("assignment", "estimated_translation", "covariance", "information"):
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))


@pytest.mark.parametrize("method", ["known-identity", "nearest-neighbor"])
def test_association_does_not_see_the_truth(monkeypatch, method):
    kept = {}
    field = {
        "record": ("estimates",),
        "association": AssociationModel(detections="all-in-field", method=method),
    }
    original = realization.observe_field

    def watched(inputs, own, start, *rest):
        kept[start] = original(inputs, own, start, *rest)
        return kept[start]._replace(outcome=kept[start].outcome.copy())

    monkeypatch.setattr(realization, "observe_field", watched)
    first, _ = run(SIGMA, estimator=treated("calibrated"), **field)
    poisoned = lambda *_: ObserverTruth(np.full((4, 181, 6), np.nan))  # noqa: E731
    monkeypatch.setattr(realization, "draw_observer_errors", poisoned)
    monkeypatch.setattr(realization, "observe_field", lambda _, own, start, *rest: kept[start])
    again, _ = run(SIGMA, estimator=treated("calibrated"), **field)
    for name in ("assignment", "estimated_translation", "associations"):
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))
    assert first.associations.sum() > 100
    assert first.wrong_associations.sum() == 0


def test_detections_in_the_field_have_the_errors_of_measurements(monkeypatch):
    """With known identities, every detection of a commanded target is its measurement."""
    field = AssociationModel(detections="all-in-field", method="known-identity")
    both = [
        run(SIGMA, record=("measurements",), association=each)[0].observations
        for each in (AssociationModel(), field)
    ]
    # the first interval, before any estimate can differ
    rows = []
    for log in both:
        good = np.isfinite(log.value[:, 0]) & (log.step < 60)
        own = zip(log.step[good], log.target[good], log.observer[good], strict=True)
        rows.append(dict(zip(own, log.value[good], strict=True)))
    common = set(rows[0]) & set(rows[1])
    assert len(common) > 100
    for key in common:
        np.testing.assert_allclose(rows[0][key][1:], rows[1][key][1:], atol=1e-4)


@pytest.mark.parametrize("factory", [FACTORY, batch("single-start")])
def test_treatments_restore_consistency_and_calibration_the_error(factory):
    """Directions with offsets of 5 arcsec, measured to 1 arcsec."""
    found = {}
    for treatment in ("none", "considered", "calibrated"):
        estimator = treated(treatment, factory)
        keep = {"record": ("covariance", "observers"), "duration_hours": 4.0}
        result, _ = run(SIGMA, estimator=estimator, n=(8, 5), **keep)
        late = result.elapsed_s > 2.0 * 3600.0
        error = result.error[0, late][..., 6:9].astype(float)
        covariance = result.covariance[0, late][..., :3, :3]
        whitened = np.linalg.solve(covariance, error[..., None])[..., 0]
        anees = (error * whitened).sum(axis=-1).mean() / 3.0
        found[treatment] = anees, np.linalg.norm(error, axis=-1).mean(), result
    assert found["none"][0] > 5.0
    assert found["considered"][0] < 2.5 and found["calibrated"][0] < 2.5
    assert found["calibrated"][1] < 0.8 * found["none"][1]
    own = found["calibrated"][2]
    left = own.observer_error[0] - own.estimated_observer_error[0]
    variance = np.diagonal(own.observer_error_covariance[0], axis1=-2, axis2=-1)
    some = slice(0, 5)
    ratio = left[-1][:, some] ** 2 / variance[-1][:, some]
    assert ratio.mean() < 2.5
    # knowledge of the offsets converges
    spread = np.sqrt(variance[:, :, 3:5].mean(axis=(1, 2)))
    assert np.all(np.diff(spread) < 0.0) and spread[-1] < 5.0
    assert np.isnan(found["none"][2].estimated_observer_error).all()


def test_late_measurements_are_calibrated_by_going_back():
    """After everything has arrived, the errors are known as without any delay."""
    late = CommunicationModel(delay_minutes=30)
    result, _ = run(
        SIGMA, estimator=treated("calibrated"), communication=late, record=("observers",)
    )
    assert np.isfinite(result.estimated_observer_error).all()
    assert not result.failed.any()


def test_a_random_walk_keeps_its_estimates_consistent():
    walk = ObserverErrorSigma(position_walk_m=3000, pointing_walk_arcsec=10)
    estimator = navigated(FACTORY, "calibrated", walk)
    keep = {"record": ("observers",), "duration_hours": 6.0}
    result, _ = run(walk, estimator=estimator, n=(8, 5), **keep)
    left = result.observer_error[0] - result.estimated_observer_error[0]
    variance = np.diagonal(result.observer_error_covariance[0], axis1=-2, axis2=-1)
    ratio = left[..., :5] ** 2 / variance[..., :5]
    assert 0.6 < ratio.mean() < 1.5
