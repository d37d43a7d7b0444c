"""Objects next to each other, and several orbits of one object."""

from functools import partial
from itertools import permutations

import numpy as np
import pytest
from maneuvered_arcs import PROBLEM, SIGMA, STEP, linked, moved

from cislunar.constants import LENGTH_UNIT_KM
from cislunar.detection import DetectionProcess
from cislunar.dynamics import EARTH_MOON
from cislunar.observation import Sensor, sensor_limits
from cislunar.orbit_determination import (
    AdmissibleRegion,
    LinkingSettings,
    OrbitFits,
    concatenate_fits,
    fit_orbits,
    make_angles,
    propagated,
)
from cislunar.survey import LineageSettings
from cislunar.survey.maneuvers import (
    CURRENT,
    SUPERSEDED,
    FieldHistory,
    Watch,
    divided_neighbors,
    duplicate_orbits,
    maneuvered_orbits,
    neighbors,
    orbit_paths,
)
from cislunar.survey.maneuvers.neighbors import (
    _assigned,
    _divided,
    _Offsets,
    _Remembered,
    _superfluous,
    _weak,
)

MINUTES, OBSERVERS = np.arange(0, 241, 10), range(4)
FIT = partial(fit_orbits, forces=EARTH_MOON)


def detections(states):
    """Angles of all objects in all exposures, and the object of each row."""
    rng, scene = np.random.default_rng(11), PROBLEM.scene
    paths = [moved(state, MINUTES) for state in states]
    order = [(m, o, k) for m in range(MINUTES.size) for o in OBSERVERS for k in range(len(states))]
    m, observer, owner = np.array(order).T
    minute = MINUTES[m]
    here = scene.observer_position[observer, minute]
    unit = np.array(paths)[owner, m, :3] - here
    unit /= np.linalg.norm(unit, axis=1)[:, None]
    unit += SIGMA * rng.standard_normal(unit.shape)
    angles = make_angles(
        minute * STEP, observer, here, unit, SIGMA, magnitude=15.0, sun=scene.sun_position[minute]
    )
    return angles, owner, np.array(paths)[:, -1]


def watch(angles, half_field=0.026):
    """Exposures toward the first object."""
    scene, first = PROBLEM.scene, PROBLEM.epoch[0]
    index, observer = np.repeat(MINUTES, len(OBSERVERS)), np.tile(OBSERVERS, MINUTES.size)
    unit = np.repeat(moved(first, MINUTES)[:, :3], len(OBSERVERS), axis=0)
    unit = unit - scene.observer_position[observer, index]
    unit /= np.linalg.norm(unit, axis=1)[:, None]
    fields = FieldHistory(index, observer, unit, np.full(index.size, half_field))
    limits = sensor_limits(Sensor(limiting_magnitude=20), scene.observer_position.shape[0])
    return Watch(fields, scene, limits, 0.4, DetectionProcess().detection_loss)


def fitted(angles, rows, states):
    return FIT(angles, rows, np.array(states), MINUTES[-1] * STEP)


@pytest.fixture(scope="module")
def group():
    """Three objects that move apart at some centimeters to decimeters a second."""
    start = np.tile(PROBLEM.epoch[0], (3, 1))
    start[1:, :3] += np.array([[20.0, 10.0, 0.0], [-15.0, 25.0, 10.0]]) / LENGTH_UNIT_KM
    start[1:, 3:] += [[2e-4, 0.0, 1e-4], [0.0, -2e-4, 1e-4]]
    return detections(start)


def mixed(owner, seed=2):
    """Detections of each object of which a fifth are exchanged within their exposures."""
    rng, given = np.random.default_rng(seed), owner.reshape(-1, 3).copy()
    for exposure in np.flatnonzero(rng.random(len(given)) < 0.3):
        given[exposure] = given[exposure][rng.permutation(3)]
    return given.ravel()


def test_mixed_detections_return_to_their_objects(group):
    angles, owner, truth = group
    given = mixed(owner)
    assert 0.1 < np.mean(given != owner) < 0.3
    # with larger variances, since mixed detections do not agree with an orbit
    wide = angles._replace(covariance=400.0 * angles.covariance)
    start = fitted(wide, [np.flatnonzero(given == k) for k in range(3)], truth)
    found = divided_neighbors(start, angles, 1e-3, partial(FIT, angles), EARTH_MOON)
    assert sorted(found.changed.tolist()) == [0, 1, 2] and found.empty.size == 0
    for i, k in enumerate(found.changed.tolist()):
        np.testing.assert_array_equal(owner[found.fits.detections(i)], k)
        assert found.fits.detections(i).size >= 0.98 * np.sum(owner == k)
        miss = found.fits.state[i] - truth[k]
        assert miss @ np.linalg.solve(found.fits.covariance[i], miss) < 25.0
        before = np.linalg.norm(start.state[k, :3] - truth[k, :3])
        assert np.linalg.norm(miss[:3]) < 0.5 * before


