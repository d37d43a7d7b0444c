"""Fields against random directions, views against plain photometry, plans against brute force."""

import warnings
from itertools import pairwise

import numpy as np
import pytest

from cislunar.detection import boresight_vectors, tangent_offset
from cislunar.errors import ConfigurationError
from cislunar.observation import METERS, Sensor, sensor_limits, unit_vectors
from cislunar.photometry import phase_angle, sphere_magnitude
from cislunar.survey import (
    FieldGrid,
    Predictions,
    SearchPlanner,
    SearchSettings,
    detection_probability,
    views,
)
from cislunar.tasking import tracking_problem

SCENE = tracking_problem(n_observers=3, n_targets=1, duration_hours=4).scene
LIMITS = sensor_limits(Sensor(), 3)
NONE = Predictions(
    np.empty((0, 6)), np.empty((0, 6, 6)), np.empty(0), np.empty(0, dtype=int), np.empty((0, 6, 6))
)
NO_FIELDS, NO_CHANCE = np.empty((3, 0, 2), dtype=int), np.empty((3, 0, 2))


def orbit_at(place, covariance, detections=0):
    """One certain orbit at a place."""
    whole = np.zeros((1, 6, 6))
    whole[0, :3, :3] = covariance
    state, count = np.append(place, np.zeros(3))[None], np.array([detections])
    return Predictions(state, whole, np.ones(1), count, whole)


def planned(planner, weight, fields, chance, known=NONE, own=(NO_FIELDS, NO_CHANCE)):
    return planner.plan(10, weight, fields, chance, known, *own)[0]


@pytest.mark.parametrize("width", [0.7, 3.0, 10.0])
def test_every_direction_lies_in_the_field_of_view_of_its_field(width):
    grid, rng = FieldGrid(width), np.random.default_rng(1)
    n = 20_000
    ra, dec = rng.uniform(-np.pi, np.pi, n), np.arcsin(rng.uniform(-1.0, 1.0, n))
    dec[:3] = 0.5 * np.pi, -0.5 * np.pi, 0.5 * np.pi - 1e-6
    field = grid.field_of(ra, dec)
    edge = np.tan(np.deg2rad(0.5 * width))
    offset = [tangent_offset(*each) for each in zip(ra, dec, *grid.center[field].T, strict=True)]
    assert np.abs(offset).max() <= edge
    np.testing.assert_array_equal(grid.field_of(*grid.center.T), np.arange(len(grid.center)))
    # no more than necessary
    assert len(grid.center) < 1.35 * 41_253.0 / width**2 + 20


def test_shadows_dim_views():
    """On a line behind the Moon: the umbra, the annular shadow, and beside both."""
    k, moon = 7, SCENE.primaries[7, 1]
    away = moon - SCENE.sun_position[k]
    away /= np.linalg.norm(away)
    side = np.cross(away, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side)
    radius = 1737.4 / METERS * 1e3
    # the umbra is 3.7e5 km long
    position = moon + radius * np.array([30.0, 60.0, 400.0, 30.0])[:, None] * away
    position[3] += 5.0 * radius * side
    plain = views(SCENE, LIMITS, k, position).margin
    seen = views(SCENE, LIMITS, k, position, eclipse=True).margin
    free = np.isfinite(plain)
    assert free.sum() >= 4 and not np.isfinite(seen[:, :2]).any()
    np.testing.assert_array_equal(seen[:, 3], plain[:, 3])
    # discs of Moon and Sun, with the Moon within the Sun
    sun = np.linalg.norm(SCENE.sun_position[k] - position[2])
    share = 1.0 - (radius / np.linalg.norm(moon - position[2]) / (695_700e3 / METERS / sun)) ** 2
    dimmed = plain[free[:, 2], 2] - seen[free[:, 2], 2]
    np.testing.assert_allclose(dimmed, -2.5 * np.log10(share), rtol=2e-3)


def test_views_are_those_of_plain_photometry():
    rng, k = np.random.default_rng(2), 7
    position = rng.uniform(-1.2, 1.2, (400, 3))
    seen = views(SCENE, LIMITS, k, position)
    sun = SCENE.sun_position[k]
    for o in range(3):
        way = position - SCENE.observer_position[o, k]
        length = np.linalg.norm(way, axis=1)
        magnitude = sphere_magnitude(length * METERS, phase_angle(way, position - sun))
        free = np.ones(400, dtype=bool)
        for center, least in zip([sun, *SCENE.primaries[k][::-1]], [35, 5, 15], strict=True):
            toward = center - SCENE.observer_position[o, k]
            cosine = way @ toward / length / np.linalg.norm(toward)
            free &= cosine < np.cos(np.deg2rad(least))
        margin = seen.margin[o]
        assert not np.isfinite(margin[~free]).any()
        np.testing.assert_allclose(margin[free], 18.0 - magnitude[free], atol=1e-9)
        unit = np.einsum("ij,nj->ni", SCENE.frame_axes[k], way / length[:, None])
        np.testing.assert_allclose(unit_vectors(seen.ra[o], seen.dec[o]), unit, atol=1e-12)


