"""Association against Stone Soup and filterpy, which propagate the tracks' current states.

A window expresses everything by the states at its begin. The oracles predict every track from one
exposure to the next, so the two meet only in detections, probabilities and innovations.
"""

from datetime import datetime, timedelta
from itertools import product
from typing import NamedTuple

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from scipy.stats import multivariate_normal
from stonesoup.dataassociator.neighbour import GNNWith2DAssignment
from stonesoup.dataassociator.probability import JPDA
from stonesoup.hypothesiser.probability import PDAHypothesiser
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.transition.linear import (
    CombinedLinearGaussianTransitionModel,
    ConstantVelocity,
)
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleDistanceHypothesis
from stonesoup.types.multihypothesis import MultipleHypothesis
from stonesoup.types.state import GaussianState
from stonesoup.types.track import Track
from stonesoup.updater.kalman import KalmanUpdater
from stonesoup.updater.probability import PDAUpdater

from cislunar.association import (
    Window,
    associate_frames,
    gaussian_log_likelihood,
    joint_probabilities,
    probabilistic,
)
from cislunar.association.nearest_neighbor import nearest_neighbor
from cislunar.association.window import updated

DETECTED, GATE, CLUTTER = 0.8, 0.85, 0.1
"""P_D, P_G, and false alarms per unit of area."""
SIDE = 5.0
EPOCH = datetime(2030, 1, 1)
STEP = np.kron(np.eye(2), [[1.0, 1.0], [0.0, 1.0]])
"""Transition of (x, x', y, y') from one exposure to the next."""
POSITION = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])


class Scene(NamedTuple):
    """Tracks (track, 4) one step before the first exposure, and detections by exposure."""

    mean: np.ndarray
    covariance: np.ndarray
    position: list[np.ndarray]
    noise: list[np.ndarray]

    def numbers(self, k):
        """The integers that identify the detections of an exposure."""
        first = sum(len(each) for each in self.position[:k])
        return range(first, first + len(self.position[k]))


def innovation(residual, design, noise, shift, covariance):
    """Innovation and its covariance after a shift of a track's state."""
    return residual - design @ shift, design @ covariance @ design.T + np.diag(noise)


def scene_of(seed, exposures, tracks, equal_noise=False):
    """Tracks close to one another, their detections, and false alarms around them."""
    rng = np.random.default_rng([11, seed])
    mean = rng.normal(scale=[0.7, 0.2, 0.7, 0.2], size=(tracks, 4))
    root = 0.15 * (rng.normal(size=(tracks, 4, 4)) + 2.0 * np.eye(4))
    covariance = root @ root.swapaxes(1, 2)
    state = mean + np.einsum("tij,tj->ti", root, rng.normal(size=(tracks, 4)))
    position, noise = [], []
    for _ in range(exposures):
        state = state @ STEP.T
        real = state[rng.random(tracks) < DETECTED] @ POSITION.T
        false = rng.uniform(-0.5 * SIDE, 0.5 * SIDE, size=(rng.poisson(CLUTTER * SIDE**2), 2))
        size = len(real) + len(false)
        variance = rng.uniform(0.02, 0.2, size=(1 if equal_noise else size, 2))
        variance = np.broadcast_to(variance, (size, 2))
        real = real + np.sqrt(variance[: len(real)]) * rng.normal(size=real.shape)
        position.append(np.concatenate([real, false]))
        noise.append(variance)
    return Scene(mean, covariance, position, noise)


def window_of(scene):
    """The window of a scene; every detection is a candidate of every track."""
    exposures, tracks = len(scene.position), len(scene.mean)
    rows = []
    for k in range(exposures):
        design = POSITION @ np.linalg.matrix_power(STEP, k + 1)
        for t, mean in enumerate(scene.mean):
            for d, z, r in zip(scene.numbers(k), scene.position[k], scene.noise[k], strict=True):
                rows.append((k, t, d, z - design @ mean, design, r))
    exposure, track, detection, residual, design, noise = map(np.array, zip(*rows, strict=True))
    weight = np.full(len(rows), np.log(DETECTED) - np.log(CLUTTER))
    seen = np.array(list(product(range(exposures), range(tracks))))
    miss = np.full(len(seen), np.log(1.0 - DETECTED * GATE))
    return Window(scene.covariance, exposure, track, detection, residual, design, noise, weight,
                  seen, miss)  # fmt: skip


