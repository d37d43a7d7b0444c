"""True objects of a survey: states that are propagated again, and the memory that they need."""

import numpy as np
import pytest
from test_survey import N_OBJECTS, PROBLEM, SENSOR, TRUTH

from cislunar.detection import DetectionProcess, Exposures
from cislunar.dynamics import EARTH_MOON
from cislunar.dynamics.ephemeris_forces import ephemeris_forces
from cislunar.ephemeris import tabulate_bodies
from cislunar.survey import TrueObjects, true_objects
from cislunar.targets import DrawnManeuvers, Maneuvers

STEPS, BLOCKS = 10, 36
START = 7.8e8
NO_EXPOSURES = Exposures(
    np.empty(0, dtype=int), np.empty(0, dtype=int), np.empty((0, 2)), np.empty(0), np.empty(0)
)


def forces_of(dynamics):
    """The CR3BP, or ephemeris forces with another radiation pressure on each object."""
    if dynamics == "cr3bp":
        return EARTH_MOON
    table = tabulate_bodies(START, START + 86400.0)
    return ephemeris_forces(table, START, area_to_mass=0.01 * np.arange(1, N_OBJECTS + 1))


@pytest.fixture(scope="module", params=["cr3bp", "ephemeris"])
def world_and_path(request):
    """Objects after a run, with their states at all its times."""
    every = DrawnManeuvers(
        smallest_m_s=1, largest_m_s=50, interval_hours=1.3, duration_minutes=7, share=0.7
    )
    # an impulse at the end of a block, along the local axes about the Moon
    stated = Maneuvers(
        np.array([0]), np.array([600.0 * STEPS]), np.zeros(1), np.array([[3.0, -2.0, 1.0]]),
        np.array([2]),
    )  # fmt: skip
    truth = TRUTH._replace(
        forces=forces_of(request.param), drawn_maneuvers=(every,), maneuvers=stated
    )
    world = TrueObjects(
        PROBLEM.scene, truth, PROBLEM.epoch, PROBLEM.ids, 3, 6.0, DetectionProcess(), SENSOR, None,
        False,
    )  # fmt: skip
    parts = []
    for block in range(BLOCKS):
        _, origin = world.observe(block, block * STEPS, STEPS, NO_EXPOSURES)
        state = world.record(0, NO_EXPOSURES, None, origin).state
        parts.append(state[:, min(block, 1) :].copy())
    return world, np.concatenate(parts, axis=1)


def test_states_are_those_that_the_objects_had(world_and_path):
    """Bit for bit: at all times, at some in any order, and of all objects and of one."""
    world, path = world_and_path
    objects, steps = (each.ravel() for each in np.indices(path.shape[:2]))
    assert path.shape == (N_OBJECTS, BLOCKS * STEPS + 1, 6)
    assert world.motion.maneuvers.start_s.size > 5
    changes = world.motion.velocity_changes_m_s.copy()
    np.testing.assert_array_equal(world.states(objects, steps), path[objects, steps])
    rng = np.random.default_rng(1)
    some = rng.permutation(objects.size)[:40]
    np.testing.assert_array_equal(
        world.states(objects[some], steps[some]), path[objects[some], steps[some]]
    )
    for j in range(N_OBJECTS):
        np.testing.assert_array_equal(
            world.states([j, j], [path.shape[1] - 1, 115]), path[j, [-1, 115]]
        )
    assert world.states([], []).shape == (0, 6)
    # maneuvers are counted once
    np.testing.assert_array_equal(world.motion.velocity_changes_m_s, changes)


def test_few_states_are_kept(world_and_path):
    world, path = world_and_path
    kept = sum(each.nbytes for each in world._kept) + world._states.nbytes
    blocks = -(-BLOCKS // true_objects._BLOCKS_KEPT)
    assert kept == N_OBJECTS * 6 * 8 * (blocks + STEPS + 1) < path.nbytes / 20
