"""The density of undetected objects, and its priors, against single propagations and sampling."""

import numpy as np
import pytest
from scipy.stats import ks_2samp

from cislunar.constants import LENGTH_UNIT_KM, TIME_UNIT_S
from cislunar.dynamics import CR3BP, EARTH_MOON, jacobi_constant, propagate, pseudo_potential
from cislunar.errors import ConfigurationError
from cislunar.orbit_determination import AdmissibleRegion, is_admissible
from cislunar.survey import (
    SOURCES,
    DensityPrior,
    ObjectDensity,
    PriorSources,
    sample_prior,
)

HALO = np.array([1.125424, 0.0, -0.1817, 0.0, -0.225458, 0.0])
PERIOD = 2.960571
RETROGRADE = np.array([0.920026, 0.0, 0.0, 0.0, 0.501040, 0.0])
SOURCE = PriorSources(
    np.array([HALO, RETROGRADE]),
    np.array([PERIOD, 0.898841]),
    np.array([[0.85, 0.05, 0.0], [0.7, 0.0, 0.1], [1.1, 0.0, 0.02]]),
    np.array([[0.5, 0.8, 0.05, 0.0, 0.0, 0.1]]),
)


def only(name, particles=300):
    return DensityPrior(**{each: float(each == name) for each in SOURCES}, particles=particles)


def test_samples_of_orbits_and_of_points_keep_their_jacobi_constants():
    state, size = sample_prior(only("families"), SOURCE, np.random.default_rng(1))
    jacobi = jacobi_constant(state)
    expected = jacobi_constant(SOURCE.orbits)
    nearest = np.abs(jacobi[:, None] - expected).min(axis=1)
    assert nearest.max() < 1e-9 and np.unique(state[:, 0]).size > 290
    # half of the samples of each orbit, within five standard deviations
    assert abs(np.count_nonzero(np.abs(jacobi - expected[0]) < 1e-9) - 150) < 5 * np.sqrt(75)
    assert np.median(size) == pytest.approx(0.5, rel=0.2)
    state, _ = sample_prior(only("zero_velocity"), SOURCE, np.random.default_rng(2))
    expected = 2.0 * pseudo_potential(SOURCE.points)
    assert np.abs(jacobi_constant(state)[:, None] - expected).min(axis=1).max() < 1e-4
    assert np.linalg.norm(state[:, 3:], axis=1).max() > 0.1


def test_uniform_samples_are_those_of_rejection_from_a_box():
    """Distance and speed of a sample within one and a half units, where the fastest speed is
    bounded away from the bodies, against rejection in six dimensions."""
    region = AdmissibleRegion(largest_distance_km=1.5 * LENGTH_UNIT_KM)
    state, _ = sample_prior(only("uniform", 4000), SOURCE, np.random.default_rng(3), region=region)
    rng, top = np.random.default_rng(4), 4.0
    box = rng.uniform(-1.0, 1.0, (2_000_000, 6)) * np.repeat([1.5, top], 3)
    box = box[is_admissible(box, 0.0, CR3BP(), region)]

    def far(states):
        away = np.linalg.norm(states[:, :3] - [[-0.01215, 0.0, 0.0]], axis=1)
        return states[(away > 0.3) & (np.linalg.norm(states[:, :3] - [1, 0, 0], axis=1) > 0.1)]

    one, other = far(state), far(box)
    assert len(other) > 2000 and np.linalg.norm(other[:, 3:], axis=1).max() < top - 0.5
    for part in (slice(0, 3), slice(3, 6)):
        norms = (np.linalg.norm(each[:, part], axis=1) for each in (one, other))
        assert ks_2samp(*norms).pvalue > 1e-3


@pytest.mark.parametrize(("least_jacobi", "share"), [(2.0, 0.0230), (3.0, 0.0697), (3.5, 0.139)])
def test_uniform_samples_near_the_earth(least_jacobi, share):
    """Share within 0.2 of the Earth, from three million points weighted by the volume of their
    velocities."""
    region = AdmissibleRegion(least_jacobi=least_jacobi)
    state, _ = sample_prior(only("uniform", 8000), SOURCE, np.random.default_rng(3), region=region)
    near = np.mean(np.linalg.norm(state[:, :3] - [-0.01215, 0.0, 0.0], axis=1) < 0.2)
    assert near == pytest.approx(share, abs=5.0 * np.sqrt(share / 8000) + 0.03 * share)


def test_few_states_of_a_small_region_are_found():
    region = AdmissibleRegion(least_jacobi=4.5)
    for seed in range(10):
        rng = np.random.default_rng(seed)
        state, _ = sample_prior(only("uniform", 50), SOURCE, rng, region=region)
        assert np.all(jacobi_constant(state) >= 4.5)


def test_shares_and_missing_sources():
    prior = DensityPrior(families=1, zero_velocity=2, table=1, uniform=0, particles=40)
    state, size = sample_prior(prior, SOURCE, np.random.default_rng(5))
    assert state.shape == (40, 6) and size.shape == (40,)
    assert np.count_nonzero(np.all(state == SOURCE.table[0], axis=1)) == 10
    for given, source, words in (
        (prior, SOURCE._replace(points=None), "zero_velocity = 2 needs states"),
        (only("none"), SOURCE, "shares .* are all zero"),
        (only("table"), SOURCE._replace(table=np.full((1, 6), 5.0)), "no state within"),
    ):
        with pytest.raises(ConfigurationError, match=words) as caught:
            sample_prior(given, source, np.random.default_rng(6))
        assert "\n" not in str(caught.value)


