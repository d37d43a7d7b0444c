"""Linking against brute force, importance sampling, and simulated objects among false alarms."""

from itertools import combinations, pairwise

import numpy as np
import pytest
from nights import HOUR, OBJECTS, SIGMA, night
from scipy.special import logsumexp
from scipy.stats import kstest, multivariate_normal

from cislunar.constants import LENGTH_UNIT_KM
from cislunar.dynamics import EARTH_MOON, propagate
from cislunar.errors import ConfigurationError
from cislunar.orbit_determination import (
    CONVERGED,
    DIRECTION_ONLY,
    ORBIT,
    SEVERAL_ORBITS,
    AdmissibleRegion,
    Angles,
    ConfirmationRule,
    LinkingSettings,
    attributables,
    attribution,
    fit_orbits,
    form_tracklets,
    link,
    linking,
    log_evidence,
    make_angles,
    refit_at,
    same_states,
    separation_probability,
)
from cislunar.orbit_determination.admissible_region import sphere_magnitude_residuals
from cislunar.orbit_determination.attribution import OrbitHypotheses, concatenate_fits
from cislunar.orbit_determination.hypotheses import LinkHypotheses
from cislunar.orbit_determination.initial_orbits import is_plausible
from cislunar.orbit_determination.least_squares import SINGULAR

LOG_CLUTTER = np.log(1.0 / np.deg2rad(3.0) ** 2)


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


@pytest.mark.parametrize("intruder", [None, 20])
def test_an_orbit_takes_ever_more_tracklets_at_once(intruder, monkeypatch):
    angles, _ = night(OBJECTS[:1], np.arange(0.0, 14.0), 0.0, 21)
    tracklets = attributables(angles, form_tracklets(angles))
    right = set(range(tracklets.time.size)) - {intruder}
    assert tracklets.time.size == 42 and tracklets.time[20] > 6.0 * HOUR
    wrong = set() if intruder is None else set(tracklets.detections[intruder].tolist())
    judge, sizes = attribution.agrees, []

    def agrees(fits, significance):
        rows = [set(fits.row[a:b].tolist()) for a, b in pairwise(fits.begin.tolist())]
        sizes.extend(len(each) for each in rows)
        return judge(fits, significance) & [not each & wrong for each in rows]

    monkeypatch.setattr(attribution, "agrees", agrees)
    rows = np.unique(np.concatenate(tracklets.detections[:3]))
    start = fit_orbits(angles, [rows], OBJECTS[:1], 0.0)
    found = attribution.extend_orbits(
        angles, tracklets, OrbitHypotheses(start, ((0, 1, 2),)),
        np.ones(tracklets.time.size, dtype=bool), forces=EARTH_MOON, spans_h=(3.0, 24.0),
        gate_probability=0.9999, significance=1e-6,
    )  # fmt: skip
    assert max(np.diff([rows.size, *sizes])) > 2 * 4
    # a wrong tracklet may exclude those that were as probable when the orbit would have taken it
    lost = right - set(found.tracklets[0])
    assert set(found.tracklets[0]) <= right and len(lost) <= (0 if intruder is None else 3)
    # four, eight, sixteen, and the rest
    assert intruder is not None or len(sizes) <= 8


def test_long_orbits_are_compared_by_some_tracklets_from_the_first_to_the_last():
    angles, origin = night(OBJECTS[:2], [0.0, 2.0], 0.0, 8)
    found = two_hypotheses(angles, (origin == 0, origin == 1), OBJECTS[:2])
    found.members[:] = [(4, 7, 9), tuple(range(0, 2000, 2))]
    assert found.compared(0) == [4, 7, 9]
    few = found.compared(1)
    assert few == sorted(set(few)) and len(few) == 22  # the first and the last are spread as well
    assert few[:8] == list(range(0, 16, 2)) and few[-8:] == list(range(1984, 2000, 2))
    assert max(np.diff(few)) < 2 * 1998 / 7


def test_an_object_may_pass_by_an_observer():
    angles, origin = night(OBJECTS[:1], [0.0, 2.0], 0.0, 8)
    fits = fit_orbits(angles, [np.arange(origin.size)], OBJECTS[:1], 0.0)
    region = AdmissibleRegion()
    for near, plausible in ((0, True), (5, True), (6, False), (12, False)):
        position = fits.position.copy()
        unit = position[:near] / np.linalg.norm(position[:near], axis=1)[:, None]
        position[:near] = unit * 0.9 * region.least_range_km / LENGTH_UNIT_KM
        found = is_plausible(fits._replace(position=position), EARTH_MOON, region)
        assert found.tolist() == [plausible]


