"""Propagation against scipy, the Jacobi integral, finite differences and linear theory."""

import numpy as np
import pytest
from scipy.integrate import DOP853, solve_ivp

from cislunar.constants import LENGTH_UNIT_KM, MU
from cislunar.dynamics import bounds, cr3bp
from cislunar.dynamics.bundle import propagate_bundle
from cislunar.dynamics.cr3bp import (
    CR3BP,
    equations_of_motion,
    jacobi_constant,
    libration_points,
    primary_distances,
    variational_matrix,
)
from cislunar.dynamics.instantaneous_frame_cr3bp import is_low_lunar
from cislunar.dynamics.propagation import (
    closest_approaches,
    propagate,
    propagate_many,
    propagate_periodic,
    propagate_stm,
)
from cislunar.errors import ConfigurationError, ConvergenceError

NEAR_MOON = np.array(
    [1.0286910409504162, 0.0, -0.18633781213335304, 0.0, -0.11733440134433075, 0.0]
)
NEAR_MOON_PERIOD = 1.5991853351534902
CATALOG_MU = 0.012150585609624041
GENERIC = np.array([0.6, 0.1, 0.2, -0.15, 0.3, 0.1])


def reference(state, times, method="DOP853", tolerance=1e-13, mu=MU):
    solution = solve_ivp(
        lambda _, y: equations_of_motion(y, mu),
        (0.0, times[-1]),
        state,
        method=method,
        t_eval=times,
        rtol=tolerance,
        atol=tolerance,
    )
    return solution.y.T


@pytest.mark.parametrize(("method", "scipy_name"), [("dopri5", "RK45"), ("dop853", "DOP853")])
@pytest.mark.parametrize("end", [2.0, -2.0])
def test_same_steps_and_dense_output_as_scipy(method, scipy_name, end):
    """At a loose tolerance truncation dominates: equal answers mean equal steps and extension."""
    times = np.linspace(0.0, end, 41)
    found = propagate(GENERIC, times, method=method, rtol=1e-5, atol=1e-5)
    expected = reference(GENERIC, times, scipy_name, 1e-5)
    precise = reference(GENERIC, times)
    assert np.abs(found - expected).max() < 1e-10
    assert np.abs(expected - precise).max() > 1e-7


def test_default_tolerances_reach_their_accuracy():
    times = np.linspace(0.0, 3.0, 31)
    precise = reference(GENERIC, times, tolerance=3e-14)
    scipy_error = np.abs(reference(GENERIC, times, "RK45", 1e-10) - precise).max()
    assert np.abs(propagate(GENERIC, times) - precise).max() < 1.05 * scipy_error
    assert np.abs(propagate(GENERIC, times, method="dop853") - precise).max() < 1e-11


def test_times_may_come_in_any_order_and_sign():
    times = np.array([0.7, -0.4, 0.0, 1.1, -0.9, 0.7])
    states = propagate(GENERIC, times, method="dop853")
    assert np.array_equal(states[2], GENERIC)
    assert np.array_equal(states[0], states[5])
    for t, state in zip(times, states, strict=True):
        assert np.allclose(propagate(state, [-t], method="dop853")[0], GENERIC, atol=1e-11)


@pytest.mark.parametrize("method", ["dopri5", "dop853"])
def test_many_agree_with_single_propagations_to_the_last_bit(method):
    """Neighbors have no effect: 21 states in 16 lanes, forward and backward, of various lengths."""
    rng = np.random.default_rng(3)
    states = GENERIC + 0.02 * rng.standard_normal((21, 6))
    times = rng.uniform(-1.0, 1.0, (21, 9)) * rng.uniform(0.1, 4.0, (21, 1))
    times[:, 3], times[:, 5], times[7] = 0.0, times[:, 6], 0.0
    together = propagate_many(states, times, method=method)
    alone = [propagate(*each, method=method) for each in zip(states, times, strict=True)]
    assert together.tobytes() == np.array(alone).tobytes()
    few = propagate_many(states[4:6], times[4], method=method)
    assert few[0].tobytes() == together[4].tobytes()


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_many_stms_agree_with_single_ones_to_the_last_bit(sign):
    rng = np.random.default_rng(5)
    states = GENERIC + 0.02 * rng.standard_normal((21, 6))
    durations = sign * np.cumsum(rng.uniform(0.0, 0.5, (21, 4)), axis=1)
    durations[3, 0], durations[7] = 0.0, 0.0
    tolerances = {"rtol": 1e-9, "atol": 1e-9}
    end, stm = propagate_stm(states, durations, **tolerances)
    for k in range(21):
        alone = propagate_stm(states[k], durations[k], **tolerances)
        assert end[k].tobytes() == alone[0].tobytes()
        assert stm[k].tobytes() == alone[1].tobytes()
    assert propagate_stm(states, durations[0, -1], **tolerances)[1].shape == (21, 6, 6)
    starts = propagate_stm(states, durations[0], start=rng.uniform(0.0, 9.0, 21), **tolerances)
    assert starts[0].shape == (21, 4, 6)
    np.testing.assert_array_equal(starts[0][0], end[0])  # the CR3BP does not depend on time


