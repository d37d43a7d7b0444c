"""Quaternions, GRP and rigid-body rotation against scipy and closed forms."""

import numpy as np
import pytest
from oracles.rigid_rotation import propagate_rotation
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from cislunar.attitude import attitude_integrator, grp, quaternion, rigid_body
from cislunar.attitude.inertia import inertia_matrix
from cislunar.attitude.quaternion import multiply_components, rotate_components
from cislunar.errors import ConfigurationError


@pytest.fixture
def rng():
    return np.random.default_rng(20241001)


@pytest.fixture
def attitudes(rng):
    return quaternion.normalize(rng.normal(size=(200, 4)))


def scipy_rotation(q):
    """scipy rotates vectors in one frame; A(q) changes the frame: its inverse."""
    return Rotation.from_quat(q).inv()


# ---- quaternions -----------------------------------------------------------------------------


def test_attitude_matrix_agrees_with_scipy(attitudes):
    np.testing.assert_allclose(
        quaternion.attitude_matrix(attitudes), scipy_rotation(attitudes).as_matrix(), atol=1e-14
    )


def test_attitude_matrix_agrees_with_its_definition(attitudes):
    for q in attitudes[:5]:
        rho, q4 = q[:3], q[3]
        cross = np.cross(np.eye(3), rho)  # row i is e_i x rho, which is -[rho x]^T = [rho x]
        np.testing.assert_allclose(cross @ [1.0, 2.0, 3.0], np.cross(rho, [1.0, 2.0, 3.0]))
        definition = (q4**2 - rho @ rho) * np.eye(3) + 2 * np.outer(rho, rho) - 2 * q4 * cross
        np.testing.assert_allclose(quaternion.attitude_matrix(q), definition, atol=1e-14)


def test_product_is_ordered_like_the_matrices(attitudes):
    p, q = attitudes[:100], attitudes[100:]
    product = quaternion.attitude_matrix(quaternion.compose(p, q))
    factors = quaternion.attitude_matrix(p) @ quaternion.attitude_matrix(q)
    np.testing.assert_allclose(product, factors, atol=1e-14)


def test_rotation_by_90_degrees_about_z():
    # The body has turned by +90 deg: its x axis lies along inertial y.
    q = quaternion.from_rotation_vector(np.array([0.0, 0.0, np.pi / 2]))
    inertial_y = np.array([0.0, 1.0, 0.0])
    np.testing.assert_allclose(quaternion.to_body(q, inertial_y), [1, 0, 0], atol=1e-15)


def test_kernels_agree_with_array_functions(attitudes, rng):
    p, q, v = attitudes[0], attitudes[1], rng.normal(size=3)
    product, turned = multiply_components(*p, *q), rotate_components(*q, *v)
    np.testing.assert_allclose(product, quaternion.compose(p, q), atol=1e-15)
    np.testing.assert_allclose(turned, quaternion.to_body(q, v), atol=1e-15)
    np.testing.assert_allclose(
        multiply_components(*q, *quaternion.inverse(q)), [0, 0, 0, 1], atol=1e-15
    )


def test_array_functions_broadcast(attitudes, rng):
    vectors = rng.normal(size=(7, 1, 3))
    body = quaternion.to_body(attitudes[:4], vectors)
    assert body.shape == (7, 4, 3)
    np.testing.assert_allclose(
        body[5, 2], quaternion.attitude_matrix(attitudes[2]) @ vectors[5, 0], atol=1e-14
    )
    back = quaternion.to_inertial(attitudes[:4], body)
    np.testing.assert_allclose(back, np.broadcast_to(vectors, (7, 4, 3)), atol=1e-14)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 0.99e-4, 1.01e-4, 1.0, np.pi - 1e-9])
def test_quaternion_of_a_rotation_vector(angle, rng):
    axis = rng.normal(size=3)
    vector = angle * axis / np.linalg.norm(axis)
    q = quaternion.from_rotation_vector(vector)
    np.testing.assert_allclose(q, Rotation.from_rotvec(vector).as_quat(), rtol=1e-15, atol=1e-15)