def test_an_orbit_of_detections_of_others_is_left_without_any(group):
    angles, owner, truth = group
    rows = [np.flatnonzero(owner == k) for k in range(3)]
    between = np.sort(np.concatenate([rows[0][::9], rows[1][4::9]]))
    rows = [np.setdiff1d(each, between) for each in rows[:2]] + [between]
    wide = angles._replace(covariance=1e6 * angles.covariance)
    fits = fitted(angles, rows[:2], truth[:2])
    other = fitted(wide, [between], [truth[:2].mean(axis=0)])
    both = concatenate_fits([fits, other], fits)
    found = divided_neighbors(both, angles, 1e-3, partial(FIT, angles), EARTH_MOON)
    assert found.empty.tolist() == [2]
    assert [np.unique(owner[found.fits.detections(i)]).tolist() for i in (0, 1)] == [[0], [1]]


@pytest.fixture(scope="module")
def further(group):
    """Orbits of three objects, and one of detections of two of them in exposures in which no orbit
    of the objects has a detection."""
    angles, owner, truth = group
    exposure = np.arange(owner.size) // 3
    rows = [np.flatnonzero((owner == k) & (exposure % 9 != 4)) for k in range(3)]
    between = np.flatnonzero((exposure % 9 == 4) & (owner == exposure // 9 % 2))
    wide = angles._replace(covariance=1e6 * angles.covariance)
    fits = fitted(angles, rows, truth)
    return concatenate_fits([fits, fitted(wide, [between], [truth[:2].mean(axis=0)])], fits)


def test_an_orbit_of_detections_that_others_miss_is_left_without_any(group, further):
    angles, owner, _ = group
    found = divided_neighbors(further, angles, 1e-3, partial(FIT, angles), EARTH_MOON)
    assert found.empty.tolist() == [3] and found.changed.tolist() == [0, 1]
    for i in range(2):
        rows = found.fits.detections(i)
        assert np.unique(owner[rows]).tolist() == [i]
        # the detections of the further orbit are in as many exposures of one object as of the other
        assert rows.size - further.detections(i).size >= further.detections(3).size // 2 - 1


def test_an_orbit_beyond_the_gates_of_others_is_kept(group, further):
    """As above, but the further orbit is of the third object, which has no other one."""
    angles, owner, truth = group
    exposure = np.arange(owner.size) // 3
    own = np.flatnonzero((owner == 2) & (exposure % 9 == 4))
    both = concatenate_fits([further.take([0, 1]), fitted(angles, [own], truth[2:])], further)
    found = divided_neighbors(both, angles, 1e-3, partial(FIT, angles), EARTH_MOON)
    assert found.empty.size == found.changed.size == 0


def test_the_orbit_without_which_all_others_agree_is_found(group, further):
    angles, owner, _ = group
    exposure = np.arange(owner.size) // 3

    def dividing(pool):
        return partial(
            _divided, angles=angles, exposure=exposure[pool],
            offsets=_Offsets(angles, pool, EARTH_MOON), fit=partial(FIT, angles), forces=EARTH_MOON,
        )  # fmt: skip

    divide = dividing(np.unique(further.row))
    found = _superfluous(further, divide(further), divide, 1e-3)
    assert found.tolist() == [False, False, False, True]
    real = further.take([0, 1, 2])
    divide = dividing(np.unique(real.row))
    assert not np.any(_superfluous(real, real, divide, 1e-3))


def test_a_set_of_detections_is_fitted_once(group):
    angles, owner, truth = group
    rows = [np.flatnonzero(owner == k) for k in range(3)]
    fitted_rows = []

    def fit(parts, state, epoch):
        fitted_rows.extend(parts)
        return FIT(angles, parts, state, epoch)

    remembered = _Remembered(fit, fitted(angles, [], truth[:0]))
    for chosen in ([0, 1], [2, 1], []):
        given = [rows[k] for k in chosen], truth[chosen], np.zeros(len(chosen))
        found = remembered(*given)
        exact = FIT(angles, *given)
        for name in OrbitFits._fields:
            np.testing.assert_array_equal(getattr(found, name), getattr(exact, name))
    assert len(fitted_rows) == 3


def test_objects_far_from_each_other_are_left_alone():
    angles, owner, truth = detections(PROBLEM.epoch)
    fits = fitted(angles, [np.flatnonzero(owner == k) for k in range(3)], truth)
    found = divided_neighbors(fits, angles, 1e-3, partial(FIT, angles), EARTH_MOON)
    assert found.changed.size == found.empty.size == 0


def test_each_exposure_has_the_division_of_least_cost(group):
    """Equation (1) against all permutations of each exposure."""
    angles, owner, truth = group
    parts = [np.flatnonzero(owner == k) for k in range(3)]
    fits = fitted(angles, [parts[0], parts[1][::3], parts[2][::7]], truth)
    exposure = np.repeat(np.arange(owner.size // 3), 3)
    found = _assigned(fits, exposure, _Offsets(angles, np.arange(owner.size), EARTH_MOON))
    state, phi = propagated(fits.state, fits.epoch, angles.time, EARTH_MOON)
    cost = np.empty((owner.size, 3))
    for r, k in np.ndindex(*cost.shape):
        way = state[k, r, :3] - angles.observer_position[r]
        along = way @ angles.direction[r]
        slope = angles.basis[r] / along @ phi[k, r, :3]
        s = slope @ fits.covariance[k] @ slope.T + angles.covariance[r]
        offset = angles.basis[r] @ way / along
        cost[r, k] = offset @ np.linalg.solve(s, offset) + np.log(np.linalg.det(s))
        cost[r, k] -= 2.0 * np.log(fits.detections(k).size)
    for rows in np.arange(owner.size).reshape(-1, 3):
        best = min(permutations(range(3)), key=lambda each, r=rows: cost[r, each].sum())
        kept = found[rows] >= 0
        assert found[rows][kept].tolist() == np.array(best)[kept].tolist()
    assert np.mean(found >= 0) > 0.95


def test_orbits_that_share_the_detections_of_one_object_are_one_object():
    angles, owner, truth = detections(PROBLEM.epoch)
    rows, later = np.flatnonzero(owner == 0), MINUTES[-1] * STEP
    exposures = np.arange(rows.size)
    parts = [rows[exposures % 3 != 0], rows[exposures % 3 == 0], np.flatnonzero(owner == 1)]
    fits = fitted(angles, parts, truth[[0, 0, 1]])
    paths = orbit_paths(fits, 0.0, later, forces=EARTH_MOON)
    every, seen = np.arange(3), watch(angles)
    assert duplicate_orbits(fits, angles, every, paths, seen, 0.99).tolist() == [1]
    # fields that did not cover the other orbit say nothing
    narrow = watch(angles, half_field=1e-7)
    assert duplicate_orbits(fits, angles, every, paths, narrow, 0.99).size == 0
    # one common exposure has two objects
    row = fits.row.copy()
    row[fits.begin[1]] = parts[0][0]
    twice = fits._replace(row=row)
    assert duplicate_orbits(twice, angles, every, paths, seen, 0.99).size == 0


def test_objects_that_were_deployed_together_are_several(group):
    angles, owner, truth = group
    fits = fitted(angles, [np.flatnonzero(owner == k) for k in range(3)], truth)
    paths = orbit_paths(fits, 0.0, MINUTES[-1] * STEP, forces=EARTH_MOON)
    found = duplicate_orbits(fits, angles, np.arange(3), paths, watch(angles), 0.99)
    assert found.size == 0


def test_an_orbit_without_most_of_its_detections_is_weak(group):
    angles, owner, truth = group
    rows = [np.flatnonzero(owner == k) for k in range(3)]
    before = fitted(angles, rows, truth)
    after = [rows[0], rows[1][: rows[1].size // 2 - 1], rows[2][: rows[2].size // 2]]
    assert _weak(before, fitted(angles, after, truth)).tolist() == [False, True, False]
    # of several, the one with the least share, and those with too few detections
    after = [rows[0][:5], rows[1][:10], rows[2][:12]]
    assert _weak(before, fitted(angles, after, truth)).tolist() == [True, False, False]
    after = [rows[0], rows[1][:10], rows[2][:12]]
    assert _weak(before, fitted(angles, after, truth)).tolist() == [False, True, False]


def test_a_candidate_that_takes_the_detections_of_a_confirmed_orbit_is_confirmed(group):
    angles, owner, truth = group
    first, second = (np.flatnonzero(owner == k) for k in (0, 1))
    parts = [first[::9], np.setdiff1d(first, first[::9]), second]
    fits = fitted(angles, parts, truth[[0, 0, 1]])
    found = maneuvered_orbits(
        linked(fits, [True, False, True]), angles, forces=EARTH_MOON, region=AdmissibleRegion(),
        linking=LinkingSettings(), settings=LineageSettings(maneuvers_per_day=0.1),
    )  # fmt: skip
    assert found.status == (SUPERSEDED, CURRENT, CURRENT)
    assert found.orbits.confirmed.tolist() == [False, True, True]
    assert found.orbits.detections(1).size >= 0.98 * first.size


def test_a_short_orbit_keeps_its_own_detections(group):
    angles, owner, truth = group
    rows = [np.flatnonzero(owner == k) for k in (0, 1)]
    fits = fitted(angles, [rows[0], rows[1][::20]], truth[:2])
    assert fits.detections(1).size == 5
    found = divided_neighbors(fits, angles, 1e-3, partial(FIT, angles), EARTH_MOON)
    assert found.changed.size == found.empty.size == 0


def test_an_orbit_that_meets_a_body_elsewhere_keeps_its_detections(group, monkeypatch):
    angles, owner, truth = group
    rows = [np.flatnonzero(owner == k) for k in (0, 1)]
    early = rows[1][angles.time[rows[1]] < 0.5 * MINUTES[-1] * STEP]
    fits = fitted(angles, [rows[0], early], truth[:2])

    def met(state, epoch, time, forces):
        path, transition = propagated(state, epoch, time, forces)
        path[1:] = np.nan
        return path, transition

    monkeypatch.setattr(neighbors, "propagated", met)
    found = divided_neighbors(fits, angles, 1e-3, partial(FIT, angles), EARTH_MOON)
    assert 1 not in found.changed and found.empty.size == 0