def test_the_probability_of_detection_is_the_share_of_noisy_magnitudes():
    rng = np.random.default_rng(3)
    chance = detection_probability([[0.3, -np.inf]], [0.5, 0.5], 0.4, 0.02)
    noisy = 18.0 - 0.3 - 2.5 * np.log10(0.5) + 0.4 * rng.standard_normal(100_000)
    kept = (noisy <= 18.0) & (rng.random(100_000) >= 0.02)
    assert chance[0, 0] == pytest.approx(kept.mean(), abs=0.01)
    assert chance[0, 1] == 0.0


def test_without_noise_a_detection_is_certain_or_impossible():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        chance = detection_probability([[0.3, 0.0, -0.3, -np.inf]], np.ones(4), [[0, 0, 0, 0]], 0.2)
    assert chance.tolist() == [[0.8, 0.4, 0.0, 0.0]]
    assert np.isnan(detection_probability([[0.3]], [1.0], np.nan, 0.2)).all()


def test_a_plan_takes_the_best_fields_and_leaves_what_is_left_to_others():
    planner = SearchPlanner(SearchSettings(block_minutes=2, slew_rate_deg_s=20), SCENE, LIMITS)
    fields = np.tile([5, 900, 900, 1800], (3, 1))
    chance, weight = np.full((3, 4), 0.8), np.array([1.0, 0.7, 0.7, 0.3])
    # 1.4 > 1.0; then 1.0 > 0.6 * 1.4 = 0.84 > 0.6. Another observer begins the next block
    for order in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        plan = planned(planner, weight, fields, chance)
        assert plan.step.tolist() == [0, 0, 0, 1, 1, 1]
        chosen = [plan.field[plan.observer == o].tolist() for o in order]
        assert chosen == [[900, 900], [5, 5], [900, 900]]
    # several fields in a round, with a fast telescope
    settings = SearchSettings(block_minutes=4, slew_rate_deg_s=20)
    plan = planned(SearchPlanner(settings, SCENE, LIMITS), weight, fields, chance)
    chosen = [set(plan.field[plan.observer == o].tolist()) for o in range(3)]
    # after both: 0.84 and 0.6; after these: 0.504 and 0.36, still more than 0.3
    assert chosen == [{5, 900}] * 3


def test_visits_leave_time_to_turn_and_settle():
    settings = SearchSettings(slew_rate_deg_s=0.4, settle_s=20, exposure_s=30)
    planner = SearchPlanner(settings, SCENE, LIMITS)
    rng = np.random.default_rng(4)
    n = 300
    ra, dec = rng.uniform(0.0, 2.0 * np.pi, (3, n)), rng.uniform(-1.0, 1.0, (3, n))
    fields = np.array([g.field_of(a, d) for g, a, d in zip(planner.grids, ra, dec, strict=True)])
    before = [None] * 3
    for block in range(3):
        plan = planned(planner, rng.random(n), fields, np.full((3, n), 0.9))
        assert plan.step.size and plan.step.max() < 20
        for o in range(3):
            own = np.flatnonzero(plan.observer == o)
            steps = plan.step[own] + 20 * block
            names = plan.field[own]
            assert names.size % 2 == 0 and 0 < names.size < 20
            half = names.size // 2
            np.testing.assert_array_equal(names[:half], names[half:])
            np.testing.assert_array_equal(np.diff(steps.reshape(2, half), axis=0), 10)
            visits = list(zip(steps.tolist(), names.tolist(), strict=True))
            if before[o] is not None:
                visits = [before[o], *visits]
            for (t1, one), (t2, other) in pairwise(visits):
                ways = planner.grids[o].direction[[one, other]]
                angle = np.rad2deg(np.arccos(np.clip(ways[0] @ ways[1], -1.0, 1.0)))
                needed = 30.0 + (angle / 0.4 + 20.0 if one != other else 0.0)
                assert 60.0 * (t2 - t1) >= needed - 1e-6
            before[o] = visits[-1]


