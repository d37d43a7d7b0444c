"""Information objectives, search and bound: against plain linear algebra and enumeration."""

from functools import cache, partial
from itertools import combinations, product

import numpy as np
import pytest
from oracles.visibility import sun_at, visible
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from cislunar.architecture.coverage.objective import CoverageObjective
from cislunar.architecture.information.brightness import bright_share, squared_detection_ranges
from cislunar.architecture.information.certificate import certify_information, greedy_information
from cislunar.architecture.information.kernels import gains, slopes
from cislunar.architecture.information.objective import InformationObjective
from cislunar.architecture.information.relaxation import information_bound
from cislunar.architecture.information.tables import (
    InformationTables,
    ObservationSettings,
    attitude_information,
    moving_targets,
    orbit_information,
    windows_of,
)
from cislunar.architecture.objective import Objective
from cislunar.architecture.orbit_slots import free_orbit_slots, satellite_orbit_slots
from cislunar.constants import LENGTH_UNIT_KM, TIME_UNIT_S
from cislunar.dynamics.propagation import advance_orbits, propagate, propagate_periodic
from cislunar.errors import ConfigurationError
from cislunar.estimation.initial_sigma import InitialSigma
from cislunar.observation.sensor import ARCSECOND, Sensor
from cislunar.observation.target_surfaces import target_surfaces
from cislunar.orbits.families import observer_library
from cislunar.photometry.facets import apparent_magnitude
from cislunar.photometry.materials import Material, PhotometryModel
from cislunar.photometry.shapes import icosahedron
from cislunar.visibility.counts import VisibilitySettings
from cislunar.visibility.tracks import satellite_tracks

LOWER = np.tril_indices(6)
SENSOR = Sensor(limiting_magnitude=17.5, occultation=False)
OBSERVATIONS = ObservationSettings(
    SENSOR, per_hour=20.0, initial=InitialSigma(3.0, 2.0, 20.0, 0.02)
)
MEMBERS = {"Halo_L2_S": 2, "Lyap_L3": 1}


def full(packed):
    """Symmetric matrices (..., 6, 6) of packed ones (..., 21)."""
    out = np.zeros((*packed.shape[:-1], 6, 6))
    out[..., LOWER[0], LOWER[1]] = packed
    return out + np.tril(out, -1).swapaxes(-1, -2)


@cache
def objective_of(seed, nuisance, places=9, items=12):
    """Objective of random matrices, some of them singular, some zero."""
    rng = np.random.default_rng(seed)
    observations = rng.standard_normal((places, items, 4, 6)) * rng.exponential(
        2.0, (places, items, 4, 1)
    )
    observations[rng.random((places, items)) < 0.3] = 0.0
    matrix = np.einsum("pila,pilb->piab", observations, observations)[..., LOWER[0], LOWER[1]]
    index = np.arange(places)
    return InformationObjective(
        InformationTables(
            np.ascontiguousarray(matrix), nuisance, (1, items, 1), index, np.zeros(places),
            np.full(places, "Halo_L1_N"), np.ones(places),
        )
    )  # fmt: skip


def direct(objective, chosen):
    """Mean information by its definition, with the formula of the Schur complement."""
    total = np.eye(6) + full(objective.tables.matrix[list(chosen)].sum(axis=0))
    k = objective.tables.nuisance
    left = total[:, k:, k:] - total[:, k:, :k] @ np.linalg.solve(total[:, :k, :k], total[:, :k, k:])
    return 0.5 * np.mean(np.linalg.slogdet(left)[1])


