"""Tracks that are added to and removed from an estimator, against estimators of those tracks."""

import numpy as np
import pytest
from measured import SENSOR, draw_truth, during
from oracles.reference_filter import ReferenceFilter

from cislunar.attitude import grp
from cislunar.attitude.quaternion import compose, inverse
from cislunar.dynamics.instantaneous_frame_cr3bp import instantaneous_frame_cr3bp
from cislunar.dynamics.propagation import propagate_stm
from cislunar.ephemeris.bodies import tabulate_bodies
from cislunar.errors import ConfigurationError
from cislunar.estimation.kalman.mukf import MultiplicativeUKF
from cislunar.estimation.light_curves.batch import BatchEstimator
from cislunar.estimation.light_curves.batch_settings import BatchSettings
from cislunar.estimation.track_arrays import covariance_roots
from cislunar.observation.measurement import measure
from cislunar.observation.measurement_derivatives import measurement_rows
from cislunar.observation.records import no_measurements, pointed_schedule, rows_of
from cislunar.observation.sensor import ExclusionAngles, Sensor
from cislunar.observation.target_surfaces import joined_surfaces, surfaces_of, target_surfaces
from cislunar.photometry import spacecraft
from cislunar.photometry.bodies import build_body
from cislunar.photometry.materials import PRINTED, Material
from cislunar.photometry.shapes import icosahedron
from cislunar.tasking.demonstration import tracking_problem
from cislunar.tasking.initial_conditions import initial_estimate

ALL = np.arange(4)
SMALL = {
    "modes": 3, "starts": 2, "first_starts": 3, "pool": 16, "use_non_detections": True,
    "window_hours": 0.2,
}  # fmt: skip
SETTINGS = {"batch": BatchSettings(**SMALL), "fading": BatchSettings(**SMALL, memory_hours=1.0)}
NEVER_HIDDEN = {
    "limiting_magnitude": 35.0, "exclusion_deg": ExclusionAngles(0.0, 0.0, 0.0),
    "occultation": False,
}  # fmt: skip
both = pytest.mark.parametrize("kind", ["ukf", *SETTINGS])


class Streams:
    """A random stream for each target, in whichever estimator it is."""

    def __init__(self, targets):
        self.targets = targets

    def spawn(self, n):
        assert n == len(self.targets)
        return [np.random.default_rng([5, j]) for j in self.targets]


class Problem:
    """Four bodies, each measured by two observers at every second of 60 steps."""

    def __init__(self):
        self.scene, _, epoch, ids, loop = tracking_problem(2, 4, duration_hours=1.0)
        dish = build_body(spacecraft.dish_on_bus(segments=4), spacecraft.SURFACES["dish_on_bus"])
        shapes = [icosahedron(), dish, icosahedron(2.0), dish._replace(areas=2.0 * dish.areas)]
        inertia = np.array([np.eye(3), np.diag([1.0, 1.6, 2.2]), 2.0 * np.eye(3), np.eye(3)])
        self.surfaces = target_surfaces(shapes, Material(), 4, inertia=inertia)
        self.initial = initial_estimate(epoch, loop.initial.components())
        self.truth = draw_truth(
            self.initial, self.scene, SENSOR.noise, 2, ids, inertia=inertia, observations=2
        )
        steps = np.arange(loop.n_steps)[:, None]
        pointing = pointed_schedule((steps + np.array([0, 2])) % 4, 4)
        motion = self.truth.translation, self.truth.quaternion, self.truth.noise
        self.records, _ = measure(1, pointing, self.scene, self.surfaces, SENSOR, *motion)

    def of(self, targets):
        """Estimates and surfaces of some targets, and their random streams."""
        return (
            self.initial.of_targets(targets),
            surfaces_of(self.surfaces, targets),
            Streams(targets),
        )

    def start(self, kind, targets, index=0, scene=None, rng=None):
        initial, surfaces, streams = self.of(np.asarray(targets))
        given = self.scene if scene is None else scene, surfaces, SENSOR, initial
        if kind == "ukf":
            return MultiplicativeUKF(*given, splitting=True, index=index)
        return BatchEstimator(
            *given, rng or streams, settings=SETTINGS[kind], splitting=True, index=index
        )

    def records_of(self, targets, first, last):
        """Records of some targets, in ascending order."""
        target, _ = rows_of(self.records)
        some = during(self.records.where(np.isin(target, targets)), first, last)
        return some._replace(offset=np.ascontiguousarray(some.offset[targets]))

    def run(self, estimator, targets, first, last):
        """What an estimator returns for each target over these steps, in two pieces, and then."""
        middle, found = (first + last) // 2, [[] for _ in targets]
        for start, stop in ((first, middle), (middle, last)):
            records = self.records_of(targets, start, stop)
            out = estimator.advance(records, covariance=True, final=stop == last)
            assert out.used.any()
            for own, *arrays in zip(found, *out[:-1], strict=True):
                own += arrays
        for own, end in zip(found, present(estimator), strict=True):
            own += end
        return found