def test_particles_move_as_single_states_and_lose_their_weight_outside():
    leaving = np.array([1.899, 0.0, 0.0, 1.0, -1.5, 0.0])
    density = ObjectDensity([HALO, RETROGRADE, leaving], [1.0, 1.0, 1.0], 6.0)
    time = 7200.0 / TIME_UNIT_S
    for step in (1, 2, 3):
        density.advance(step * time)
    for k, state in enumerate((HALO, RETROGRADE)):
        expected = propagate(state, [3.0 * time], forces=EARTH_MOON, method="dop853")[0]
        np.testing.assert_allclose(density.state[k], expected, atol=1e-9)
    np.testing.assert_array_equal(density.weight, [2.0, 2.0, 0.0])
    density.missed([0.5, 0.0, 1.0])
    assert density.expected == pytest.approx(3.0)
    density.advance(3.0 * time * (1.0 - 1e-16))  # the same time but for rounding
    density.advance(3.0 * time * (1.0 + 1e-15))
    with pytest.raises(ConfigurationError, match="before"):
        density.advance(time)
    with pytest.raises(ConfigurationError, match="between 0 and 1"):
        density.missed([1.5, 0.0, 0.0])


def test_objects_are_born_where_none_is_left():
    density = ObjectDensity([HALO, RETROGRADE], [1.0, 1.0], 2.0, births_per_day=24.0)
    density.missed([1.0, 1.0])
    assert density.expected == 0.0
    density.advance(3600.0 / TIME_UNIT_S)
    assert density.expected == pytest.approx(1.0, rel=1e-12)
    density.observed([0.5, 0.5], [], [], 0.1)
    assert density.expected == pytest.approx(0.5, rel=1e-12)
    with pytest.raises(ConfigurationError, match="likelihood must not be negative"):
        density.observed([0.5, 0.5], [0], [[-1.0]], 0.1)
    with pytest.raises(ConfigurationError, match="an expected number of inf"):
        ObjectDensity([HALO], [1.0], np.inf)


def test_what_is_left_is_the_mean_number_of_undetected_objects():
    """Thinning of a Poisson process: exposures that detect with a probability leave the others."""
    rng, n = np.random.default_rng(7), 20_000
    chance = np.array([[0.9, 0.2], [0.5, 0.0]])
    density = ObjectDensity([HALO, RETROGRADE], [1.0, 1.0], 4.0)
    for each in chance:
        density.missed(each)
    counts = rng.poisson(2.0, (n, 2))
    for each in chance:
        counts = rng.binomial(counts, 1.0 - each)
    error = 5.0 * np.sqrt(density.weight / n)
    assert np.all(np.abs(counts.mean(axis=0) - density.weight) < error)


def test_detections_raise_the_density_as_in_simulated_objects():
    """Expected numbers in two cells, given one detection of the first kind: all simulated runs with
    exactly these detections, against equation (1)."""
    rng, n = np.random.default_rng(8), 400_000
    weight, chance, alarms = np.array([0.6, 0.9]), np.array([0.8, 0.5]), np.array([0.3, 0.3])
    kinds = np.array([[0.7, 0.3], [0.2, 0.8]])  # of a detection (column), given the cell (row)
    counts = rng.poisson(weight, (n, 2))
    seen = rng.binomial(counts, chance)
    first = rng.binomial(seen, kinds[:, 0])
    real = np.stack([first.sum(axis=1), (seen - first).sum(axis=1)])
    total = real + rng.poisson(alarms, (n, 2)).T
    same = (total[0] == 1) & (total[1] == 0)
    assert np.count_nonzero(same) > 50_000
    density = ObjectDensity([HALO, RETROGRADE], [1.0, 1.0], 2.0)
    density.weight = weight.copy()
    density.observed(chance, [0, 1], kinds[:, 0][None], 0.3)
    np.testing.assert_allclose(counts[same].mean(axis=0), density.weight, atol=0.02)
    # without detections the weights are those after a miss; two visits share one object
    again = ObjectDensity([HALO, RETROGRADE], [1.0, 1.0], 2.0)
    again.observed(chance, [], np.empty((0, 0)), 0.3)
    np.testing.assert_allclose(again.weight, 1.0 - chance)
    again.observed([0.0, 1.0], [1], [[1.0], [1.0]], 0.0, visits=2)
    np.testing.assert_allclose(again.weight, [0.2, 1.0])


@pytest.mark.parametrize(
    "change",
    [
        {"likelihood": [[np.nan, 1.0]]},
        {"likelihood": [1.0, 1.0]},
        {"particles": [0, 2]},
        {"false_alarms": -1.0},
        {"visits": 0},
    ],
)
def test_impossible_detections_are_refused(change):
    density = ObjectDensity([HALO, RETROGRADE], [1.0, 1.0], 2.0)
    given = {"particles": [0, 1], "likelihood": [[1.0, 1.0]], "false_alarms": 0.3}
    with pytest.raises(ConfigurationError, match=f"^{next(iter(change))}"):
        density.observed([0.5, 0.5], **given | change)
    with pytest.raises(ConfigurationError, match="time = nan"):
        density.advance(np.nan)
    np.testing.assert_array_equal(density.weight, [1.0, 1.0])