@pytest.mark.parametrize("nuisance", [0, 3])
def test_value_replacement_and_slope_are_those_of_the_definition(nuisance):
    objective = objective_of(1, nuisance)
    orbit, ones = np.array([7, 2, 4]), np.ones(3, dtype=np.int64)
    value = objective.value(orbit, ones)
    assert value == pytest.approx(direct(objective, orbit), rel=1e-12)
    assert objective.value([2, 2], [1, 1]) == 0.0
    found = objective.best_replacement(orbit, ones, 1, 1, 1, value)
    plain = Objective.best_replacement(objective, orbit, ones, 1, 1, 1, value)
    assert found[:2] == plain[:2] and found.value == pytest.approx(plain.value)
    base = objective.sums(orbit)
    slope = np.empty_like(base)
    slopes(base, nuisance, slope)
    step = 1e-6 * objective.tables.matrix[5]
    change = [np.sum(objective.item_values(base + s * step)) for s in (-1.0, 1.0)]
    assert np.sum(slope * step) == pytest.approx(0.5 * (change[1] - change[0]), rel=1e-7)


def test_gains_only_fall_and_lazy_greedy_is_greedy():
    objective = objective_of(2, 0, places=30)
    matrix = objective.tables.matrix.copy()
    matrix[15:] = matrix[:15]  # every orbit slot twice: ties
    twice = InformationObjective(
        InformationTables(matrix, *(vars(objective.tables)[key] for key in (
            "nuisance", "shape", "orbit", "phase", "family", "stability_index"
        )))
    )  # fmt: skip
    chosen, last = [], np.full(30, np.inf)
    for _ in range(8):
        base = twice.sums(chosen)
        gain = gains(base, twice.item_values(base), matrix, np.arange(30), 0)
        assert (gain <= last * (1.0 + 1e-12)).all()
        last, gain[chosen] = gain.copy(), -1.0
        chosen.append(int(np.flatnonzero(gain >= gain.max() - 1e-9)[0]))
    assert greedy_information(twice, 8)[0].tolist() == chosen


@pytest.mark.parametrize("nuisance", [0, 3])
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("number", [1, 2, 4, 8])
def test_bound_and_search_enclose_what_enumeration_finds(seed, nuisance, number):
    objective = objective_of(seed, nuisance)
    best = max(direct(objective, chosen) for chosen in combinations(range(9), number))
    found = certify_information(objective, number)
    assert found.greedy <= found.value <= best * (1.0 + 1e-12)
    assert found.value >= 0.99 * best
    assert found.bound >= best * (1.0 - 1e-12)
    assert found.gap == pytest.approx(found.bound / found.value - 1.0)
    # a tangent is a bound at any share, also far from the best
    poor = information_bound(objective, np.arange(number), steps=2)
    assert poor.bound >= best * (1.0 - 1e-12)
    if nuisance == 0:
        assert found.greedy >= (1.0 - np.exp(-1.0)) * best
        assert found.gap < 0.12
        halved = certify_information(objective, number, halvings=2)
        assert best * (1.0 - 1e-12) <= halved.bound and halved.gap < 0.12


@pytest.mark.parametrize("nuisance", [0, 3])
def test_relaxation_is_solved(nuisance):
    objective = objective_of(4, nuisance)

    def value(share):
        total = np.eye(6) + full(np.einsum("p,pie->ie", share, objective.tables.matrix))
        left = np.linalg.slogdet(total)[1] - np.linalg.slogdet(total[:, :nuisance, :nuisance])[1]
        return 0.5 * np.mean(left)

    equal = {"type": "eq", "fun": lambda share: share.sum() - 4.0}
    solved = minimize(
        lambda share: -value(share), np.full(9, 4.0 / 9.0), bounds=[(0.0, 1.0)] * 9,
        constraints=[equal], options={"ftol": 1e-10},
    )  # fmt: skip
    relaxed = information_bound(objective, np.arange(4), steps=200).bound
    assert -solved.fun <= relaxed * (1.0 + 1e-9)
    if nuisance:  # otherwise a bound of gains may be lower
        assert relaxed <= -solved.fun * (1.0 + 2e-4)


def test_a_tenth_of_a_satellite_has_not_nearly_its_whole_information():
    observations = 1e6 * np.eye(10)[:, :, None] * np.eye(6)[LOWER]  # slot c sees item c only
    tables = objective_of(0, 0).tables
    own = np.arange(10)
    same = InformationTables(
        observations, 0, (1, 10, 1), own, 0.0 * own, tables.family[own % 9], 1.0 + own
    )
    found = certify_information(InformationObjective(same), 4)
    assert found.value == pytest.approx(0.4 * 3.0 * np.log1p(1e6))
    assert found.value <= found.bound <= (1.0 + 1e-8) * found.value