def present(estimator):
    """Prediction, orbit, counters and light curve of each target."""
    ahead, orbits = estimator.predict(), estimator.orbits()
    found = [*ahead[1:5], *ahead.rotation, *orbits[1:], estimator.counters, estimator.failed]
    if isinstance(estimator, BatchEstimator):
        curves = [estimator.light_curve(j)[0] for j in range(estimator.failed.size)]
        found += [estimator.searches, curves]
    return [list(own) for own in zip(*found, strict=True)]


def assert_same(found, wanted):
    """Whether what was returned for each target is the same, bit for bit."""
    for own, other in zip(found, wanted, strict=True):
        for one, two in zip(own, other, strict=True):
            np.testing.assert_array_equal(one, two)


@pytest.fixture(scope="module")
def problem():
    return Problem()


@both
def test_the_other_tracks_are_those_of_a_run_without_the_removed(problem, kind):
    some = [0, 2]
    every, alone = problem.start(kind, ALL), problem.start(kind, some)
    problem.run(every, ALL, 0, 20)
    problem.run(alone, some, 0, 20)
    every.remove([3, 1])
    assert_same(present(every), present(alone))
    assert_same(problem.run(every, some, 20, 60), problem.run(alone, some, 20, 60))
    every.remove(1)
    assert_same(present(every), present(alone)[:1])
    with pytest.raises(ConfigurationError, match=r"tracks \[1\] cannot be removed.* to 0$"):
        every.remove([1])


@both
def test_tracks_added_at_the_present_are_those_of_an_estimator_started_then(problem, kind):
    old, new = [0, 1], [2, 3]
    together, first = problem.start(kind, old), problem.start(kind, old)
    problem.run(together, old, 0, 20)
    problem.run(first, old, 0, 20)
    together.add(*problem.of(new))
    second = problem.start(kind, new, index=20)
    wanted = problem.run(first, old, 20, 60) + problem.run(second, new, 20, 60)
    assert_same(problem.run(together, ALL, 20, 60), wanted)


@both
def test_an_estimator_with_added_tracks_is_one_started_with_all(problem, kind):
    every = problem.start(kind, ALL, index=7, rng=np.random.default_rng(1))
    parts = problem.start(kind, [0], index=7, rng=np.random.default_rng(1))
    for more in ([1, 2], [3]):
        parts.add(*problem.of(more)[:2])
    assert_same(problem.run(parts, ALL, 7, 40), problem.run(every, ALL, 7, 40))


@pytest.mark.parametrize("kind", ["ukf", "batch"])
def test_earlier_estimates_are_propagated_without_measurements(problem, kind):
    old, new = [0], [1, 2, 3]
    together, second = problem.start(kind, old), problem.start(kind, new, index=8)
    problem.run(together, old, 0, 20)
    unchanged = present(together)
    together.add(*problem.of(new), index=8)
    second.advance(no_measurements(3, 12))
    assert_same(present(together), unchanged + present(second))
    assert_same(problem.run(together, ALL, 20, 60)[1:], problem.run(second, new, 20, 60))
    with pytest.raises(ConfigurationError, match=r"index = 61: .* between 0 and the present, 60$"):
        together.add(*problem.of(new), index=61)
    assert together.failed.size == 4


@both
def test_a_later_start_is_a_shift_of_time(problem, kind):
    scene = problem.scene
    shifted = scene._replace(
        observer_position=np.ascontiguousarray(scene.observer_position[:, 12:]),
        **{name: getattr(scene, name)[12:] for name in scene._fields[3:]},
    )
    later, other = problem.start(kind, ALL, 12), problem.start(kind, ALL, scene=shifted)
    assert_same(problem.run(later, ALL, 12, 60), problem.run(other, ALL, 12, 60))


@both
def test_all_tracks_may_be_removed(problem, kind):
    emptied, started = problem.start(kind, ALL), problem.start(kind, [1, 2], index=20)
    problem.run(emptied, ALL, 0, 20)
    emptied.remove(ALL)
    assert emptied.advance(no_measurements(0, 5)).translation.shape == (0, 5, 6)
    emptied.add(*problem.of([1, 2]), index=20)
    started.advance(no_measurements(2, 5), final=False)
    emptied.advance(no_measurements(2, 5), final=False)
    started.advance(no_measurements(2, 5), final=False)
    assert_same(present(emptied), present(started))


