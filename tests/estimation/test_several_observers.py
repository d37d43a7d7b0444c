"""Two observers of one target at the same steps, against the exact linear-Gaussian solution.

The prior is so narrow that every measurement is linear over it; records differ in variance.
"""

import numpy as np
import pytest
from measured import constant_schedule, draw_truth, during

from cislunar.attitude import grp
from cislunar.attitude.quaternion import compose, inverse
from cislunar.attitude.rigid_body import spherical_transition
from cislunar.dynamics.propagation import propagate_stm
from cislunar.estimation.kalman.mukf import MultiplicativeUKF
from cislunar.estimation.light_curves.batch import BatchEstimator
from cislunar.estimation.light_curves.batch_settings import PRESETS
from cislunar.estimation.light_curves.light_curve import cost_and_derivatives
from cislunar.estimation.light_curves.row_blocks import WEIGHT
from cislunar.evaluation.cramer_rao import CramerRaoBound
from cislunar.observation.measurement import measure
from cislunar.observation.measurement_derivatives import measurement_rows
from cislunar.observation.sensor import ExclusionAngles, Sensor
from cislunar.tasking.demonstration import tracking_problem
from cislunar.tasking.initial_conditions import initial_estimate
from cislunar.tasking.planning.assignment import IDLE

NARROW = np.repeat([2e-4, 2e-4, 1e-3, 1e-3], 3)
"""Prior standard deviations in units of the usual ones."""

OBSERVERS = (0, 2)
TARGET = 1


class Problem:
    """Both observers measure one target for an hour, the second with four times the variance."""

    def __init__(self):
        made = tracking_problem(3, 3, duration_hours=1.0)
        self.scene, self.surfaces, epoch, ids, loop = made
        self.initial = initial_estimate(epoch, NARROW * loop.initial.components())
        # noise small beside the prior's share of a measurement, so that the updates matter
        self.sensor = Sensor(
            magnitude_noise=1e-3,
            angle_noise_arcsec=0.02,
            limiting_magnitude=35.0,
            exclusion_deg=ExclusionAngles(0.0, 0.0, 0.0),
            occultation=False,
        )
        self.truth = draw_truth(self.initial, self.scene, self.sensor.noise, 2, ids, observations=2)
        observations = constant_schedule([TARGET, IDLE, TARGET], 3, loop.n_steps)
        motion = self.truth.translation, self.truth.quaternion, self.truth.noise
        records, _ = measure(1, observations, self.scene, self.surfaces, self.sensor, *motion)
        assert np.isfinite(records.value).all()
        variance = records.variance * np.where(records.observer == OBSERVERS[1], 4.0, 1.0)[:, None]
        self.records = records._replace(variance=variance)

    def first_step(self):
        """The records of the first step, alone."""
        return self.records.where(np.arange(self.records.observer.size) < 2)

    def rows(self, quaternion, state, k=1):
        """Derivatives (6, 12) of both observers' measurements at a time."""
        out = np.zeros((6, 12))
        for i, observer in enumerate(OBSERVERS):
            rows = np.empty((3, 6))
            measurement_rows(
                state, quaternion, observer, k, TARGET, self.scene, self.surfaces, rows
            )
            out[3 * i : 3 * i + 3, :3], out[3 * i : 3 * i + 3, 6:9] = rows[:, :3], rows[:, 3:]
        return out


@pytest.fixture(scope="module")
def problem():
    return Problem()


def _joint(covariance, rows, variance):
    """Covariance and gain of one update with all measurements."""
    innovation = rows @ covariance @ rows.T + np.diag(variance)
    gain = np.linalg.solve(innovation, rows @ covariance).T
    return covariance - gain @ rows @ covariance, gain


def _expected(problem, quaternion, state):
    """Measurements of both observers without noise."""
    truth = problem.truth
    attitudes, states = truth.quaternion.copy(), truth.translation.copy()
    attitudes[TARGET, 1], states[TARGET, 1] = quaternion, state
    observations = constant_schedule([TARGET, IDLE, TARGET], 3, 1)
    silent = np.zeros_like(truth.noise)
    found, _ = measure(
        1, observations, problem.scene, problem.surfaces, problem.sensor, states, attitudes, silent
    )
    return found.value


def test_two_updates_of_the_filter_are_one_joint_update(problem):
    filt = MultiplicativeUKF(problem.scene, problem.surfaces, problem.sensor, problem.initial)
    prior = filt.predict()
    quaternion, state = prior.quaternion[TARGET], prior.translation[TARGET]
    covariance = prior.root[TARGET] @ prior.root[TARGET].T
    rows, records = problem.rows(quaternion, state), problem.first_step()
    posterior, gain = _joint(covariance, rows, records.variance.ravel())
    correction = gain @ (records.value - _expected(problem, quaternion, state)).ravel()
    estimates = filt.advance(records)
    assert estimates.used.all() and estimates.used.size == 2
    sigma = np.sqrt(np.diag(posterior))
    assert np.min(sigma / np.sqrt(np.diag(covariance))) < 0.7
    np.testing.assert_allclose(estimates.sigma[TARGET, 0], sigma, rtol=1e-3)
    turned = compose(estimates.quaternion[TARGET, 0], inverse(quaternion))
    moved = estimates.translation[TARGET, 0] - state
    np.testing.assert_allclose(
        np.r_[grp.from_quaternion(turned), moved] / np.r_[sigma[:3], sigma[6:]],
        np.r_[correction[:3], correction[6:]] / np.r_[sigma[:3], sigma[6:]],
        atol=2e-2,
    )


