"""Tracklets and attributables against plain loops, and of simulated objects among false alarms."""

import numpy as np
import pytest
from nights import HOUR, OBJECTS, OBSERVERS, SIGMA, night
from scipy.stats import chi2

from cislunar.constants import TIME_UNIT_S
from cislunar.dynamics import EARTH_MOON
from cislunar.errors import ConfigurationError
from cislunar.orbit_determination import (
    TrackletSettings,
    attributables,
    fit_orbits,
    form_tracklets,
    make_angles,
    tangent_basis,
)


def test_three_detections_suppress_false_tracklets():
    angles, origin = night(OBJECTS[:2], [0.0, 2.0], 8.0, 6, visits=(0.0, 6.0, 12.0))
    pairs = form_tracklets(angles)
    triples = form_tracklets(angles, TrackletSettings(least_detections=3))
    right = [rows for rows in triples if np.all(origin[rows] == origin[rows[0]])]
    assert len(right) == 2 * 2 * len(OBSERVERS)  # objects, hours
    assert [rows.tolist() for rows in triples] == [r.tolist() for r in pairs if len(r) >= 3]
    false = [sum(np.any(origin[rows] < 0) for rows in each) for each in (pairs, triples)]
    assert false[0] > 10 and false[1] < 0.1 * false[0]
    with pytest.raises(ConfigurationError, match="least_detections"):
        TrackletSettings(least_detections=1)


def test_long_tracklets_are_divided():
    angles, _ = night(OBJECTS[:1], [0.0], 0.0, 7, visits=np.arange(0.0, 300.0, 10.0))
    long = form_tracklets(angles, TrackletSettings(largest_span_min=600))
    parts = form_tracklets(angles)
    assert [rows.size for rows in long] == [30] * len(OBSERVERS)
    assert np.concatenate(parts).tolist() == np.concatenate(long).tolist()
    spans = [np.ptp(angles.time[rows]) / HOUR for rows in parts]
    assert len(parts) == 3 * len(OBSERVERS) and min(spans) > 1.4 and max(spans) <= 2.0


@pytest.mark.parametrize(
    ("visits", "longest", "sizes"),
    [
        (np.arange(4) * 14.0, 20, [2, 2]),
        (np.append(np.arange(90) / 3.0, 44.0 + 14.0 * np.arange(30)), 120, [96, 9, 9, 6]),
    ],
)
def test_parts_of_uneven_tracklets_keep_the_limit_and_lose_no_detection(visits, longest, sizes):
    angles, _ = night(OBJECTS[:1], [0.0], 0.0, 7, visits=visits)
    parts = form_tracklets(angles, TrackletSettings(largest_span_min=longest))
    spans = [np.ptp(angles.time[rows]) / HOUR * 60.0 for rows in parts]
    assert max(spans) <= longest * (1.0 + 1e-9)
    for o in range(len(OBSERVERS)):
        assert [rows.size for rows in parts if angles.observer[rows[0]] == o] == sizes


def test_detections_that_are_not_in_order_of_time_are_refused():
    angles, _ = night(OBJECTS[:1], [0.0], 0.0, 7)
    turned = angles.rows(np.arange(angles.time.size)[::-1])
    state = np.zeros((1, 6))
    for call in (
        lambda: form_tracklets(turned), lambda: attributables(turned, [[0, 1]]),
        lambda: fit_orbits(turned, [[0, 1, 2]], state, 0.0, forces=EARTH_MOON),
    ):  # fmt: skip
        with pytest.raises(ConfigurationError, match=r"time of row 1 is before.*; sort the rows"):
            call()


def test_attributables_are_continued():
    angles, _ = night(OBJECTS[:2], [0.0, 2.0], 1.0, 9)
    early = angles.rows(np.arange(np.count_nonzero(angles.time < 1.0 * HOUR)))
    first = attributables(early, form_tracklets(early))
    formed = form_tracklets(angles)
    assert 2 <= first.time.size < len(formed)
    again, anew = attributables(angles, formed, known=first), attributables(angles, formed)
    for continued, whole in zip(again[:-1], anew[:-1], strict=True):
        np.testing.assert_array_equal(continued, whole)
    assert [d.tolist() for d in again.detections] == [d.tolist() for d in anew.detections]


