"""Attribution of tracklets to an orbit, and plausibility of orbits near an observer."""

from itertools import pairwise

import numpy as np
import pytest
from nights import HOUR, OBJECTS, night
from scipy.stats import chi2

from cislunar.constants import LENGTH_UNIT_KM
from cislunar.dynamics import EARTH_MOON, VELOCITY_UNIT_M_S, propagate
from cislunar.orbit_determination import (
    CONVERGED,
    AdmissibleRegion,
    Angles,
    attributables,
    attribution,
    exposure_numbers,
    fit_orbits,
    form_tracklets,
    tracklet_matches,
)
from cislunar.orbit_determination.attribution import OrbitHypotheses
from cislunar.orbit_determination.initial_orbits import is_plausible


@pytest.mark.parametrize("visits", [(0.0, 20.0, 40.0), (0.0, 5.0, 30.0), tuple(range(0, 60, 6))])
def test_the_gate_keeps_its_share_of_tracklets_of_curved_paths(visits):
    """Of an object about the Moon, whose path straight lines miss by up to an arcminute."""
    retrograde = np.array([[1.06, 0.0, 0.0, 0.0, -0.5, 0.0]])
    angles, _ = night(retrograde, np.arange(0.0, 30.0, 1.5), 0.0, 24, visits)
    number = np.rint(angles.time / HOUR // 1.5).astype(int) * 3 + angles.observer
    rows = [np.flatnonzero(number == k) for k in np.unique(number)]
    tracklets = attributables(angles, rows, degree=1)
    fit = fit_orbits(angles, [np.arange(angles.time.size)], retrograde, 0.0)
    given = fit, tracklets, np.array([-np.inf]), np.array([np.inf])
    half, most = (tracklet_matches(*given, share, forces=EARTH_MOON)[1] for share in (0.5, 0.9999))
    assert len(rows) == 60 and most.size >= 59
    assert abs(half.size - 30) < 3.0 * np.sqrt(60 * 0.25)


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
        return judge(fits, significance) & np.array([not each & wrong for each in rows], bool)

    monkeypatch.setattr(attribution, "agrees", agrees)
    rows = np.unique(np.concatenate(tracklets.detections[:3]))
    start = fit_orbits(angles, [rows], OBJECTS[:1], 0.0)
    found = attribution.extend_orbits(
        angles, tracklets, OrbitHypotheses(start, ((0, 1, 2),)),
        np.ones(tracklets.time.size, dtype=bool), exposure_numbers(angles), forces=EARTH_MOON,
        spans_h=(3.0, 24.0),
        gate_probability=0.9999, significance=1e-6,
    )  # fmt: skip
    assert max(np.diff([rows.size, *sizes])) > 2 * 4
    # a wrong tracklet may exclude those that were as probable when the orbit would have taken it
    lost = right - set(found.tracklets[0])
    assert set(found.tracklets[0]) <= right and len(lost) <= (0 if intruder is None else 3)
    # four, eight, sixteen, and the rest
    assert intruder is not None or len(sizes) <= 8


def test_fits_with_priors_attribute_the_same_tracklets(monkeypatch):
    angles, origin = night(OBJECTS[:2], np.arange(0.0, 20.0), 0.3, 22)
    tracklets = attributables(angles, form_tracklets(angles))
    own = [np.flatnonzero([np.all(origin[rows] == k) for rows in tracklets.detections])
           for k in range(2)]  # fmt: skip
    members = tuple(tuple(each[:8].tolist()) for each in own)
    rows = [np.unique(np.concatenate([tracklets.detections[t] for t in each])) for each in members]
    start = fit_orbits(angles, rows, OBJECTS[:2], 0.0)
    found, priors = {}, []

    def fitted(*given, prior=None, **settings):
        priors.append(0 if prior is None else np.count_nonzero(prior.status == CONVERGED))
        return fit_orbits(*given, prior=prior, **settings)

    monkeypatch.setattr(attribution, "fit_orbits", fitted)
    for many in (10**6, 10):
        assert not any(priors)
        monkeypatch.setattr(attribution, "_MANY", many)
        found[many] = attribution.extend_orbits(
            angles, tracklets, OrbitHypotheses(start, members),
            np.ones(tracklets.time.size, dtype=bool), exposure_numbers(angles), forces=EARTH_MOON,
            spans_h=(3.0, 24.0), gate_probability=0.9999, significance=1e-6,
        )  # fmt: skip
    none = attribution.extend_orbits(
        angles, tracklets, OrbitHypotheses(start.take([]), ()), np.ones(0, dtype=bool),
        exposure_numbers(angles), forces=EARTH_MOON, spans_h=(3.0,), gate_probability=0.99,
        significance=1e-6,
    )  # fmt: skip
    assert none.tracklets == ()
    assert max(priors) == 2
    exact, fast = found.values()
    assert fast.tracklets == exact.tracklets and min(map(len, exact.tracklets)) > 40
    np.testing.assert_array_equal(fast.fits.row, exact.fits.row)
    np.testing.assert_allclose(fast.fits.chi_squared, exact.fits.chi_squared, atol=1e-4)
    sigma = np.sqrt(exact.fits.covariance[:, range(6), range(6)])
    assert np.abs((fast.fits.state - exact.fits.state) / sigma).max() < 1e-3


def test_orbits_whose_last_fit_does_not_agree_are_extended_by_fits_to_all_angles(monkeypatch):
    angles, _ = night(OBJECTS[:1], np.arange(0.0, 8.0), 0.0, 23)
    tracklets = attributables(angles, form_tracklets(angles))
    rows = np.unique(np.concatenate(tracklets.detections[:6]))
    start = fit_orbits(angles, [rows], OBJECTS[:1], 0.0)
    judge, fitted = attribution.agrees, []

    def agrees(fits, significance):
        fitted.append(fits)
        # the first fit to all angles after those with a prior
        last = fits.row.size and fits.row[0] == 0 and len(fitted) == first_whole
        return judge(fits, significance) & (not last)

    monkeypatch.setattr(attribution, "agrees", agrees)
    monkeypatch.setattr(attribution, "_MANY", 10)
    given = (
        angles, tracklets, OrbitHypotheses(start, ((0, 1, 2, 3, 4, 5),)),
        np.ones(tracklets.time.size, dtype=bool), exposure_numbers(angles),
    )  # fmt: skip
    settings = {"forces": EARTH_MOON, "spans_h": (24.0,), "gate_probability": 0.9999,
                "significance": 1e-6}  # fmt: skip
    first_whole = 0
    expected = attribution.extend_orbits(*given, **settings)
    first_whole, before = len(fitted), len(fitted)
    fitted.clear()
    found = attribution.extend_orbits(*given, **settings)
    assert len(fitted) > before and fitted[before].row[0] == 0
    assert found.tracklets == expected.tracklets
    np.testing.assert_array_equal(found.fits.row, expected.fits.row)


@pytest.mark.parametrize("change_m_s", [0.0, 0.1, 0.2])
def test_a_long_orbit_takes_no_tracklets_that_contradict_it(change_m_s):
    """A maneuver an hour after 144 detections, which hide its effect on chi squared of them all."""
    burn = 24.2 * HOUR
    state = propagate(OBJECTS[0], [burn], method="dop853")[0]
    state[3:] += change_m_s / VELOCITY_UNIT_M_S * np.array([0.6, 0.8, 0.0])
    other = propagate(state, [-burn], method="dop853")
    one, two = (
        night(OBJECTS[:1], np.arange(24.0), 0.0, 31),
        night(other, np.arange(25, 34), 0.0, 32),
    )
    parts = zip(one[0][:-1], two[0][:-1], strict=True)
    angles = Angles(*map(np.concatenate, parts), 0.0)
    tracklets = attributables(angles, form_tracklets(angles))
    before = np.flatnonzero(tracklets.time < burn)
    start = fit_orbits(angles, [np.flatnonzero(angles.time < burn)], OBJECTS[:1], 0.0)
    found = attribution.extend_orbits(
        angles, tracklets, OrbitHypotheses(start, (tuple(before.tolist()),)),
        np.ones(tracklets.time.size, dtype=bool), exposure_numbers(angles), forces=EARTH_MOON,
        spans_h=(3.0, 6.0, 12.0, 24.0), gate_probability=0.9999, significance=1e-4,
    )  # fmt: skip
    rise = found.fits.chi_squared[0] - start.chi_squared[0]
    degrees = 2 * (found.fits.row.size - start.row.size)
    assert rise <= chi2.isf(1e-6, max(degrees, 1))
    # without a maneuver, all of them
    assert change_m_s > 0.0 or len(found.tracklets[0]) == tracklets.time.size


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