def test_many_name_the_first_collision():
    falling = [1.0 - MU, 0.0, 0.0, 0.0, 0.0, 0.0]
    with pytest.raises(ConvergenceError, match=r"0.98785.*stopped at t = 0 of 2: .*underflow"):
        propagate_many([GENERIC, falling, GENERIC], [1.0, 2.0])
    with pytest.raises(ConfigurationError, match=r"times of shape \(3, 1\).* 2 states"):
        propagate_many([GENERIC, GENERIC], [[1.0]] * 3)
    assert propagate_many(np.empty((0, 6)), [1.0]).shape == (0, 1, 6)


@pytest.mark.parametrize("times", [[1.0, 2.0], [0.5, -1.0]])
def test_a_collision_is_nan_beside_others_bit_for_bit(times):
    falling = [1.0 - MU + 0.004, 0.0, 0.0, 0.0, -0.004, 0.0]
    states = [GENERIC, falling, [0.9 * each for each in GENERIC]]
    many = propagate_many(states, times, on_failure="nan")
    end, stm = propagate_stm(states, times, on_failure="nan")
    assert np.isnan(many[1]).all() and np.isnan(end[1]).all() and np.isnan(stm[1]).all()
    assert many[[0, 2]].tobytes() == propagate_many(states[::2], times).tobytes()
    for given, alone in zip((end, stm), propagate_stm(states[::2], times), strict=True):
        assert given[[0, 2]].tobytes() == alone.tobytes()
    messages = []
    for function, state in ((propagate, falling), (propagate_many, [falling])):
        with pytest.raises(ConvergenceError) as failure:
            function(state, [2.0])
        messages.append(str(failure.value))
    assert messages[0] == messages[1]  # at the same time, and so after the same steps
    lost = propagate_many([*states[::2], np.full(6, np.nan)], times, on_failure="nan")
    assert lost[:2].tobytes() == many[[0, 2]].tobytes() and np.isnan(lost[2]).all()
    with pytest.raises(ConfigurationError, match="on_failure = 'skip' must be one of raise, nan"):
        propagate_many(states, times, on_failure="skip")


@pytest.mark.parametrize(("method", "drift"), [("dopri5", 1e-8), ("dop853", 1e-11)])
def test_jacobi_constant_is_conserved(method, drift):
    times = np.linspace(0.0, 10.0, 200)
    jacobi = jacobi_constant(propagate(GENERIC, times, method=method))
    assert np.abs(jacobi - jacobi_constant(GENERIC)).max() < drift


def test_stm_against_central_differences():
    duration = 1.3
    end, stm = propagate_stm(GENERIC, duration)
    assert np.allclose(end, propagate(GENERIC, [duration], method="dop853")[0], atol=1e-12)
    step = 1e-5
    for k in range(6):
        offset = np.zeros(6)
        offset[k] = step
        ahead = propagate(GENERIC + offset, [duration], method="dop853")[0]
        behind = propagate(GENERIC - offset, [duration], method="dop853")[0]
        difference = (ahead - behind) / (2.0 * step)
        assert np.allclose(stm[:, k], difference, rtol=1e-7, atol=1e-7)


def test_stm_is_symplectic_and_composes():
    middle, first = propagate_stm(GENERIC, 0.8)
    _, second = propagate_stm(middle, 0.5)
    end, whole = propagate_stm(GENERIC, 1.3)
    assert np.allclose(second @ first, whole, atol=1e-9)
    _, inverse = propagate_stm(end, -1.3)
    assert np.allclose(inverse @ whole, np.eye(6), atol=1e-8)
    assert np.linalg.det(whole) == pytest.approx(1.0, abs=1e-8)


@pytest.mark.parametrize("index", range(5))
def test_stm_at_libration_points_has_the_linear_frequencies(index):
    """eig(Phi) = exp(lambda t), lambda^4 + (4 - Uxx - Uyy) lambda^2 + Uxx Uyy - Uxy^2 = 0."""
    point = np.concatenate([libration_points()[index], np.zeros(3)])
    duration = 0.7
    _, stm = propagate_stm(point, duration)
    u = variational_matrix(point)[3:, :3]
    squared = np.roots([1.0, 4.0 - u[0, 0] - u[1, 1], u[0, 0] * u[1, 1] - u[0, 1] ** 2]).astype(
        complex
    )
    rates = np.concatenate([np.sqrt(squared), -np.sqrt(squared)])
    vertical = 1j * np.sqrt(-u[2, 2])
    expected = np.exp(duration * np.concatenate([rates, [vertical, -vertical]]))
    found = np.linalg.eigvals(stm)
    for value in expected:
        assert np.abs(found - value).min() < 1e-8


