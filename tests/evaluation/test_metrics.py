import numpy as np
import pytest
from measured import evaluate

from cislunar.attitude import grp
from cislunar.attitude.quaternion import from_rotation_vector
from cislunar.errors import ConfigurationError
from cislunar.evaluation import metrics
from cislunar.evaluation.metrics import INCONSISTENT, NEVER_OBSERVED, TRACKED

STEP_S = 600.0
N_STEPS = 144


@pytest.fixture
def consistent():
    rng = np.random.default_rng(2)
    sigma = rng.uniform(0.5, 2.0, size=(4, 20_000, 12))
    return sigma * rng.standard_normal(sigma.shape), sigma


def _whole(error, sigma):
    return evaluate(error, sigma, np.ones(error.shape[:2], dtype=bool), STEP_S)


def test_a_consistent_filter_scores_as_a_gaussian(consistent):
    found = _whole(*consistent)
    np.testing.assert_allclose(found.coverage, 0.9973, atol=0.002)
    np.testing.assert_allclose(found.anees, 1.0, atol=0.06)
    np.testing.assert_allclose(found.rmse, 1.3229, rtol=0.03)  # rms of U(0.5, 2)


def test_an_overconfident_filter_scores_the_square_of_its_overconfidence(consistent):
    error, sigma = consistent
    found = _whole(error, sigma / 3.0)
    np.testing.assert_allclose(found.anees, 9.0, rtol=0.06)
    np.testing.assert_allclose(found.coverage, 0.6827, atol=0.02)


def test_a_failed_estimate_is_not_covered_and_is_not_averaged():
    error = np.ones((1, 10, 12))
    sigma = np.ones((1, 10, 12))
    error[0, 4:] = np.nan
    sigma[0, 4:] = np.nan
    found = _whole(error, sigma)
    assert np.all(found.coverage == 0.4)
    assert np.all(found.anees == 1.0)
    assert np.all(found.rmse == 1.0)
    lost = np.full((1, 10, 12), np.nan)
    assert np.all(np.isnan(_whole(lost, sigma).rmse))


def _run(rotation_outside, translation_outside, observed):
    """One target whose errors leave the bounds for a share of the final four hours."""
    error, sigma = np.zeros((1, N_STEPS, 12)), np.ones((1, N_STEPS, 12))
    final = round(4.0 * 3600.0 / STEP_S)
    for part, share in ((slice(0, 6), rotation_outside), (slice(6, 12), translation_outside)):
        error[:, N_STEPS - round(share * final) :, part] = 5.0
    used = np.zeros((1, N_STEPS), dtype=bool)
    used[0, 3] = observed
    return evaluate(error, sigma, used, STEP_S)


@pytest.mark.parametrize(
    ("rotation", "translation", "observed", "expected"),
    [
        (0.0, 0.0, True, (TRACKED, TRACKED, TRACKED)),
        (0.4, 0.4, True, (TRACKED, TRACKED, TRACKED)),
        (0.6, 0.0, True, (INCONSISTENT, INCONSISTENT, TRACKED)),
        (0.0, 0.6, True, (INCONSISTENT, TRACKED, INCONSISTENT)),
        (1.0, 1.0, False, (NEVER_OBSERVED, NEVER_OBSERVED, NEVER_OBSERVED)),
    ],
)
def test_status(rotation, translation, observed, expected):
    result = _run(rotation, translation, observed)
    got = (result.status, result.status_rotation, result.status_translation)
    assert tuple(int(status[0]) for status in got) == expected
    assert result.status.dtype == np.uint8


def test_only_the_final_hours_decide():
    error, sigma = np.zeros((1, N_STEPS, 12)), np.ones((1, N_STEPS, 12))
    error[:, : N_STEPS - 24] = 100.0
    used = np.ones((1, N_STEPS), dtype=bool)
    assert evaluate(error, sigma, used, STEP_S).status[0] == TRACKED


def test_attitude_angle_inverts_the_grp():
    angles = np.array([0.0, 1e-9, 0.3, 60.0, 179.0])
    axis = np.array([0.6, 0.0, 0.8])
    quaternions = [from_rotation_vector(np.deg2rad(angle) * axis) for angle in angles]
    error = np.array([grp.from_quaternion(q) for q in quaternions])
    np.testing.assert_allclose(metrics.attitude_angle_deg(error), angles, rtol=1e-12, atol=1e-15)


def test_final_attitude_error_is_the_rms_angle():
    error, sigma = np.zeros((2, N_STEPS, 12)), np.ones((2, N_STEPS, 12))
    p = grp.from_quaternion(from_rotation_vector(np.array([0.0, np.deg2rad(20.0), 0.0])))
    error[0, -24::2, :3] = p
    used = np.ones((2, N_STEPS), dtype=bool)
    final = evaluate(error, sigma, used, STEP_S).final_attitude_error_deg
    np.testing.assert_allclose(final, [20.0 / np.sqrt(2.0), 0.0], rtol=1e-12)


def test_anees_of_unique_attitudes_is_of_the_steps_after_that_status():
    """By hand: two intervals; the status of the first target changes after the first one."""
    error, sigma = np.zeros((2, N_STEPS, 12)), np.ones((2, N_STEPS, 12))
    error[:, :, 0], error[:, 1:, 1] = 3.0, 6.0
    found = metrics.Evaluation(2, N_STEPS, STEP_S)
    for steps, known in ((slice(0, 1), [False, True]), (slice(1, None), [True, True])):
        found.update(error[:, steps], sigma[:, steps], [True, True], known=known)
    result = found.result()
    np.testing.assert_allclose(result.unique_share, [1.0 / N_STEPS, 1.0])
    later = (3.0 + 15.0 * (N_STEPS - 1)) / N_STEPS
    np.testing.assert_allclose(result.anees_unique, [3.0, later])
    np.testing.assert_allclose(result.anees_unique[1], result.anees[1, :3].mean())


