"""Exposures within the closed loop: what the estimation side knows, and the bookkeeping."""

from types import SimpleNamespace

import numpy as np
import pytest

from cislunar.association import ASSOCIATORS, AssociationModel
from cislunar.detection import FALSE_ALARM
from cislunar.dynamics.cr3bp import EARTH_MOON
from cislunar.errors import ConfigurationError
from cislunar.estimation.estimator import Prediction
from cislunar.observation.measurement import DETECTED, FAINT, NOT_TASKED
from cislunar.observation.records import rows_of
from cislunar.observation.scene import make_scene
from cislunar.observation.sensor import Sensor
from cislunar.observation.target_surfaces import target_surfaces
from cislunar.photometry.materials import Material
from cislunar.photometry.shapes import icosahedron
from cislunar.tasking import field_observations, realization
from cislunar.tasking.closed_loop import run_closed_loop
from cislunar.tasking.demonstration import tracking_problem
from cislunar.tasking.field_observations import observe_field
from cislunar.tasking.initial_conditions import ALARM, stream
from cislunar.tasking.planning.detection_model import DetectionModel
from cislunar.tasking.planning.information import TaskingModel
from cislunar.tasking.planning.schedule_model import ScheduleModel
from cislunar.tasking.realization import USED
from cislunar.tasking.settings import CommunicationModel, LoopSettings
from cislunar.tasking.truth import Truth

BRIGHT = Sensor(limiting_magnitude=22.0)


def in_field(method, **changes):
    given = {"false_alarms_deg2": 0.5, "detections": "all-in-field", "method": method}
    return AssociationModel(**(given | changes))


def run(association, n_observers=4, n_targets=10, seeds=(3,), **settings):
    settings = {"duration_hours": 2, "sensor": BRIGHT, "association": association} | settings
    scene, surfaces, epoch, ids, loop = tracking_problem(n_observers, n_targets, **settings)
    return run_closed_loop(scene, surfaces, epoch, ids, seeds, loop)


def poison(monkeypatch, n_targets=10):
    """Give every detection a random origin after it was simulated."""
    real, rng = field_observations.expose, np.random.default_rng(5)

    def scrambled(*given, **named):
        detections, origin, outcome = real(*given, **named)
        return detections, rng.integers(-1, n_targets, origin.size), outcome

    monkeypatch.setattr(field_observations, "expose", scrambled)


LEARNED = TaskingModel(detection=DetectionModel())


@pytest.mark.parametrize("method", ASSOCIATORS)
@pytest.mark.parametrize("tasking", [TaskingModel(), LEARNED], ids=["plain", "learned"])
def test_origins_are_hidden_from_estimation_and_tasking(monkeypatch, method, tasking):
    """With known identities they are not, which shows that the poison works."""
    clean = run(in_field(method), tasking=tasking)
    poison(monkeypatch)
    poisoned = run(in_field(method), tasking=tasking)
    names = ["error", "sigma", "assignment", "information", "existence", "track_status",
             "associations", "gospa"]  # fmt: skip
    if tasking is LEARNED:
        names += ["brightness_offset", "brightness_offset_sigma"]
    same = {
        name: np.array_equal(getattr(clean, name), getattr(poisoned, name), equal_nan=True)
        for name in names
    }
    if method == "known-identity":
        assert not same["error"] and not same["associations"]
    else:
        assert all(same.values()), same
        assert not np.array_equal(clean.wrong_associations, poisoned.wrong_associations)
    assert clean.associations.sum() > 100


@pytest.mark.parametrize("method", ["known-identity", "nearest-neighbor", "multiple-frames"])
def test_a_lone_target_is_tracked_as_if_its_identity_were_known(method):
    """One observer and one target, without false alarms or losses: to the bit."""
    alone = in_field(method, false_alarms_deg2=0, detection_loss=0, confirmations=1)
    tasked = run(AssociationModel(), n_observers=1, n_targets=1)
    found = run(alone, n_observers=1, n_targets=1)
    np.testing.assert_array_equal(found.error, tasked.error)
    np.testing.assert_array_equal(found.sigma, tasked.sigma)
    np.testing.assert_array_equal(found.bound, tasked.bound)
    np.testing.assert_array_equal(found.outcome, tasked.outcome)
    assert np.count_nonzero(tasked.outcome == USED) > 100


