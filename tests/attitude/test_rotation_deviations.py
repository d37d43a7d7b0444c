"""Rotation with deviations of inertia and torque from the assumed body, and its derivatives."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from cislunar.attitude.parameter_deviations import (
    TRACK_COLUMNS,
    TURN_PER_STEP,
    begin_track,
    ends_of,
    extend_track,
    make_track,
    parameter_transition,
    perturbed_rotation,
    weigh_ends,
)
from cislunar.attitude.quaternion import compose, to_body

ASSUMED = np.array([1.0, 1.3, 0.8])
RATE = np.array([0.8, -0.5, 0.3])
AMOUNTS = np.array([0.1, -0.2, 0.02, -0.01, 0.03])
KINDS = np.arange(5)
TIMES = np.array([0.05, 3.1, 3.11, 8.0])


def _body(amounts):
    out = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    perturbed_rotation(KINDS, amounts, np.diag(ASSUMED), np.diag(1.0 / ASSUMED), out)
    return out


def _motion(change):
    """Attitude and rate at all times by SciPy, with changes of the rate and the amounts."""
    amounts = AMOUNTS + change[3:]
    moments, torque = ASSUMED * np.exp([0.0, *amounts[:2]]), amounts[2:]

    def slope(_, y):
        q, w = y[:4], y[4:]
        return np.r_[compose(np.r_[0.5 * w, 0.0], q), torque - np.cross(w, moments * w) / moments]

    start = np.r_[0.0, 0.0, 0.0, 1.0, RATE + change[:3]]
    return solve_ivp(slope, (0.0, 9.0), start, rtol=1e-11, atol=1e-11, t_eval=TIMES).y.T


def begun(*given):
    """A track from its start, and the times of its step's ends."""
    track, times = make_track()
    begin_track(track, times, *given)
    return track, times


def _read(track, times, when):
    """Attitude, and the turns of all columns in the body frame (3, TRACK_COLUMNS), at a time."""
    weights = weigh_ends(times, when)
    q = np.array([np.dot(weights, ends_of(track, 0, c)) for c in range(4)])
    q /= np.linalg.norm(q)
    turns = [
        [np.dot(weights, ends_of(track, 1 + i, c)) for i in range(3)] for c in range(TRACK_COLUMNS)
    ]
    return q, to_body(q, turns).T


def test_attitude_and_all_derivatives_against_scipy():
    body, still = _body(AMOUNTS), np.array([0.0, 0.0, 0.0, 1.0])
    track, times = begun(still, RATE, body, True)
    alone, alone_times = begun(still, RATE, body, False)
    ends = [(_motion(h), _motion(-h)) for h in 1e-4 * np.eye(TRACK_COLUMNS)]
    reference = _motion(np.zeros(TRACK_COLUMNS))
    for k, when in enumerate(TIMES):
        extend_track(track, times, when, body, True, TURN_PER_STEP)
        extend_track(alone, alone_times, when, body, False, TURN_PER_STEP)
        (q, turns), (without, _) = _read(track, times, when), _read(alone, alone_times, when)
        np.testing.assert_array_equal(without, q)
        expected = reference[k, :4] / np.linalg.norm(reference[k, :4])
        np.testing.assert_allclose(q, expected, atol=2e-5)
        for c, (above, below) in enumerate(ends):
            back = below[k, :4] * [-1.0, -1.0, -1.0, 1.0]
            turn = Rotation.from_quat(compose(above[k, :4], back)).as_rotvec() / 2e-4
            np.testing.assert_allclose(turns[:, c], turn, atol=2e-4 * max(1.0, when))


def test_transition_with_and_without_deviations():
    inertia, inverse = np.diag(ASSUMED), np.diag(1.0 / ASSUMED)
    known, found = np.empty((6, 6)), np.empty((6, 11))
    for omega in (RATE, np.zeros(3)):
        parameter_transition(omega, 0.02, inertia, inverse, KINDS[:0], known)
        parameter_transition(omega, 0.02, inertia, inverse, KINDS, found)
        np.testing.assert_array_equal(found[:, :6], known)
    # at rest only a torque has an effect: t on the rate and t^2 / 2 on the attitude
    np.testing.assert_array_equal(found[:, 6:8], 0.0)
    np.testing.assert_allclose(found[3:, 8:], 0.02 * np.eye(3), rtol=1e-12)
    np.testing.assert_allclose(found[:3, 8:], 0.0002 * np.eye(3), rtol=1e-12)


@pytest.mark.parametrize("rate", [0.0, 1e200, np.nan])
def test_a_track_ends_whatever_the_rate(rate):
    body = _body(AMOUNTS)
    track, times = begun(np.array([0.0, 0.0, 0.0, 1.0]), np.full(3, rate), body, True)
    extend_track(track, times, 1.0, body, True, TURN_PER_STEP)
    assert not times[0] > 1.0
