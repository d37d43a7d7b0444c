"""Tests for orbits that are estimated anew after a maneuver, in the closed loop."""

from functools import partial

import numpy as np
import pytest
from test_maneuver_alarms import BRIGHT, DETECTION, PLAIN, run

from cislunar.association.model import AssociationModel
from cislunar.constants import LENGTH_UNIT_KM
from cislunar.estimation.light_curves.batch import batch
from cislunar.estimation.maneuvers import monitored
from cislunar.targets.maneuvers import Maneuvers
from cislunar.tasking.communication.model import CommunicationModel

RECOVERING = DETECTION.model_copy(update={"recover": True})
TIME_S = 9000.0


def impulse(target, velocity, time_s=TIME_S):
    given = np.array([target]), np.array([time_s]), np.zeros(1), np.array([velocity])
    return Maneuvers(*given, np.zeros(1, dtype=np.int64))


run = partial(run, hours=8.0)


def km(result, target):
    return LENGTH_UNIT_KM * np.linalg.norm(result.error[0, :, target, 6:9], axis=1)


@pytest.mark.parametrize("factory", [PLAIN, batch()], ids=["mukf", "batch"])
@pytest.mark.parametrize("size", [1.0, 100.0])
def test_a_target_is_recovered(factory, size):
    """Target 3 is observed throughout: orbit, time and vector of its maneuver are found."""
    velocity = size * np.array([0.6, -0.64, 0.48])
    plain, found = (
        run(monitored(factory, each), impulse(3, velocity)) for each in (DETECTION, RECOVERING)
    )
    first = np.argmax(found.maneuver_alarm[0].any(axis=1))
    steps = found.error.shape[1] // found.maneuver_alarm.shape[1]
    before = slice(None, (first + 1) * steps - 1)
    for name in ("error", "sigma", "estimated_translation"):
        one, other = (each.histories[name][0, before] for each in (plain, found))
        np.testing.assert_array_equal(one, other, err_msg=name)
    log = found.recovered_maneuvers
    assert log.seed.tolist() == [0] and log.target.tolist() == [3]
    assert log.probability[0] > 0.99 and abs(log.time_s[0] - TIME_S) < 720.0
    assert abs(log.time_s[0] - TIME_S) < 4.0 * log.time_sigma_s[0]
    error = log.velocity_m_s[0] - velocity
    assert error @ np.linalg.solve(log.covariance[0], error) < 16.3  # 99.9 %
    assert km(found, 3)[-1] < 0.2 * km(plain, 3)[-1] and km(found, 3)[-1] < 3.0
    normalized = found.error[0, -1, 3, 6:] / found.sigma[0, -1, 3, 6:]
    assert np.all(np.abs(normalized) < 4.0)


@pytest.mark.parametrize("share", [0.0, 0.05])
def test_coasting_targets_stay_bit_for_bit(share):
    settings = RECOVERING.model_copy(update={"search_share": share})
    plain, found = run(PLAIN, hours=4.0), run(monitored(PLAIN, settings), hours=4.0)
    for name, values in plain.histories.items():
        np.testing.assert_array_equal(found.histories[name], values, err_msg=name)
    assert found.recovered_maneuvers.target.size == 0


def test_late_measurements():
    """The bank uses late measurements as soon as they are there."""
    given = {"communication": CommunicationModel(delay_minutes=20, update_minutes=60)}
    found = run(monitored(PLAIN, RECOVERING), impulse(3, (6.0, -6.4, 4.8)), **given)
    assert found.recovered_maneuvers.target.tolist() == [3]
    assert km(found, 3)[-1] < 3.0


CLUTTER = AssociationModel(detections="all-in-field", false_alarms_deg2=0.1)


def test_detections_without_identity():
    """A small maneuver leaves the detections within the gates."""
    found = run(
        monitored(PLAIN, RECOVERING), impulse(3, (0.6, -0.64, 0.48)), hours=6.0, association=CLUTTER
    )
    assert 3 in found.recovered_maneuvers.target.tolist()
    assert km(found, 3)[-1] < 3.0


@pytest.mark.parametrize(
    ("factory", "method", "size"),
    [
        (PLAIN, "multiple-frames", 10.0),
        (PLAIN, "multiple-frames", 100.0),
        (PLAIN, "joint-probabilities", 100.0),
        (batch(), "nearest-neighbor", 100.0),
    ],
)
def test_a_target_that_leaves_its_gates_is_associated_again(factory, method, size):
    """Among false alarms, several exposures agree with one orbit after the maneuver."""
    velocity = size * np.array([0.6, -0.64, 0.48])
    clutter = CLUTTER.model_copy(update={"method": method})
    given = {"given": impulse(3, velocity), "hours": 6.0, "association": clutter}
    lost, found = (run(monitored(factory, each), **given) for each in (DETECTION, RECOVERING))
    assert found.recovered_maneuvers.target.tolist() == [3]
    assert abs(found.recovered_maneuvers.time_s[0] - TIME_S) < 720.0
    np.testing.assert_allclose(found.recovered_maneuvers.velocity_m_s[0], velocity, atol=1.0)
    assert km(found, 3)[-1] < 3.0 and km(lost, 3)[-1] > 50.0
    assert found.wrong_associations.sum() == 0


def test_tracks_of_coasting_targets_take_no_false_alarms():
    """Wide gates change nothing without a maneuver, bit for bit, at nine false alarms a frame."""
    given = {"association": CLUTTER.model_copy(update={"false_alarms_deg2": 1.0}), "hours": 4.0}
    plain, found = run(PLAIN, **given), run(monitored(PLAIN, RECOVERING), **given)
    for name, values in plain.histories.items():
        np.testing.assert_array_equal(found.histories[name], values, err_msg=name)
    assert found.recovered_maneuvers.target.size == 0


def test_a_target_that_has_left_the_field_is_searched_for():
    """Three observers of eight targets do not observe target 6 for five hours after its maneuver,
    and then point beside it. The search finds it."""
    narrow = BRIGHT.model_copy(update={"field_of_view_deg": 1.0})
    velocity = np.array([330.0, -352.0, 264.0])
    given = {"given": impulse(6, velocity, 15120.0), "hours": 14.0, "sensor": narrow}
    searching = RECOVERING.model_copy(update={"search_share": 0.2})
    lost, found = (
        run(monitored(PLAIN, each), **given, counts=(3, 8)) for each in (RECOVERING, searching)
    )
    assert lost.recovered_maneuvers.target.size == 0 and km(lost, 6)[-1] > 1000.0
    assert found.recovered_maneuvers.target.tolist() == [6]
    np.testing.assert_allclose(found.recovered_maneuvers.velocity_m_s[0], velocity, atol=5.0)
    assert km(found, 6)[-1] < 3.0
