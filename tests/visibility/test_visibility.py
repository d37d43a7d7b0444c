"""Compiled visibility counts against plain NumPy, pair by pair, and independent propagation."""

import numpy as np
import pytest
from oracles.visibility import visible
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from cislunar.architecture.coverage.measures import coverage
from cislunar.architecture.coverage.tables import coverage_tables
from cislunar.constants import LENGTH_UNIT_KM, MU, TIME_UNIT_S
from cislunar.dynamics.cr3bp import equations_of_motion
from cislunar.errors import ConfigurationError
from cislunar.observation.sensor import ExclusionAngles
from cislunar.observation.sightline import EARTH_RADIUS, sunlit_share
from cislunar.orbits.catalog import periodic_orbits
from cislunar.orbits.families import OrbitSet
from cislunar.photometry.sphere import phase_function, sphere_magnitude
from cislunar.visibility.counts import (
    VisibilitySettings,
    count_visibility,
    observation_times,
)
from cislunar.visibility.kernel import count_observations, count_observers, mark_observations
from cislunar.visibility.phasing import distinct_phases
from cislunar.visibility.tracks import architecture_tracks, satellite_tracks

SYNODIC_MONTH = 29.53 * 86_400.0 / TIME_UNIT_S
UNIT_M = LENGTH_UNIT_KM * 1e3
MOON = np.array([1.0 - MU, 0.0, 0.0])
EARTH = np.array([-MU, 0.0, 0.0])


def sun_at(times):
    """A Sun that revolves once a month, in the ecliptic at 5 degrees to the Moon's plane."""
    angle = -2.0 * np.pi * np.asarray(times) / SYNODIC_MONTH
    return 389.0 * np.stack([np.cos(angle), np.sin(angle), 0.09 * np.sin(angle + 1.0)], axis=-1)


def observed(observer, target, sun, settings):
    """What one satellite observes by the compiled kernel: bool, shape (time, target)."""
    counts = count_observers(
        observer[None],
        target,
        sun,
        settings.exclusion_deg.cosines,
        settings.faintness_at(len(observer)),
        MU,
    )
    return counts > 0


OPEN = ExclusionAngles(0.0, 0.0, 0.0)
SETTINGS = VisibilitySettings()


@pytest.mark.parametrize("n_targets", [1, 127, 128, 129, 1025, 2500])
def test_every_pair_of_random_tracks(n_targets):
    rng = np.random.default_rng(n_targets)
    observer = rng.normal(size=(40, 3)) * [1.0, 1.0, 0.5]
    target = np.vstack([MOON, rng.uniform(-1.4, 1.4, (n_targets - 1, 3))])
    sun = sun_at(rng.uniform(0.0, SYNODIC_MONTH, 40))
    expected = visible(observer, target, sun, SETTINGS)
    np.testing.assert_array_equal(observed(observer, target, sun, SETTINGS), expected)
    faintness = SETTINGS.faintness_at(len(sun))
    given = observer[None, None], target, sun, SETTINGS.exclusion_deg.cosines, faintness, MU
    counts = count_observations(*given)
    np.testing.assert_array_equal(counts[0, 0], expected.sum(axis=0))
    bits = mark_observations(*given)
    np.testing.assert_array_equal(bits[0, 0], np.packbits(expected, bitorder="little"))


@pytest.mark.parametrize(
    "settings",
    [
        VisibilitySettings(limiting_magnitude=16.0, diffuse_reflection_coefficient=0.2),
        VisibilitySettings(target_radius_m=3.0, exclusion_deg=OPEN),
        VisibilitySettings(
            limiting_magnitude=19.0, exclusion_deg=ExclusionAngles(100.0, 60.0, 95.0)
        ),
    ],
)
def test_other_settings(settings):
    rng = np.random.default_rng(1)
    observer, target = 0.2 * rng.normal(size=(60, 3)), 0.2 * rng.normal(size=(300, 3))
    sun = sun_at(rng.uniform(0.0, SYNODIC_MONTH, 60))
    expected = visible(observer, target, sun, settings)
    assert 0.02 < expected.mean() < 0.98
    np.testing.assert_array_equal(observed(observer, target, sun, settings), expected)