def test_orbits_with_few_magnitudes_are_worth_more_than_those_with_many():
    """Equation (3), and its sum with the rest in a plan: an orbit that is known exactly attracts
    the telescopes by its light curve alone."""
    settings = SearchSettings(
        block_minutes=2, slew_rate_deg_s=20, information_worth=0, characterization_worth=1
    )
    planner = SearchPlanner(settings, SCENE, LIMITS, 0.4)
    ratio = 0.4**2 / LIMITS.noise_variance[1, 0]
    worth = planner._brightness_worth(1, np.array([0, 2, 400]))
    assert ratio > 6.0
    np.testing.assert_allclose(worth, 0.5 * np.log([7.0, 4.0, 1.0 + 6.0 / 400.0]))
    place = np.array([[0.2, 0.9, 0.1]])
    own = planner.fields_of(views(SCENE, LIMITS, 10, place))[:, :, None].repeat(2, axis=2)
    chance = np.ones((3, 1, 2))
    # a field elsewhere is worth 0.16
    weight, fields = np.array([0.2, 0.2]), np.array([[7, 8]] * 3)
    for count, followed in ((10, True), (400, False)):
        planner = SearchPlanner(settings, SCENE, LIMITS, 0.4)
        one = orbit_at(place[0], np.zeros((3, 3)), count)
        plan = planned(planner, weight, fields, np.full((3, 2), 0.8), one, (own, chance))
        assert (own[0, 0, 0] in plan.field[plan.observer == 0]) == followed
    without = SearchPlanner(
        settings.model_copy(update={"characterization_worth": 0}), SCENE, LIMITS
    )
    plan = planned(without, weight, fields, np.full((3, 2), 0.8), one, (own, chance))
    assert np.isin(plan.field, [7, 8]).all()


def test_exposures_point_at_the_centers_of_fields():
    planner = SearchPlanner(SearchSettings(), SCENE, LIMITS)
    fields = np.tile([40, 2000, 3100], (3, 1))
    plan = planned(planner, np.ones(3), fields, np.full((3, 3), 0.5))
    given = planner.exposures(plan, 21)
    toward = boresight_vectors(given, SCENE, 21)
    for row, (step, o, field) in enumerate(zip(*plan, strict=True)):
        axes = SCENE.frame_axes[21 + step]
        np.testing.assert_allclose(axes @ toward[row], planner.grids[o].direction[field], atol=1e-9)


def test_a_second_observer_is_worth_more_than_the_same_again():
    """An orbit whose range is open along the line of sight of one observer: the information of
    equation (2), by the determinant of the updated covariance, and the plan."""
    settings = SearchSettings(information_worth=0.05)
    planner = SearchPlanner(settings, SCENE, LIMITS)
    index, place = 10, np.array([0.2, 0.9, 0.1])
    line = place - SCENE.observer_position[0, index]
    line /= np.linalg.norm(line)
    covariance = 1e-10 * np.eye(3) + 1e-3 * np.outer(line, line)
    known = orbit_at(place, covariance)
    gains = [planner._information(o, index, place[None], covariance[None])[0] for o in range(3)]
    for o in range(3):
        updated = planner._measured(o, index, place[None], covariance[None])[0]
        ratio = np.linalg.slogdet(covariance)[1] - np.linalg.slogdet(updated)[1]
        assert gains[o] == pytest.approx(0.05 * 0.5 * ratio, rel=1e-6)
    assert gains[1] > gains[0] + 0.1 and gains[2] > gains[0] + 0.1
    seen = views(SCENE, LIMITS, index, place[None])
    own = planner.fields_of(seen)[:, :, None].repeat(2, axis=2), np.ones((3, 1, 2))
    # what a search finds elsewhere is worth 0.16: more than the same observer again, less than
    # another one
    weight, fields = np.array([0.2, 0.2]), np.array([[7, 8]] * 3)
    assert not np.isin(own[0], fields).any()
    settings = SearchSettings(block_minutes=2, slew_rate_deg_s=20, information_worth=0.05)
    planner = SearchPlanner(settings, SCENE, LIMITS)
    plan = planned(planner, weight, fields, np.full((3, 2), 0.8), known, own)
    follows = [own[0][o, 0, 0] in plan.field[plan.observer == o] for o in range(3)]
    assert follows == [False, True, False]
    without = SearchPlanner(
        SearchSettings(block_minutes=2, slew_rate_deg_s=20, information_worth=0), SCENE, LIMITS
    )
    plan = planned(without, weight, fields, np.full((3, 2), 0.8), known, own)
    assert np.isin(plan.field, [7, 8]).all()
    # at 10 steps of a minute, after the search
    settings = settings.model_copy(update={"search_days": 9.9 / 1440.0})
    for strategy in ("density", "uniform-sweep", "fixed-staring"):
        settings = settings.model_copy(update={"strategy": strategy})
        planner = SearchPlanner(settings, SCENE, LIMITS)
        plan = planned(planner, weight, fields, np.full((3, 2), 0.8), known, own)
        assert plan.field.tolist() == own[0][plan.observer, 0, 0].tolist() and plan.field.size == 6