# ---- generalized Rodrigues parameters --------------------------------------------------------


def test_grp_round_trip(attitudes):
    for q in attitudes:
        p = grp.grp_from_quaternion_components(*q)
        back = grp.quaternion_from_grp_components(*p)
        np.testing.assert_allclose(back, np.sign(q[3]) * q, atol=1e-13)


def test_grp_kernels_agree_with_array_functions(attitudes):
    p = grp.from_quaternion(attitudes)
    q = grp.to_quaternion(p)
    for i in range(5):
        found = grp.grp_from_quaternion_components(*attitudes[i])
        np.testing.assert_allclose(found, p[i])
        np.testing.assert_allclose(grp.quaternion_from_grp_components(*p[i]), q[i])
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1.0, rtol=1e-14)


def test_grp_is_that_of_the_rotation_vector_of_scipy(attitudes):
    """f sin(angle / 2) / (a + cos(angle / 2)) along the axis, with a = 0.5 and f = 3."""
    vector = Rotation.from_quat(attitudes).as_rotvec()
    angle = np.linalg.norm(vector, axis=1)[:, None]
    expected = 3.0 * np.sin(angle / 2) / (0.5 + np.cos(angle / 2)) * vector / angle
    np.testing.assert_allclose(grp.from_quaternion(attitudes), expected, atol=1e-13)


def test_small_grp_is_the_rotation_vector():
    """p - angle is of third order in the angle, since f = 2 (a + 1)."""
    axis = np.array([1.0, -2.0, 2.0]) / 3.0
    for angle in (1e-1, 1e-2):
        q = quaternion.from_rotation_vector(angle * axis)
        p = grp.from_quaternion(q)
        excess = np.abs(p - angle * axis).max() / angle**3
        # f sin(h)/(a + cos(h)), h = angle/2: (1/24) (3/(1 + a) - 1) angle^3 to leading order
        leading = abs(3.0 / (1.0 + 0.5) - 1.0) / 24.0 * 2.0 / 3.0
        assert excess == pytest.approx(leading, rel=2e-2)


def test_grp_of_opposite_signs_and_half_turn(attitudes):
    np.testing.assert_array_equal(grp.from_quaternion(attitudes), grp.from_quaternion(-attitudes))
    half_turn = np.array([1.0, 0.0, 0.0, 0.0])
    found = grp.grp_from_quaternion_components(*half_turn)
    np.testing.assert_allclose(found, [6.0, 0.0, 0.0])
    np.testing.assert_allclose(grp.from_quaternion(half_turn), [6.0, 0.0, 0.0])


# ---- rigid bodies ----------------------------------------------------------------------------