def test_custody_is_of_the_last_state_of_every_target():
    """By hand: position and attitude must be within 10 km and 5 deg at the end, and only then."""

    def state(km, degrees):
        turn = from_rotation_vector(np.deg2rad(degrees) * np.array([0.6, 0.0, 0.8]))
        found = np.zeros(12)
        found[:3] = grp.from_quaternion(turn)
        found[6:9] = km / 384_400.0 * np.array([2.0, -1.0, 2.0]) / 3.0
        return found

    last = [(9.0, 4.0), (11.0, 4.0), (9.0, 6.0), (np.nan, 4.0), (9.0, 4.0)]
    error = np.zeros((5, N_STEPS, 12))
    error[0, :-1], error[:, -1] = state(50.0, 90.0), [state(*each) for each in last]
    used = np.ones((5, N_STEPS), dtype=bool)
    used[4] = False
    found = evaluate(error, np.ones_like(error), used, STEP_S)
    np.testing.assert_array_equal(found.custody, [True, False, False, False, True])
    np.testing.assert_array_equal(found.custody_position, [True, False, True, False, True])
    np.testing.assert_array_equal(found.custody_attitude, [True, True, False, True, True])
    np.testing.assert_array_equal(found.accurate_attitude, found.custody_attitude)
    assert found.status[4] == NEVER_OBSERVED
    wide = metrics.Evaluation(5, N_STEPS, STEP_S, metrics.Custody(12.0, 7.0))
    known = [True, True, True, True, False]
    wide.update(error, np.ones_like(error), used.any(axis=1), known=known)
    np.testing.assert_array_equal(wide.result().custody, [True, True, True, False, False])
    np.testing.assert_array_equal(wide.result().custody_attitude, known)
    assert wide.result().accurate_attitude.all()
    with pytest.raises(ConfigurationError, match="position_km = 0 must be a number above 0"):
        metrics.Custody(position_km=0)


def _histories():
    """A run with a failed estimate, an ended bound and a target never observed."""
    rng = np.random.default_rng(8)
    sigma = rng.uniform(0.5, 2.0, size=(4, N_STEPS, 12))
    error = sigma * rng.standard_normal(sigma.shape)
    bound = 0.7 * sigma
    used = rng.random((4, N_STEPS)) < 0.01
    used[0], used[1, 5], used[2:, 7] = False, True, True
    error[1, 130:], sigma[1, 130:], bound[2, 130:] = np.nan, np.nan, np.nan
    return error, sigma, bound, used


def test_sums_are_those_of_whole_histories():
    """Against plain averages of whole histories."""
    error, sigma, bound, used = _histories()
    found = evaluate(error, sigma, used, STEP_S, bound)
    last = slice(N_STEPS - 24, None)
    both = np.isfinite(error + bound)[:, last]
    squared = [np.where(both, each[:, last] ** 2, 0.0).sum(axis=1) for each in (error, bound)]
    lengths = [each.reshape(4, 4, 3).sum(axis=2) for each in squared]
    ratio = np.where(used.any(axis=1)[:, None], np.sqrt(lengths[0] / lengths[1]), np.nan)
    angle = metrics.attitude_angle_deg(error[:, last])
    least = np.sqrt((bound[:, last, :3] ** 2).sum(axis=2))
    covered = np.abs(error) <= 3.0 * sigma
    for name, wanted in {
        "coverage": covered.mean(axis=1),
        "final_coverage": covered[:, last].mean(axis=1),
        "anees": np.nanmean((error / sigma) ** 2, axis=1),
        "rmse": np.sqrt(np.nanmean(error**2, axis=1)),
        "final_attitude_error_deg": np.sqrt(np.nanmean(angle**2, axis=1)),
        "bound_ratio": ratio,
        "bound_attitude_deg": np.rad2deg(np.sqrt(np.nanmean(least**2, axis=1))),
    }.items():
        np.testing.assert_allclose(getattr(found, name), wanted, rtol=1e-12, err_msg=name)
    rotation = covered[:, last, :6].mean(axis=(1, 2))
    assert found.status_rotation[0] == NEVER_OBSERVED
    np.testing.assert_array_equal(
        found.status_rotation[1:], np.where(rotation[1:] < 0.5, INCONSISTENT, TRACKED)
    )


@pytest.mark.parametrize("lengths", [(144,), (1,) * 144, (7, 60, 77), (140, 4)])
def test_the_lengths_of_the_intervals_do_not_matter(lengths):
    """To the last bit."""
    error, sigma, bound, used = _histories()
    collected = metrics.Evaluation(*error.shape[:2], STEP_S)
    for end, length in zip(np.cumsum(lengths), lengths, strict=True):
        some = slice(end - length, end)
        observed = used[:, some].any(axis=1)
        collected.update(error[:, some], sigma[:, some], observed, bound[:, some])
    whole = evaluate(error, sigma, used, STEP_S, bound)
    for name, values in whole._asdict().items():
        np.testing.assert_array_equal(getattr(collected.result(), name), values, err_msg=name)