def test_the_choice_is_that_of_brute_force():
    angles, _ = night(OBJECTS[:3], [0.0, 0.5], 0.5, 4)
    tracklets = attributables(angles, form_tracklets(angles))
    settings, region = LinkingSettings(), AdmissibleRegion()
    found = LinkHypotheses(angles, tracklets, EARTH_MOON, region, settings, LOG_CLUTTER)
    rng, n = np.random.default_rng(5), tracklets.time.size
    drawn = {tuple(sorted(rng.choice(n, 3, replace=False).tolist())) for _ in range(14)}
    rows = [np.unique(np.concatenate([tracklets.detections[t] for t in each])) for each in drawn]
    for number, (each, own) in enumerate(zip(sorted(drawn), rows, strict=True)):
        fit = fit_orbits(angles, [own], OBJECTS[:1], 0.0)
        found.fits.append(fit)
        found.members.append(each)
        found.scores.append(float(rng.uniform(1.0, 10.0)) + number * 1e-3)
    sets = [
        {row for t in each for row in tracklets.detections[t].tolist()} for each in found.members
    ]
    best = 0.0
    for size in range(1, len(sets) + 1):
        for some in combinations(range(len(sets)), size):
            if sum(len(sets[k]) for k in some) == len(set().union(*(sets[k] for k in some))):
                best = max(best, sum(found.scores[k] for k in some))
    chosen = found.selected()
    assert sum(found.scores[k] for k in chosen) == pytest.approx(best)
    assert 1 < len(chosen) < len(sets)


def test_the_evidence_is_that_of_importance_sampling():
    """The integral over states, by samples from a wider Gaussian and exact residuals."""
    angles, _ = night(OBJECTS[:1], [0.0, 2.0], 0.0, 6)
    region, rng, n = AdmissibleRegion(), np.random.default_rng(7), 4000
    rows = np.arange(angles.time.size)
    fit = fit_orbits(angles, [rows], OBJECTS[:1], 0.0)
    wide = multivariate_normal(fit.state[0], 1.5 * fit.covariance[0], allow_singular=True)
    sample = wide.rvs(n, random_state=rng)
    density = []
    for state in sample:
        way = propagate(state, angles.time, method="dop853")[:, :3] - angles.observer_position
        along = np.einsum("ni,ni->n", way, angles.direction)
        miss = np.einsum("nai,ni->na", angles.basis, way) / along[:, None] / SIGMA
        density.append(-0.5 * np.sum(miss**2) - miss.size * 0.5 * np.log(2.0 * np.pi * SIGMA**2))
    expected = logsumexp(np.array(density) - wide.logpdf(sample)) - np.log(n) + region.log_density
    assert log_evidence(fit, angles, region)[0] == pytest.approx(expected, abs=0.1)


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


def test_confirmation_needs_observers_tracklets_and_a_determined_orbit():
    rule = ConfirmationRule()
    for observers, verdict, ratio, expected in (
        ([0, 1, 2], ORBIT, 30.0, True),
        ([0, 1, 2], SEVERAL_ORBITS, 30.0, False),
        ([0, 1, 2], ORBIT, 5.0, False),
        ([0, 0, 1, 1], ORBIT, 30.0, False),
        ([0, 0, 0, 1, 1], ORBIT, 30.0, True),
        ([0, 0, 0, 0, 1], ORBIT, 30.0, False),
        ([0] * 9, ORBIT, 90.0, False),
        ([0, 0, 0, 1, 1], DIRECTION_ONLY, 30.0, False),
    ):
        assert rule.confirms(observers, verdict, ratio) is expected
    assert not rule.confirms([0, 1, 2], ORBIT, 30.0, separation=0.002)