def test_all_orbit_slots_are_proven_and_runs_agree_in_every_bit():
    objective = objective_of(3, 3)
    every = certify_information(objective, 9)
    assert every.proven or every.gap < 1e-8
    one, two = (certify_information(objective, 4) for _ in range(2))
    assert one.orbit.tolist() == two.orbit.tolist()
    assert (one.value, one.bound, one.steps) == (two.value, two.bound, two.steps)


@cache
def scene():
    """Observers' orbits, moving targets (one on no closed orbit), windows and Sun."""
    orbits = observer_library(MEMBERS)
    targets = observer_library({"Halo_L1_N": 2, "Halo_L2_N": 1})
    period = targets.period * np.array([1.0, 1.0, 0.0])
    windows = windows_of(6.0, 2, hours=12.0, step_hours=4.0)
    return orbits, targets.state, period, windows, sun_at(windows.times)


def seen_at(window, sample, place, tables, positions):
    """Position of an orbit slot at a time, and which targets (target, 3) it sees."""
    orbits, _, _, windows, sun = scene()
    orbit, phase = tables.orbit[place], tables.phase[place]
    time = windows.times[window, [sample]]
    track = satellite_tracks(orbits.state[[orbit]], orbits.period[[orbit]], [phase], time)[0, 0]
    settings = VisibilitySettings(SENSOR.limiting_magnitude, 1.0, 0.5, SENSOR.exclusion_deg)
    return track[0], visible(track, positions, sun[window, [sample]], settings)[0]


def later(state, elapsed):
    """State after an elapsed time."""
    return propagate(state, [elapsed], method="dop853")[0] if elapsed else state


def each_observation():
    """Window, sample, states of the targets at the window's start, and time since then."""
    _, state, period, windows, _ = scene()
    for w, start in enumerate(windows.start):
        at_start = np.array([
            propagate_periodic(s, p, [start], method="dop853")[0] if p else later(s, start)
            for s, p in zip(state, period, strict=True)
        ])  # fmt: skip
        np.testing.assert_allclose(advance_orbits(state, period, start), at_start, atol=1e-13)
        for k, time in enumerate(windows.times[w]):
            yield w, k, at_start, time - start


def test_orbit_tables_agree_with_differences():
    orbits, state, period, windows, sun = scene()
    targets, places = moving_targets(state, period, windows), free_orbit_slots(orbits, 2)
    tables = orbit_information(orbits, places, targets, windows, sun, OBSERVATIONS)
    assert tables.shape == (2, 3, 1) and tables.nuisance == 0
    sigma = OBSERVATIONS.initial.components()[6:]
    expected = np.zeros((6, 2, 3, 6, 6))
    shift = 1e-3 * np.diag(sigma)
    for w, k, at_start, elapsed in each_observation():
        place_of = [later(each, elapsed)[:3] for each in at_start]
        near = [
            [[later(each + sign * d, elapsed)[:3] for d in shift] for sign in (1.0, -1.0)]
            for each in at_start
        ]
        for place in range(6):
            observer, seen = seen_at(w, k, place, tables, np.array(place_of))
            for j in np.flatnonzero(seen):
                line = np.array(near[j]) - observer
                plus, minus = line / np.linalg.norm(line, axis=-1, keepdims=True)
                slope = (plus - minus) / 2e-3
                weight = 20.0 * 4.0 / seen.sum() / (3.0 * ARCSECOND) ** 2
                expected[place, w, j] += weight * slope @ slope.T
    found = full(tables.matrix).reshape(expected.shape)
    scale = np.sqrt(np.einsum("...ii->...", expected))[..., None, None] ** 2
    assert 0.0 < np.mean(scale > 0.0) < 1.0
    assert np.all(np.abs(found - expected) <= 1e-6 * scale + 1e-12)