def test_the_orbit_of_the_batch_estimator_uses_both_directions(problem):
    estimator = BatchEstimator(
        problem.scene, problem.surfaces, problem.sensor, problem.initial, np.random.default_rng(0)
    )
    prior = estimator.predict()
    rows = problem.rows(prior.quaternion[TARGET], prior.translation[TARGET])
    angles = [1, 2, 4, 5]
    records = problem.first_step()
    posterior, _ = _joint(
        prior.covariance[TARGET], rows[angles, 6:], records.variance.ravel()[angles]
    )
    estimates = estimator.advance(records)
    sigma = np.sqrt(np.diag(posterior))
    np.testing.assert_allclose(estimates.sigma[TARGET, 0, 6:], sigma, rtol=1e-3)
    assert [len(estimator.light_curve(j)[0]) for j in range(3)] == [0, 2, 0]


def test_the_light_curve_is_the_union_of_both_observers_rows(problem):
    """Its information is the sum of both, by their variances, and gives the uncertainty."""
    estimator = BatchEstimator(
        problem.scene, problem.surfaces, problem.sensor, problem.initial,
        np.random.default_rng(0), settings=PRESETS["single-start"],
    )  # fmt: skip
    estimates = estimator.advance(problem.records)
    data, model, anchor = estimator.light_curve(TARGET)
    assert data.shape[0] == 2 * (problem.records.offset.shape[1] - 1)
    np.testing.assert_array_equal(data[:, WEIGHT], np.tile([1.0, 0.25], data.shape[0] // 2))
    u, gradient = np.full(6, 0.3), np.empty(6)

    def information(rows, noise=1.0):
        out = np.empty((6, 6))
        given = model._replace(noise_variance=noise * model.noise_variance)
        cost_and_derivatives(u, rows, anchor, given, gradient, out)
        return out - anchor.information

    first, second = data[::2].copy(), data[1::2].copy()
    second[:, WEIGHT] = 1.0
    together = information(first) + information(second, noise=4.0)
    np.testing.assert_allclose(information(data), together, rtol=1e-9, atol=1e-9)
    deviations = model.sigma * np.sqrt(np.diag(np.linalg.inv(together + anchor.information)))
    assert np.min(deviations / model.sigma) < 0.7
    np.testing.assert_allclose(estimates.sigma[TARGET, -1, 3:6], deviations[3:], rtol=2e-2)


def test_the_information_of_two_observers_adds_up_in_the_bound(problem):
    truth, sigma = problem.truth, problem.initial.sigma
    motion = truth.translation, truth.quaternion, truth.angular_velocity
    least = CramerRaoBound(problem.scene, problem.surfaces, sigma).advance(*motion, problem.records)
    transition = np.zeros((12, 12))
    turn = np.empty((6, 6))
    spherical_transition(truth.angular_velocity[TARGET, 0], problem.scene.step_s, turn)
    transition[:6, :6] = turn
    transition[6:, 6:] = propagate_stm(truth.translation[TARGET, 0], problem.scene.step)[1]
    scaled = transition * sigma
    rows = problem.rows(truth.quaternion[TARGET, 1], truth.translation[TARGET, 1]) @ scaled
    weight = 1.0 / problem.first_step().variance.ravel()
    information = np.eye(12) + rows.T @ (weight[:, None] * rows)
    expected = np.sqrt(np.diag(scaled @ np.linalg.solve(information, scaled.T)))
    np.testing.assert_allclose(least[TARGET, 0], expected, rtol=1e-6)


def test_two_equal_observations_are_one_of_half_the_variance(problem):
    truth, sigma = problem.truth, problem.initial.sigma
    motion = truth.translation, truth.quaternion, truth.angular_velocity
    alone = problem.records.where(problem.records.observer == 0)
    twice = problem.records._replace(
        observer=np.zeros_like(problem.records.observer),
        variance=np.repeat(alone.variance, 2, axis=0),
    )
    halved = alone._replace(variance=0.5 * alone.variance)
    found = [
        CramerRaoBound(problem.scene, problem.surfaces, sigma).advance(*motion, records)
        for records in (twice, halved)
    ]
    np.testing.assert_allclose(found[0], found[1], rtol=1e-8)


def test_the_bound_in_intervals_is_that_of_the_whole(problem):
    truth, sigma = problem.truth, problem.initial.sigma
    motion = truth.translation, truth.quaternion, truth.angular_velocity
    whole = CramerRaoBound(problem.scene, problem.surfaces, sigma).advance(*motion, problem.records)
    bound, parts = CramerRaoBound(problem.scene, problem.surfaces, sigma), []
    for start, end in ((0, 1), (1, 23), (23, 60)):
        states = [each[:, start : end + 1] for each in motion]
        parts.append(bound.advance(*states, during(problem.records, start, end)))
    # the transition matrix is integrated from the start of every interval, to 1e-13
    np.testing.assert_allclose(np.concatenate(parts, axis=1), whole, rtol=1e-12)
