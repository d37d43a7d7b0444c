import numpy as np
import pytest
from measured import draw_truth, evaluate

from cislunar.errors import ConfigurationError
from cislunar.estimation.estimator import CHOLESKY_FAILURES, UPDATES
from cislunar.estimation.kalman.mukf import MultiplicativeUKF
from cislunar.evaluation.metrics import NEVER_OBSERVED
from cislunar.observation.scene import make_scene
from cislunar.observation.sensor import Sensor
from cislunar.observation.target_surfaces import target_surfaces
from cislunar.photometry.materials import Material
from cislunar.photometry.shapes import icosahedron
from cislunar.tasking import realization
from cislunar.tasking.closed_loop import run_closed_loop
from cislunar.tasking.demonstration import tracking_problem
from cislunar.tasking.histories import HISTORIES
from cislunar.tasking.initial_conditions import (
    epoch_states,
    initial_estimate,
    monitored_targets,
)
from cislunar.tasking.planning.information import TaskingModel
from cislunar.tasking.realization import OUTCOME_NAMES, USED
from cislunar.tasking.settings import LoopSettings

BRIGHT = Sensor(limiting_magnitude=22.0)


def _run(seeds=(0,), n_observers=4, n_targets=5, **settings):
    settings = {"duration_hours": 6.0, "sensor": BRIGHT} | settings
    scene, surfaces, epoch, ids, loop = tracking_problem(n_observers, n_targets, **settings)
    return run_closed_loop(scene, surfaces, epoch, ids, seeds, loop)


@pytest.fixture(scope="module")
def result():
    return _run(seeds=(0, 1), keep_information=True)


def test_shapes_and_ranges(result):
    assert result.assignment.shape == (2, 6, 4)
    assert result.error.shape == result.sigma.shape == (2, 360, 5, 12)
    assert result.error.dtype == np.float32
    assert result.valid.shape == (2, 360, 5)
    assert result.pair_information.shape == (2, 6, 4, 5)
    assert result.metrics.coverage.shape == (2, 5, 12)
    assert result.elapsed_s[0] == 60.0
    assert result.elapsed_s[-1] == 6 * 3600.0
    assert result.outcome.max() < len(OUTCOME_NAMES)
    assert result.counters[..., CHOLESKY_FAILURES].sum() == 0
    np.testing.assert_array_equal(result.counters[..., UPDATES], result.valid.sum(axis=1))
    assert not result.failed.any()


def test_only_assigned_targets_are_measured(result):
    for s in range(2):
        for e in range(6):
            tasked = set(result.assignment[s, e]) - {-1}
            window = result.outcome[s, 60 * e : 60 * (e + 1)]
            assert set(np.flatnonzero((window != 0).any(axis=0))) == tasked
            assert all((window[:, j] != 0).all() for j in tasked)


def test_information_is_that_of_the_assigned_pairs_and_at_least_of_the_best(result):
    for s in range(2):
        for e in range(6):
            pairs = result.pair_information[s, e]
            chosen = result.assignment[s, e]
            busy = np.flatnonzero(chosen >= 0)
            assert result.information[s, e] == pytest.approx(pairs[busy, chosen[busy]].sum())
            assert result.information[s, e] >= pairs.max()


def test_estimates_improve_and_stay_consistent(result):
    """Positions after hundreds of observations with a noise of 3 arcsec."""
    observed = result.metrics.status != NEVER_OBSERVED
    assert observed.sum() >= 6
    position_km = 384_400.0 * np.linalg.norm(result.error[..., 6:9], axis=-1)
    final = np.median(position_km[:, -30:], axis=1)[observed]
    assert np.median(final) < 5.0
    assert result.metrics.coverage[observed][:, 6:].mean() > 0.95
    assert 0.3 < np.nanmedian(result.metrics.anees[observed][:, 6:]) < 2.0