def test_observations_count_by_the_share_of_bright_attitudes():
    orbits, state, period, windows, sun = scene()
    targets, places = moving_targets(state, period, windows), free_orbit_slots(orbits, 2)
    given = orbits, places, targets, windows, sun, OBSERVATIONS
    plain = orbit_information(*given).matrix
    assert np.array_equal(
        orbit_information(*given, squared_ranges=np.full((3, 7, 2), 1e9)).matrix, plain
    )
    some = np.tile([0.0, 1e9, 1e9, 1e9], (3, 7, 1))
    np.testing.assert_allclose(orbit_information(*given, squared_ranges=some).matrix, 0.75 * plain)
    some[1] = 0.0
    found = orbit_information(*given, squared_ranges=some).matrix.reshape(len(plain), 2, 3, 21)
    assert found[:, :, 0].any() and not found[:, :, 1].any()


def test_reaches_are_where_magnitudes_are_those_of_the_limit():
    shape = icosahedron(1.0)
    surfaces = target_surfaces(shape, MATERIAL, 2, MODEL)
    attitudes = Rotation.random(6, random_state=4).as_quat()
    found = np.sqrt(squared_detection_ranges(surfaces, 17.0, attitudes)) * LENGTH_UNIT_KM * 1e3
    assert found.shape == (2, 91, 6) and np.array_equal(*found)
    assert np.all(np.diff(found[0]) >= 0.0)
    for row, angle in ((0, 0.0), (30, 60.0), (60, 120.0)):
        toward = [np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle)), 0.0]
        far = [apparent_magnitude(q, [1.0, 0.0, 0.0], toward, 1.0, shape, MATERIAL, MODEL)
               for q in attitudes]  # fmt: skip
        np.testing.assert_allclose(found[0, row], np.sort(10.0 ** (0.2 * (17.0 - np.array(far)))))
    # 60 degrees between the ways to Sun and observer, between two of the distances
    squared_ranges = squared_detection_ranges(surfaces, 17.0, attitudes)[0]
    distance = np.sqrt(squared_ranges[30, 2:4].mean())
    way, light = distance * np.array([1.0, 0.0, 0.0]), 400.0 * np.array([0.5, np.sqrt(0.75), 0.0])
    assert bright_share(*way, *light, squared_ranges) == pytest.approx(3.0 / 6.0)
    with pytest.raises(ConfigurationError, match="quaternion"):
        squared_detection_ranges(surfaces, 17.0, np.empty((0, 4)))


RATE = np.deg2rad([-40.0, 5.0, 8.0]) / 3600.0
MATERIAL, MODEL = Material(), PhotometryModel(irradiance="1/r^2")


def turned_magnitude(quaternion, elapsed, light, toward, shape, change):
    """Magnitude after a while, of a body whose first angular velocity and attitude were changed."""
    q = Rotation.from_rotvec(change[3:]).inv() * Rotation.from_quat(quaternion).inv()
    q = Rotation.from_rotvec((RATE + change[:3]) * elapsed * TIME_UNIT_S).inv() * q
    distance = np.linalg.norm(toward)
    ways = light / np.linalg.norm(light), toward / distance, distance * LENGTH_UNIT_KM * 1e3
    return float(apparent_magnitude(q.inv().as_quat(), *ways, shape, MATERIAL, MODEL))


