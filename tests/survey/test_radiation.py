"""Orbits whose radiation pressure is not known: consistency for random factors."""

from types import SimpleNamespace

import numpy as np
import pytest

from cislunar.constants import TIME_UNIT_S
from cislunar.dynamics import EARTH_MOON, propagate_many
from cislunar.dynamics.ephemeris_forces import ephemeris_forces
from cislunar.ephemeris import tabulate_bodies, tdb_seconds
from cislunar.estimation.navigation import ObserverErrorSigma
from cislunar.orbit_determination import (
    AdmissibleRegion,
    OrbitStates,
    by_radiation,
    fit_orbits,
    make_angles,
    orbits_at,
    propagated,
)
from cislunar.survey import LineageSettings
from cislunar.survey.maneuvers import find_lineage, maneuvers_within, orbit_paths
from cislunar.survey.navigation import (
    RemainingErrors,
    calibrate,
    considered,
    corrected_angles,
    uncalibrated,
)

START, SIGMA, DEVIATION, OBJECTS = tdb_seconds("2024-10-01T00:00:00"), np.pi / 648_000.0, 0.3, 24
DAYS, OBSERVERS, STEP_S = 5, 3, 7_200.0
SIGMAS = ObserverErrorSigma(position_m=100, pointing_arcsec=3)
COASTING = LineageSettings(maneuvers_per_day=0)
# states at 0.6 to 0.8 units of length from the Earth, in the propagation frame of J2000 axes
RNG = np.random.default_rng(7)


FACTOR = 1.0 + DEVIATION * RNG.standard_normal(OBJECTS)


def true_forces():
    """Force models of the objects, each with its own radiation pressure."""
    table = tabulate_bodies(START, START + 86_400.0 * (DAYS + 6))
    return [ephemeris_forces(table, START, area_to_mass=0.02 * each) for each in FACTOR]


@pytest.fixture(scope="module")
def found():
    table = tabulate_bodies(START, START + 86_400.0 * (DAYS + 6))
    forces = ephemeris_forces(table, START, area_to_mass=0.02)
    angle = RNG.uniform(0.0, 2.0 * np.pi, OBJECTS)
    distance = RNG.uniform(0.6, 0.8, OBJECTS)
    start = np.zeros((OBJECTS, 6))
    start[:, :2] = (distance * [np.cos(angle), np.sin(angle)]).T
    start[:, 3:5] = (distance**-0.5 * [-np.sin(angle), np.cos(angle)]).T
    start[:, 5] = 0.1
    time = np.arange(12 * DAYS) * STEP_S / TIME_UNIT_S
    path = np.array([
        propagate_many(start[[k]], time, method="dop853", forces=own)[0]
        for k, own in enumerate(true_forces())
    ])  # fmt: skip
    owner = np.arange(time.size) % OBSERVERS
    place = np.array([[0.3, 0.0, 0.1], [-0.2, 0.4, 0.0], [0.0, -0.3, -0.2]])[owner]
    parts = path[..., :3] - place
    unit = parts / np.linalg.norm(parts, axis=2)[..., None]
    unit = unit + SIGMA * RNG.standard_normal(unit.shape)
    order = np.argsort(np.tile(time, OBJECTS), kind="stable")
    angles = make_angles(
        np.tile(time, OBJECTS)[order], np.tile(owner, OBJECTS)[order],
        np.tile(place, (OBJECTS, 1))[order], unit.reshape(-1, 3)[order], SIGMA,
    )  # fmt: skip
    of = np.repeat(np.arange(OBJECTS), time.size)[order]
    rows = [np.flatnonzero(of == k) for k in range(OBJECTS)]
    fits = fit_orbits(angles, rows, path[:, -1], time[-1], forces=forces)
    return forces, angles, fits, path[:, -1]


def normalized(fits, truth):
    miss = (truth - fits.state)[..., None]
    return (miss.swapaxes(1, 2) @ np.linalg.solve(fits.covariance, miss))[:, 0, 0]