@pytest.mark.parametrize("distance", [1e-12, 1e-9, 1e-7, 1e-6, 1e-4, 1e-2])
def test_targets_next_to_the_satellite(distance):
    # Single precision cannot distinguish such a target from the satellite; the decision must.
    rng = np.random.default_rng(2)
    observer = np.array([[0.9, 0.13, -0.2], [1.1, -0.3, 0.05]])
    direction = rng.normal(size=(500, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    sun = sun_at([0.3, 2.0])
    for t in range(2):
        target = observer[t] + distance * direction
        here = slice(t, t + 1)
        expected = visible(observer[here], target, sun[here], SETTINGS)
        assert 0.1 < expected.mean() < 0.95
        np.testing.assert_array_equal(
            observed(observer[here], target, sun[here], SETTINGS), expected
        )


def test_target_at_the_satellite_is_not_observable():
    observer = np.array([[0.9, 0.13, -0.2]])
    assert not observed(observer, observer, sun_at([0.3]), SETTINGS).any()


@pytest.mark.parametrize("margin", [1e-10, -1e-10])
@pytest.mark.parametrize("body, degrees", [(0, 35.0), (1, 5.0), (2, 15.0)])
def test_lines_of_sight_at_the_exclusion_angles(body, degrees, margin):
    # Within 1e-10 rad of the limit, far below single precision.
    rng = np.random.default_rng(4)
    observer = np.array([0.6, -0.2, 0.7])
    sun = sun_at([0.8])
    toward = (sun[0], MOON, EARTH)[body] - observer
    toward /= np.linalg.norm(toward)
    across = np.cross(toward, rng.normal(size=(400, 3)))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    angle = np.deg2rad(degrees) + margin
    length = rng.uniform(1e-3, 0.05, (400, 1))
    target = observer + length * (np.cos(angle) * toward + np.sin(angle) * across)
    bright = VisibilitySettings(limiting_magnitude=40.0)
    seen = observed(observer[None], target, sun, bright)
    assert np.all(seen == (margin > 0.0))


@pytest.mark.parametrize("margin", [1e-9, -1e-9])
def test_targets_at_the_limiting_magnitude(margin):
    rng = np.random.default_rng(6)
    observer, sun = np.array([0.6, -0.2, 0.7]), sun_at([0.8])
    direction = rng.normal(size=(200, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)

    def excess(length, unit):
        target = observer + length * unit
        light = target - sun[0]
        alpha = np.arccos(np.dot(unit, light) / np.linalg.norm(light))
        return sphere_magnitude(length * UNIT_M, alpha) - 18.0

    no_exclusion = VisibilitySettings(exclusion_deg=OPEN)
    length = np.array([brentq(excess, 1e-6, 10.0, args=(u,), xtol=1e-14) for u in direction])
    target = observer + direction * (length * (1.0 - margin))[:, None]
    seen = observed(observer[None], target, sun, no_exclusion)
    assert np.all(seen == (margin > 0.0))


def test_phase_polynomial_stays_within_the_rounding_allowed():
    # The kernel decides again in double precision within 2e-6; its polynomial must be closer.
    from cislunar.visibility import kernel

    cosine = np.cos(np.linspace(0.0, np.pi, 20_001))
    x = np.abs(cosine)
    k = sum(getattr(kernel, f"_K{power}") * x**power for power in range(9))
    fitted = np.pi * np.maximum(cosine, 0.0) + (1.0 - x) ** 1.5 * k
    exact = phase_function(np.arccos(cosine))
    assert np.max(np.abs(fitted - exact)) < 0.25 * kernel._ROUNDING


def test_observers_are_counted_by_satellite():
    rng = np.random.default_rng(7)
    track = rng.normal(size=(9, 12, 3))
    target = rng.normal(size=(150, 3))
    sun = sun_at(rng.uniform(0.0, SYNODIC_MONTH, 12))
    expected = sum(visible(each, target, sun, SETTINGS).astype(int) for each in track)
    counts = count_observers(
        track, target, sun, SETTINGS.exclusion_deg.cosines, SETTINGS.faintness_at(len(sun)), MU
    )
    assert expected.max() > 2
    np.testing.assert_array_equal(counts, expected)


def test_targets_too_faint_in_shadow_are_not_observed():
    """Pair by pair, by the share of the Sun that is seen: counts, coverage and its tables."""
    settings = VisibilitySettings(exclusion_deg=OPEN, eclipse=True)
    times, sun = np.zeros(1), sun_at([0.4])
    away = -sun[0] / np.linalg.norm(sun[0])
    reach = np.linspace(0.01, 0.05, 12)[:, None]
    aside = np.array([0.0, 0.0, 1.0]) * EARTH_RADIUS * np.linspace(0.9, 1.1, 12)[:, None]
    target = np.vstack([EARTH + reach * away, EARTH + reach * away + aside, MOON + 0.1])
    state = np.array([[0.9, 0.05, 0.05, 0.0, 0.0, 0.0]])
    share = sunlit_share(target[:, None], sun, np.array([[EARTH, MOON]]))[:, 0]
    assert np.any(share == 0.0) and np.any((share > 0.0) & (share < 1.0)) and np.any(share == 1.0)
    seen = visible(state[:, :3], target, sun, settings)[0]
    for j in np.flatnonzero(share < 1.0):
        dim = np.inf if share[j] == 0.0 else -2.5 * np.log10(share[j])
        fainter = settings.model_copy(update={"limiting_magnitude": 18.0 - dim})
        seen[j] &= share[j] > 0.0 and visible(state[:, :3], target[j : j + 1], sun, fainter)[0, 0]
    without = settings.model_copy(update={"eclipse": False})
    lit = count_visibility(state, [0.0], target, times, sun, without, max_satellites=1)
    found = count_visibility(state, [0.0], target, times, sun, settings, max_satellites=1)
    np.testing.assert_array_equal(found.observations[0, 0], seen)
    assert lit.observations.sum() > found.observations.sum() > 0
    whole = coverage(state[:, None, :3], target, times, sun, settings)
    assert whole.union_coverage == seen.mean()
    orbits = OrbitSet(np.array(["own"]), state, *np.zeros((5, 1)))
    table = coverage_tables(orbits, target, times, sun, settings, phases=1)
    bits = np.unpackbits(table.layers[0, 0, 0].view(np.uint8), bitorder="little")
    np.testing.assert_array_equal(bits[: len(target)], seen)


def test_ten_satellites_need_32_phases():
    phase, members = distinct_phases(10)
    assert len(phase) == 32
    assert [len(rows) for rows in members] == list(range(1, 11))
    for n, rows in enumerate(members, start=1):
        np.testing.assert_allclose(phase[rows], np.arange(n) / n, rtol=1e-15)


@pytest.mark.parametrize("count", [0, 2.5, None])
def test_impossible_numbers_of_satellites_are_refused(count):
    with pytest.raises(ConfigurationError, match=f"max_satellites = {count}"):
        distinct_phases(count)


HALO = [1.14, 0.0, -0.16, 0.0, -0.223, 0.0]


@pytest.mark.parametrize(
    "call, message",
    [
        (lambda: satellite_tracks([HALO], [3.0, 3.0], [0.0], [0.0]), "period has shape"),
        (lambda: satellite_tracks(np.empty((0, 6)), [], [0.0], [0.0]), "state has shape"),
        (lambda: satellite_tracks([HALO], [3.0], 0.0, [0.0]), "phase has shape"),
        (lambda: satellite_tracks([HALO], [3.0], [0.0], [np.nan]), "times of time 0"),
        (lambda: architecture_tracks([HALO], [3.0], [0], [0.0]), r"satellites = \[0.0\]"),
        (lambda: architecture_tracks([HALO], [3.0], [1.5], [0.0]), r"satellites = \[1.5\]"),
        (lambda: architecture_tracks([HALO], [3.0], [1, 1], [0.0]), "satellites has shape"),
        (lambda: architecture_tracks([HALO], [3.0], [1], [0.0], phase=[0, 0]), "phase has shape"),
        (lambda: observation_times(np.nan, 1.0), "duration_days = nan"),
        (lambda: observation_times(1.0, np.inf), "step_hours = inf"),
        (lambda: observation_times("1", 1.0), "duration_days = '1'"),
    ],
)
def test_impossible_tracks_and_times_are_refused(call, message):
    with pytest.raises(ConfigurationError, match=message):
        call()


def test_paper_horizon():
    times = observation_times(30.0, 1.0)
    assert len(times) == 721
    np.testing.assert_allclose(times * TIME_UNIT_S, np.arange(721) * 3600.0)


def test_fractional_steps():
    np.testing.assert_allclose(observation_times(1.0, 0.1)[-1] * TIME_UNIT_S, 86_400.0)
    assert len(observation_times(0.1, 0.1)) == 25


@pytest.mark.parametrize("days, hours", [(1.0, 7.0), (1.0, 0.0), (1.0, -1.0), (-1.0, 1.0)])
def test_impossible_horizon_is_refused(days, hours):
    with pytest.raises(ConfigurationError, match="step_hours"):
        observation_times(days, hours)


@pytest.fixture(scope="module")
def stable_orbits():
    """A halo that barely leaves its orbit in 10 days of free flight, and a long L3 Lyapunov."""
    halo = periodic_orbits("Halo_L2_S", jacobi=3.05)
    lyapunov = periodic_orbits("Lyap_L3", jacobi=2.9)
    pick = int(np.argmin(halo.stability_index))
    state = np.vstack([halo.state[pick], lyapunov.state[0]])
    return state, np.array([halo.period[pick], lyapunov.period[0]])


def fly(state, times):
    """Positions by scipy's integrator, without wrapping."""
    if times[-1] == 0.0:
        return state[None]
    flown = solve_ivp(
        lambda _, s: equations_of_motion(s), (0.0, times[-1]), state, method="DOP853",
        t_eval=times, rtol=1e-13, atol=1e-13,
    )  # fmt: skip
    return flown.y.T


def test_counts_are_those_of_satellites_flown_one_by_one(stable_orbits):
    state, period = stable_orbits
    rng = np.random.default_rng(12)
    times = observation_times(10.0, 6.0)
    sun = sun_at(times)
    # Among them targets within 1000 km of a satellite's path.
    near = fly(state[0], times)[::5, :3] + rng.normal(size=(9, 3)) * 1e-3
    target = np.vstack([rng.uniform(-1.3, 1.3, (60, 3)), near])
    found = count_visibility(state, period, target, times, sun, SETTINGS, max_satellites=5)
    assert found.observations.shape == (2, 5, 69)
    assert found.observations.dtype == np.uint16
    for orbit in range(2):
        for n in range(1, 6):
            seen = np.zeros(len(target), dtype=int)
            distance = 0.0
            for j in range(n):
                start = fly(state[orbit], np.array([0.0, j * period[orbit] / n]))[-1]
                path = fly(start, times)[:, :3]
                seen += visible(path, target, sun, SETTINGS).sum(axis=0)
                distance += np.linalg.norm(path - EARTH, axis=1).sum()
                distance += np.linalg.norm(path - MOON, axis=1).sum()
            np.testing.assert_array_equal(found.observations[orbit, n - 1], seen)
            assert found.distance[orbit, n - 1] == pytest.approx(distance, rel=1e-8)


def test_library_orbits_over_the_papers_horizon(library):
    """Every family over 30 days: the compiled counts are the plain ones on the same tracks."""
    rng = np.random.default_rng(30)
    rows = np.flatnonzero(np.r_[True, library.family[1:] != library.family[:-1]]) + 11
    times = observation_times(30.0, 1.0)
    sun = sun_at(times)
    target = rng.uniform(-1.3, 1.3, (40, 3))
    state, period = library.state[rows], library.period[rows]
    found = count_visibility(state, period, target, times, sun, SETTINGS, max_satellites=2)
    track = satellite_tracks(state, period, [0.0, 0.5], times)
    expected = np.array(
        [[visible(path, target, sun, SETTINGS).sum(axis=0) for path in each] for each in track]
    )
    np.testing.assert_array_equal(found.observations[:, 0], expected[:, 0])
    np.testing.assert_array_equal(found.observations[:, 1], expected.sum(axis=1))


def test_unstable_orbit_is_wrapped_by_its_period(library):
    row = int(np.argmax(library.stability_index))
    period = library.period[row]
    times = np.array([0.0, 0.1, 0.4, 0.8]) * period
    again = np.concatenate([times, times + period, times + 7.0 * period])
    track = satellite_tracks([library.state[row]], [period], [0.0], again)[0, 0]
    np.testing.assert_allclose(track[4:8], track[:4], atol=1e-9)
    np.testing.assert_allclose(track[8:], track[:4], atol=1e-9)


def test_phases_run_ahead_of_the_first_satellite(stable_orbits):
    state, period = stable_orbits
    times = np.linspace(0.0, 1.0, 5)
    track = satellite_tracks(state, period, [0.0, 0.25], times)
    later = satellite_tracks(state[:1], period[:1], [0.0], times + 0.25 * period[0])
    np.testing.assert_allclose(track[0, 1], later[0, 0], atol=1e-12)
    np.testing.assert_allclose(track[0, 0, 0], state[0, :3], atol=1e-15)


def test_many_observations_do_not_overflow(stable_orbits):
    state, period = stable_orbits
    times = np.linspace(0.0, 5.0, 7000)
    everything = VisibilitySettings(limiting_magnitude=99.0, exclusion_deg=OPEN)
    target = np.array([[0.3, 0.4, 0.5]])
    found = count_visibility(
        state[:1], period[:1], target, times, sun_at(times), everything, max_satellites=10
    )
    np.testing.assert_array_equal(found.observations[0, :, 0], 7000 * np.arange(1, 11))


def test_progress_ends_with_all_orbits(stable_orbits):
    state, period = (np.repeat(part[:1], 10, axis=0) for part in stable_orbits)
    calls = []
    count_visibility(
        state, period, np.zeros((1, 3)), [0.0], sun_at([0.0]), SETTINGS, max_satellites=1,
        progress=lambda done, total: calls.append((done, total)),
    )  # fmt: skip
    assert calls[-1] == (10, 10)
    assert [done for done, _ in calls] == sorted({done for done, _ in calls})
