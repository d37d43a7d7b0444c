"""Linking of detections of several objects among false alarms, and continuation of known orbits."""

import numpy as np
import pytest
from nights import HOUR, LOG_CLUTTER, OBJECTS, night

from cislunar.constants import LENGTH_UNIT_KM
from cislunar.dynamics import propagate
from cislunar.errors import ConfigurationError
from cislunar.orbit_determination import (
    DIRECTION_ONLY,
    ORBIT,
    SEVERAL_ORBITS,
    AdmissibleRegion,
    Angles,
    LinkingSettings,
    attributables,
    exposure_numbers,
    fit_orbits,
    form_tracklets,
    link,
    linking,
)
from cislunar.orbit_determination.attribution import OrbitHypotheses
from cislunar.orbit_determination.hypotheses import LinkHypotheses
from cislunar.orbit_determination.least_squares import SINGULAR
from cislunar.orbit_determination.scores import log_scores


def linked(angles, **given):
    return link(
        angles, attributables(angles, form_tracklets(angles)), log_clutter=LOG_CLUTTER, **given
    )


def origins(found, origin):
    return [np.unique(origin[found.detections(k)]).tolist() for k in range(found.log_ratio.size)]


def test_objects_among_false_alarms_are_linked_and_confirmed():
    angles, origin = night(OBJECTS, [0.0, 2.0, 5.0], 1.0, 1)
    assert np.count_nonzero(origin < 0) > 50
    assert not any("origin" in name and name != "origin_velocity" for name in Angles._fields)
    found = linked(angles)
    assert origins(found, origin)[:4] and sorted(origins(found, origin)[:4]) == [[0], [1], [2], [3]]
    assert found.confirmed[:4].all() and not found.confirmed[4:].any()
    assert found.verdict[:4] == (ORBIT,) * 4
    for k in range(4):
        assert found.detections(k).size >= 16
        truth = propagate(OBJECTS[origin[found.detections(k)[0]]], [found.fits.epoch[k]])[0]
        error = found.fits.state[k] - truth
        assert error @ np.linalg.solve(found.fits.covariance[k], error) < 25.0
    again = linked(angles)
    np.testing.assert_array_equal(again.fits.state, found.fits.state)
    np.testing.assert_array_equal(again.log_ratio, found.log_ratio)


def test_an_orbit_has_one_detection_in_an_exposure_at_most():
    """Each detection twice, as of two objects that no telescope separates."""
    single, _ = night(OBJECTS[:1], [0.0, 2.0, 5.0], 0.0, 1)
    angles = single.rows(np.repeat(np.arange(single.time.size), 2))
    exposure = exposure_numbers(angles)
    assert np.unique(exposure).size == single.time.size
    found = linked(angles)
    assert found.log_ratio.size >= 1 and found.confirmed[0]
    for k in range(found.log_ratio.size):
        own = exposure[found.detections(k)]
        assert np.unique(own).size == own.size
    rows = np.arange(0, angles.time.size, 2)
    fits = fit_orbits(angles, [rows, np.union1d(rows, [1])], np.tile(OBJECTS[0], (2, 1)), 0.0)
    score = log_scores(fits, angles, AdmissibleRegion(), LinkingSettings(), LOG_CLUTTER)
    assert np.isfinite(score[0]) and score[1] == -np.inf


def test_false_alarms_alone_give_no_confirmed_orbit():
    angles, origin = night(OBJECTS, [0.0, 2.0, 5.0], 2.0, 2)
    alarms = angles.rows(np.flatnonzero(origin < 0))
    assert alarms.time.size > 100
    found = linked(alarms)
    assert not found.confirmed.any() and found.log_ratio.size <= 2


@pytest.mark.parametrize("window_h", [36.0, 1.0])
def test_known_orbits_are_continued(window_h, monkeypatch):
    extended, usable = LinkHypotheses.extended, []

    def observed(self, orbits, given):
        usable.append(given.copy())
        return extended(self, orbits, given)

    angles, origin = night(OBJECTS, [0.0, 2.0, 5.0, 9.0], 0.5, 3)
    early = np.count_nonzero(angles.time < 4.0 * HOUR)
    first = linked(angles.rows(np.arange(early)))
    monkeypatch.setattr(LinkHypotheses, "extended", observed)
    later = linked(angles, known=first, settings=LinkingSettings(window_h=window_h))
    # old tracklets of confirmed orbits are not attributed to others
    tracklets = attributables(angles, form_tracklets(angles))
    old = [rows.max() < early and origin[rows].min() >= 0 for rows in tracklets.detections]
    assert first.confirmed.sum() == 4 and sum(old) >= 24
    assert usable[0][old].all() if window_h == 36.0 else not usable[0][old].any()
    assert usable[0][tracklets.time > 8.5 * HOUR].all()
    at_once = linked(angles)
    for found in (later, at_once):
        assert sorted(origins(found, origin)[:4]) == [[0], [1], [2], [3]]
        assert [found.detections(k).size for k in range(4)] == [24] * 4
    order = [np.argsort([origin[x.detections(k)[0]] for k in range(4)]) for x in (later, at_once)]
    sigma = np.sqrt(np.diagonal(at_once.fits.covariance[order[1]], axis1=1, axis2=2))
    apart = later.fits.state[order[0]] - at_once.fits.state[order[1]]
    assert np.abs(apart / sigma).max() < 1e-2