def correlated(sigma, n_targets, factor):
    """Any covariance of each target, with standard deviations in units of `sigma`."""
    rng = np.random.default_rng(4)
    roots = rng.normal(size=(n_targets, 12, 12)) / np.sqrt(12.0) + 0.3 * np.eye(12)
    return (roots @ roots.swapaxes(1, 2)) * np.multiply.outer(factor * sigma, factor * sigma)


def test_the_first_update_of_correlated_states_is_that_of_filterpy(problem):
    surfaces, sensor = target_surfaces(icosahedron(), Material(), 4), Sensor(**NEVER_HIDDEN)
    covariance = correlated(problem.initial.sigma, 4, 0.1)
    initial = problem.initial._replace(covariance=covariance)
    motion = problem.truth.translation, problem.truth.quaternion, problem.truth.noise
    pointing = pointed_schedule([[0, 2]], 4)
    records, _ = measure(1, pointing, problem.scene, surfaces, sensor, *motion)
    found = MultiplicativeUKF(problem.scene, surfaces, sensor, initial).advance(records)
    assert found.used.all()
    for observer, j in enumerate((0, 2)):
        reference = ReferenceFilter(
            problem.scene, icosahedron(), Material(), sensor.noise, initial, np.zeros(12), j
        )
        reference.predict()
        reference.update(records.value[observer], observer)
        reference.reset()
        sigma = np.sqrt(np.diag(reference.ukf.P))
        np.testing.assert_allclose(found.sigma[j, 0], sigma, rtol=1e-5)
        turned = compose(found.quaternion[j, 0], inverse(reference.quaternion))
        rate = found.angular_velocity[j, 0] - reference.ukf.x[3:6]
        moved = found.translation[j, 0] - reference.ukf.x[6:]
        error = np.r_[grp.from_quaternion(turned), rate, moved]
        assert np.max(np.abs(error) / sigma) < 1e-5


def test_the_first_update_of_a_correlated_orbit_is_that_of_linear_estimation(problem):
    scene, j = problem.scene, 2
    covariance = correlated(problem.initial.sigma, 4, 1e-2)
    initial = problem.initial._replace(covariance=covariance)
    sensor = Sensor(angle_noise_arcsec=0.1, **NEVER_HIDDEN)
    motion = initial.translation, initial.quaternion
    states = [np.repeat(each[:, None], 2, axis=1) for each in motion]
    ahead, transition = propagate_stm(initial.translation[j], scene.step)
    states[0][:, 1] = ahead
    pointing = pointed_schedule([[j, -1]], 4)
    records, _ = measure(
        1, pointing, scene, problem.surfaces, sensor, *states, np.zeros((4, 2, 2, 3))
    )
    estimator = BatchEstimator(scene, problem.surfaces, sensor, initial, Streams(ALL))
    deviations = np.sqrt(np.diagonal(covariance[:, :6, :6], axis1=1, axis2=2))
    for k in ALL:
        _, model, _ = estimator.light_curve(k)
        np.testing.assert_array_equal(model.sigma, deviations[k])
    found = estimator.advance(records, covariance=True)
    rows = np.empty((3, 6))
    measurement_rows(ahead, initial.quaternion[j], 0, 1, j, scene, problem.surfaces, rows)
    design, noise = np.pad(rows[1:, 3:], ((0, 0), (0, 3))), np.diag(records.variance[0, 1:])
    prior = transition @ covariance[j, 6:, 6:] @ transition.T
    gain = prior @ design.T @ np.linalg.inv(design @ prior @ design.T + noise)
    posterior = prior - gain @ design @ prior
    scale = np.sqrt(np.diag(prior))
    assert np.min(np.sqrt(np.diag(posterior)) / scale) < 0.7
    apart = (found.covariance[j, 0] - posterior) / np.multiply.outer(scale, scale)
    np.testing.assert_allclose(apart, 0.0, atol=1e-4)


@pytest.mark.parametrize("kind", ["ukf", "batch"])
def test_an_invalid_covariance_is_refused_in_one_line(problem, kind):
    good = correlated(problem.initial.sigma, 4, 1.0)
    indefinite, uneven, missing = good.copy(), good.copy(), good.copy()
    indefinite[2, 0, 1] = indefinite[2, 1, 0] = 2.0 * np.sqrt(good[2, 0, 0] * good[2, 1, 1])
    uneven[2, 7, 6] *= 1.1
    missing[2, 3, 3] = np.nan
    for wrong, text in (
        (indefinite, "of target 2 is not symmetric and positive definite$"),
        (uneven, "of target 2 is not symmetric and positive definite$"),
        (missing, "of target 2 is not symmetric and positive definite$"),
        (good[:3], r"of shape \(3, 12, 12\): it must be \(4, 12, 12\)$"),
    ):
        initial = problem.initial._replace(covariance=wrong)
        given = problem.scene, problem.surfaces, SENSOR, initial
        with pytest.raises(ConfigurationError, match="^initial covariance " + text):
            MultiplicativeUKF(*given) if kind == "ukf" else BatchEstimator(*given, Streams(ALL))


