"""Hypotheses of linked orbits: the choice between them, their evidence, duplicates."""

from itertools import combinations

import numpy as np
import pytest
from nights import HOUR, LOG_CLUTTER, OBJECTS, SIGMA, night
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from cislunar.constants import LENGTH_UNIT_KM
from cislunar.dynamics import EARTH_MOON, propagate
from cislunar.orbit_determination import (
    AdmissibleRegion,
    LinkingSettings,
    attributables,
    fit_orbits,
    form_tracklets,
    linking,
    log_evidence,
    refit_at,
    same_states,
)
from cislunar.orbit_determination.admissible_region import sphere_magnitude_residuals
from cislunar.orbit_determination.attribution import OrbitHypotheses, concatenate_fits
from cislunar.orbit_determination.hypotheses import LinkHypotheses


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


def test_long_orbits_are_compared_by_some_tracklets_from_the_first_to_the_last():
    angles, origin = night(OBJECTS[:2], [0.0, 2.0], 0.0, 8)
    found = two_hypotheses(angles, (origin == 0, origin == 1), OBJECTS[:2])
    found.members[:] = [(4, 7, 9), tuple(range(0, 2000, 2))]
    assert found.compared(0) == [4, 7, 9]
    few = found.compared(1)
    assert few == sorted(set(few)) and len(few) == 22  # the first and the last are spread as well
    assert few[:8] == list(range(0, 16, 2)) and few[-8:] == list(range(1984, 2000, 2))
    assert max(np.diff(few)) < 2 * 1998 / 7


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
    # by the states alone
    nothing = (np.empty(0, dtype=np.int64),) * 3
    monkeypatch.setattr(linking, "tracklet_matches", lambda *_, **__: nothing)
    speed = np.linalg.norm(OBJECTS[0, 3:])
    later = propagate(OBJECTS[0], [apart_km / LENGTH_UNIT_KM / speed], method="dop853")[0]
    twins = np.array([OBJECTS[0], later])
    # in different exposures, since one object has one detection in an exposure
    hours = np.array([0.0, 1.0, 2.0, 3.0, 5.0, 6.0])
    angles, origin = night(twins, hours, 0.0, 12)
    own = np.searchsorted(hours, angles.time / HOUR, side="right") % 2 == origin
    angles, origin = angles.rows(own), origin[own]
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
