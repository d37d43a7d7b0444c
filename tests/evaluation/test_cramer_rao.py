"""The posterior Cramer-Rao bound against brute force, closed forms and the filter itself."""

import numpy as np
import pytest
from measured import during, evaluate

from cislunar.attitude import grp
from cislunar.attitude.inertia import inertia_matrix
from cislunar.attitude.parameter_deviations import parameter_transition, perturbed_rotation
from cislunar.attitude.quaternion import compose, from_rotation_vector, normalize
from cislunar.attitude.rigid_body import (
    propagate_torque_free,
    propagate_under_torque,
    spherical_transition,
)
from cislunar.dynamics.propagation import propagate, propagate_stm
from cislunar.errors import ConfigurationError
from cislunar.evaluation.cramer_rao import CramerRaoBound
from cislunar.observation.body_parameters import BodyParameterPrior
from cislunar.observation.measurement import target_magnitude
from cislunar.observation.measurement_derivatives import deviation_row, measurement_rows
from cislunar.observation.records import Measurements, schedule
from cislunar.observation.sensor import Sensor
from cislunar.observation.sightline import direction_angles
from cislunar.observation.target_surfaces import body_of
from cislunar.photometry.bodies import apparent_body_magnitude
from cislunar.photometry.materials import PhotometryModel
from cislunar.photometry.parameter_deviations import perturbed_body
from cislunar.tasking.closed_loop import run_closed_loop
from cislunar.tasking.demonstration import tracking_problem
from cislunar.tasking.initial_conditions import initial_estimate
from cislunar.tasking.truth import Truth, TruthModel, draw_truth

BRIGHT = Sensor(limiting_magnitude=25.0)
UNEVEN = (1.0, 1.8, 2.3)
"""Principal moments of a body whose angular velocity changes."""