def test_the_separation_of_observers_is_uniform_for_one_object_and_rejects_two():
    """The probability of the extra sum of squares is uniform on (0, 1) for one object; detections
    of two objects by one observer each are rejected."""
    probability, rejected, rng = [], [], np.random.default_rng(8)
    angles, _ = night(OBJECTS[:1], [0.0, 4.0, 9.0, 15.0], 0.0, 100)
    angles = angles.rows(np.flatnonzero(angles.observer < 2))
    states = [propagate(OBJECTS[0], [t], method="dop853")[0, :3] for t in angles.time]
    exact = np.array(states) - angles.observer_position
    exact /= np.linalg.norm(exact, axis=1, keepdims=True)
    for _ in range(150):
        noisy = exact + SIGMA * rng.normal(size=exact.shape)
        given = make_angles(angles.time, angles.observer, angles.observer_position, noisy, SIGMA)
        fit = fit_orbits(given, [np.arange(angles.time.size)], OBJECTS[:1], 0.0)
        probability += separation_probability(fit, given, forces=EARTH_MOON).tolist()
    assert kstest(probability, "uniform").pvalue > 1e-3
    for offset in (3e-4, 1e-3, 3e-3):
        pair = np.array([OBJECTS[0], OBJECTS[0] + [0.0, offset, 0.0, 0.0, 0.0, offset]])
        angles, origin = night(pair, [0.0, 3.0, 8.0], 0.0, 200)
        rows = np.flatnonzero((angles.observer < 2) & (angles.observer == origin))
        fit = fit_orbits(angles, [rows], pair[:1], 0.0)
        assert fit.status[0] == CONVERGED
        rejected += separation_probability(fit, angles, forces=EARTH_MOON).tolist()
    assert max(rejected) < 1e-6
    # one observer, or more than three, have no test
    angles, _ = night(OBJECTS[:1], [0.0, 3.0, 8.0], 0.0, 300)
    fit = fit_orbits(angles, [np.flatnonzero(angles.observer == 1)], OBJECTS[:1], 0.0)
    assert separation_probability(fit, angles, forces=EARTH_MOON).tolist() == [1.0]


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


def two_hypotheses(angles, groups, starts):
    """Hypotheses of two groups of tracklets (boolean function of detections), and their indices."""
    tracklets = attributables(angles, form_tracklets(angles))
    found = LinkHypotheses(
        angles, tracklets, EARTH_MOON, AdmissibleRegion(), LinkingSettings(), LOG_CLUTTER
    )
    for group, start in zip(groups, starts, strict=True):
        own = tuple(t for t, rows in enumerate(tracklets.detections) if group[rows].all())
        rows = [np.unique(np.concatenate([tracklets.detections[t] for t in own]))]
        found.add(OrbitHypotheses(fit_orbits(angles, rows, start[None], 0.0), (own,)))
    assert len(found.members) == 2
    return found


def test_one_object_of_varying_brightness_is_one_orbit():
    """Magnitudes that differ by 1.4 mag between tracklets suggest two objects, the angles one."""
    angles, _ = night(OBJECTS[:1], np.arange(0.0, 16.0, 1.0), 0.0, 31)
    sun = np.tile([389.0, 30.0, 0.0], (angles.time.size, 1))
    zero = np.zeros(angles.time.size)
    angles = angles._replace(sun=sun, magnitude=zero, magnitude_variance=zero + 1e-4)
    place = np.array([propagate(OBJECTS[0], [t], method="dop853")[0, :3] for t in angles.time])
    expected = -sphere_magnitude_residuals(place - angles.observer_position, angles)
    bright = np.rint(angles.time / HOUR - 0.15).astype(int) % 2 == 0
    shift = np.where(bright, -0.7, 0.7)
    for varying in (True, False):
        found = two_hypotheses(
            angles._replace(magnitude=expected + shift * varying),
            (bright, ~bright),
            [OBJECTS[0]] * 2,
        )
        chosen = found.selected()
        assert chosen == [0, 1]
        one = linking._without_duplicates(found, chosen)
        assert len(one) == 1 and found.members[one[0]] == found.joint_members(0, 1)
        # the premise: by the scores, magnitudes outweigh the agreement of the states
        assert (found.scores[one[0]] < sum(found.scores[:2])) == varying


