"""Late measurements against the same in order, contact against geometry, expected updates."""

import dataclasses

import numpy as np
import pytest
from measured import draw_truth

from cislunar.dynamics.cr3bp import EARTH_MOON
from cislunar.dynamics.propagation import propagate_stm
from cislunar.errors import ConfigurationError
from cislunar.estimation.registry import estimator_named
from cislunar.evaluation.cramer_rao import CramerRaoBound
from cislunar.observation.measurement import EXCLUDED, measure
from cislunar.observation.records import pointed_schedule, rows_of
from cislunar.observation.sensor import Sensor
from cislunar.observation.sightline import EARTH_RADIUS, occulted
from cislunar.tasking.closed_loop import run_closed_loop
from cislunar.tasking.communication.contact import arrivals, contacts
from cislunar.tasking.communication.model import CommunicationModel, Contact
from cislunar.tasking.communication.reception import Reception
from cislunar.tasking.decision import Decision
from cislunar.tasking.demonstration import tracking_problem
from cislunar.tasking.initial_conditions import initial_estimate
from cislunar.tasking.planning.detection import LearnedDetection
from cislunar.tasking.planning.detection_model import DetectionModel
from cislunar.tasking.planning.information import TaskingModel
from cislunar.tasking.planning.pending import PlannedObservations, expected_update
from cislunar.tasking.planning.schedule import detection_probabilities

BRIGHT = Sensor(limiting_magnitude=22.0)
SPAN, SPANS = 30, 5


@pytest.fixture(scope="module")
def problem():
    return tracking_problem(4, 5, duration_hours=SPAN * SPANS / 60.0, sensor=BRIGHT)