def test_orbits_with_an_estimated_radiation_pressure_are_consistent(found):
    forces, angles, fits, truth = found
    assert normalized(fits, truth).mean() > 30.0
    given = {"forces": forces, "settings": COASTING}
    better, _, none = maneuvers_within(fits, angles, **given, radiation_sigma=DEVIATION)
    # the mean of 24 chi-squared variables with six degrees of freedom: 6 +- 0.7
    assert normalized(better, truth).mean() == pytest.approx(6.0, abs=2.1)
    assert none.before.size == 0
    np.testing.assert_allclose(
        better.root.swapaxes(1, 2) @ better.root, better.covariance, rtol=1e-6, atol=1e-24
    )


def test_predictions_consider_the_unknown_radiation_pressure(found):
    """Four days after the last detection, against objects with their own radiation pressure."""
    forces, angles, fits, truth = found
    given = {"forces": forces, "settings": COASTING, "radiation_sigma": DEVIATION}
    better, _, _ = maneuvers_within(fits, angles, **given)
    end = float(fits.epoch[0])
    times = end + np.array([2.0, 4.0]) * 86_400.0 / TIME_UNIT_S
    then = np.array([
        propagated(truth[[k]], fits.epoch[[k]], times[1:], own)[0][0, 0]
        for k, own in enumerate(true_forces())
    ])  # fmt: skip
    starts = OrbitStates.of(better)
    known, _ = orbits_at(starts, times[1], forces)
    middle, _ = orbits_at(starts, times[0], forces, DEVIATION)
    later, kept = orbits_at(middle, times[1], forces, DEVIATION)
    direct, _ = orbits_at(starts, times[1], forces, DEVIATION)
    np.testing.assert_array_equal(kept, np.arange(OBJECTS))
    np.testing.assert_allclose(later.state, direct.state, rtol=0, atol=1e-8)
    scale = np.abs(direct.shift).max(axis=0)
    np.testing.assert_allclose(later.shift / scale, direct.shift / scale, rtol=0, atol=1e-3)
    assert normalized(known, then).mean() > 30.0
    # at most: the factor that the fit has estimated counts with its prior
    assert 2.0 < normalized(direct, then).mean() < 8.1