def test_attitude_tables_agree_with_differences():
    orbits, state, period, windows, sun = scene()
    shape = icosahedron(1.0)
    surfaces = target_surfaces(shape, MATERIAL, 3, MODEL)
    targets, places = moving_targets(state, period, windows), free_orbit_slots(orbits, 2)
    given = OBSERVATIONS, surfaces, RATE, np.random.default_rng(5)
    tables = attitude_information(orbits, places, targets, windows, sun, *given, attitudes=2)
    assert tables.shape == (2, 3, 2) and tables.nuisance == 3
    drawn = np.random.default_rng(5).standard_normal((2, 3, 2, 4))
    drawn /= np.linalg.norm(drawn, axis=-1, keepdims=True)
    sigma = OBSERVATIONS.initial.components()[:6]
    expected = np.zeros((6, 2, 3, 2, 6, 6))
    for w, k, at_start, elapsed in each_observation():
        turn = Rotation.from_euler("z", elapsed).as_matrix()
        positions = np.array([later(each, elapsed)[:3] for each in at_start])
        for place in range(6):
            observer, seen = seen_at(w, k, place, tables, positions)
            for j, s in product(np.flatnonzero(seen), range(2)):
                ways = turn @ (sun[w, k] - positions[j]), turn @ (observer - positions[j])
                magnitude = partial(turned_magnitude, drawn[w, j, s], elapsed, *ways, shape)
                if not magnitude(np.zeros(6)) < SENSOR.limiting_magnitude:
                    continue
                step = np.diag(1e-4 * np.roll(sigma, 3))
                slope = np.array([magnitude(d) - magnitude(-d) for d in step]) / 2e-4
                weight = 20.0 * 4.0 / seen.sum() / SENSOR.magnitude_noise**2
                expected[place, w, j, s] += weight * np.outer(slope, slope)
    found = full(tables.matrix).reshape(expected.shape)
    scale = np.einsum("...ii->...", expected)[..., None, None]
    assert 0.0 < np.mean(scale > 0.0) < 1.0
    assert np.all(np.abs(found - expected) <= 1e-4 * scale + 1e-12)


def test_satellites_of_slots_have_the_phases_of_the_paper():
    places = satellite_orbit_slots(scene()[0], [2, 0], [3, 1], [0.0, 0.25])
    assert places.orbit.tolist() == [2, 2, 2, 0]
    assert places.phase == pytest.approx([0.0, 1.0 / 3.0, 2.0 / 3.0, 0.25])


@pytest.mark.parametrize(
    "change, message",
    [
        ({"count": 0}, "count = 0"),
        ({"hours": 200.0}, "hours = 200"),
        ({"step_hours": 5.0}, "step_hours"),
    ],
)
def test_impossible_windows_are_refused(change, message):
    with pytest.raises(ConfigurationError, match=message):
        windows_of(**{"horizon_days": 6.0, "count": 2, "hours": 24.0} | change)


@pytest.mark.parametrize(
    "change, message",
    [
        ({"state": np.zeros(6)}, "state"),
        ({"period": [1.0]}, "period has shape"),
        ({"period": [-1.0, 0.0, 1.0]}, "period must not be negative"),
    ],
)
def test_impossible_orbits_are_refused_at_the_epoch_too(change, message):
    _, state, period, windows, _ = scene()
    given = {"state": state, "period": period} | change
    with pytest.raises(ConfigurationError, match=message):
        advance_orbits(**given, time=0.0)
    with pytest.raises(ConfigurationError, match=message):
        moving_targets(**given, windows=windows)


def test_impossible_settings_tables_and_numbers_are_refused():
    with pytest.raises(ConfigurationError, match=r"InformationTables, made by .* not a NoneType"):
        InformationObjective(None)
    with pytest.raises(ConfigurationError, match=r"CoverageTables, made by .* InformationTables"):
        CoverageObjective(objective_of(0, 0).tables)
    with pytest.raises(ConfigurationError, match="per_hour"):
        ObservationSettings(per_hour=0.0)
    with pytest.raises(ConfigurationError, match="velocity_m_s"):
        ObservationSettings(initial=InitialSigma(1.0, 1.0, 1.0, 0.0))
    with pytest.raises(ConfigurationError, match="phases = 0"):
        free_orbit_slots(scene()[0], 0)
    with pytest.raises(ConfigurationError, match="leaves no orbit"):
        free_orbit_slots(scene()[0], 1, 0.5)
    with pytest.raises(ConfigurationError, match="n_satellites = 10"):
        certify_information(objective_of(0, 0), 10)
    with pytest.raises(ConfigurationError, match="steps = 0"):
        certify_information(objective_of(0, 0), 3, steps=0)