def test_spherical_propagation_solves_the_kinematics(rng):
    q0, omega = quaternion.normalize(rng.normal(size=4)), rng.normal(size=3)

    def rate(_, q):
        return 0.5 * quaternion.compose(np.append(omega, 0.0), q)

    solution = solve_ivp(rate, (0.0, 5.0), q0, method="DOP853", rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(
        rigid_body.propagate_spherical(q0, omega, 5.0), solution.y[:, -1], atol=1e-10
    )


def test_spherical_propagation_composes_and_reverses(rng):
    q0, omega = quaternion.normalize(rng.normal(size=4)), rng.normal(size=3)
    once = rigid_body.propagate_spherical(q0, omega, 3.0)
    twice = rigid_body.propagate_spherical(
        rigid_body.propagate_spherical(q0, omega, 1.0), omega, 2.0
    )
    np.testing.assert_allclose(once, twice, atol=1e-15)
    np.testing.assert_allclose(
        rigid_body.propagate_spherical(once, omega, -3.0), q0, rtol=0, atol=1e-15
    )


def test_general_body_keeps_energy_and_inertial_angular_momentum(rng):
    inertia = np.array([[3.0, 0.2, -0.1], [0.2, 2.0, 0.3], [-0.1, 0.3, 1.5]])
    q0, omega = quaternion.normalize(rng.normal(size=4)), np.array([0.1, 1.0, 0.2])
    times = np.linspace(0.0, 200.0, 101)
    q, w = propagate_rotation(q0, omega, times, inertia)
    energy = np.einsum("ti,ij,tj->t", w, inertia, w)
    momentum = quaternion.to_inertial(q, w @ inertia)
    assert np.ptp(w, axis=0).min() > 0.1  # it does tumble
    np.testing.assert_allclose(energy, energy[0], rtol=1e-11)
    np.testing.assert_allclose(
        momentum, np.broadcast_to(momentum[0], momentum.shape), atol=1e-11 * np.abs(momentum).max()
    )


def test_symmetric_top_agrees_with_its_closed_form():
    """Transverse rate turns at (I3/I1 - 1) w3 in the body; the axis turns at H/I1 in space."""
    transverse, axial = 2.0, 3.1
    omega = np.array([0.4, 0.0, 0.7])
    times = np.linspace(-20.0, 50.0, 29)
    q, w = propagate_rotation([0, 0, 0, 1], omega, times, [transverse, transverse, axial])
    nutation = (axial / transverse - 1.0) * omega[2] * times
    closed = np.stack(
        [0.4 * np.cos(nutation), 0.4 * np.sin(nutation), np.full(times.size, 0.7)], axis=1
    )
    np.testing.assert_allclose(w, closed, atol=1e-11)
    momentum = np.array([transverse * 0.4, 0.0, axial * 0.7])
    precession = Rotation.from_rotvec(np.outer(times, momentum) / transverse)
    axis = quaternion.to_inertial(q, [0.0, 0.0, 1.0])
    np.testing.assert_allclose(axis, precession.apply([0.0, 0.0, 1.0]), atol=1e-11)


def test_general_integrator_agrees_with_closed_form_on_a_sphere(rng):
    """Same integrator, spherical inertia: the branch that torque-free motion skips."""
    q0, omega = quaternion.normalize(rng.normal(size=4)), rng.normal(size=3) * 1e-4
    q, w = np.empty(4), np.empty(3)
    unit = np.eye(3)
    rigid_body.propagate_kernel(q0, omega, unit, unit, 86400.0, 1e-13, q, w)
    closed = rigid_body.propagate_spherical(q0, omega, 86400.0)
    np.testing.assert_allclose(q, closed, atol=1e-11)
    np.testing.assert_allclose(w, omega, rtol=1e-13)
    spherical = propagate_rotation(q0, omega, [86400.0], 1047.2)
    np.testing.assert_allclose(spherical[0][0], closed, atol=1e-14)


def test_body_at_rest_stays():
    q, w = propagate_rotation([0, 0, 0, 1], [0, 0, 0], [0.0, 1e5], [3, 2, 1.5])
    np.testing.assert_array_equal(q, [[0, 0, 0, 1]] * 2)
    np.testing.assert_array_equal(w, np.zeros((2, 3)))


def test_scale_of_inertia_does_not_matter():
    arguments = ([0, 0, 0, 1], [0.1, 0.9, 0.3], [10.0])
    q, w = propagate_rotation(*arguments, [3, 2, 1.5])
    q2, w2 = propagate_rotation(*arguments, np.diag([3e3, 2e3, 1.5e3]))
    np.testing.assert_allclose(q, q2, atol=1e-14)
    np.testing.assert_allclose(w, w2, atol=1e-14)


def _solved(q0, omega, inertia, acceleration, duration):
    """Euler's equations with a constant torque by SciPy."""
    matrix = np.diag(inertia)

    def rate(_, y):
        turn = 0.5 * quaternion.compose(np.append(y[4:], 0.0), y[:4])
        gyroscopic = np.linalg.solve(matrix, np.cross(matrix @ y[4:], y[4:]))
        return np.concatenate([turn, gyroscopic + acceleration])

    start = np.concatenate([q0, omega])
    return solve_ivp(rate, (0.0, duration), start, method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]


@pytest.mark.parametrize("inertia", [[1.0, 1.0, 1.0], [3.0, 2.0, 1.5]])
@pytest.mark.parametrize("size", [0.0, 1e-3, 0.3])
def test_constant_torque_agrees_with_scipy(inertia, size, rng):
    q0, omega = quaternion.normalize(rng.normal(size=4)), rng.normal(size=3)
    acceleration = size * rng.normal(size=3)
    expected = _solved(q0, omega, inertia, acceleration, 20.0)
    q, w = propagate_rotation(q0, omega, [7.0, 20.0], inertia, acceleration)
    np.testing.assert_allclose(q[1], expected[:4], atol=2e-10)
    np.testing.assert_allclose(w[1], expected[4:], atol=2e-10)


def test_torque_spins_up_a_body_at_rest_about_its_axis():
    q, w = propagate_rotation([0, 0, 0, 1], [0, 0, 0], [4.0], [3, 2, 1.5], [0.0, 0.0, 0.05])
    np.testing.assert_allclose(w, [[0.0, 0.0, 0.2]], atol=1e-12)
    angle = 0.5 * 0.05 * 4.0**2
    np.testing.assert_allclose(q, [[0, 0, np.sin(angle / 2), np.cos(angle / 2)]], atol=1e-12)


@pytest.mark.parametrize(("scale", "dt"), [(2e-4, 60.0), (0.05, 60.0), (1e-9, 1.0)])
def test_short_step_agrees_with_the_propagation(scale, dt, rng):
    inertia = np.array([[3.0, 0.2, -0.1], [0.2, 2.0, 0.3], [-0.1, 0.3, 1.5]])
    q0, omega = quaternion.normalize(rng.normal(size=4)), scale * rng.normal(size=3)
    q, w = propagate_rotation(q0, omega, [dt], inertia)
    stepped = attitude_integrator.torque_free_step(*omega, inertia, np.linalg.inv(inertia), dt)
    steps = max(1.0, np.linalg.norm(omega) * dt / attitude_integrator.TURN_PER_STEP)
    turned = quaternion.compose(np.array(stepped[:4]), q0)
    np.testing.assert_allclose(turned, q[0], atol=2e-9 * steps)
    np.testing.assert_allclose(stepped[4:], w[0], atol=2e-9 * steps * scale)


@pytest.mark.parametrize(
    ("inertia", "message"),
    [
        ([1.0, 1.0, 3.0], "exceed the sum"),
        ([1.0, -1.0, 1.0], "positive"),
        ([[2, 1, 0], [0, 2, 0], [0, 0, 2]], "symmetric"),
        ([1.0, 2.0], "3 x 3"),
        ([1.0, np.nan, 1.0], "3 x 3"),
    ],
)
def test_impossible_inertia_is_refused(inertia, message):
    with pytest.raises(ConfigurationError, match=message):
        inertia_matrix(inertia)


@pytest.mark.parametrize("duration", [1e-6, 3.0])
def test_gradients_carried_back_to_initial_error_and_rate(duration, rng):
    """Chain rule through dq(omega t) (x) dq(p) (x) q against central differences."""
    nominal = quaternion.normalize(rng.normal(size=4))
    p, omega = np.array([0.3, 0.5, -0.4]), np.array([0.3, -0.2, 0.5])
    vector, weight = rng.normal(size=3), rng.normal(size=3)

    def body_vector(x):
        start = quaternion.compose(grp.to_quaternion(x[:3]), nominal)
        return quaternion.to_body(rigid_body.propagate_spherical(start, x[3:], duration), vector)

    x = np.concatenate([p, omega])
    # A small turn e of the body changes a body vector b by b x e.
    gradient = np.cross(weight, body_vector(x))
    back = rigid_body.pull_back_gradient(omega, duration, *gradient)
    over_p = grp.pull_back_to_grp(p, np.array(back[:3]))
    h = 1e-5
    numerical = [
        weight @ (body_vector(x + step) - body_vector(x - step)) / (2 * h) for step in np.eye(6) * h
    ]
    np.testing.assert_allclose(np.concatenate([over_p, back[3:]]), numerical, atol=2e-10)