class Problem:
    """Truth, observers and settings of a short run; every target is seen at every third step."""

    def __init__(self, n_targets=3, hours=3.0, inertia=1.0):
        made = tracking_problem(3, n_targets, duration_hours=hours, sensor=BRIGHT)
        self.scene, self.surfaces, epoch, ids, self.loop = made
        self.inertia = inertia
        self.surfaces = self.bodies(np.tile(inertia * np.eye(3), (n_targets, 1, 1)))
        self.sigma = self.loop.initial.components()
        initial = initial_estimate(epoch, self.sigma)
        self.truth = draw_truth(initial, self.scene, BRIGHT.noise, 4, ids)
        if inertia != 1.0:
            self.truth = self._tumbling()
        step = np.arange(self.loop.n_steps)
        self.observer = np.where(step % 3 == 1, (step // 30) % 3, -1) * np.ones((n_targets, 1), int)

    def bodies(self, inertia):
        """The targets' surfaces with other inertia."""
        return self.surfaces._replace(inertia=inertia)

    def _tumbling(self) -> Truth:
        truth = self.truth
        moved = [
            propagate_torque_free(q[0], w, self.loop.elapsed_s, self.inertia)
            for q, w in zip(truth.quaternion, truth.angular_velocity[:, 0], strict=True)
        ]
        quaternion, rate = (np.array(each) for each in zip(*moved, strict=True))
        return truth._replace(quaternion=quaternion, angular_velocity=rate)

    def bound(
        self, observer=None, sigma=None, surfaces=None, noise=BRIGHT.noise, ends=None, **changes
    ):
        """Bound of one observer, or none, for each target and step; in intervals up to `ends`."""
        observations = used_by(self.observer if observer is None else observer, noise)
        bound = CramerRaoBound(
            self.scene,
            self.surfaces if surfaces is None else surfaces,
            self.sigma if sigma is None else sigma,
            **changes,
        )
        return self.carried(bound, observations, ends)

    def carried(self, bound, observations, ends=None):
        """The bound worked through in intervals that end with these steps."""
        truth, parts, start = self.truth, [], 0
        for end in (observations.offset.shape[1] - 1,) if ends is None else ends:
            some = slice(start, end + 1)
            motion = truth.translation, truth.quaternion, truth.angular_velocity
            states = [each[:, some] for each in motion]
            parts.append(bound.advance(*states, during(observations, start, end)))
            start = end
        return np.concatenate(parts, axis=1)


def used_by(observer, noise=BRIGHT.noise):
    """Records of one observer, or none (-1), for each target and step."""
    target, step = np.nonzero(np.asarray(observer) >= 0)
    observations = schedule(target, step, observer[target, step], *observer.shape)
    variance = np.sign(noise) * np.asarray(noise) ** 2
    return Measurements(
        *observations, np.empty((target.size, 3)), np.tile(variance, (target.size, 1))
    )


@pytest.fixture(scope="module")
def problem():
    return Problem()


@pytest.fixture(scope="module")
def tumbling():
    return Problem(inertia=UNEVEN)


# The full nonlinear model, from the initial state on.


def _moved(problem, j, change, kinds):
    """Attitudes, rates and translations of target j at all times, from a changed start.

    `change` has the changes of the twelve states, then the deviations of inertia and torque.
    """
    truth = problem.truth
    start = compose(grp.to_quaternion(change[:3]), truth.quaternion[j, 0])
    rate = truth.angular_velocity[j, 0] + change[3:6]
    elapsed = problem.loop.elapsed_s
    if kinds.size:
        assumed = inertia_matrix(problem.inertia)
        body = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
        perturbed_rotation(kinds, change[12:], assumed, np.linalg.inv(assumed), body)
        attitude, rates = propagate_under_torque(start, rate, elapsed, body[0], body[2])
    else:
        attitude, rates = propagate_torque_free(start, rate, elapsed, problem.inertia)
    state = truth.translation[j, 0] + change[6:12]
    times = problem.scene.step * np.arange(elapsed.size)
    return attitude, rates, propagate(state, times, method="dop853")


def _measured(scene, surfaces, j, observer, k, quaternion, state):
    d = state[:3] - scene.observer_position[observer, k]
    s = scene.sun_position[k] - state[:3]
    magnitude = target_magnitude(
        *d, *s, scene.frame_axes[k], tuple(quaternion), surfaces, j
    )  # fmt: skip
    return np.array([magnitude, *direction_angles(*d, scene.observer_axes[k])])


def _perturbed(problem, j, kinds, amounts):
    """The targets' surfaces, with deviations of target j."""
    surfaces = problem.surfaces
    own = slice(surfaces.first[j], surfaces.first[j + 1])
    parts = [each.copy() for each in (surfaces.areas, surfaces.normals, surfaces.material)]
    perturbed = perturbed_body(kinds, amounts, body_of(surfaces, j))
    parts[0][own], parts[1][own] = perturbed.areas, perturbed.normals
    parts[2][j] = perturbed.materials[0]
    return surfaces._replace(areas=parts[0], normals=parts[1], material=parts[2])


def _all_measured(problem, j, change, turning, kinds):
    """Measurements of target j, one row each, and its state at the end as an error vector."""
    first = 12 + turning.size
    attitude, rates, states = _moved(problem, j, change[:first], turning)
    surfaces = _perturbed(problem, j, kinds, change[first:])
    rows = [
        _measured(problem.scene, surfaces, j, observer, k, attitude[k], states[k])
        for k, observer in enumerate(problem.observer[j], start=1)
        if observer >= 0
    ]
    true = problem.truth.quaternion[j, -1] * np.array([-1.0, -1.0, -1.0, 1.0])
    turn = grp.from_quaternion(compose(attitude[-1], true))
    return np.array(rows), np.concatenate([turn, rates[-1], states[-1]])


def _brute_force(problem, j, estimated_parameters=None):
    """Final bound by the information form and central differences of the model."""
    estimated_parameters = (
        BodyParameterPrior() if estimated_parameters is None else estimated_parameters
    )
    (turning, of_rotation), (kinds, of_surface) = (
        estimated_parameters.rotation_kinds(), estimated_parameters.surface_kinds(20)
    )  # fmt: skip
    sigma = np.r_[of_rotation, of_surface]
    size = 12 + sigma.size
    steps = np.r_[np.repeat([1e-6, 1e-10, 1e-8, 1e-7], 3), 1e-4 * sigma]
    rows, transition = [], []
    for c in range(size):
        change = np.zeros(size)
        change[c] = steps[c]
        (up, up_end), (down, down_end) = (
            _all_measured(problem, j, s * change, turning, kinds) for s in (1, -1)
        )
        rows.append((up - down) / (2.0 * steps[c]))
        transition.append((up_end - down_end) / (2.0 * steps[c]))
    h = np.stack(rows, axis=-1).reshape(-1, size)
    weight = np.tile(BRIGHT.noise**-2, h.shape[0] // 3)
    scale = np.r_[problem.sigma, sigma]  # information in units of the initial uncertainty
    information = np.eye(size) + (h * scale).T @ (weight[:, None] * (h * scale))
    phi = np.stack(transition, axis=-1) * scale
    return np.sqrt(np.diag(phi @ np.linalg.solve(information, phi.T)))


@pytest.mark.parametrize("j", [0, 1, 2])
def test_bound_is_that_of_the_whole_nonlinear_model(problem, j):
    np.testing.assert_allclose(problem.bound()[j, -1], _brute_force(problem, j), rtol=2e-4)


@pytest.mark.parametrize("j", [0, 2])
def test_bound_of_a_body_whose_rate_changes(tumbling, j):
    least = tumbling.bound()[j, -1]
    np.testing.assert_allclose(least, _brute_force(tumbling, j), rtol=2e-4)
    sphere = tumbling.bodies(np.tile(np.eye(3), (3, 1, 1)))
    assert np.abs(least[:6] / tumbling.bound(surfaces=sphere)[j, -1, :6] - 1.0).max() > 0.02


def test_bound_with_estimated_surface(problem):
    estimated_parameters = BodyParameterPrior(0.25, 0.25, 0.5, 0.3, 0.2, 0.1, 0.2)
    least, known = (
        problem.bound(estimated_parameters=estimated_parameters)[:, -1],
        problem.bound()[:, -1],
    )
    np.testing.assert_allclose(least[1], _brute_force(problem, 1, estimated_parameters), rtol=2e-4)
    assert np.all(least[:, :6] > known[:, :6])
    assert (least[:, :3] / known[:, :3]).max() > 1.1


def test_bound_with_estimated_reflection_law(problem):
    """The derivatives by the law are those of the magnitude, and an unknown law costs accuracy."""
    estimated_parameters = BodyParameterPrior(
        phong_share=0.7, lommel_seeliger_share=0.5, phase_slope=0.1, phase_curvature=0.1
    )
    least = problem.bound(estimated_parameters=estimated_parameters)[:, -1]
    assert np.all(least[:, :6] > problem.bound()[:, -1, :6])
    scene, surfaces, truth = problem.scene, problem.surfaces, problem.truth
    kinds, sigma = estimated_parameters.surface_kinds(20)
    row, checked = np.empty(4), 0
    for j, k, observer in ((0, 5, 0), (1, 40, 1), (2, 77, 2), (0, 150, 2)):
        q, state = truth.quaternion[j, k], truth.translation[j, k]
        deviation_row(state, q, observer, k, j, scene, surfaces, kinds, sigma, row)
        away = state[:3] - scene.observer_position[observer, k]
        light = scene.frame_axes[k] @ (scene.sun_position[k] - state[:3])
        view = -scene.frame_axes[k] @ away
        body = body_of(surfaces, j)
        reading = PhotometryModel(fresnel="sqrt" if surfaces.fresnel_sqrt else "printed")
        for i in range(4):
            ends = [
                apparent_body_magnitude(
                    q, normalize(light), normalize(view), 1e7,
                    perturbed_body(kinds, side * 1e-5 * np.eye(4)[i], body), reading,
                )
                for side in (1.0, -1.0)
            ]  # fmt: skip
            if np.isfinite(ends).all():
                assert row[i] == pytest.approx(sigma[i] * (ends[0] - ends[1]) / 2e-5, rel=1e-6)
                checked += 1
    assert checked >= 8


def test_bound_with_estimated_inertia_and_torque(tumbling):
    estimated_parameters = BodyParameterPrior(
        log_slope=0.25, log_inertia=0.1, angular_acceleration_deg_h2=0.5
    )
    least = tumbling.bound(estimated_parameters=estimated_parameters)
    np.testing.assert_allclose(
        least[1, -1], _brute_force(tumbling, 1, estimated_parameters), rtol=3e-4
    )
    assert (least[:, -1, :6] / tumbling.bound()[:, -1, :6]).max() > 1.1
    moved = tumbling.bound(estimated_parameters=estimated_parameters, ends=(7, 180))
    np.testing.assert_allclose(moved, least, rtol=1e-10)


def test_inertia_may_differ_between_targets(tumbling):
    spheres = tumbling.bodies(np.tile(np.eye(3), (3, 1, 1)))
    mixed = tumbling.bodies(np.array([np.diag(UNEVEN), np.eye(3), np.diag(UNEVEN)]))
    least = tumbling.bound(surfaces=mixed)
    np.testing.assert_array_equal(least[[0, 2]], tumbling.bound()[[0, 2]])
    np.testing.assert_array_equal(least[1], tumbling.bound(surfaces=spheres)[1])


# Terms of the bound.


def test_measurement_rows_are_the_derivatives_of_the_measurement(problem):
    scene, surfaces, truth = problem.scene, problem.surfaces, problem.truth
    rows = np.empty((3, 6))
    for j, k, observer in ((0, 5, 0), (1, 40, 1), (2, 77, 2), (0, 150, 2)):
        q, state = truth.quaternion[j, k], truth.translation[j, k]
        measurement_rows(state, q, observer, k, j, scene, surfaces, rows)
        expected = np.empty((3, 6))
        for c in range(6):
            ends = []
            for sign in (1.0, -1.0):
                change = np.zeros(6)
                change[c] = sign * (1e-6 if c < 3 else 1e-5)
                turned = compose(from_rotation_vector(change[:3]), q)
                moved = state[:3] + change[3:]
                ends.append(_measured(scene, surfaces, j, observer, k, turned, moved))
            expected[:, c] = (ends[0] - ends[1]) / (2.0 * abs(change[c]))
        for row, wanted in zip(rows, expected, strict=True):
            np.testing.assert_allclose(row, wanted, rtol=1e-5, atol=1e-7 * np.abs(wanted).max())


@pytest.mark.parametrize("rate", [1e-4, 0.01])
def test_transition_of_a_rigid_body(rate):
    """Integrated; against the closed form for a sphere and differences for another body."""
    omega, dt = rate * np.array([0.6, -0.5, 0.7]), 60.0
    closed, integrated = np.empty((6, 6)), np.empty((6, 6))
    spherical_transition(omega, dt, closed)
    none = np.empty(0, np.int64)
    parameter_transition(omega, dt, np.eye(3), np.eye(3), none, integrated)
    unit = np.repeat([1.0, 1.0 / dt], 3)  # an angular velocity counts by the turn it makes
    np.testing.assert_allclose(integrated * unit, closed * unit, rtol=0, atol=3e-7)

    inertia = np.diag(UNEVEN)
    parameter_transition(omega, dt, inertia, np.linalg.inv(inertia), none, integrated)
    still = np.array([0.0, 0.0, 0.0, 1.0])
    (true,), _ = propagate_torque_free(still, omega, [dt], UNEVEN)
    back = true * np.array([-1.0, -1.0, -1.0, 1.0])
    expected = np.empty((6, 6))
    for c in range(6):
        ends = []
        for sign in (1.0, -1.0):
            change = np.zeros(6)
            change[c] = sign * 1e-4 * unit[c]
            start = from_rotation_vector(change[:3])
            (q,), (w,) = propagate_torque_free(start, omega + change[3:], [dt], UNEVEN)
            ends.append(np.concatenate([grp.from_quaternion(compose(q, back)), w]))
        expected[:, c] = (ends[0] - ends[1]) / (2.0 * abs(change[c]))
    scale = np.outer(1.0 / unit, unit)
    np.testing.assert_allclose(integrated * scale, expected * scale, rtol=0, atol=3e-7)


# Closed forms.


def test_without_measurements_the_initial_uncertainty_is_propagated(problem):
    """With spherical inertia, the rate keeps its uncertainty and the attitude gains t J w."""
    never = np.full_like(problem.observer, -1)
    least = problem.bound(never)
    duration = problem.loop.elapsed_s[-1]
    for j in range(3):
        turn = np.empty((6, 6))
        spherical_transition(problem.truth.angular_velocity[j, 0], duration, turn)
        expected = np.sqrt((turn**2) @ problem.sigma[:6] ** 2)
        np.testing.assert_allclose(least[j, -1, :6], expected, rtol=1e-9)
        _, stm = propagate_stm(problem.truth.translation[j, 0], duration * problem.scene.step / 60)
        expected = np.sqrt((stm**2) @ problem.sigma[6:] ** 2)
        np.testing.assert_allclose(least[j, -1, 6:], expected, rtol=1e-6)


def test_linear_case_in_closed_form(problem):
    """One direction, position known far better than range: the mean of n + 1 measurements.

    With known rates and velocities the motion is known, and the components of position across the
    line of sight are averages.
    """
    sigma = problem.sigma.copy()
    sigma[3:6] *= 1e-9
    sigma[9:] *= 1e-9
    sigma[:3] *= 1e-6
    for count in (1, 4, 9):
        observer = np.full_like(problem.observer, -1)
        observer[:, :count] = 1
        least = problem.bound(observer, sigma)
        for j in range(3):
            d = problem.truth.translation[j, count, :3] - problem.scene.observer_position[1, count]
            axes = problem.scene.observer_axes[count]
            b = axes @ d
            declination = np.arcsin(b[2] / np.linalg.norm(b))
            noise = np.array([BRIGHT.noise[1] * np.cos(declination), BRIGHT.noise[2]])
            across = np.linalg.norm(d) * noise
            expected = (count / across**2 + 1.0 / sigma[6] ** 2) ** -0.5
            variance = (sigma[6] ** 2 + (expected**2).sum()) ** 0.5  # the range is not measured
            got = np.sqrt((least[j, count - 1, 6:9] ** 2).sum())
            assert got == pytest.approx(variance, rel=2e-3)


def test_process_noise_adds_its_variance_at_every_step(problem):
    never = np.full_like(problem.observer, -1)
    variance = np.zeros(12)
    variance[3:6] = (0.1 * problem.sigma[3]) ** 2
    least = problem.bound(never, process_variance=variance)
    steps = np.arange(1, problem.loop.n_steps + 1)
    expected = np.sqrt(problem.sigma[3] ** 2 + steps * variance[3])
    np.testing.assert_allclose(least[1, :, 3:6], expected[:, None] * np.ones(3), rtol=1e-9)


def test_vanishing_process_noise_changes_nothing(problem):
    """The recursion from step to step and the sum over all measurements are the same bound."""
    tiny = problem.bound(process_variance=1e-30 * problem.sigma**2)
    np.testing.assert_allclose(tiny, problem.bound(), rtol=1e-6)


# Properties of a bound.


def test_more_measurements_never_raise_the_bound(problem):
    every = problem.bound(np.where(problem.observer < 0, 0, problem.observer))
    some = problem.bound()
    none = problem.bound(np.full_like(problem.observer, -1))
    assert np.all(every <= some * (1 + 1e-9)) and np.all(some <= none * (1 + 1e-9))
    assert np.all(every[:, -1] < 0.98 * none[:, -1])


def test_bound_does_not_depend_on_units(problem):
    """Ten times the noise and the initial uncertainty give ten times the bound."""
    ten = problem.bound(sigma=10.0 * problem.sigma, noise=10.0 * BRIGHT.noise)
    np.testing.assert_allclose(ten, 10.0 * problem.bound(), rtol=1e-9)


def test_bound_does_not_depend_on_the_area(problem):
    """A larger body is brighter, but its light curve has the same information."""
    larger = problem.surfaces._replace(areas=7.0 * problem.surfaces.areas)
    np.testing.assert_allclose(problem.bound(surfaces=larger), problem.bound(), rtol=1e-9)


def test_bound_ends_where_the_truth_enters_a_primary(problem):
    translation = problem.truth.translation.copy()
    translation[1, 100:, :3] = [0.9878, 0.0, 0.001]
    lost = Problem.__new__(Problem)
    lost.__dict__ = vars(problem) | {"truth": problem.truth._replace(translation=translation)}
    least = lost.bound()
    assert np.all(np.isnan(least[1, 99:])) and np.all(np.isfinite(least[1, :98]))
    np.testing.assert_array_equal(least[[0, 2]], problem.bound()[[0, 2]])


def test_a_consistent_estimator_does_not_beat_the_bound():
    """Over targets and realizations with many observations; the filter is near the bound."""
    scene, surfaces, epoch, ids, loop = tracking_problem(5, 5, duration_hours=6.0, sensor=BRIGHT)
    result = run_closed_loop(scene, surfaces, epoch, ids, range(8), loop)
    error = (result.error[:, -60:] ** 2).astype(float)
    least = (result.bound[:, -60:] ** 2).astype(float)
    observed = result.valid.mean(axis=1) > 0.3
    assert observed.sum() >= 30
    for part, above in ((slice(6, 9), 1.5), (slice(9, 12), 1.5), (slice(0, 3), np.inf)):
        squared = (error[..., part].sum(axis=3) / least[..., part].sum(axis=3)).mean(axis=1)
        ratio = np.sqrt(squared[observed].mean())
        assert 0.85 < ratio < above, (part, ratio)


def test_the_loop_records_the_bound_of_the_measurements_used():
    scene, surfaces, epoch, ids, loop = tracking_problem(
        2, 3, duration_hours=3.0, sensor=BRIGHT, record_every=7
    )
    result = run_closed_loop(scene, surfaces, epoch, ids, (5,), loop)
    assert result.bound.shape == result.sigma.shape and result.bound.dtype == np.float32
    sigma = loop.initial.components()
    truth = draw_truth(initial_estimate(epoch, sigma), scene, BRIGHT.noise, 5, ids)
    seen_from = np.full(result.valid.shape[1:], -1)
    for number, start in enumerate(loop.epochs):
        for observer, j in enumerate(result.assignment[0, number]):
            if j >= 0:
                window = slice(start, start + loop.steps_per_interval)
                used = result.valid[0, window, j]
                seen_from[window, j] = np.where(used, observer, -1)
    least = CramerRaoBound(scene, surfaces, sigma).advance(
        truth.translation, truth.quaternion, truth.angular_velocity, used_by(seen_from.T)
    )
    expected = least[:, loop.recorded].swapaxes(0, 1).astype(np.float32)
    np.testing.assert_array_equal(result.bound[0], expected)


def test_bound_is_that_of_the_true_noise():
    """Twice the true noise raises the bound where the same measurements are used."""
    scene, surfaces, epoch, ids, loop = tracking_problem(3, 3, duration_hours=2.0, sensor=BRIGHT)
    found = []
    for factor in (1.0, 2.0):
        model = TruthModel(surfaces, factor * BRIGHT.noise, np.zeros(3))
        found.append(run_closed_loop(scene, surfaces, epoch, ids, (5,), loop, truth=model))
    same = (found[0].valid == found[1].valid).all(axis=1)[0] & found[0].valid.any(axis=1)[0]
    assert same.any()
    near, far = (each.bound[0, -1][same] for each in found)
    assert np.all(near < far) and np.all(far < 2.0 * near)


# The metric.


def test_error_over_bound():
    rng = np.random.default_rng(3)
    least = np.repeat([0.1, 1e-5, 1e-3, 2.0], 3) * np.ones((3, 4000, 12))
    error = least * rng.standard_normal(least.shape) * np.repeat([1.0, 2.0, 3.0, 4.0], 3)
    error[1, 2000:] = np.nan
    used = np.array([[True], [True], [False]])
    ratio = evaluate(error, least, used, 1.0, least).bound_ratio
    np.testing.assert_allclose(ratio[:2], np.tile([1.0, 2.0, 3.0, 4.0], (2, 1)), rtol=0.05)
    assert np.all(np.isnan(ratio[2]))
    error[0], least[1] = np.nan, np.nan
    assert np.all(np.isnan(evaluate(error, least, used, 1.0, least).bound_ratio))


def test_only_the_final_hours_count():
    error, least = np.full((1, 144, 12), 100.0), np.full((1, 144, 12), 1.0)
    error[:, -24:], least[:, -24:] = 0.02, 0.01
    used = np.ones((1, 144), dtype=bool)
    found = evaluate(error, least, used, 600.0, least)
    np.testing.assert_allclose(found.bound_ratio, 2.0, rtol=1e-12)
    assert found.bound_attitude_deg[0] == pytest.approx(np.rad2deg(0.01 * np.sqrt(3.0)))
    assert np.all(np.isnan(evaluate(error, least, used, 600.0).bound_ratio))


# Refused inputs.


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"observer": np.zeros((3, 4), dtype=int), "ends": (180,)}, "measurements"),
        ({"sigma": np.zeros(12)}, "sigma"),
        ({"process_variance": -np.ones(12)}, "process_variance"),
        ({"process_variance": np.ones(3)}, "process_variance"),
        ({"noise": (0.1, -1.0, 1e-5)}, "variance"),
    ],
)
def test_impossible_inputs_are_named(problem, changes, message):
    with pytest.raises(ConfigurationError, match=message):
        problem.bound(**changes)