def chains(angles, settings):
    """Tracklets by sets of pairs: the definition of `form_tracklets`, one observer at a time."""
    gap = settings.largest_gap_min * 60.0 / TIME_UNIT_S
    fastest = settings.largest_rate_arcsec_s * SIGMA * TIME_UNIT_S
    bend = settings.largest_acceleration_arcsec_s2 * SIGMA * TIME_UNIT_S**2
    c, s, found = np.cos(angles.time), np.sin(angles.time), []
    x, y, z = angles.direction.T
    fixed = np.stack([c * x - s * y, s * x + c * y, z], axis=1)
    noise = np.sqrt(np.trace(angles.covariance, axis1=1, axis2=2))

    def bent(p, q, row):
        span = angles.time[[row, q]] - angles.time[p]
        line = fixed[p] + (fixed[q] - fixed[p]) * span[0] / span[1]
        allowed = 0.5 * bend * span[0] * (span[0] - span[1])
        part = span[0] / span[1]
        allowed += 5.0 * np.hypot(noise[row], noise[p] * abs(1.0 - part) + noise[q] * part)
        return np.linalg.norm(fixed[row] - line) / allowed

    def misfit(chain, row):
        path = [*chain[-6:], row]
        degree = 2 if len(path) == 4 else 3
        x = (angles.time[path] - angles.time[row]) / np.ptp(angles.time[path])
        design = x[:, None] ** np.arange(degree + 1) / noise[path, None]
        value = (fixed[path] - fixed[row]) / noise[path, None]
        left = value - design @ np.linalg.lstsq(design, value)[0]
        return 2.0 * np.sum(left**2) / chi2.isf(1e-6, 2 * (len(path) - degree - 1))

    def next_ones(chain, measure):
        each = [(angles.time[q], measure(chain, q), q) for p, q in pairs if p == chain[-1]]
        good = [one for one in each if one[1] <= 1.0]
        return sorted(one for one in good if one[0] == min(good)[0])

    def grown(chain):
        while best := next_ones(chain, misfit):
            chain = [*chain, best[0][2]]
        return chain

    for observer in np.unique(angles.observer):
        rows = np.flatnonzero(angles.observer == observer).tolist()
        pairs = {
            (p, q)
            for p in rows
            for q in rows
            if 0.0 < angles.time[q] - angles.time[p] <= gap
            and np.linalg.norm(fixed[q] - fixed[p]) <= fastest * (angles.time[q] - angles.time[p])
        }
        used = set()
        for pair in sorted(pairs):
            if pair in used:
                continue
            thirds = next_ones(list(pair), lambda chain, row: bent(*chain, row))
            trials = [grown([*pair, row]) for *_, row in thirds]
            chain = max(trials, key=len) if trials else list(pair)
            used |= {(p, q) for i, p in enumerate(chain) for q in chain[i + 1 :]}
            if len(chain) >= settings.least_detections:
                found.append(chain)
    longest = {row: max(len(c) for c in found if row in c) for c in found for row in c}
    return [c for c in found if min(longest[row] for row in c) < len(c) + 2]


@pytest.mark.parametrize("least", [2, 3])
def test_tracklets_are_those_of_plain_loops(least):
    angles, _ = night(OBJECTS, [0.0, 1.0], 4.0, 21, visits=(0.0, 5.0, 12.0))
    settings = TrackletSettings(least_detections=least)
    expected = chains(angles, settings)
    assert len(expected) > 2 * len(OBSERVERS) * len(OBJECTS) - 3
    assert [rows.tolist() for rows in form_tracklets(angles, settings)] == expected


def test_objects_that_are_close_are_not_mixed():
    """Five objects within some arc minutes, observed every ten minutes, as after a deployment."""
    rng = np.random.default_rng(26)
    group = OBJECTS[0] + np.concatenate([np.zeros((5, 3)), 3e-3 * rng.normal(size=(5, 3))], axis=1)
    angles, origin = night(group, [6.0], 0.5, 27, visits=np.arange(0.0, 90.0, 10.0))
    apart = np.linalg.norm(np.diff(angles.direction[origin >= 0], axis=0), axis=1) / SIGMA
    assert 30.0 < np.median(apart) < 300.0
    formed = [rows.tolist() for rows in form_tracklets(angles)]
    assert formed == chains(angles, TrackletSettings())
    of_objects = [origin[rows] for rows in formed if np.all(origin[rows] >= 0)]
    whole = [each for each in of_objects if np.ptp(each) == 0 and each.size == 9]
    assert len(whole) == len(group) * len(OBSERVERS)
    mixed = [each.size for each in of_objects if np.ptp(each) > 0]
    assert len(mixed) < 0.2 * len(whole), mixed