@pytest.mark.parametrize("method", ASSOCIATORS)
def test_an_interval_has_a_row_of_every_detection_taken_and_every_commanded_exposure(
    monkeypatch, method
):
    fields, found = [], []

    def observed(*given):
        fields.append(observe_field(*given))
        return fields[-1]

    def associated(inputs, own, start, n_steps, field):
        found.append(field_observations.associate_interval(inputs, own, start, n_steps, field))
        return found[-1]

    monkeypatch.setattr(realization, "observe_field", observed)
    monkeypatch.setattr(realization, "associate_interval", associated)
    result = run(in_field(method, detection_loss=0.3), tasking=TaskingModel())
    assert len(fields) == len(found) == 2
    for number, (field, each) in enumerate(zip(fields, found, strict=True)):
        rows, exposures = each.measurements, field.exposures
        target, step = rows_of(rows)
        pairs = list(zip(target.tolist(), step.tolist(), rows.observer.tolist(), strict=True))
        assert len(set(pairs)) == len(pairs)
        wanted = set(
            zip(field.command.tolist(), exposures.step.tolist(), exposures.observer.tolist(),
                strict=True)
        )  # fmt: skip
        assert {pair for pair, told in zip(pairs, each.commanded, strict=True) if told} == wanted
        taken = np.isfinite(rows.value).all(axis=1)
        assert np.all(taken | each.commanded) and not np.any(each.estimates.used & ~taken)
        assert not np.any(each.right & ~taken)
        at = {pair: e for e, pair in enumerate(zip(exposures.step, exposures.observer,
                                                   strict=True))}  # fmt: skip
        counts, of = np.zeros((10, 2), dtype=int), [[] for _ in range(10)]
        for row in np.flatnonzero(taken):
            e = at[step[row], rows.observer[row]]
            here = np.flatnonzero(field.detections.exposure == e)
            if method == "joint-probabilities":
                continue
            same = np.flatnonzero(
                np.all(field.detections.value[here] == rows.value[row], axis=1)
                & np.all(field.detections.variance[here] == rows.variance[row], axis=1)
            )
            assert same.size == 1
            origin = field.origin[here[same[0]]]
            assert each.right[row] == (origin == target[row])
            if each.estimates.used[row]:
                counts[target[row]] += [1, origin != target[row]]
                of[target[row]].append(origin)
        if method != "joint-probabilities":
            np.testing.assert_array_equal(each.counts, counts)
            for j, origins in enumerate(of):
                among = -2 if not origins else np.bincount(np.array(origins) + 1).max()
                if origins:
                    assert origins.count(each.origin[j]) == among
                else:
                    assert each.origin[j] == -2
        assert np.all(each.outcome[taken] == np.where(each.estimates.used[taken], USED, DETECTED))
        assert NOT_TASKED not in each.outcome
        np.testing.assert_array_equal(result.associations[0, number], each.counts[:, 0])


def still(n_steps, tasked, ids, process, seed=7, start=0):
    """What two observers return that look at targets at rest."""
    n_times = n_steps + 1
    observers = np.tile([[[1.15, 0.2, 0.1]], [[1.1, 0.3, 0.1]]], (1, n_times + start, 1))
    sun = np.tile([200.0, -300.0, 40.0], (n_times + start, 1))
    scene = make_scene(observers, sun, 1e-6, observer_rate_deg_h=[0, 0, 0], axes=np.eye(3))
    n = len(ids)
    states = np.zeros((n, n_times, 6))
    states[..., :3] = np.array([[0.3, 0.5, 0.2], [0.31, 0.51, 0.2]])[ids][:, None]
    attitude = np.tile([0.0, 0.0, 0.0, 1.0], (n, n_times, 1))
    motion = Truth(states, attitude, np.zeros((n, n_times, 3)), np.zeros((n, n_times, 2, 3)))
    inputs = SimpleNamespace(
        scene=scene, ids=np.array(ids), forces=EARTH_MOON,
        settings=SimpleNamespace(
            sensor=Sensor(limiting_magnitude=30.0, field_of_view_deg=6.0), association=process
        ),
    )  # fmt: skip
    surfaces = target_surfaces(icosahedron(), Material(), n)
    own = SimpleNamespace(
        seed=seed,
        truth=SimpleNamespace(surfaces=surfaces, sensor=None),
        observers=None,
        scene=lambda given: given.scene,
    )
    return observe_field(
        inputs, own, start, SimpleNamespace(target_by_step=tasked),
        Prediction(start + 1, states[:, 0], np.tile(np.eye(6), (n, 1, 1))), motion,
        np.zeros((n, n_times)),
    )  # fmt: skip