class LogLikelihood(PDAHypothesiser):
    """The hypotheses of PDA with their negative log-likelihood ratios as distances.

    Stone Soup's assignment adds the probabilities of pairs, of which no sum is the probability of
    the assignment. It adds distances, and their sum is.
    """

    def hypothesise(self, *args, **kwargs):
        return MultipleHypothesis(
            [
                SingleDistanceHypothesis(
                    each.prediction,
                    each.measurement,
                    -each.probability.log_value,
                    each.measurement_prediction,
                )
                for each in super().hypothesise(*args, **kwargs)
            ]
        )


def hypothesiser(kind=PDAHypothesiser):
    """Of the hypotheses of a track, with likelihood ratios instead of probabilities."""
    still = [ConstantVelocity(0.0), ConstantVelocity(0.0)]
    predictor = KalmanPredictor(CombinedLinearGaussianTransitionModel(still))
    return kind(predictor, KalmanUpdater(None), CLUTTER, DETECTED, GATE, normalise=False)


def tracks_of(scene):
    return [
        Track([GaussianState(mean, covariance, timestamp=EPOCH)])
        for mean, covariance in zip(scene.mean, scene.covariance, strict=True)
    ]


def exposures_of(scene):
    """Time of each exposure, and its detections with their numbers."""
    for k, (position, noise) in enumerate(zip(scene.position, scene.noise, strict=True)):
        time = EPOCH + timedelta(seconds=k + 1)
        found = [
            Detection(z, timestamp=time, measurement_model=LinearGaussian(4, (0, 2), np.diag(r)))
            for z, r in zip(position, noise, strict=True)
        ]
        yield time, found, {id(one): d for one, d in zip(found, scene.numbers(k), strict=True)}


def taken(found):
    return sorted(zip(found.track.tolist(), found.detection.tolist(), strict=True))


@pytest.mark.parametrize("seed", range(25))
def test_nearest_neighbor_is_the_assignment_of_stone_soup(seed):
    scene = scene_of(seed, 3, 2 + seed % 2)
    associator, updater = GNNWith2DAssignment(hypothesiser(LogLikelihood)), KalmanUpdater(None)
    tracks, expected = tracks_of(scene), []
    for time, detections, number in exposures_of(scene):
        chosen = associator.associate(tracks, detections, time)
        for t, track in enumerate(tracks):
            found = chosen[track]
            if found:
                expected.append((t, number[id(found.measurement)]))
            track.append(updater.update(found) if found else found.prediction)
    assert taken(nearest_neighbor(window_of(scene), GATE)) == sorted(expected)


def jpda(scene, updater):
    """Probability of every pair of a track and a detection in its gate."""
    associator, tracks, expected = JPDA(hypothesiser()), tracks_of(scene), {}
    for time, detections, number in exposures_of(scene):
        found = associator.associate(tracks, detections, time)
        for t, track in enumerate(tracks):
            pairs = [each for each in found[track] if each]
            expected |= {(t, number[id(each.measurement)]): each.probability for each in pairs}
            track.append(updater.update(found[track]) if pairs else found[track][0].prediction)
    return expected


def assert_probabilities(scene, expected, monkeypatch):
    monkeypatch.setattr(probabilistic, "_LEAST_WEIGHT", 0.0)
    window = window_of(scene)
    found = joint_probabilities(window, GATE)
    exposure_of = dict(zip(window.detection.tolist(), window.exposure.tolist(), strict=True))
    # a row is that of the most probable detection, with the probability of any
    wanted = {}
    for (track, detection), weight in expected.items():
        wanted.setdefault((exposure_of[detection], track), {})[detection] = float(weight)
    places = list(zip(found.exposure.tolist(), found.track.tolist(), strict=True))
    assert sorted(places) == sorted(wanted)
    for place, detection, weight in zip(
        places, found.detection.tolist(), found.weight, strict=True
    ):
        assert weight == pytest.approx(sum(wanted[place].values()), rel=1e-9)
        assert detection == max(wanted[place], key=wanted[place].get)