def test_metrics_are_those_of_the_recorded_errors(result):
    error = result.error[0].swapaxes(0, 1).astype(float)
    sigma = result.sigma[0].swapaxes(0, 1).astype(float)
    again = evaluate(error, sigma, result.valid[0].T, 60.0)
    np.testing.assert_allclose(result.metrics.anees[0], again.anees, rtol=1e-4)
    np.testing.assert_allclose(result.metrics.rmse[0], again.rmse, rtol=1e-5)
    np.testing.assert_array_equal(result.metrics.status[0], again.status)


def test_a_rerun_gives_the_same_bytes_and_seeds_are_independent(result):
    again = _run(seeds=(1,))
    assert again.error[0].tobytes() == result.error[1].tobytes()
    assert again.sigma[0].tobytes() == result.sigma[1].tobytes()
    assert again.outcome[0].tobytes() == result.outcome[1].tobytes()
    assert result.error[0].tobytes() != result.error[1].tobytes()


@pytest.mark.parametrize("at_once", [5 * 17, 1])
def test_an_interval_may_be_simulated_in_parts(result, monkeypatch, at_once):
    """Of 17 steps, of which the last in an interval are fewer, and of one step. Only the bound has
    other rounding errors."""
    monkeypatch.setattr(realization, "TARGET_STEPS_AT_ONCE", at_once)
    seen, advance = [], MultiplicativeUKF.advance

    def noted(self, measurements, **given):
        seen.append(given["final"])
        return advance(self, measurements, **given)

    monkeypatch.setattr(MultiplicativeUKF, "advance", noted)
    divided = _run(keep_information=True)
    assert seen == ([False] * (3 if at_once > 1 else 59) + [True]) * 6
    assert divided.histories.keys() == result.histories.keys()
    for name, values in divided.histories.items():
        np.testing.assert_array_equal(values, result.histories[name][:1], name)
    for name, values in divided.metrics._asdict().items():
        tolerance = 1e-12 if name.startswith("bound_") else 0.0
        np.testing.assert_allclose(values, getattr(result.metrics, name)[:1], tolerance, 0.0)
    np.testing.assert_array_equal(divided.counters, result.counters[:1])


def test_targets_above_the_range_of_short_integers_are_named_rightly():
    assert np.iinfo(HISTORIES["assignment"].dtype).max > 1e6


def test_thinning_keeps_the_metrics_and_the_last_state(result):
    thin = _run(seeds=(0,), record_every=50)
    assert thin.elapsed_s[-1] == result.elapsed_s[-1]
    assert thin.error.shape[1] == 8
    steps = np.rint(thin.elapsed_s / 60.0).astype(int) - 1
    np.testing.assert_array_equal(thin.error[0], result.error[0, steps])
    np.testing.assert_array_equal(thin.metrics.anees[0], result.metrics.anees[0])


@pytest.mark.parametrize("method", ["greedy", "random", "tpe"])
def test_other_methods_run_and_gain_less(result, method):
    other = _run(seeds=(0,), method=method, max_evaluations=12, early_stop=12, duration_hours=2.0)
    assert other.information[0, 0] <= result.information[0, 0] + 1e-9
    assert np.all(other.evaluations == (1 if method == "greedy" else 12))


def test_surplus_observers_are_idle():
    crowded = _run(n_observers=6, n_targets=2, duration_hours=1.0)
    assert np.all((crowded.assignment >= 0).sum(axis=-1) <= 2)


def test_full_information_and_process_noise_are_settings():
    model = TaskingModel(states="full", measurements=60)
    changed = _run(tasking=model, duration_hours=1.0)
    assert changed.information[0, 0] > _run(duration_hours=1.0).information[0, 0]


def test_the_last_interval_may_be_short():
    result = _run(duration_hours=2.5, interval_minutes=60.0)
    assert result.assignment.shape[1] == 3
    assert np.all(np.isfinite(result.error))


def test_progress_counts_the_epochs_of_all_seeds():
    calls = []
    scene, surfaces, epoch, ids, loop = tracking_problem(2, 2, duration_hours=2.0)
    run_closed_loop(
        scene, surfaces, epoch, ids, (3, 4), loop, progress=lambda *args: calls.append(args)
    )
    assert calls == [(1, 4), (2, 4), (3, 4), (4, 4)]