def test_planned_measurements_are_not_planned_again():
    """The covariance that a plan returns is that of the whole state after all planned measurements,
    by Kalman updates; a plan that begins with it looks elsewhere."""
    rng, index, place = np.random.default_rng(2), 10, np.array([0.2, 0.9, 0.1])
    root = 0.03 * rng.standard_normal((6, 6))
    whole = (root @ root.T)[None]
    known = orbit_at(place, np.eye(3))._replace(covariance=whole, planned=whole)
    seen = views(SCENE, LIMITS, index, place[None])
    own = (
        SearchPlanner(SearchSettings(), SCENE, LIMITS).fields_of(seen)[:, :, None],
        np.ones((3, 1, 1)),
    )
    weight, fields = np.array([0.5, 0.5]), np.array([[7, 8]] * 3)
    given = weight, fields, np.full((3, 2), 0.8)
    settings = SearchSettings(block_minutes=2, slew_rate_deg_s=20, information_worth=0.05)
    planner = SearchPlanner(settings, SCENE, LIMITS)
    plan, planned_covariance = planner.plan(index, *given, known, *own)
    expected = whole[0]
    for o in np.flatnonzero([own[0][o, 0, 0] in plan.field[plan.observer == o] for o in range(3)]):
        h, noise = planner._tangents(o, index, place[None])
        h = np.concatenate([h[0], np.zeros((2, 3))], axis=1)
        gain = expected @ h.T @ np.linalg.inv(h @ expected @ h.T + noise[0] * np.eye(2))
        expected = expected - gain @ h @ expected
    assert np.trace(expected) < 0.5 * np.trace(whole[0])
    np.testing.assert_allclose(planned_covariance[0], expected, rtol=1e-6, atol=1e-12)
    planner = SearchPlanner(settings, SCENE, LIMITS)
    plan, _ = planner.plan(index, *given, known._replace(planned=planned_covariance), *own)
    assert np.isin(plan.field, [7, 8]).all()


def test_baselines_sweep_the_clear_sky_and_stare_at_the_libration_points():
    nothing = np.empty(0), np.empty((3, 0), dtype=int), np.empty((3, 0))
    planner = SearchPlanner(SearchSettings(strategy="uniform-sweep"), SCENE, LIMITS)
    plans = [planned(planner, *nothing) for _ in range(4)]
    sun = SCENE.sun_position[10]
    for o in range(3):
        seen = [each.field[each.observer == o] for each in plans]
        assert all(each.size == 20 for each in seen)
        first = np.concatenate([each[:10] for each in seen])
        assert np.unique(first).size == 40
        toward = SCENE.frame_axes[10] @ (sun - SCENE.observer_position[o, 10])
        cosine = planner.grids[o].direction[first] @ toward / np.linalg.norm(toward)
        assert cosine.max() < np.cos(np.deg2rad(35.0))
    planner = SearchPlanner(SearchSettings(strategy="fixed-staring"), SCENE, LIMITS)
    plan = planned(planner, *nothing)
    l1 = np.array([0.8369, 0.0, 0.0]) - SCENE.observer_position[0, 10]
    l2 = np.array([1.1557, 0.0, 0.0]) - SCENE.observer_position[0, 10]
    ways = [SCENE.frame_axes[10] @ each for each in (l1, l2)]
    near = [planner.grids[0].field_of(np.arctan2(y, x), np.arctan2(z, np.hypot(x, y)))
            for x, y, z in ways]  # fmt: skip
    assert set(plan.field[plan.observer == 0].tolist()) <= {int(each) for each in near}
    assert plan.field.size


def test_bad_settings_are_refused():
    for settings, words in (
        (SearchSettings(block_minutes=1), "give at least one step"),
        (SearchSettings(block_minutes=3), "turn by 180 deg"),
        (SearchSettings(block_minutes=1.5), "must be a multiple"),
    ):
        with pytest.raises(ConfigurationError, match=words):
            SearchPlanner(settings, SCENE, LIMITS)
    with pytest.raises(ConfigurationError, match="below 60"):
        FieldGrid(60.0)


def test_views_of_an_unknown_time_or_of_other_observers_are_refused():
    here = SCENE.observer_position[0, :1] + 0.1
    for wrong, words in (({"index": 10**6}, "index"), ({"position": here[:, :2]}, "position"),
                         ({"limits": sensor_limits(Sensor(), 50)}, "limits of 50")):  # fmt: skip
        with pytest.raises(ConfigurationError, match=words):
            views(**({"scene": SCENE, "limits": LIMITS, "index": 1, "position": here} | wrong))
