"""The posterior Cramer-Rao bound and its terms against brute force."""

import numpy as np
import pytest
from bound_problem import BRIGHT, UNEVEN, Problem
from oracles.rigid_rotation import propagate_rotation

from cislunar.attitude import grp
from cislunar.attitude.inertia import inertia_matrix
from cislunar.attitude.parameter_deviations import parameter_transition, perturbed_rotation
from cislunar.attitude.quaternion import compose, from_rotation_vector, normalize
from cislunar.attitude.rigid_body import spherical_transition
from cislunar.dynamics.propagation import propagate
from cislunar.observation.body_parameters import BodyParameterPrior
from cislunar.observation.measurement import target_magnitude
from cislunar.observation.measurement_derivatives import deviation_row, measurement_rows
from cislunar.observation.sightline import direction_angles
from cislunar.observation.target_surfaces import body_of
from cislunar.photometry.bodies import apparent_body_magnitude
from cislunar.photometry.materials import PhotometryModel
from cislunar.photometry.parameter_deviations import perturbed_body


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
        attitude, rates = propagate_rotation(start, rate, elapsed, body[0], body[2])
    else:
        attitude, rates = propagate_rotation(start, rate, elapsed, problem.inertia)
    state = truth.translation[j, 0] + change[6:12]
    times = problem.scene.step * np.arange(elapsed.size)
    return attitude, rates, propagate(state, times, method="dop853")


def _measured(scene, surfaces, j, observer, k, quaternion, state):
    place = scene.observer_position[observer, k]
    d, given = state[:3] - place, (scene.sun_position[k], scene.frame_axes[k])
    magnitude = target_magnitude(state[:3], place, *given, tuple(quaternion), surfaces, j)
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
    (true,), _ = propagate_rotation(still, omega, [dt], UNEVEN)
    back = true * np.array([-1.0, -1.0, -1.0, 1.0])
    expected = np.empty((6, 6))
    for c in range(6):
        ends = []
        for sign in (1.0, -1.0):
            change = np.zeros(6)
            change[c] = sign * 1e-4 * unit[c]
            start = from_rotation_vector(change[:3])
            (q,), (w,) = propagate_rotation(start, omega + change[3:], [dt], UNEVEN)
            ends.append(np.concatenate([grp.from_quaternion(compose(q, back)), w]))
        expected[:, c] = (ends[0] - ends[1]) / (2.0 * abs(change[c]))
    scale = np.outer(1.0 / unit, unit)
    np.testing.assert_allclose(integrated * scale, expected * scale, rtol=0, atol=3e-7)