def test_two_orbits_of_an_object_are_joined_with_its_unknown_radiation_pressure(found):
    """The later orbit is propagated back over days to where the two may meet."""
    forces, angles, fits, truth = found
    early, late = [], []
    for k in range(OBJECTS):
        rows = fits.detections(k)
        early.append(rows[: rows.size // 6])
        late.append(rows[rows.size // 6 :])
    ends = [float(angles.time[each[-1]]) for each in early]
    first = np.array([
        propagated(truth[[k]], fits.epoch[[k]], np.array([ends[k]]), own)[0][0, 0]
        for k, own in enumerate(true_forces())
    ])  # fmt: skip
    start, epoch = np.concatenate([first, truth]), np.concatenate([ends, fits.epoch])
    both = fit_orbits(angles, early + late, start, epoch, forces=forces)
    settings = LineageSettings(maneuvers_per_day=0.1)
    uncertain = {"forces": forces, "settings": settings}
    both, *_ = maneuvers_within(both, angles, **uncertain, radiation_sigma=DEVIATION)
    before = np.arange(2 * OBJECTS) < OBJECTS
    paths = orbit_paths(both, 0.0, float(angles.time[-1]), forces=forces)

    def joined(sigma):
        pairs = find_lineage(
            both, angles, before, ~before, paths=paths, region=AdmissibleRegion(),
            expected_objects=200.0, radiation_sigma=sigma, **uncertain,
        )  # fmt: skip
        right = pairs.after - pairs.before == OBJECTS
        found = both.take(pairs.after[right]).updated(
            np.arange(right.sum()), pairs.state[right], pairs.covariance[right]
        )
        return normalized(found, truth[pairs.before[right]])

    assert joined(DEVIATION).size > OBJECTS / 2
    assert 4.0 < joined(DEVIATION).mean() < 8.1
    assert joined(0.0).mean() > 10.0


def test_nothing_changes_if_the_radiation_pressure_is_known_or_there_is_none(found):
    forces, angles, fits, _ = found
    given = {"settings": COASTING}
    same, _, _ = maneuvers_within(fits, angles, forces=forces, **given)
    np.testing.assert_array_equal(same.state, fits.state)
    one = fits.take([0])
    other, _, _ = maneuvers_within(
        one, angles, forces=EARTH_MOON, **given, radiation_sigma=DEVIATION
    )
    np.testing.assert_array_equal(other.state, one.state)


@pytest.fixture(scope="module")
def biased(found):
    """Detections by observers with errors, their scene, the errors, and members of the orbits."""
    _, angles, fits, _ = found
    error = SIGMAS.constant()[:5] * np.random.default_rng(3).standard_normal((OBSERVERS, 5))
    # right ascension and declination are those of the propagation frame
    scene = SimpleNamespace(
        step=STEP_S / TIME_UNIT_S,
        observer_axes=np.tile(np.eye(3), (12 * DAYS, 1, 1)),
        observer_position=np.zeros((OBSERVERS, 1, 3)),
    )
    ra = np.arctan2(angles.direction[:, 1], angles.direction[:, 0])
    east = np.stack([-np.sin(ra), np.cos(ra), np.zeros_like(ra)], axis=1)
    north = np.cross(angles.direction, east)
    own, equator = error[angles.observer], np.hypot(*angles.direction[:, :2].T)
    unit = angles.direction + (own[:, 3] * equator)[:, None] * east + own[:, [4]] * north
    measured = angles._replace(
        direction=unit / np.linalg.norm(unit, axis=1)[:, None],
        basis=np.stack([east, north], axis=1),
        observer_position=angles.observer_position - own[:, :3],
    )
    members = [fits.row[a:b] for a, b in zip(fits.begin, fits.begin[1:], strict=False)]
    return measured, scene, error, members


def test_orbits_consider_the_observers_with_the_gain_of_the_estimated_factor(found, biased):
    """Against differences of the estimate by the noise of each angle, by each error of an observer,
    and by the factor of the radiation pressure."""
    forces, _, given, truth = found
    measured, scene, error, members = biased
    prior, rows = uncalibrated(SIGMAS, OBSERVERS), members[0]
    remaining = RemainingErrors(measured, scene, prior)

    def estimate(mean, row=0, shift=0.0):
        used = corrected_angles(measured, scene, prior._replace(mean=mean))
        basis = used.basis.copy()
        basis[row] -= (
            np.sum(basis[row] * shift, axis=-1)[..., None] * used.direction[row][..., None, :]
        )
        used = used._replace(basis=basis)
        fits = fit_orbits(used, [rows], truth[:1], given.epoch[0], forces=forces)
        return maneuvers_within(
            considered(fits, remaining, forces=forces), used, forces=forces,
            settings=COASTING, radiation_sigma=DEVIATION, remaining=remaining,
        )[0]  # fmt: skip

    none, columns = np.zeros_like(error), []
    for index in np.ndindex(error.shape):
        mean = none.copy()
        mean[index] = SIGMAS.constant()[index[1]]
        columns.append(0.5 * (estimate(mean).state[0] - estimate(-mean).state[0]))
    for row in rows:
        for along in measured.basis[row] * SIGMA:
            ends = [estimate(none, row, sign * along).state[0] for sign in (1.0, -1.0)]
            columns.append(0.5 * (ends[0] - ends[1]))
    start = estimate(none).state, given.epoch[:1]
    path = propagated(*start, measured.time[rows], forces)[0][0]
    shift = by_radiation(*start, measured.time[rows], path[None], forces, DEVIATION)[0, :, :3, 0]
    shift /= np.linalg.norm(path[:, :3] - measured.observer_position[rows], axis=1)[:, None]
    ends = [estimate(none, rows, sign * shift[:, None]).state[0] for sign in (1.0, -1.0)]
    columns.append(0.5 * (ends[0] - ends[1]))
    expected, covariance = np.array(columns).T @ np.array(columns), estimate(none).covariance[0]
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(covariance / scale, expected / scale, atol=0.01)


def test_the_calibration_is_the_joint_least_squares_solution_for_factors_as_well(found, biased):
    """Against one system of equations for two orbits, their factors of the radiation pressure and
    the observers, with derivatives by differences."""
    forces, _, given, truth = found
    measured, scene, error, members = biased
    start, sigma = uncalibrated(SIGMAS, OBSERVERS), SIGMAS.constant()[:5]
    used = corrected_angles(measured, scene, start)
    fits = fit_orbits(used, members[:2], truth[:2], given.epoch[0], forces=forces)
    noise = np.sqrt(measured.covariance[0, 0, 0])

    def residuals(states, factors, errors):
        own, out = corrected_angles(measured, scene, start._replace(mean=errors)), []
        for state, factor, rows in zip(states, factors, members, strict=False):
            strength = forces.radiation.strength * (1.0 + DEVIATION * factor)
            changed = forces._replace(radiation=forces.radiation._replace(strength=strength))
            times = own.time[rows] - fits.epoch[0]
            path = propagate_many(
                state[None], times, method="dop853", forces=changed, start=fits.epoch[0]
            )[0]
            way = path[:, :3] - own.observer_position[rows]
            along = np.einsum("nc,nc->n", way, own.direction[rows])[:, None]
            out.append(np.einsum("nac,nc->na", own.basis[rows], way) / along / noise)
        return np.concatenate(out).ravel()

    point = [fits.state, np.zeros(2), np.zeros_like(error)]
    sizes = [1e-6 * np.ones((2, 6)), 0.3 * np.ones(2), np.tile(sigma, (OBSERVERS, 1))]
    base, columns = residuals(*point), []
    for which, size in enumerate(sizes):
        for index in np.ndindex(size.shape):
            ends = []
            for sign in (1.0, -1.0):
                changed = [each.copy() for each in point]
                changed[which][index] += sign * size[index]
                ends.append(residuals(*changed))
            columns.append((ends[0] - ends[1]) / (2.0 * (0.3 if which == 1 else 1.0)))
    design = np.array(columns).T
    known = 2 + error.size  # have a prior, of unit standard deviation
    whole = np.concatenate([design, np.eye(known, 12 + known, 12)])
    scale = np.linalg.norm(whole, axis=0)
    right = np.concatenate([base, np.zeros(known)])
    step = -np.linalg.lstsq(whole / scale, right, rcond=None)[0] / scale
    spread = np.linalg.inv((whole / scale).T @ (whole / scale)) / np.outer(scale, scale)
    remaining = RemainingErrors(measured, scene, start)
    found = calibrate(fits, remaining, SIGMAS, forces=forces, radiation_sigma=DEVIATION)
    expected = step[14:].reshape(error.shape) * sigma
    deviation = np.sqrt(np.diag(spread)[14:]).reshape(error.shape) * sigma
    own = np.sqrt(np.diag(found.covariance.reshape(error.size, -1))).reshape(error.shape)
    np.testing.assert_allclose(own, deviation, rtol=1e-3)
    assert np.abs((found.mean - expected) / deviation).max() < 0.05
    known_factor = calibrate(fits, remaining, SIGMAS, forces=forces)
    assert np.abs((known_factor.mean - expected) / deviation).max() > 0.2


def test_an_orbit_that_cannot_be_propagated_does_not_count(found, biased):
    forces, _, given, truth = found
    measured, scene, _, members = biased
    prior = uncalibrated(SIGMAS, OBSERVERS)
    used = corrected_angles(measured, scene, prior)
    fits = fit_orbits(used, members[:3], truth[:3], given.epoch[0], forces=forces)
    lost = fits.updated([1], np.full((1, 6), np.nan), fits.covariance[[1]])
    remaining = RemainingErrors(measured, scene, prior)
    with_it = calibrate(lost, remaining, SIGMAS, forces=forces)
    without = calibrate(fits.take([0, 2]), remaining, SIGMAS, forces=forces)
    np.testing.assert_array_equal(with_it.mean, without.mean)
    np.testing.assert_array_equal(with_it.covariance, without.covariance)
    new = considered(lost, remaining, forces=forces)
    np.testing.assert_array_equal(new.covariance[1], lost.covariance[1])
    assert np.all(new.covariance[0] != lost.covariance[0])
    moved, _, lineage = maneuvers_within(
        lost, used, forces=forces, settings=COASTING, radiation_sigma=DEVIATION
    )
    np.testing.assert_array_equal(moved.covariance[1], lost.covariance[1])
    assert np.all(np.isfinite(moved.state[[0, 2]])) and lineage.before.size == 0