def test_detections_before_the_longest_arc_no_longer_determine_an_orbit():
    angles, origin = night(OBJECTS, [0.0, 2.0, 5.0, 9.0], 0.5, 3)
    first = linked(angles.rows(np.flatnonzero(angles.time < 6.0 * HOUR)))
    assert first.confirmed.sum() == 4
    settings = LinkingSettings(window_h=2.0, longest_arc_days=4.0 / 24.0)
    later = linked(angles, known=first, settings=settings)
    assert sorted(origins(later, origin)[:4]) == [[0], [1], [2], [3]]
    for k in range(4):
        time = angles.time[later.detections(k)]
        # those of the first hour are older than the arc of the orbit that is continued
        assert time.size == 18 and time.min() > 1.5 * HOUR and time.max() > 8.5 * HOUR


def test_an_orbit_that_is_singular_at_its_last_detection_stays_at_the_time_of_its_fit(monkeypatch):
    def singular(fits, *given, **options):
        bad = np.full((1, 6, 6), np.nan)
        status = np.array([SINGULAR])
        return fits._replace(covariance=bad, root=bad, status=status)

    angles, _ = night(OBJECTS, [0.0, 2.0, 5.0], 0.5, 3)
    usual = linked(angles)
    monkeypatch.setattr(linking, "refit_at", singular)
    found = linked(angles)
    assert found.log_ratio.size == usual.log_ratio.size
    assert np.isfinite(found.fits.covariance).all() and np.all(found.fits.status == 0)
    assert np.any(found.fits.epoch != usual.fits.epoch)


def test_a_link_of_one_observer_states_what_it_leaves_open():
    """Three tracklets of one observer permit two orbits of one object and leave the range of
    another open; the true orbit is among those that are kept."""
    for number, observer, verdict in ((1, 1, SEVERAL_ORBITS), (3, 1, DIRECTION_ONLY)):
        angles, _ = night(OBJECTS[number : number + 1], [0.0, 2.0, 5.0], 0.0, 20)
        found = linked(angles.rows(np.flatnonzero(angles.observer == observer)))
        assert found.verdict == (verdict,) and not found.confirmed.any()
        if verdict == DIRECTION_ONLY:
            assert found.undetermined_directions[0] > 0
            continue
        states = [found.fits.state[0], *found.rivals[0].state]
        epochs = [found.fits.epoch[0], *found.rivals[0].epoch]
        ways = [
            np.linalg.norm(state[:3] - propagate(OBJECTS[number], [t])[0, :3])
            for state, t in zip(states, epochs, strict=True)
        ]
        assert len(states) == 2 and min(ways) < 0.01 < max(ways)


@pytest.mark.parametrize("seed", range(9, 29))
@pytest.mark.parametrize("apart_km", [100.0, 10.0])
def test_neighbors_on_one_orbit_are_separated_or_one_and_never_wrong(apart_km, seed):
    speed = np.linalg.norm(OBJECTS[0, 3:])
    later = propagate(OBJECTS[0], [apart_km / LENGTH_UNIT_KM / speed], method="dop853")[0]
    twins = np.array([OBJECTS[0], later])
    angles, origin = night(twins, [0.0, 2.0, 5.0], 0.2, seed)
    found = linked(angles)
    confirmed = np.flatnonzero(found.confirmed)
    assert confirmed.size == 2 or (apart_km < 50.0 and confirmed.size == 1)
    right = set()
    for k in confirmed.tolist():
        sigma = np.linalg.inv(found.fits.covariance[k])
        errors = found.fits.state[k] - [
            propagate(state, [found.fits.epoch[k]], method="dop853")[0] for state in twins
        ]
        squared = np.einsum("ni,ij,nj->n", errors, sigma, errors)
        nearest = int(np.argmin(squared))
        assert squared[nearest] < 30.0
        assert np.mean(origin[found.detections(k)] == nearest) > 0.9
        right.add(nearest)
    assert len(right) == confirmed.size


def test_bad_input_and_nothing_to_link():
    angles, _ = night(OBJECTS[:1], [0.0], 0.0, 8)
    empty = linked(angles.rows([]))
    assert empty.log_ratio.size == 0 and empty.verdict == ()
    with pytest.raises(ConfigurationError, match="log_clutter: give one finite number"):
        link(angles, attributables(angles, []), log_clutter=-np.inf)
    with pytest.raises(ConfigurationError, match="gate_probability"):
        LinkingSettings(gate_probability=1.5)
    grown = OrbitHypotheses(fit_orbits(angles, [], np.empty((0, 6)), 0.0), ())
    assert grown.fits.take([]).epoch.size == 0