def test_attributables_are_fits_of_polynomials():
    rng = np.random.default_rng(22)
    straight = night(OBJECTS[:1], [0.0], 0.0, 23, visits=(0.0, 4.0, 9.0))[0]
    curved = night(OBJECTS[:1], [0.0], 0.0, 24, visits=np.arange(0.0, 100.0, 10.0))[0]
    for angles, degree in ((straight, 1), (curved, 2)):
        variance = rng.uniform(1.0, 4.0, angles.time.size) * SIGMA**2
        angles = angles._replace(covariance=variance[:, None, None] * np.eye(2))
        rows = np.flatnonzero(angles.observer == 1)
        one = attributables(angles, [rows])
        # the same in a frame that does not rotate, by NumPy's polynomials
        t, weight = angles.time[rows], 1.0 / variance[rows]
        middle = weight @ t / weight.sum()
        c, s = np.cos(t - middle), np.sin(t - middle)
        x, y, z = angles.direction[rows].T
        fixed = np.stack([c * x - s * y, s * x + c * y, z], axis=1)
        mean = weight @ fixed
        mean /= np.linalg.norm(mean)
        east, north = tangent_basis(mean)
        offset = np.stack([fixed @ east, fixed @ north], axis=1) / (fixed @ mean)[:, None]
        fit, scale = np.polyfit(t - middle, offset, degree, w=np.sqrt(weight)), np.ptp(t)
        left = offset - np.vander(t - middle, degree + 1) @ fit
        assert one.chi_squared[0] == pytest.approx(weight @ (left**2).sum(axis=1), rel=1e-4)
        unit = mean + fit[-1] @ [east, north]
        length = np.linalg.norm(unit)
        rate = fit[-2] @ [east, north] / length
        np.testing.assert_allclose(one.direction[0], unit / length, atol=1e-12)
        assert one.time[0] == pytest.approx(middle, abs=1e-15)
        rate -= (rate @ unit) * unit / length**2
        np.testing.assert_allclose(one.rate[0], rate, atol=1e-10 / scale)


def test_tracklets_of_several_observers_or_of_one_time_are_refused():
    angles, _ = night(OBJECTS[:1], [0.0], 0.0, 25)
    mixed = [np.flatnonzero(angles.observer == 0), np.array([0, 1])]
    assert angles.observer[0] != angles.observer[1]
    with pytest.raises(ConfigurationError, match=r"rows \[0, 1\] has 2 observers and 2 times"):
        attributables(angles, mixed)
    for given, words in (
        ({"tracklets": [[0, angles.time.size]]}, "tracklets: .* must be a whole number"),
        ({"tracklets": [[0, 1.5]]}, r"tracklets: 1\.5 must be a whole number"),
        ({"tracklets": [angles.observer == 0]}, "give the number of each row once, not a mask"),
        ({"tracklets": [[0, 3, 0]]}, "give the number of each row once, not a mask"),
        ({"tracklets": mixed[:1], "degree": -1}, "degree = -1 must be a whole number"),
        ({"tracklets": [mixed[0][:2]], "degree": 2}, "degree = 2 needs 3 different times"),
    ):
        with pytest.raises(ConfigurationError, match=words):
            attributables(angles, **given)
    same = make_angles([0.0, 0.0], [0, 0], np.zeros((2, 3)), np.eye(3)[:2], SIGMA)
    with pytest.raises(ConfigurationError, match="1 observers and 1 times"):
        attributables(same, [[0, 1]])
    none = attributables(angles, [])
    assert none.time.size == 0 and none.covariance.shape == (0, 4, 4) and none.detections == ()


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"sigma_rad": [SIGMA] * 3}, r"sigma_rad has shape \(3,\); give numbers"),
        ({"sigma_rad": -SIGMA}, "sigma_rad of row 0 must be positive"),
        ({"magnitude": np.ones((2, 2))}, r"magnitude has shape \(2, 2\)"),
        ({"magnitude_sigma": [0.1]}, r"magnitude_sigma has shape \(1,\)"),
        ({"sun": np.ones(3)}, r"sun has shape \(3,\)"),
        ({"observer": [0.0, 1.0]}, "give 2 whole numbers"),
        ({"time": [1.0, 0.0]}, "sort the rows"),
    ],
)
def test_angles_of_wrong_shapes_are_refused(given, words):
    right = {"time": [0.0, 1.0], "observer": [0, 1], "observer_position": np.zeros((2, 3)),
             "direction": np.eye(3)[:2], "sigma_rad": SIGMA}  # fmt: skip
    assert make_angles(**right, magnitude=15.0).magnitude.shape == (2,)
    with pytest.raises(ConfigurationError, match=words):
        make_angles(**right | given)
