"""Twenty observers on ten L2 and L3 halos track subsets of the 202 targets for a day.

The satellite counts are those of scenario A of Paul & Fan. The paper does not give the members of
the families, which are distributed along them. The assertions are claims of the paper that several
seeds confirm.
"""

import numpy as np
import pytest

from cislunar.constants import LENGTH_UNIT_KM, TIME_UNIT_S
from cislunar.dynamics.propagation import propagate_periodic
from cislunar.ephemeris.sampling import interpolate_sun, sample_ephemeris
from cislunar.estimation.estimator import CHOLESKY_FAILURES
from cislunar.estimation.kalman.mukf import mukf
from cislunar.evaluation.metrics import INCONSISTENT, NEVER_OBSERVED
from cislunar.observation.scene import make_scene
from cislunar.observation.target_surfaces import target_surfaces
from cislunar.orbits.families import observer_library
from cislunar.orbits.tracked import tracked_targets
from cislunar.photometry.materials import Material
from cislunar.photometry.shapes import icosahedron
from cislunar.tasking.closed_loop import run_closed_loop
from cislunar.tasking.initial_conditions import epoch_states, monitored_targets
from cislunar.tasking.settings import LoopSettings

SATELLITES = {
    "Halo_L3_N": {1: 2, 4: 1},
    "Halo_L3_S": {2: 1, 4: 1, 6: 2},
    "Halo_L2_S": {4: 7, 5: 1, 6: 3, 3: 1},
    "Halo_L2_N": {5: 1},
}
SEEDS = (0, 1, 2)


@pytest.fixture(scope="module")
def campaign():
    times = LoopSettings().elapsed_s / TIME_UNIT_S
    library = observer_library(dict.fromkeys(SATELLITES, 8))
    tracks = []
    for family, members in SATELLITES.items():
        orbits = np.flatnonzero(library.family == family)
        for member, count in members.items():
            state, period = library.state[orbits[member]], library.period[orbits[member]]
            for k in range(count):
                track = propagate_periodic(state, period, times + k * period / count)
                tracks.append(track[:, :3])
    ephemeris = sample_ephemeris(duration_days=1.0, step_minutes=10.0)
    sun = interpolate_sun(times, ephemeris.time, ephemeris.sun_position)
    targets = tracked_targets()
    states = epoch_states(targets.state, targets.period, seed=1)

    def run(n_targets, seeds=SEEDS, estimator="mukf", **settings):
        ids = monitored_targets(202, n_targets, seed=1)
        surfaces = target_surfaces(icosahedron(), Material(), n_targets)
        loop = LoopSettings(record_every=60, **settings)
        scene = make_scene(np.array(tracks), sun, loop.step_s)
        return run_closed_loop(scene, surfaces, states[ids], ids, seeds, loop, estimator=estimator)

    return run


@pytest.fixture(scope="module")
def by_target_count(campaign):
    return {n: campaign(n) for n in (20, 50, 100)}


def _observed(result):
    return result.metrics.status != NEVER_OBSERVED


def _median_rmse(result, components):
    return np.median(result.metrics.rmse[_observed(result)][:, components])


ATTITUDE, POSITION = slice(0, 3), slice(6, 9)


@pytest.mark.parametrize("n_targets", [20, 50, 100])
def test_translation_is_tracked_for_any_number_of_targets(by_target_count, n_targets):
    result = by_target_count[n_targets]
    observed = _observed(result)
    coverage = result.metrics.coverage[observed][:, 6:].mean(axis=0)
    anees = result.metrics.anees[observed][:, 6:].mean(axis=0)
    assert coverage[:3].mean() >= 0.97
    assert coverage[3:].mean() >= 0.97
    assert 0.8 <= anees[:3].mean() <= 3.0
    assert 0.8 <= anees[3:].mean() <= 3.0
    inconsistent = (result.metrics.status_translation == INCONSISTENT).sum()
    assert inconsistent <= 0.03 * observed.sum()
    assert result.counters[..., CHOLESKY_FAILURES].sum() == 0


def test_rotation_is_tracked_with_an_observer_for_each_target(by_target_count):
    result = by_target_count[20]
    observed = _observed(result)
    assert result.metrics.coverage[observed][:, :3].mean() >= 0.85
    assert np.all((result.metrics.status_rotation == INCONSISTENT).sum(axis=1) <= 5)
    assert np.median(result.final_attitude_error_deg[observed]) < 2.0


def test_errors_grow_with_the_number_of_targets(by_target_count):
    results = [by_target_count[n] for n in (20, 50, 100)]
    attitude = [_median_rmse(result, ATTITUDE) for result in results]
    position = [_median_rmse(result, POSITION) for result in results]
    final = [np.median(result.final_attitude_error_deg[_observed(result)]) for result in results]
    for figures in (attitude, position, final):
        assert figures[0] < figures[1] < figures[2]
    assert np.all(np.array(position) * LENGTH_UNIT_KM < 12.0)


def test_position_error_grows_with_the_tasking_interval(campaign):
    errors = [
        _median_rmse(campaign(50, interval_minutes=minutes), POSITION) for minutes in (30.0, 240.0)
    ]
    assert errors[0] < errors[1]


def test_without_magnitude_the_attitude_is_consistent_and_inaccurate(campaign):
    result = campaign(20, seeds=(0, 1), estimator=mukf(use_magnitude=False))
    final = np.rad2deg(np.sqrt(np.mean(result.sigma[:, -1, :, :3].astype(float) ** 2, axis=-1)))
    assert np.all((final > 34.0) & (final < 35.0))
    assert result.metrics.coverage[..., :3].mean() > 0.98