@pytest.fixture(scope="module")
def spans(problem):
    """Truth and measurements of consecutive spans, each observer at two targets in turn."""
    scene, surfaces, epoch, ids, loop = problem
    initial = initial_estimate(epoch, loop.initial.components())
    truth = draw_truth(initial, scene, BRIGHT.noise, 3, ids)
    pointing = (np.arange(SPAN * SPANS)[:, None] // 40 + np.arange(4)) % 5
    found = []
    for first in range(0, SPAN * SPANS, SPAN):
        motion = type(truth)(*(each[:, first : first + SPAN + 1] for each in truth))
        plan = pointed_schedule(pointing[first : first + SPAN], 5)
        states = motion.translation, motion.quaternion, motion.noise
        found.append((motion, measure(first + 1, plan, scene, surfaces, BRIGHT, *states,
                                      origin=first)[0]))  # fmt: skip
    return initial, found


def _made(problem, initial, name):
    scene, surfaces = problem[:2]
    make = estimator_named(name)
    own = make(scene, surfaces, BRIGHT, initial, np.random.default_rng(4), EARTH_MOON)
    bound = CramerRaoBound(scene, surfaces, initial.sigma)

    def work(motion, measurements, wanted):
        estimates = own.advance(measurements)
        states = motion.translation, motion.quaternion, motion.angular_velocity
        return estimates, bound.advance(*states, measurements.where(estimates.used), wanted)

    return own, bound, work


@pytest.mark.parametrize("name", ["mukf", "batch"])
def test_late_measurements_give_the_estimates_of_the_same_in_order(problem, spans, name):
    initial, spans = spans
    everywhere = np.ones(SPAN, dtype=bool)
    in_order = _made(problem, initial, name)
    for motion, measurements in spans:
        expected = in_order[2](motion, measurements, everywhere)
    delays = np.array([0, 7, 45, 80])[:, None]  # by observer: the last one's span the others
    arrival = np.arange(SPAN * SPANS) + delays
    late = _made(problem, initial, name)
    reception = Reception(arrival, SPAN, late[:2], (problem.scene, problem.surfaces), 5)
    for number, (motion, measurements) in enumerate(spans):
        reception.receive(number * SPAN, late[2])
        so_far = reception.advance(number * SPAN, motion, measurements, everywhere, late[2])
    # many measurements are pending: the estimates follow from the received ones
    known = late[0].predict().covariance[:, 0, 0]
    assert np.any(known > 1.5 * in_order[0].predict().covariance[:, 0, 0])
    partly = _made(problem, initial, name)
    for number, (motion, measurements) in enumerate(spans):
        _, step = rows_of(measurements)
        taken = SPAN * number + step
        there = arrival[measurements.observer, taken]
        now = there < SPAN * (SPANS - 1) if number < SPANS - 1 else there == taken
        again = partly[2](motion, measurements.where(now), everywhere)
    for one, other in zip(again[0][:4], so_far[0][:4], strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(again[1], so_far[1])
    # all measurements arrive before the last span, the earliest last
    late = _made(problem, initial, name)
    arrival = np.minimum(np.arange(SPAN * SPANS) + delays, SPAN * (SPANS - 1) - 1)
    arrival = np.maximum(arrival, np.arange(SPAN * SPANS))
    reception = Reception(arrival, SPAN, late[:2], (problem.scene, problem.surfaces), 5)
    for number, (motion, measurements) in enumerate(spans):
        reception.receive(number * SPAN, late[2])
        now = reception.advance(number * SPAN, motion, measurements, everywhere, late[2])
    for one, other in zip(expected[0], now[0], strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(expected[1], now[1])
    np.testing.assert_array_equal(in_order[0].counters, late[0].counters)
    assert not reception._spans and np.all(reception.observed)


def test_contact_is_limited_by_disks_and_angles(problem):
    scene = problem.scene
    rng = np.random.default_rng(5)
    position = scene.observer_position.copy()
    moon, earth = scene.primaries[0, 1], scene.primaries[0, 0]
    position[0] = moon + (moon - earth) * 0.05 + rng.normal(0.0, 0.004, position[0].shape)
    position[1] = earth + 0.9 * scene.sun_position / 389.0 + rng.normal(0.0, 0.2, position[1].shape)
    scene = scene._replace(observer_position=position)
    found = contacts(CommunicationModel(contact=Contact(moon=True)), scene)
    for o in range(4):
        for k in range(0, position.shape[1], 3):
            # to a point above the Earth, which would hide its center
            way = earth - position[o, k]
            way *= 1.0 - 1.5 * EARTH_RADIUS / np.linalg.norm(way)
            assert found[o, k] != occulted(*position[o, k], *way, scene.primaries[k])
    assert 0.1 < found[0].mean() < 0.9
    away = contacts(CommunicationModel(contact=Contact(sun_deg=20.0)), scene)
    way, light = position - earth, scene.sun_position - earth
    angle = np.arctan2(np.linalg.norm(np.cross(way, light), axis=-1), np.sum(way * light, axis=-1))
    np.testing.assert_array_equal(away, np.rad2deg(angle) >= 20.0)
    assert 0.1 < away[1].mean() < 0.9
    position[2] = earth + EARTH_RADIUS * scene.sun_position / 389.0  # under the Sun at noon
    assert np.all(contacts(CommunicationModel(contact=Contact(sun_deg=20.0)), scene)[2])
    model = CommunicationModel(delay_minutes=2.5, contact=Contact(moon=True))
    when = arrivals(model, scene)
    for k in range(when.shape[1]):
        waits = np.flatnonzero(found[0, 1 + k :])
        assert when[0, k] == 3 + (k + waits[0] if waits.size else when.shape[1])


@pytest.mark.parametrize("model", [TaskingModel(), TaskingModel(measurements=20)])
def test_expected_updates_agree_with_the_filter(problem, spans, model):
    initial, found = spans
    scene = problem.scene
    own, _, work = _made(problem, initial, "mukf")
    ahead, _, _ = _made(problem, initial, "mukf")
    nothing = np.zeros(SPAN, dtype=bool)
    for number, (motion, measurements) in enumerate(found[:3]):
        none = measurements.where(np.zeros(measurements.observer.size, bool))
        ahead.advance(measurements if number == 0 else none)
        work(motion, measurements, nothing)
    parts = []
    for number in (1, 2):
        measurements = found[number][1]
        target, step = rows_of(measurements)
        seen = np.isfinite(measurements.value[:, 0])
        columns = number * SPAN + step + 1, target, measurements.observer, np.ones(step.size)
        parts.append([column[seen] for column in columns])
    observations = PlannedObservations(*map(np.concatenate, zip(*parts, strict=True)))
    prediction = ahead.predict()
    updated = expected_update(prediction, observations, scene, BRIGHT, model, EARTH_MOON)
    known = own.predict().covariance
    before, after, expected = (
        np.sqrt(np.trace(each[:, :3, :3], axis1=1, axis2=2))
        for each in (prediction.covariance, updated.covariance, known)
    )
    assert np.all(after < before) and np.any(after < 0.3 * before)
    np.testing.assert_allclose(after, expected, rtol=0.1)
    doubtful = observations._replace(probability=0.25 * observations.probability)
    less = expected_update(prediction, doubtful, scene, BRIGHT, model, EARTH_MOON)
    larger, smaller = (np.trace(each.covariance, axis1=1, axis2=2) for each in (less, updated))
    assert np.all(larger > smaller)


@pytest.mark.parametrize("measurements", [1, 20])
def test_expected_updates_are_those_of_linear_measurements(problem, spans, measurements):
    scene, number = problem.scene, 60
    sensor = Sensor(limiting_magnitude=22.0, angle_noise_arcsec=0.1)
    own, _, _ = _made(problem, spans[0], "mukf")
    prediction = own.predict()
    # certain enough for linear measurements
    truth = spans[1][1][0].translation[:, -1]
    prediction = prediction._replace(
        index=number, translation=truth, covariance=1e-4 * prediction.covariance
    )
    index = np.array([58, 41, 41, 59, 60, 12])
    target, observer = np.array([0, 0, 0, 1, 1, 3]), np.array([0, 2, 0, 2, 0, 1])
    probability = np.array([1.0, 0.5, 1.0, 0.2, 1.0, 0.8])
    observations = PlannedObservations(index, target, observer, probability)
    model = TaskingModel(measurements=measurements, detection=DetectionModel())
    updated = expected_update(prediction, observations, scene, sensor, model, EARTH_MOON)
    information = np.linalg.inv(prediction.covariance)
    for k, j, o, share in zip(index, target, observer, probability, strict=True):
        duration = (k - number) * scene.step
        if k < number:
            place, stm = propagate_stm(truth[j], duration)
        else:
            place, stm = truth[j], np.eye(6)
        axes = scene.observer_axes[k]
        x, y, z = axes @ (place[:3] - scene.observer_position[o, k])
        across, distance = np.hypot(x, y), np.sqrt(x * x + y * y + z * z)
        right_ascension = np.array([-y, x, 0.0]) / across**2
        declination = np.array([-x * z / across, -y * z / across, across]) / distance**2
        slope = np.array([right_ascension, declination]) @ axes @ stm[:3]
        information[j] += share * slope.T @ (slope / sensor.noise[1:, None] ** 2)
    for j in range(5):
        expected = np.linalg.inv(information[j])
        scale = np.sqrt(np.diag(expected))
        difference = (updated.covariance[j] - expected) / np.outer(scale, scale)
        assert np.abs(difference).max() < 1e-6
    least = np.linalg.eigvalsh(updated.covariance[0]) / np.linalg.eigvalsh(prediction.covariance[0])
    assert least.min() < 0.5
    np.testing.assert_array_equal(updated.covariance[2], prediction.covariance[2])


def test_pending_trials_lower_the_bonus_of_a_first_detection():
    model = DetectionModel(brightness="sphere", never_detected_bonus=4.0)
    learned, reference = LearnedDetection(model, 4), LearnedDetection(model, 4)
    margin = np.random.default_rng(2).normal(0.0, 0.5, (2, 3, 4))
    detects = learned.detects(margin[..., None])
    decision = Decision(None, None, 0.0, 0, 0.0, None, detects, np.array([0, 4]))
    # slots of four steps; target 0 is observed by two observers, by one of them in both slots,
    # target 1 by one, and target 3 by none
    target = np.array([[0, 0, 2], [0, 1, 2]]).repeat(4, axis=0)
    plan = pointed_schedule(target, 4)
    reception = Reception(np.arange(16) + np.array([8, 8, 0])[:, None], 8, (), (), 4)
    reception.note(0, decision, plan, np.full(plan.observer.size, EXCLUDED, dtype=np.uint8))
    assert np.all(learned.bonus() == 4.0)
    reception.learn(8, learned)
    reception.expect(learned)
    weight, miss = np.exp(reference.log_weight), 1.0 - detects
    expected = [
        weight[0] @ (miss[0, 0, 0] * miss[1, 0, 0] * miss[0, 1, 0]),
        weight[1] @ miss[1, 1, 1],
        1.0,
        1.0,
    ]
    np.testing.assert_allclose(learned.bonus(), 4.0 * np.array(expected), rtol=1e-12)
    assert np.all(learned.bonus()[2:] == 4.0)
    learned.detected[1] = True
    value = learned.pair_values(np.ones((3, 4)), detects[0])
    bonus = 4.0 * np.array([expected[0], 0.0, 1.0, 1.0])
    np.testing.assert_allclose(value, learned.probability(detects[0]) * (1.0 + bonus))
    np.testing.assert_allclose(detection_probabilities(learned, margin[..., None]).bonus, bonus)
    learned.detected[1] = False
    reception.learn(16, learned)
    reception.expect(learned)
    assert np.all(learned.bonus() == 4.0)


def test_detections_are_learned_when_an_interval_is_complete(problem, spans):
    measurements = spans[1][0][1]
    learned = []

    class Learner:
        def learn(self, target, observer, outcome, detects):
            learned.extend(observer.tolist())

    arrival = np.arange(SPAN * SPANS) + np.array([0, 7, 45, 80])[:, None]
    reception = Reception(arrival, SPAN, (), (), 5)
    starts, detects = np.zeros(1, dtype=np.int64), np.zeros((1, 4, 5, 1))
    decision = Decision(None, None, 0.0, 0, 0.0, None, detects, starts)
    found = np.zeros(measurements.observer.size, dtype=np.uint8)
    reception.note(0, decision, measurements, found)
    for now, expected in ((30, {0}), (60, {0, 1}), (90, {0, 1, 2}), (120, {0, 1, 2, 3})):
        reception.learn(now, Learner())
        assert set(learned) == expected
    counts = np.bincount(learned)
    np.testing.assert_array_equal(counts, np.bincount(measurements.observer))


def test_delays_increase_errors_and_pending_measurements_help():
    errors = {}
    for delay, pending in ((0.0, True), (60.0, True), (60.0, False)):
        model = CommunicationModel(delay_minutes=delay, use_pending_measurements=pending)
        problem = tracking_problem(
            3, 9, duration_hours=8.0, sensor=BRIGHT, communication=model, record_every=60
        )
        result = run_closed_loop(*problem[:4], (0, 1), problem.loop)
        away = np.linalg.norm(result.error[:, -1, :, 6:9], axis=-1)
        errors[delay, pending] = np.exp(np.mean(np.log(away)))
    assert errors[0.0, True] < errors[60.0, True] < errors[60.0, False]


def test_permanent_contact_changes_nothing(problem):
    scene, surfaces, epoch, ids, loop = problem
    runs = []
    # permanent contact, and communication without conditions
    for model in (CommunicationModel(), CommunicationModel(contact=Contact(sun_deg=1e-9))):
        settings = dataclasses.replace(loop, communication=model)
        runs.append(run_closed_loop(scene, surfaces, epoch, ids, (0,), settings))
    for name in ("error", "sigma", "bound", "outcome", "assignment"):
        assert getattr(runs[0], name).tobytes() == getattr(runs[1], name).tobytes()


@pytest.mark.parametrize(
    "given, words",
    [
        ({"delay_minutes": 360.0}, "delay_minutes = 360.0 is as long as the run"),
        ({"delay_minutes": -1.0}, "delay_minutes = -1.0 must be"),
        (
            {"contact": {"sun_deg": 180.0}},
            "sun_deg = 180.0 must be a number at least 0 and below 180",
        ),
        ({"update_minutes": 0.25}, "update_minutes = 0.25 must be a multiple of step_s"),
        ({"update_minutes": 0.0}, "update_minutes = 0.0 must be a number above 0"),
    ],
)
def test_impossible_communication_is_refused(given, words):
    with pytest.raises(ConfigurationError, match=words):
        tracking_problem(2, 2, duration_hours=6.0, communication=CommunicationModel(**given))


def test_pending_measurements_need_translational_states():
    with pytest.raises(ConfigurationError, match="use_pending_measurements needs states"):
        tracking_problem(
            2, 2, duration_hours=6.0, communication=CommunicationModel(delay_minutes=5.0),
            tasking=TaskingModel(states="full"),
        )  # fmt: skip