def test_losses_are_drawn_for_each_target_and_false_alarms_for_each_observer():
    n_steps, loss, rate = 2000, 0.2, 0.1
    process = in_field("known-identity", false_alarms_deg2=rate, detection_loss=loss)
    both = still(n_steps, np.zeros((n_steps, 2), dtype=np.int64), [0, 1], process)
    assert both.exposures.step.size == 2 * n_steps
    assert np.all(both.command == 0)
    np.testing.assert_array_equal(
        np.unique(both.detections.exposure[both.origin == 0]),
        np.flatnonzero(both.outcome == DETECTED),
    )
    assert set(both.outcome.tolist()) == {DETECTED, FAINT}
    lost = np.ones((2, 2 * n_steps), dtype=bool)
    for j in range(2):
        lost[j, both.detections.exposure[both.origin == j]] = False
        spread = 4.0 * np.sqrt(loss * (1.0 - loss) / (2 * n_steps))
        assert lost[j].mean() == pytest.approx(loss, abs=spread)
        for o in range(2):
            assert lost[j, o::2].mean() == pytest.approx(loss, abs=1.5 * spread)
    # losses of two targets, and of two observers, are independent
    assert np.mean(lost[0] & lost[1]) == pytest.approx(loss**2, abs=0.02)
    assert np.mean(lost[0, ::2] & lost[0, 1::2]) == pytest.approx(loss**2, abs=0.03)
    mean = rate * np.rad2deg(2.0 * np.tan(np.deg2rad(3.0))) ** 2
    false = both.detections.exposure[both.origin == FALSE_ALARM]
    assert false.size == pytest.approx(2 * n_steps * mean, abs=4.0 * np.sqrt(2 * n_steps * mean))
    # another set of targets, and an idle observer, change neither
    idle = np.zeros((n_steps, 2), dtype=np.int64)
    idle[:, 0] = -1
    other = still(n_steps, idle, [1], process)
    assert np.all(other.exposures.observer == 1)
    np.testing.assert_array_equal(
        np.sort(other.detections.exposure[other.origin == 0]), np.flatnonzero(~lost[1, 1::2])
    )
    np.testing.assert_array_equal(
        np.bincount(other.detections.exposure[other.origin == FALSE_ALARM], minlength=n_steps),
        np.bincount(false, minlength=2 * n_steps)[1::2],
    )
    expected = stream(ALARM, 7, 0).poisson(np.full((n_steps, 2), mean))
    np.testing.assert_array_equal(
        np.bincount(false, minlength=2 * n_steps).reshape(n_steps, 2), expected
    )


def test_false_alarms_do_not_change_the_truth_or_the_known_identities():
    quiet, noisy = (
        run(in_field("known-identity", false_alarms_deg2=rate, detection_loss=0.1))
        for rate in (0, 2)
    )
    np.testing.assert_array_equal(noisy.error, quiet.error)
    assert not noisy.wrong_associations.any()


def test_delayed_links_need_known_identities():
    for late in (
        {"delay_minutes": 10},
        {"contact": {"moon": True}},
    ):
        with pytest.raises(ConfigurationError, match=r"association\.detections") as caught:
            LoopSettings(
                association=in_field("multiple-frames"), communication=CommunicationModel(**late)
            )
        assert "\n" not in str(caught.value) and "communication" in str(caught.value)


def test_counted_neighbors_have_no_bound_of_a_schedule():
    with pytest.raises(ConfigurationError, match=r"association\.count_neighbors.*bound_steps"):
        LoopSettings(
            association=in_field("multiple-frames", count_neighbors=True),
            schedule=ScheduleModel(slot_minutes=20, bound_steps=5),
        )