def test_surfaces_of_parts_are_joined(problem):
    surfaces = problem.surfaces
    parts = [surfaces_of(surfaces, np.array(some, dtype=int)) for some in ([0], [], [1, 2, 3])]
    joined = joined_surfaces(parts)
    for name in set(surfaces._fields) - {"shadows", "table"}:
        np.testing.assert_array_equal(getattr(joined, name), getattr(surfaces, name))
    for name in ("shadows", "table"):
        for one, other in zip(getattr(joined, name), getattr(surfaces, name), strict=True):
            np.testing.assert_array_equal(one, other)
    assert joined.shadows.lookup is surfaces.shadows.lookup
    printed = target_surfaces(icosahedron(), Material(), 1, PRINTED)
    with pytest.raises(ConfigurationError, match="irradiance_4pi must be the same"):
        joined_surfaces([surfaces, printed])


def test_force_models_may_have_values_for_each_target(problem):
    """Frames of low lunar orbits are those of the tracks that have them."""
    start, low = 7.8e8, np.array([False, True, True, False])
    forces = instantaneous_frame_cr3bp(
        tabulate_bodies(start, start + 7200.0), start, problem.scene.step_s, 60, low
    )

    def estimator(targets, index=0):
        initial, surfaces, _ = problem.of(np.array(targets))
        given = problem.scene, surfaces, SENSOR, initial
        own = forces.of_targets(np.array(targets))
        return MultiplicativeUKF(*given, forces=own, index=index)

    def after(made, n_steps):
        return made.advance(no_measurements(made.failed.size, n_steps)).translation[:, -1]

    every, first, second = estimator(ALL), estimator([0, 1]), estimator([2, 3], 4)
    np.testing.assert_array_equal(after(first, 10), after(every, 10)[:2])
    every.remove([0])
    remaining = after(every, 10)
    np.testing.assert_array_equal(remaining, after(estimator(ALL), 20)[1:])
    with pytest.raises(ConfigurationError, match="values for 2 targets, not for 4; pass a model"):
        first.add(*problem.of([2, 3]))
    first.add(*problem.of([2, 3]), index=4, forces=forces)
    together = after(first, 10)
    np.testing.assert_array_equal(together[2:], after(second, 16))
    np.testing.assert_array_equal(together[1], remaining[0])
    initial, surfaces, _ = problem.of([0])
    with pytest.raises(ConfigurationError, match="values for 4 targets, not for 1"):
        MultiplicativeUKF(problem.scene, surfaces, SENSOR, initial, forces=forces)


@both
def test_measurements_that_do_not_fit_the_tracks_are_refused(problem, kind):
    estimator = problem.start(kind, ALL)
    records = problem.records_of(ALL, 0, 5)
    for wrong, words in (
        (records._replace(observer=records.observer + 5), r"measurements\.observer: . must be"),
        (no_measurements(2, 5), "5 steps of 2 targets do not fit 4 tracks"),
        (no_measurements(4, 99), "in a scene with 60 steps to come"),
    ):
        with pytest.raises(ConfigurationError, match=words):
            estimator.advance(wrong)
    for removed in ([1.5], [False, True, False, False]):
        with pytest.raises(ConfigurationError, match="cannot be removed"):
            estimator.remove(removed)
    initial, _, streams = problem.of(np.arange(3))
    with pytest.raises(ConfigurationError, match="estimates of 3 targets, surfaces of 4"):
        if kind == "ukf":
            MultiplicativeUKF(problem.scene, problem.surfaces, SENSOR, initial)
        else:
            BatchEstimator(problem.scene, problem.surfaces, SENSOR, initial, streams)


def test_roots_of_covariances_and_what_is_none():
    given = np.array([np.diag([4.0, 0.0, 9.0]), np.eye(3) + 0.5])
    roots = covariance_roots(given)
    np.testing.assert_allclose(roots @ roots.swapaxes(1, 2), given, rtol=1e-11, atol=1e-11)
    for wrong in (np.diag([1.0, -1.0, 1.0]), np.diag([1.0, np.nan, 1.0])):
        with pytest.raises(np.linalg.LinAlgError):
            covariance_roots(wrong[None])
