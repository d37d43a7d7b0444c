import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cislunar.constants import GM_MOON_KM3_S2, LENGTH_UNIT_KM, MOON_RADIUS_KM, MU, TIME_UNIT_S
from cislunar.dynamics.bundle import propagate_bundle, step_bundle, step_cloud
from cislunar.dynamics.cr3bp import EARTH_MOON, equations_of_motion, jacobi_constant
from cislunar.dynamics.tableau import STAGES8
from cislunar.errors import ConfigurationError

STEP = 60.0 / TIME_UNIT_S
DAY_STEPS = 1440


def _low_lunar_orbit():
    radius = MOON_RADIUS_KM + 100.0
    speed = np.sqrt(GM_MOON_KM3_S2 / radius) * TIME_UNIT_S / LENGTH_UNIT_KM
    r = radius / LENGTH_UNIT_KM
    return np.array([1.0 - MU, 0.0, -r, speed, 0.0, 0.0])


STATES = {
    "retrograde": np.array([0.920026, 0.0, 0.0, 0.0, 0.501040, 0.0]),
    "halo": np.array([1.145831, 0.0, 0.154015, 0.0, -0.220793, 0.0]),
    "low lunar": _low_lunar_orbit(),
}


def test_a_day_of_one_minute_steps_meets_the_tolerance_of_the_paper():
    """The error over a day is 1e-12, a hundredth of the tolerance, also in a 100 km lunar orbit."""
    tracks = propagate_bundle(np.array([*STATES.values()]), STEP, DAY_STEPS)
    for name, track in zip(STATES, tracks, strict=True):
        reference = solve_ivp(
            lambda _, y: equations_of_motion(y),
            (0.0, DAY_STEPS * STEP),
            STATES[name],
            method="DOP853",
            rtol=1e-13,
            atol=1e-14,
        ).y[:, -1]
        assert np.max(np.abs(track[-1, :3] - reference[:3])) < 1e-12, name
        drift = jacobi_constant(track[-1]) - jacobi_constant(track[0])
        assert abs(drift) < 1e-12, name


def test_a_bundle_agrees_with_its_states_one_by_one():
    states = np.array([*STATES.values()])
    together = propagate_bundle(states, STEP, 10)
    alone = np.array([propagate_bundle(state[None], STEP, 10)[0] for state in states])
    np.testing.assert_allclose(together, alone, rtol=1e-14, atol=1e-15)
    np.testing.assert_array_equal(together[:, 0], states)


@pytest.mark.filterwarnings("error")
def test_a_collision_does_not_affect_other_states_and_raises_nothing():
    states = np.stack([np.array([1.0 - MU, 0.0, 0.0, 0.0, 0.0, 0.0]), STATES["halo"]])
    tracks = propagate_bundle(states, STEP, 2)
    assert not np.any(np.isfinite(tracks[0, -1]))
    np.testing.assert_array_equal(tracks[1], propagate_bundle(states[1:], STEP, 2)[0])


def _circling(center, mass, kilometers):
    """A state on a circle about a primary, in the rotating frame."""
    d = kilometers / LENGTH_UNIT_KM
    return np.array([center + 0.6 * d, 0.0, 0.8 * d, 0.0, np.sqrt(mass / d) - 0.6 * d, 0.0])


def _cloud_day(state, sigma=0.0):
    points = state[:, None] + sigma * np.random.default_rng(0).standard_normal((6, 5))
    whole = points.copy()
    slopes, work = np.empty((STAGES8, *points.shape)), np.empty(points.shape)
    for _ in range(DAY_STEPS):
        step_cloud(EARTH_MOON, 0.0, points, STEP, slopes, work)
        step_bundle(EARTH_MOON, 0.0, whole, STEP, slopes, work)
    return points, whole


@pytest.mark.parametrize(
    "state",
    [
        _circling(1.0 - MU, MU, 7_500.0),
        _circling(-MU, 1.0 - MU, 32_000.0),
        STATES["retrograde"],
        STATES["halo"],
    ],
)
def test_fewer_stages_away_from_the_primaries_are_exact_enough(state):
    """Just outside the region of full DOP853 steps, the error over a day is a tenth of 1e-10."""
    cloud, bundle = _cloud_day(state, 1e-5)
    assert 0.0 < np.max(np.abs(cloud - bundle)) < 1e-11


@pytest.mark.parametrize(
    "state", [_circling(1.0 - MU, MU, 6_500.0), _circling(-MU, 1.0 - MU, 29_000.0)]
)
def test_near_a_primary_every_stage_is_taken(state):
    cloud, bundle = _cloud_day(state)
    np.testing.assert_array_equal(cloud, bundle)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"state": np.zeros((1, 5))}, r"state has shape \(1, 5\)"),
        ({"state": STATES["halo"]}, r"state has shape \(6,\)"),
        ({"dt": np.nan}, "dt = nan"),
        ({"n_steps": -1}, "n_steps = -1"),
        ({"start": np.inf}, "start = inf"),
    ],
)
def test_impossible_arguments_are_refused(wrong, words):
    with pytest.raises(ConfigurationError, match=words):
        propagate_bundle(**({"state": STATES["halo"][None], "dt": STEP, "n_steps": 2} | wrong))