def test_periodic_propagation_stays_on_an_unstable_orbit():
    args = (NEAR_MOON, NEAR_MOON_PERIOD)
    times = np.array([0.3, 0.3 + 40 * NEAR_MOON_PERIOD, 0.3 - 25 * NEAR_MOON_PERIOD])
    states = propagate_periodic(*args, times, mu=CATALOG_MU)
    assert np.abs(states - states[0]).max() < 1e-9
    around = propagate_periodic(*args, np.linspace(0, NEAR_MOON_PERIOD, 50), mu=CATALOG_MU)
    direct = propagate(NEAR_MOON, np.linspace(0, NEAR_MOON_PERIOD, 50), forces=CR3BP(CATALOG_MU))
    # The published state closes to 5e-8 only; the two reach a fast perilune by opposite ways.
    assert np.abs(around - direct)[:, :3].max() < 1e-6


def test_fixed_step_equals_one_scipy_step():
    solver = DOP853(lambda _, y: equations_of_motion(y), 0.0, GENERIC, 1.0, first_step=0.01)
    solver.step()
    assert solver.t == 0.01
    found = propagate_bundle(GENERIC[None], 0.01, 1)[0, -1]
    assert np.allclose(found, solver.y, rtol=0.0, atol=1e-15)


def test_closest_approaches_against_dense_sampling():
    _, perilune = closest_approaches(NEAR_MOON, NEAR_MOON_PERIOD)
    times = np.linspace(0.0, NEAR_MOON_PERIOD, 200_001)
    distances = primary_distances(propagate(NEAR_MOON, times, method="dop853"))
    assert perilune == pytest.approx(distances[1].min(), rel=1e-6)
    assert perilune <= distances[1].min() * (1 + 1e-9)
    perigee, _ = closest_approaches(GENERIC, 4.0)
    times = np.linspace(0.0, 4.0, 20001)
    assert perigee == pytest.approx(primary_distances(propagate(GENERIC, times))[0].min(), rel=1e-6)


def test_collision_raises_with_time_and_remedy():
    with pytest.raises(ConvergenceError, match=r"stopped at t = 0 of 1: .*underflow"):
        propagate([1.0 - MU, 0.0, 0.0, 0.0, 0.0, 0.0], [1.0])
    just_above = [-MU, 0.0, 1e-12, 0.0, 0.0, -1.0]
    with pytest.raises(ConvergenceError, match="underflow"):
        propagate_stm(just_above, 1.0)


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"method": "euler"}, "euler"),
        ({"rtol": 1e-16}, "rtol"),
        ({"state": [1.0, 2.0]}, "6 finite numbers"),
        ({"times": [np.nan]}, "times"),
        ({"state": [*GENERIC[:4], 300.0, 0.1]}, "state: vy = 300 is taken in units of 1.02"),
    ],
)
def test_impossible_settings_are_named(kwargs, message):
    settings = {"state": GENERIC, "times": [1.0], **kwargs}
    with pytest.raises(ConfigurationError, match=message):
        propagate(settings.pop("state"), settings.pop("times"), **settings)


@pytest.mark.parametrize(
    "call, name",
    [
        (lambda: cr3bp.primary_distances([0.1, 0.2]), "position"),
        (lambda: cr3bp.pseudo_potential(1.0), "position"),
        (lambda: cr3bp.zero_velocity_function(["a", "b", "c"], 3.0), "position"),
        (lambda: cr3bp.zero_velocity_function(GENERIC[:3], "a"), "jacobi"),
        (lambda: cr3bp.equations_of_motion(GENERIC[:3]), "state"),
        (lambda: cr3bp.jacobi_constant(GENERIC[:4]), "state"),
        (lambda: cr3bp.variational_matrix([GENERIC]), "state"),
        (lambda: cr3bp.libration_points("a"), "mu"),
        (lambda: is_low_lunar(GENERIC[:3]), "state"),
    ],
)
def test_other_shapes_are_refused(call, name):
    with pytest.raises(ConfigurationError, match=f"^{name} "):
        call()


@pytest.mark.parametrize("duration", [[-1.0, 1.0], [2.0, 1.0], [0.5, np.nan], np.inf, [], [[1.0]]])
def test_durations_of_one_state_are_in_order(duration):
    with pytest.raises(ConfigurationError, match="duration of one state: give finite numbers of"):
        propagate_stm(GENERIC, duration)


def test_one_start_or_one_of_each_state():
    with pytest.raises(ConfigurationError, match=r"start has shape \(3,\); give one, or one of"):
        propagate_many([GENERIC, GENERIC], [1.0], start=np.zeros(3))


def test_a_state_in_km_has_no_least_distances():
    with pytest.raises(ConfigurationError, match="state"):
        closest_approaches(np.array([3e5, 0.0, 0.0, 0.0, 1.0, 0.0]), 1.0)


def test_states_that_are_not_examined_are_within_the_bounds():
    """At random and at the corners of the cube, in which components are largest."""
    rng = np.random.default_rng(3)
    states = bounds._WITHIN_BOUNDS * rng.uniform(-1.0, 1.0, (100_000, 6))
    states[:50_000] = bounds._WITHIN_BOUNDS * rng.choice([-1.0, 1.0], (50_000, 6))
    assert bounds._excess_km_s(states).max() < bounds._LARGEST_EXCESS_KM_S
    distance_km = LENGTH_UNIT_KM * np.linalg.norm(states[:, :3], axis=1)
    assert distance_km.max() < bounds._FURTHEST_KM