@pytest.mark.parametrize("seed", range(12))
def test_joint_probabilities_of_one_exposure_are_those_of_stone_soup(seed, monkeypatch):
    scene = scene_of(seed, 1, 2 + seed % 2)
    assert_probabilities(scene, jpda(scene, PDAUpdater(None, gm_method=True)), monkeypatch)


@pytest.mark.parametrize("seed", range(8))
def test_joint_probabilities_of_later_exposures_are_those_of_stone_soup(seed, monkeypatch):
    """They depend on the update by the weighted innovations of the exposures before."""
    scene = scene_of(seed, 3, 2, equal_noise=True)
    assert_probabilities(scene, jpda(scene, PDAUpdater(None, gm_method=True)), monkeypatch)


def test_joint_probabilities_after_detections_of_different_noise(monkeypatch):
    """The mixture of the updates by each detection, each with its own gain."""
    for seed in range(8):
        scene = scene_of(seed, 3, 2)
        assert_probabilities(scene, jpda(scene, PDAUpdater(None, gm_method=True)), monkeypatch)


def histories(state, exposures, rule, updater):
    """Score and detections of every history of a track that stays in its gates."""
    if not exposures:
        yield 0.0, ()
        return
    (time, detections, number), *later = exposures
    for one in rule.hypothesise(state, detections, time):
        after = updater.update(one) if one else one.prediction
        own = (number[id(one.measurement)],) if one else ()
        for value, rest in histories(after, later, rule, updater):
            yield value - one.distance, own + rest


@pytest.mark.parametrize("seed", range(16))
@pytest.mark.parametrize("confirmations", [1, 2, 3])
def test_windows_take_the_best_histories_of_stone_soup(seed, confirmations):
    scene = scene_of(seed, 3, 2)
    exposures, rule = list(exposures_of(scene)), hypothesiser(LogLikelihood)
    every = [
        [
            (value, own)
            for value, own in histories(track, exposures, rule, KalmanUpdater(None))
            if not own or len(own) >= confirmations
        ]
        for track in tracks_of(scene)
    ]
    apart = (pair for pair in product(*every) if not set(pair[0][1]) & set(pair[1][1]))
    best = max(apart, key=lambda pair: pair[0][0] + pair[1][0])
    expected = sorted((t, d) for t, (_, own) in enumerate(best) for d in own)
    assert taken(associate_frames(window_of(scene), GATE, confirmations, 3, 5000)) == expected


@pytest.mark.parametrize("scale", [1.0, 1e-6])
def test_updates_and_likelihoods_are_those_of_filterpy(scale):
    """At the scale of optical directions in rad too."""
    scene = scene_of(3, 6, 1)
    mean, covariance = scale * scene.mean[0], scale**2 * scene.covariance[0]
    peer = KalmanFilter(dim_x=4, dim_z=2)
    peer.x, peer.P, peer.F, peer.H, peer.Q = mean, covariance, STEP, POSITION, np.zeros((4, 4))
    shift, start, after = np.zeros(4), mean, np.eye(4)
    for position, noise in zip(scene.position, scene.noise, strict=True):
        after = STEP @ after
        z, r, design = scale * position[0], scale**2 * noise[0], POSITION @ after
        nu, s = innovation(z - design @ start, design, r, shift, covariance)
        squared, log_likelihood = gaussian_log_likelihood(nu, s)
        shift, covariance = updated(nu, s, design, shift, covariance)
        peer.predict()
        peer.update(z, R=np.diag(r))
        np.testing.assert_allclose(nu, peer.y, rtol=0, atol=1e-11 * scale)
        np.testing.assert_allclose(s, peer.S, rtol=1e-9, atol=1e-12 * scale**2)
        assert squared == pytest.approx(peer.mahalanobis**2, rel=1e-9)
        assert log_likelihood == pytest.approx(peer.log_likelihood, rel=1e-9)
        plain = multivariate_normal(POSITION @ peer.x_prior, s).logpdf(z)
        assert log_likelihood == pytest.approx(plain, rel=1e-9)
        np.testing.assert_allclose(after @ (start + shift), peer.x, rtol=0, atol=1e-11 * scale)
        own = after @ covariance @ after.T
        np.testing.assert_allclose(own, peer.P, rtol=0, atol=1e-11 * scale**2)