def test_cells_have_the_same_truth_of_common_targets():
    scene, _, epoch, _, loop = tracking_problem(2, 5, duration_hours=1.0)
    sigma = loop.initial.components()
    some = np.array([4, 1])
    whole = draw_truth(initial_estimate(epoch, sigma), scene, BRIGHT.noise, 7, np.arange(5))
    part = draw_truth(initial_estimate(epoch[some], sigma), scene, BRIGHT.noise, 7, some)
    for name in whole._fields:
        np.testing.assert_array_equal(getattr(part, name), getattr(whole, name)[some], name)


def test_truth_is_sampled_from_the_initial_distribution():
    scene, _, epoch, _, loop = tracking_problem(1, 1, duration_hours=1.0)
    n = 600
    sigma = loop.initial.components()
    initial = initial_estimate(np.tile(epoch[0], (n, 1)), sigma)
    truth = draw_truth(initial, scene, BRIGHT.noise, 0, np.arange(n))
    error = truth.translation[:, 0] - initial.translation
    np.testing.assert_allclose(error.std(axis=0), sigma[6:], rtol=0.1)
    rates = truth.angular_velocity[:, 0] - initial.angular_velocity
    np.testing.assert_allclose(rates.std(axis=0), sigma[3:6], rtol=0.1)
    np.testing.assert_allclose(truth.noise.std(axis=(0, 1, 2)), BRIGHT.noise, rtol=0.03)
    # small angles: the vector part is half the rotation vector
    np.testing.assert_allclose(2.0 * truth.quaternion[:, 0, :3].std(axis=0), sigma[:3], rtol=0.1)


def test_monitored_sets_grow_by_addition():
    large = monitored_targets(202, 202, seed=1)
    assert sorted(large) == list(range(202))
    for n in (20, 50, 100):
        np.testing.assert_array_equal(monitored_targets(202, n, seed=1), large[:n])
    assert not np.array_equal(large, monitored_targets(202, 202, seed=2))
    for n in (0, 203):
        with pytest.raises(ConfigurationError, match="n_targets"):
            monitored_targets(202, n, seed=1)


@pytest.mark.parametrize(
    "call, name",
    [
        (lambda: monitored_targets(2.5, 1, seed=1), "n_available"),
        (lambda: monitored_targets(2, 1, seed=-1), "seed"),
        (lambda: epoch_states(np.ones((2, 6)), [1.0], seed=1), "period"),
        (lambda: epoch_states(np.ones((2, 6)), [1.0, np.nan], seed=1), "period"),
        (lambda: epoch_states(np.ones(6), [1.0], seed=1), "state"),
        (lambda: epoch_states(np.ones((1, 6)), [1.0], seed=-1), "seed"),
        (lambda: initial_estimate(np.ones(6), np.ones(12)), "translation"),
        (lambda: initial_estimate(np.full((1, 6), np.nan), np.ones(12)), "translation"),
        (lambda: initial_estimate(np.ones((1, 6)), np.ones(6)), "sigma"),
    ],
)
def test_impossible_initial_conditions_are_named(call, name):
    with pytest.raises(ConfigurationError, match=f"^{name}"):
        call()


def test_epoch_states_lie_on_the_orbits():
    """A period later than the start is the start; phases depend on seed and target alone."""
    state = np.array([[0.920026, 0.0, 0.0, 0.0, 0.501040, 0.0]] * 3)
    period = np.full(3, 0.898841)
    states = epoch_states(state, period, seed=4)
    np.testing.assert_array_equal(epoch_states(state[:2], period[:2], seed=4), states[:2])
    radius = np.linalg.norm(states[:, :2] - [0.98785, 0.0], axis=1)
    assert np.all(np.abs(radius - 0.07) < 0.01)
    assert np.ptp(states[:, 1]) > 0.01


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("interval_minutes", 0.75),
        ("interval_minutes", 0.0),
        ("duration_hours", -1.0),
        ("step_s", np.nan),
        ("method", "best"),
        ("record_every", 0),
        ("max_evaluations", 0),
    ],
)
def test_impossible_settings_name_the_key(key, value):
    with pytest.raises(ConfigurationError, match=key):
        LoopSettings(**{key: value})


