"""Tests for maneuvers in the closed loop."""

import pickle

import numpy as np
import pytest

from cislunar.association.model import AssociationModel
from cislunar.errors import ConfigurationError
from cislunar.estimation.kalman.mukf import mukf
from cislunar.estimation.light_curves.batch import batch
from cislunar.estimation.maneuvers import ManeuverDetection, monitored
from cislunar.estimation.navigation.errors import ObserverErrorSigma
from cislunar.estimation.navigation.factory import navigated
from cislunar.observation.sensor import Sensor
from cislunar.targets.maneuvers import NO_MANEUVERS, Maneuvers
from cislunar.tasking.closed_loop import ClosedLoop, run_closed_loop
from cislunar.tasking.communication.model import CommunicationModel
from cislunar.tasking.demonstration import tracking_problem
from cislunar.tasking.histories import HISTORIES
from cislunar.tasking.truth import TruthModel

BRIGHT = Sensor(limiting_magnitude=25.0, angle_noise_arcsec=1.0)
DETECTION = ManeuverDetection(false_alarms_per_target_day=1e-3, spacing_minutes=30)
PLAIN = mukf(use_magnitude=False)
NAMES = [name for name in HISTORIES if name.startswith("maneuver_")]


def run(factory, given=NO_MANEUVERS, hours=4.0, sensor=BRIGHT, counts=(4, 5), **settings):
    settings = {"record": ("estimates", "covariance", "truth"), **settings}
    scene, surfaces, epoch, ids, loop = tracking_problem(
        *counts, duration_hours=hours, sensor=sensor, **settings
    )
    truth = TruthModel(surfaces, sensor.noise, np.zeros(3), maneuvers=given)
    return run_closed_loop(scene, surfaces, epoch, ids, [3], loop, estimator=factory, truth=truth)


@pytest.mark.parametrize(
    "factory",
    [
        PLAIN,
        batch(),
        navigated(PLAIN, "calibrated", ObserverErrorSigma(pointing_arcsec=0.1)),
    ],
    ids=["mukf", "batch", "calibrated"],
)
def test_estimates_stay_and_a_maneuver_is_found(factory):
    """Target 3 is observed throughout; its impulse is found within the interval."""
    tested = monitored(factory, DETECTION)
    impulse = np.array([6.0, -8.0, 4.0])
    given = Maneuvers(
        np.array([3]), np.array([5400.0]), np.zeros(1), impulse[None], np.zeros(1, dtype=np.int64)
    )
    before, after = run(factory, given), run(tested, given)
    for name, values in before.histories.items():
        np.testing.assert_array_equal(after.histories[name], values, err_msg=name)
    assert [name for name in after.histories if name not in before.histories] == NAMES
    alarm = after.maneuver_alarm[0]
    assert not alarm[0].any() and alarm[1:].any(axis=0).tolist() == [False] * 3 + [True, False]
    assert after.maneuver_statistic[0, 1:, 3].max() > 100.0
    first = np.argmax(alarm[:, 3])
    assert abs(after.maneuver_estimated_time[0, first, 3] - 5400.0) <= 3600.0
    last = np.argmax(after.maneuver_statistic[0, :, 3])
    error = after.maneuver_estimate[0, last, 3] - impulse
    assert np.linalg.norm(error) < 0.5 * np.linalg.norm(impulse)
    unobserved = after.maneuver_statistic[0] == 0.0
    assert np.all(np.isnan(after.maneuver_estimate[0][unobserved]))


def test_without_a_maneuver_there_is_no_alarm():
    found = run(monitored(PLAIN, DETECTION), hours=6.0)
    assert not found.maneuver_alarm.any()
    assert 0.0 < found.maneuver_statistic.max() < 30.0


def test_late_measurements_and_a_copied_loop():
    """The test goes back in time with the estimator; a run resumed from a copy is the same."""
    tested = monitored(PLAIN, DETECTION)
    given = {"communication": CommunicationModel(delay_minutes=20, update_minutes=30)}
    late = run(tested, **given)
    assert np.isfinite(late.maneuver_statistic).all() and not late.maneuver_alarm.any()
    scene, surfaces, epoch, ids, loop = tracking_problem(4, 5, duration_hours=30.0, sensor=BRIGHT)
    loops = [ClosedLoop(scene, surfaces, epoch, ids, [3], loop, estimator=tested) for _ in (0, 1)]
    pieces = list(loops[0].pieces())
    assert len(pieces) == 2
    next(loops[1].pieces())
    loops[1].state = pickle.loads(pickle.dumps(loops[1].state))
    (second,) = loops[1].pieces()
    for name in NAMES:
        np.testing.assert_array_equal(second.kept[name], pieces[1].kept[name])


def test_detections_without_identity():
    """An interval is processed in several windows; the estimates stay bit for bit."""
    given = {"association": AssociationModel(detections="all-in-field"), "hours": 2.0}
    plain, tested = run(PLAIN, **given), run(monitored(PLAIN, DETECTION), **given)
    for name, values in plain.histories.items():
        np.testing.assert_array_equal(tested.histories[name], values, err_msg=name)
    assert tested.maneuver_statistic.max() > 0.0


def test_settings():
    assert monitored(PLAIN, ManeuverDetection()) is PLAIN
    for given, words in (
        ({"false_alarms_per_target_day": 0}, "false_alarms_per_target_day"),
        ({"false_alarms_per_target_day": 1}, "false_alarms_per_target_day"),
        ({"spacing_minutes": 90, "window_hours": 1}, "longer than window_hours"),
    ):
        with pytest.raises(ConfigurationError, match=words):
            ManeuverDetection(**given)
