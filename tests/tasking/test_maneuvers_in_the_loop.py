"""True targets that maneuver, in the closed loop."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cislunar.constants import MU, TIME_UNIT_S
from cislunar.dynamics.cr3bp import equations_of_motion, primary_positions
from cislunar.dynamics.maneuvers import VELOCITY_UNIT_M_S, local_axes
from cislunar.estimation.kalman.mukf import mukf
from cislunar.observation.sensor import Sensor
from cislunar.targets.maneuver_model import DrawnManeuvers
from cislunar.targets.maneuvers import NO_MANEUVERS, Maneuvers
from cislunar.tasking.closed_loop import run_closed_loop
from cislunar.tasking.demonstration import tracking_problem
from cislunar.tasking.truth import TruthModel

BRIGHT = Sensor(limiting_magnitude=25.0, angle_noise_arcsec=1.0)
RECORD = "truth", "estimates", "measurements"


def maneuvers(*rows):
    """Rows of target, start (s), duration (s), axes and three components (m/s)."""
    target, start, duration, axes, *velocity = np.array(rows, dtype=float).T
    whole = target.astype(np.int64), axes.astype(np.int64)
    return Maneuvers(whole[0], start, duration, np.stack(velocity, axis=1), whole[1])


def run(given=NO_MANEUVERS, drawn=(), n=(4, 5), seeds=(3,), **settings):
    settings = {"duration_hours": 3.0, "sensor": BRIGHT, "record": RECORD} | settings
    scene, surfaces, epoch, ids, loop = tracking_problem(*n, **settings)
    truth = TruthModel(surfaces, BRIGHT.noise, np.zeros(3), maneuvers=given, drawn_maneuvers=drawn)
    estimator = mukf(use_magnitude=False)
    return run_closed_loop(
        scene, surfaces, epoch, ids, list(seeds), loop, estimator=estimator, truth=truth
    )


@pytest.fixture(scope="module")
def coasting():
    return run()


def by_scipy(state, start_s, stop_s):
    span = start_s / TIME_UNIT_S, stop_s / TIME_UNIT_S
    found = solve_ivp(
        lambda _, y: equations_of_motion(y), span, state, "DOP853", rtol=1e-13, atol=1e-14
    )
    return found.y[:, -1]


def test_the_truth_maneuvers_and_nobody_knows(coasting):
    moving = run(maneuvers((3, 5430.0, 0.0, 0, 30.0, -20.0, 10.0)))
    others = [0, 1, 2, 4]  # target 3 is observed throughout
    before, after = coasting.true_translation[0], moving.true_translation[0]
    np.testing.assert_array_equal(after[:, others], before[:, others])
    step = 5430 // 60  # number of recorded times before the impulse
    np.testing.assert_array_equal(after[:step, 3], before[:step, 3])
    here = by_scipy(before[step - 1, 3], 5400.0, 5430.0)
    here[3:] += np.array([30.0, -20.0, 10.0]) / VELOCITY_UNIT_M_S
    for k in (step, step + 40):
        expected = by_scipy(here, 5430.0, 60.0 * (k + 1))
        np.testing.assert_allclose(after[k, 3], expected, rtol=0.0, atol=1e-11)
    # up to the impulse everything is as without it, estimates and tasking included
    for name in ("estimated_translation", "sigma", "error"):
        np.testing.assert_array_equal(
            getattr(moving, name)[0, :step], getattr(coasting, name)[0, :step]
        )
    # in the interval of the impulse, the estimates of the others do not know of it either
    np.testing.assert_array_equal(
        moving.estimated_translation[0, :120, others],
        coasting.estimated_translation[0, :120, others],
    )
    assert not np.array_equal(moving.estimated_translation, coasting.estimated_translation)
    log = moving.maneuvers
    assert (log.seed.tolist(), log.target.tolist()) == ([0], [3])
    assert (log.start_s.tolist(), log.duration_s.tolist()) == ([5430.0], [0.0])
    np.testing.assert_allclose(log.velocity_m_s, [[30.0, -20.0, 10.0]], rtol=1e-14)
    assert coasting.maneuvers.target.size == 0


def test_the_noise_of_a_maneuvering_target_stays():
    """The random numbers of the measurements: without an effect on where it is, none changes."""
    given = maneuvers((3, 5430.0, 0.0, 0, 1e-12, 0.0, 0.0))
    first, second = run(), run(given)
    np.testing.assert_allclose(
        second.observations.value, first.observations.value, rtol=0.0, atol=1e-9
    )


@pytest.mark.parametrize("axes", [1, 2])
def test_local_axes_are_those_of_the_inertial_motion(coasting, axes):
    given = np.array([3.0, 40.0, -5.0])
    moving = run(maneuvers((2, 3600.0, 0.0, axes, *given)))
    state = coasting.true_translation[0, 59, 2]
    change = moving.maneuvers.velocity_m_s[0]
    # inertial position and velocity relative to the body, which moves on a circle about z
    center = np.array(primary_positions(MU)[axes - 1])
    away = state[:3] - center
    velocity = state[3:] + np.cross([0.0, 0.0, 1.0], away)
    normal = np.cross(away, velocity)
    assert change @ away / np.linalg.norm(away) == pytest.approx(3.0, rel=1e-9)
    assert change @ normal / np.linalg.norm(normal) == pytest.approx(-5.0, rel=1e-9)
    assert change @ velocity > 0.0 and np.linalg.norm(change) == pytest.approx(
        np.linalg.norm(given)
    )
    rotation = local_axes(state, center, np.zeros(3), [0.0, 0.0, 1.0])
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(rotation) == pytest.approx(1.0)


def test_a_burn_over_two_intervals_and_two_realizations():
    """Recorded with its whole change of velocity, in each realization."""
    found = run(maneuvers((0, 3000.0, 1200.0, 0, 5.0, 0.0, 1.0)), seeds=(3, 4)).maneuvers
    assert found.seed.tolist() == [0, 1] and found.duration_s.tolist() == [1200.0] * 2
    np.testing.assert_allclose(found.velocity_m_s, [[5.0, 0.0, 1.0]] * 2, rtol=1e-12)


def test_drawn_maneuvers_belong_to_seed_and_target():
    kind = DrawnManeuvers(smallest_m_s=1.0, largest_m_s=100.0)
    found = run(drawn=(kind,), seeds=(3, 4)).maneuvers
    assert found.seed.tolist() == [0] * 5 + [1] * 5
    assert all(np.all(np.diff(found.start_s[found.seed == k]) > 0.0) for k in (0, 1))
    fewer = run(drawn=(kind,), n=(4, 3)).maneuvers
    for j in range(3):
        one = found.velocity_m_s[(found.seed == 0) & (found.target == j)]
        np.testing.assert_array_equal(fewer.velocity_m_s[fewer.target == j], one)