def test_inconsistent_problems_are_refused():
    scene, surfaces, epoch, ids, loop = tracking_problem(2, 3, duration_hours=1.0)
    with pytest.raises(ConfigurationError, match="seeds"):
        run_closed_loop(scene, surfaces, epoch, ids, [], loop)
    with pytest.raises(ConfigurationError, match="duration_hours"):
        run_closed_loop(scene, surfaces, epoch, ids, [0], LoopSettings(duration_hours=2.0))
    with pytest.raises(ConfigurationError, match="epoch_state"):
        run_closed_loop(scene, surfaces, epoch[:2], ids, [0], loop)
    with pytest.raises(ConfigurationError, match="target_ids"):
        run_closed_loop(scene, surfaces, epoch, np.array([1, 1, 2]), [0], loop)


def _with_nan(values, *index):
    changed = np.array(values, dtype=float)
    changed[index] = np.nan
    return changed


WRONG = {
    "a state that is not finite": (
        lambda p: {"epoch_state": _with_nan(p.epoch, 1, 2)},
        "epoch_state of target 1 is not finite",
    ),
    "an observer that is not finite": (
        lambda p: {
            "scene": p.scene._replace(
                observer_position=_with_nan(p.scene.observer_position, 1, 7, 0)
            )
        },
        "scene.observer_position of observer 1, time 7 is not finite",
    ),
    "states without velocities": (lambda p: {"epoch_state": p.epoch[:, :3]}, r"shape \(3, 3\)"),
    "one seed": (lambda p: {"seeds": 1}, "seeds = 1: give a sequence"),
    "a negative seed": (lambda p: {"seeds": [-1]}, "seeds: each = -1 must be"),
    "settings by key": (lambda p: {"settings": {}}, "settings = {}: give LoopSettings"),
    "a problem": (lambda p: {"scene": p}, "give the Scene that make_scene returns"),
    "a word": (lambda p: {"forces": "cr3bp"}, "forces = 'cr3bp': give a force model"),
    "no function": (lambda p: {"progress": 3}, "progress = 3: give a function"),
    "half an identity": (lambda p: {"target_ids": [0, 0.5, 1]}, "must be whole numbers from 0 on"),
    "no estimator": (lambda p: {"estimator": 3}, "estimator = 3: give a name"),
    "an initial estimate that is not finite": (
        lambda p: {"initial": _estimate(p)._replace(translation=_with_nan(p.epoch, 2))},
        "initial translation of target 2 is not finite",
    ),
    "a quaternion of norm 2": (
        lambda p: {"initial": _estimate(p)._replace(quaternion=np.tile([0, 0, 0, 2.0], (3, 1)))},
        "initial quaternion of target 0 has norm 2; divide it",
    ),
    "standard deviations of an orbit": (
        lambda p: {"initial": _estimate(p)._replace(sigma=np.ones(6))},
        r"initial sigma has shape \(6,\); give \(12,\)",
    ),
}


def _estimate(problem):
    return initial_estimate(problem.epoch, problem.loop.initial.components())


@pytest.mark.parametrize(("changes", "message"), WRONG.values(), ids=WRONG)
def test_a_wrong_argument_is_named_before_the_run(changes, message):
    problem = tracking_problem(2, 3, duration_hours=1.0)
    given = dict(zip(ARGUMENTS, (*problem[:4], [0], problem.loop), strict=True))
    with pytest.raises(ConfigurationError, match=message) as refused:
        run_closed_loop(**given | changes(problem))
    assert "\n" not in str(refused.value)


ARGUMENTS = ("scene", "surfaces", "epoch_state", "target_ids", "seeds", "settings")


def test_initial_quaternions_are_normalized():
    problem = tracking_problem(1, 2, duration_hours=1.0)
    near = np.array([[0.0, 0.0, 0.6, 0.8], [0.0, 0.0, 0.6, 0.8 + 5e-7]])
    found = _estimate(problem)._replace(quaternion=near).checked().quaternion
    np.testing.assert_array_equal(found[0], near[0])
    assert np.linalg.norm(found[1]) == pytest.approx(1.0, abs=1e-15)


