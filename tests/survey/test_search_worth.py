"""Worth of architectures for the search, against single objects and times."""

from itertools import combinations

import numpy as np
import pytest
from oracles.visibility import sun_at

from cislunar.architecture.coverage import (
    CoverageObjective,
    certify_coverage,
    coverage_tables,
)
from cislunar.constants import SECONDS_PER_DAY, TIME_UNIT_S
from cislunar.dynamics import propagate
from cislunar.errors import ConfigurationError
from cislunar.orbit_determination import AdmissibleRegion
from cislunar.orbits.families import observer_library
from cislunar.survey import search_tables
from cislunar.visibility.counts import VisibilitySettings, observation_times

ORBITS = observer_library({"Halo_L2_S": 2, "Lyap_L1": 2})
TIMES = observation_times(1.5, 3.0)
SUN = sun_at(TIMES)
SETTINGS = VisibilitySettings(
    limiting_magnitude=16.0, target_radius_m=1.0,
    exclusion_deg={"sun": 45.0, "moon": 10.0, "earth": 10.0}, eclipse=True,
)  # fmt: skip
OBJECTS = np.array(
    [[1.125424, 0.0, -0.1817, 0.0, -0.225458, 0.0], [1.05, 0.1, 0.0, 0.0, -0.4, 0.02],
     [0.82, 0.0, 0.05, 0.0, 0.15, 0.0], [0.5, 0.8, 0.05, 0.0, 0.0, 0.1],
     [-0.6, 0.3, 0.1, 0.2, -0.5, 0.0]]
)  # fmt: skip


@pytest.fixture(scope="module")
def tables():
    return search_tables(ORBITS, OBJECTS, TIMES, SUN, SETTINGS, phases=3, fold=3)


def test_the_worth_is_that_of_each_object_at_each_time(tables):
    """Static tables of one object at one time, whose kernel is tested against the definition."""
    days = np.floor(TIMES * TIME_UNIT_S / SECONDS_PER_DAY + 1e-9).astype(int)
    seen = np.zeros((12, days.max() + 1, len(OBJECTS)), dtype=bool)
    for j, state in enumerate(OBJECTS):
        since = TIMES - np.where(days == 0, 0.0, TIMES[days.argmax()])  # begins anew each day
        path = np.array([propagate(state, [t], method="dop853")[0, :3] for t in since])
        static = coverage_tables(ORBITS, path, TIMES, SUN, SETTINGS, phases=3)
        for slot in range(12):
            own = CoverageObjective(static).seen([slot], [1])
            for k, day in enumerate(days):
                seen[slot, day, j] |= own[k, k]
    assert 0.05 < seen.mean() < 0.95
    objective = CoverageObjective(tables)
    assert tables.shape == seen.shape[1:]
    for chosen in ([0], [3, 8], [0, 1, 5, 11]):
        found = objective.value(chosen, np.ones(len(chosen), int))
        assert found == pytest.approx(np.minimum(seen[chosen].sum(axis=0), 3).mean() / 3)


def test_the_bound_holds_for_all_architectures(tables):
    objective = CoverageObjective(tables)
    best = max(objective.value(pair, [1, 1, 1]) for pair in combinations(range(12), 3))
    found = certify_coverage(objective, 3)
    assert found.value == pytest.approx(best) and found.bound >= best - 1e-12


def test_particles_that_leave_are_left_out():
    fast = [[1.5, 0.0, 0.0, 2.0, 0.0, 0.0]]
    whole = search_tables(ORBITS, np.concatenate([OBJECTS, fast]), TIMES, SUN, SETTINGS, phases=2)
    assert whole.shape[1] == len(OBJECTS)
    with pytest.raises(ConfigurationError, match="none of 1 particles stays") as caught:
        search_tables(ORBITS, fast, TIMES, SUN, SETTINGS, phases=2, region=AdmissibleRegion())
    assert "\n" not in str(caught.value)
    with pytest.raises(ConfigurationError, match="must have equal steps"):
        uneven = TIMES + 0.01 * (np.arange(TIMES.size) == 3)
        search_tables(ORBITS, OBJECTS, uneven, sun_at(uneven), SETTINGS, phases=2)
    with pytest.raises(ConfigurationError, match=r"target has shape \(1, 2, 3\)"):
        coverage_tables(ORBITS, np.zeros((1, 2, 3)), TIMES, SUN, SETTINGS, phases=2)