@pytest.mark.parametrize("apart_km", [100.0, 10.0, 0.0])
def test_duplicates_are_orbits_whose_states_agree(apart_km, monkeypatch):
    # without predictions of tracklets, which a curved path may spoil
    nothing = (np.empty(0, dtype=np.int64),) * 3
    monkeypatch.setattr(linking, "tracklet_matches", lambda *_, **__: nothing)
    speed = np.linalg.norm(OBJECTS[0, 3:])
    later = propagate(OBJECTS[0], [apart_km / LENGTH_UNIT_KM / speed], method="dop853")[0]
    twins = np.array([OBJECTS[0], later])
    angles, origin = night(twins, [0.0, 2.0, 5.0], 0.0, 12)
    found = two_hypotheses(angles, (origin == 0, origin == 1), twins)
    chosen = linking._without_duplicates(found, [0, 1])
    a, b = found.fits[:2]
    covariance = a.covariance[0] + b.covariance[0]
    apart = a.state[0] - b.state[0]  # both at the epoch of the fits
    squared = apart @ np.linalg.solve(covariance, apart)
    # the independent test of the difference of the states; the gate is at 27.9
    assert a.epoch[0] == b.epoch[0] and (squared < 20.0 or squared > 100.0)
    assert (len(chosen) == 1) == (squared < 20.0) == (apart_km == 0.0)
    later = refit_at(b, angles, angles.time[-1], forces=EARTH_MOON)
    for one, other in ((a, b), (a, later), (later, a)):
        pairs = same_states(concatenate_fits([one, other], a), 0.9999, forces=EARTH_MOON)
        assert pairs.tolist() == ([[0, 1]] if apart_km == 0.0 else [])


def test_bad_input_and_nothing_to_link():
    angles, _ = night(OBJECTS[:1], [0.0], 0.0, 8)
    empty = linked(angles.rows([]))
    assert empty.log_ratio.size == 0 and empty.verdict == ()
    with pytest.raises(ConfigurationError, match="log_clutter must be finite"):
        link(angles, attributables(angles, []), log_clutter=-np.inf)
    with pytest.raises(ConfigurationError, match="gate_probability"):
        LinkingSettings(gate_probability=1.5)
    grown = OrbitHypotheses(fit_orbits(angles, [], np.empty((0, 6)), 0.0), ())
    assert grown.fits.take([]).epoch.size == 0


def test_the_evidence_of_a_covariance_that_is_singular_in_double_precision():
    angles, _ = night(OBJECTS[:1], [0.0, 2.0], 0.0, 6)
    region, rng = AdmissibleRegion(), np.random.default_rng(7)
    fit = fit_orbits(angles, [np.arange(angles.time.size)], OBJECTS[:1], 0.0)
    sigma = np.repeat([region.position_sigma, region.velocity_sigma], 3)
    share = np.array([1e5, 1e2, 1e-1, 1e-3, 1e-5, 1e-7])
    turned = np.linalg.qr(rng.standard_normal((6, 6)))[0]
    wide = fit._replace(root=(np.diag(share) @ turned * sigma)[None])
    # determinants by the singular values that the factors were made with
    own = np.linalg.slogdet(fit.covariance[0] / np.outer(sigma, sigma))[1]
    expected = -0.5 * np.sum(np.log1p(share**-2.0)) - 0.5 * own
    difference = log_evidence(wide, angles, region) - log_evidence(fit, angles, region)
    assert difference[0] == pytest.approx(expected, abs=1e-6)


def test_pairs_of_orbits_with_a_singular_covariance():
    """Along an undetermined direction a distance is likely that is not likely across it."""
    angles, _ = night(OBJECTS[:1], [0.0, 2.0], 0.0, 6)
    one = fit_orbits(angles, [np.arange(angles.time.size)], OBJECTS[:1], 0.0)
    direction = np.array([0.6, 0.8, 0.0, 0.0, 0.0, 0.0])
    across = np.array([0.8, -0.6, 0.0, 0.0, 0.0, 0.0])
    wide = 1e-10 * np.eye(6) + 1e10 * np.outer(direction, direction)
    assert np.linalg.matrix_rank(wide) < 6
    starts = [OBJECTS[0], OBJECTS[0] + 1e-3 * direction, OBJECTS[0] + 2.0 * across]
    fits = [one._replace(state=state[None], covariance=wide[None]) for state in starts]
    pairs = same_states(concatenate_fits(fits, one), 0.9999, forces=EARTH_MOON)
    assert pairs.tolist() == [[0, 1]]