def test_a_shortened_interval_is_announced(caplog):
    _run(n_observers=1, n_targets=1, duration_hours=0.3, interval_minutes=15.0)
    (warning,) = (each for each in caplog.messages if "interval_minutes = 15" in each)
    assert "duration_hours = 0.3 is no multiple of" in warning and "\n" not in warning


@pytest.mark.parametrize(
    ("arguments", "settings", "message"),
    [
        ((2, 0), {}, "n_targets = 0 must be a whole number of at least 1"),
        ((-1, 2), {}, "n_observers = -1 must be"),
        ((2.5, 2), {}, "n_observers = 2.5 must be"),
        ((2, 2), {"duration": 3}, "duration is none of the LoopSettings: did you mean 'duration_h"),
        ((2, 2), {"duration_hours": "3"}, "duration_hours = '3' must be a positive number"),
        ((2, 2), {"record_every": 1.5}, "record_every = 1.5 must be a whole number"),
        ((2, 2), {"tasking": {}}, "tasking = {}: give a TaskingModel"),
        ((2, 2), {"histories": "errors"}, "histories = 'errors': give a tuple"),
        ((2, 2, "printed"), {}, "model = 'printed': give a PhotometryModel"),
    ],
)
def test_a_problem_names_its_wrong_argument(arguments, settings, message):
    with pytest.raises(ConfigurationError, match=message):
        tracking_problem(*arguments, **settings)


def test_a_failed_target_does_not_end_the_run():
    """The estimate of a target that hits the Moon ends, and the others continue."""
    scene, surfaces, epoch, ids, loop = tracking_problem(3, 3, duration_hours=6.0, sensor=BRIGHT)
    epoch = epoch.copy()
    epoch[1] = [0.98785, 0.0, 0.03, 0.0, 0.0, -0.8]
    result = run_closed_loop(scene, surfaces, epoch, ids, [0], loop)
    assert result.failed[0].tolist()[1] != 0
    assert result.failed[0, [0, 2]].tolist() == [0, 0]
    assert np.all(np.isnan(result.error[0, -1, 1]))
    assert np.all(np.isfinite(result.error[0, :, [0, 2]]))
    assert not np.any(result.assignment[0, -1] == 1)
    assert result.metrics.coverage[0, 1].max() < 1.0


def test_targets_without_measurements_are_never_observed(caplog):
    """With a limiting magnitude of 5 no target is measured, and none is inconsistent."""
    found = _run(sensor=Sensor(limiting_magnitude=5.0), duration_hours=1.0)
    assert np.all(found.metrics.status == NEVER_OBSERVED)
    assert np.all(found.assignment == -1)
    assert not np.any(found.outcome == USED)
    assert "no target was ever tasked" in caplog.text
    assert "raise Sensor.limiting_magnitude = 5, or" in caplog.text


def test_surfaces_follow_the_targets(caplog):
    """A black target is never detected, though tasking assumes a sphere."""
    scene, _, epoch, ids, loop = tracking_problem(4, 2, duration_hours=2.0, sensor=BRIGHT)
    black = Material(diffuse_weight=0.0, specular_weight=0.0)
    surfaces = target_surfaces(icosahedron(), [black, Material()], 2)
    result = run_closed_loop(scene, surfaces, epoch, ids, [0], loop)
    assert not result.valid[0, :, 0].any()
    assert (result.assignment == 0).any()
    faint, tasked = result.outcome == OUTCOME_NAMES.index("faint"), result.outcome != 0
    assert faint[0, :, 0].any()
    share = 100.0 * faint.sum() / tasked.sum()
    assert f"warning: {share:.1f} % of the observations faint; raise Sensor.lim" in caplog.text


def test_observers_are_needed():
    with pytest.raises(ConfigurationError, match="observer_position has no observers"):
        make_scene(np.empty((0, 5, 3)), np.ones((5, 3)), 60.0)
