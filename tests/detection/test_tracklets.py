"""Tracklets against fits of NumPy and SciPy and sampled errors."""

import numpy as np
import pytest
from scipy.optimize import curve_fit
from scipy.stats import chi2, kstest

from cislunar.detection import tracklet
from cislunar.errors import ConfigurationError

SIGMA = np.deg2rad(3.0 / 3600.0)
EPOCH_S = 8.0e8


def line(rng, n=8, ra=2.0):
    time = EPOCH_S + np.sort(rng.uniform(0.0, 1800.0, n))
    sigma = SIGMA * rng.uniform(0.5, 2.0, size=(n, 2))
    slope = np.array([3e-6, -2e-6])
    return time, np.array([ra, 0.4]) + slope * (time - EPOCH_S)[:, None], sigma


def fitted(time, angles, sigma, middle):
    """Values, rates and covariances of both angles by SciPy."""
    values, covariances = [], []
    for axis in range(2):
        value, covariance = curve_fit(
            lambda t, a, b: a + b * t, time - middle, angles[:, axis], p0=[0.0, 0.0],
            sigma=sigma[:, axis], absolute_sigma=True,
        )  # fmt: skip
        values.append(value)
        covariances.append(covariance)
    return np.array(values), covariances


def test_a_tracklet_is_the_weighted_fit_of_a_line():
    rng = np.random.default_rng(1)
    time, true, sigma = line(rng)
    angles = true + sigma * rng.normal(size=true.shape)
    found = tracklet(2, np.arange(10, 18), time, angles, sigma**2)
    assert found.observer == 2 and found.detections.tolist() == list(range(10, 18))
    weight = (1.0 / sigma**2).sum(axis=1)
    assert found.time_s == pytest.approx(np.average(time, weights=weight), abs=1e-6)
    values, covariances = fitted(time, angles, sigma, found.time_s)
    np.testing.assert_allclose(found.attributable[:2], values[:, 0], rtol=1e-10)
    np.testing.assert_allclose(found.attributable[2:], values[:, 1], rtol=1e-5)
    squares = 0.0
    for axis in range(2):
        rows = np.ix_([axis, axis + 2], [axis, axis + 2])
        np.testing.assert_allclose(found.covariance[rows], covariances[axis], rtol=1e-4, atol=1e-25)
        slope, value = np.polyfit(time - found.time_s, angles[:, axis], 1, w=1.0 / sigma[:, axis])
        assert found.attributable[[axis, axis + 2]] == pytest.approx([value, slope], rel=1e-8)
        squares += np.sum(
            ((angles[:, axis] - value - slope * (time - found.time_s)) / sigma[:, axis]) ** 2
        )
    assert found.chi_squared == pytest.approx(squares, rel=1e-5)
    assert not found.covariance[np.ix_([0, 2], [1, 3])].any()


def test_the_covariance_is_that_of_sampled_detections():
    rng = np.random.default_rng(2)
    time, true, sigma = line(rng)
    found = [
        tracklet(0, range(8), time, true + sigma * rng.normal(size=true.shape), sigma**2)
        for _ in range(4000)
    ]
    middle = found[0].time_s
    expected = np.array([2.0, 0.4, 3e-6, -2e-6])
    expected[:2] += expected[2:] * (middle - EPOCH_S)
    errors = np.array([each.attributable for each in found]) - expected
    scale = np.sqrt(np.diag(found[0].covariance))
    np.testing.assert_allclose(
        np.cov((errors / scale).T), found[0].covariance / np.outer(scale, scale), atol=0.09
    )
    assert np.all(np.abs(errors.mean(axis=0)) < 4.0 * scale / np.sqrt(4000))
    squares = [each.chi_squared for each in found]
    assert kstest(squares, chi2(2 * 8 - 4).cdf).pvalue > 1e-3


@pytest.mark.parametrize("start", [2.0 * np.pi - 1e-3, -1e-3, np.pi - 1e-3])
@pytest.mark.parametrize("wrapped", ["0 to 360", "-180 to 180"])
def test_a_path_may_cross_a_whole_turn(start, wrapped):
    time, true, sigma = line(np.random.default_rng(3), ra=start)
    middle = tracklet(0, range(8), time, true, sigma**2)
    turned = true.copy()
    least = 0.0 if wrapped == "0 to 360" else -np.pi
    turned[:, 0] = least + (true[:, 0] - least) % (2.0 * np.pi)
    assert np.ptp(turned[:, 0]) > 6.0 or np.ptp(turned[:, 0]) < 0.1
    found = tracklet(0, range(8), time, turned, sigma**2)
    np.testing.assert_allclose(found.attributable, middle.attributable, atol=1e-12)
    assert 0.0 <= found.attributable[0] < 2.0 * np.pi
    expected = start + 3e-6 * (found.time_s - EPOCH_S)
    assert found.attributable[0] == pytest.approx(expected % (2.0 * np.pi), abs=1e-9)
    assert found.attributable[2] == pytest.approx(3e-6, rel=1e-6)
    assert found.chi_squared < 1e-3


def test_detections_in_any_order_give_the_same_tracklet():
    rng = np.random.default_rng(4)
    time, true, sigma = line(rng)
    order = rng.permutation(8)
    one = tracklet(0, range(8), time, true, sigma**2)
    other = tracklet(0, order, time[order], true[order], sigma[order] ** 2)
    np.testing.assert_allclose(other.attributable, one.attributable, rtol=1e-9)
    np.testing.assert_allclose(other.covariance, one.covariance, rtol=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"time_s": [5.0, 5.0]}, "two different times"),
        ({"time_s": [5.0, np.nan]}, "finite"),
        ({"direction": [[0.1, 0.2], [np.nan, 0.2]]}, "finite"),
        ({"variance": [[1e-9, 1e-9], [0.0, 1e-9]]}, "positive"),
        ({"variance": [[1e-9, 1e-9], [np.inf, 1e-9]]}, "finite"),
        ({"time_s": [5.0]}, "shapes"),
        ({"direction": [[0.1, 0.2]] * 3}, "shape"),
        ({"detections": [1, 2, 3]}, "shape"),
    ],
)
def test_faulty_detections_are_one_line(change, message):
    given = {
        "detections": [0, 1],
        "time_s": [0.0, 60.0],
        "direction": [[0.1, 0.2], [0.1, 0.2]],
        "variance": np.full((2, 2), 1e-9),
    }
    with pytest.raises(ConfigurationError, match=message) as caught:
        tracklet(0, **(given | change))
    assert "\n" not in str(caught.value)
