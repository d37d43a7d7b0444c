"""Orbits before and after a maneuver, and lost orbits, against quadrature and single exposures."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal
from test_survey import SETTINGS as SURVEY
from test_survey import surveyed

from cislunar.constants import SECONDS_PER_DAY, TIME_UNIT_S
from cislunar.detection import DetectionProcess
from cislunar.dynamics import (
    EARTH_MOON,
    VELOCITY_UNIT_M_S,
    propagate,
    propagate_many,
    propagate_stm,
)
from cislunar.observation import Sensor, sensor_limits
from cislunar.orbit_determination import (
    AdmissibleRegion,
    LinkedOrbits,
    LinkingSettings,
    fit_orbits,
    make_angles,
)
from cislunar.survey import LineageSettings, detection_probability, views
from cislunar.survey.maneuvers import (
    CURRENT,
    LOST,
    SUPERSEDED,
    FieldHistory,
    Watch,
    divided,
    find_lineage,
    maneuvered_orbits,
    maneuvers_within,
    orbit_paths,
    overlapping_pairs,
    replaced,
)
from cislunar.tasking import tracking_problem

PROBLEM = tracking_problem(n_observers=6, n_targets=3, duration_hours=12)
STEP = PROBLEM.scene.step
BEFORE, AFTER, MANEUVER = np.arange(0, 121, 10), np.arange(420, 541, 10), 301.3
WHOLE = np.arange(0, 541, 10)
"""Minutes of the detections, and of the maneuver; of the detections of a single orbit."""

SETTINGS = LineageSettings(maneuvers_per_day=0.3)
SIGMA = np.deg2rad(1.0 / 3600.0)
REGION = AdmissibleRegion()


def moved(state, minutes):
    return propagate(state, np.asarray(minutes) * STEP, method="dop853")


def arcs(change_m_s, n_observers=3, seed=5):
    """Orbits fitted to angles of the first object before and after a change of velocity, of the
    second before and after none, and of the third before alone; with their true states."""
    rng, scene = np.random.default_rng(seed), PROBLEM.scene
    change = np.concatenate([np.zeros(3), np.asarray(change_m_s) / VELOCITY_UNIT_M_S])
    one, two, three = PROBLEM.epoch
    met = moved(one, [MANEUVER])[0] + change
    paths = [
        (BEFORE, moved(one, BEFORE)),
        (BEFORE, moved(two, BEFORE)),
        (BEFORE, moved(three, BEFORE)),
        (AFTER, propagate(met, (AFTER - MANEUVER) * STEP, method="dop853")),
        (AFTER, moved(two, AFTER)),
    ]
    rows = []
    for which, (minutes, states) in enumerate(paths):
        for minute, state in zip(minutes.tolist(), states, strict=True):
            rows += [(minute, which, o, state) for o in range(n_observers)]
    rows.sort(key=lambda row: row[0])
    minute, which, observer, state = (np.array(each) for each in zip(*rows, strict=True))
    here = scene.observer_position[observer, minute]
    unit = state[:, :3] - here
    unit /= np.linalg.norm(unit, axis=1)[:, None]
    unit += SIGMA * rng.standard_normal(unit.shape)
    angles = make_angles(
        minute * STEP, observer, here, unit, SIGMA, magnitude=15.0, sun=scene.sun_position[minute]
    )
    fits = fit_orbits(
        angles, [np.flatnonzero(which == k) for k in range(5)],
        np.array([states[-1] for _, states in paths]),
        np.array([minutes[-1] for minutes, _ in paths]) * STEP, forces=EARTH_MOON,
    )  # fmt: skip
    return angles, fits, np.array([states[-1] for _, states in paths])


def lineage(angles, fits, before=None, after=None, settings=SETTINGS):
    everything = np.ones(fits.epoch.size, dtype=bool)
    paths = orbit_paths(fits, 0.0, AFTER[-1] * STEP, forces=EARTH_MOON)
    return find_lineage(
        fits, angles, everything if before is None else before,
        everything if after is None else after, forces=EARTH_MOON, region=REGION,
        expected_objects=200.0, settings=settings, paths=paths,
    )  # fmt: skip


@pytest.mark.parametrize("change", [(0.3, -0.2, 0.5), (-20.0, 30.0, 5.0), (250.0, 300.0, -200.0)])
def test_a_maneuver_connects_two_orbits_of_one_object(change):
    angles, fits, truth = arcs(change)
    found = lineage(angles, fits, after=np.arange(5) == 3)
    assert (found.before.tolist(), found.after.tolist()) == ([0], [3])
    assert found.probability[0] > 0.999
    assert abs(found.time[0] - MANEUVER * STEP) < 4.0 * found.time_sigma[0]
    error = found.velocity_m_s[0] - change
    assert error @ np.linalg.solve(found.velocity_covariance[0], error) < 20.0
    error = found.state[0] - truth[3]
    assert error @ np.linalg.solve(found.covariance[0], error) < 25.0
    # the orbit before tells where the maneuver was, and so more of the state after it
    share = np.linalg.solve(fits.covariance[3], found.covariance[0])
    assert np.linalg.det(share) < 0.9


def test_the_ratio_of_likelihoods_is_that_of_quadrature_over_impulse_times():
    """Equation (1) by the midpoint rule over impulses every two seconds, each with propagations of
    its own, and the moments of time and change of velocity over them."""
    angles, fits, _ = arcs((-20.0, 30.0, 5.0))
    settings = LineageSettings(maneuvers_per_day=0.3, scales_m_s=(1.0, 40.0))
    found = lineage(angles, fits, np.arange(5) == 0, np.arange(5) == 3, settings)
    width = 2.0 / TIME_UNIT_S
    times = MANEUVER * STEP + width * np.arange(-300, 301)
    assert times[0] > BEFORE[-1] * STEP and times[-1] < AFTER[0] * STEP
    weight, change = [], []
    for t in times:
        z, s = np.zeros(6), np.zeros((6, 6))
        for k, sign in ((0, -1.0), (3, 1.0)):
            state, stm = propagate_stm(fits.state[k], t - fits.epoch[k], start=fits.epoch[k])
            z += sign * state
            s += stm @ fits.covariance[k] @ stm.T
        for scale in settings.scales_m_s:
            prior = np.diag([0.0] * 3 + [(scale / VELOCITY_UNIT_M_S) ** 2] * 3)
            weight.append(0.5 * multivariate_normal.pdf(z, np.zeros(6), s + prior))
            change.append((prior @ np.linalg.solve(s + prior, z))[3:] * VELOCITY_UNIT_M_S)
    weight, change = np.array(weight), np.array(change)
    rate = 0.3 * TIME_UNIT_S / SECONDS_PER_DAY
    expected = np.log(rate * width * weight.sum() / 200.0) - REGION.log_density
    assert found.log_ratio[0] == pytest.approx(expected, abs=0.02)
    share = weight / weight.sum()
    mean = share @ np.repeat(times, 2)
    sigma = np.sqrt(share @ (np.repeat(times, 2) - mean) ** 2)
    assert abs(found.time[0] - mean) < 0.05 * sigma
    assert found.time_sigma[0] == pytest.approx(sigma, rel=0.05)
    spread = np.sqrt(np.diag(found.velocity_covariance[0]))
    assert np.all(np.abs(found.velocity_m_s[0] - share @ change) < 0.05 * spread)


def test_other_objects_are_not_connected():
    """Without the orbit before, the orbit after a maneuver is of a new object."""
    angles, fits, _ = arcs((-20.0, 30.0, 5.0))
    none = lineage(angles, fits, np.array([0, 1, 1, 0, 0], dtype=bool), np.arange(5) == 3)
    assert none.before.size == 0 and none.state.shape == (0, 6)
    assert none.velocity_covariance.shape == (0, 3, 3)


def test_errors_of_time_velocity_and_state_are_those_of_the_covariance():
    squared = []
    for seed in range(20):
        angles, fits, truth = arcs((2.0, -6.0, 4.0), n_observers=2, seed=seed)
        found = lineage(angles, fits, np.arange(5) == 0, np.arange(5) == 3)
        change = found.velocity_m_s[0] - (2.0, -6.0, 4.0)
        state = found.state[0] - truth[3]
        squared.append((
            ((found.time[0] - MANEUVER * STEP) / found.time_sigma[0]) ** 2,
            change @ np.linalg.solve(found.velocity_covariance[0], change) / 3.0,
            state @ np.linalg.solve(found.covariance[0], state) / 6.0,
        ))  # fmt: skip
    # chi squared with 20, 60 and 120 degrees of freedom
    mean = np.mean(squared, axis=0)
    assert np.all(np.abs(mean - 1.0) < 4.0 * np.sqrt(2.0 / np.array([20.0, 60.0, 120.0])))


def linked(fits, confirmed):
    n = fits.epoch.size
    return LinkedOrbits(
        fits, np.full(n, 100.0), ("orbit",) * n, np.zeros(n, int), np.asarray(confirmed),
        (fits.take([]),) * n, {},
    )  # fmt: skip


def watch(orbit, minutes, fits, offset_deg=0.0, observers=range(6)):
    """Exposures of some observers toward an orbit, or next to it, and states of the orbit."""
    scene, sensor = PROBLEM.scene, Sensor(limiting_magnitude=20)
    states = propagate(
        fits.state[orbit], np.asarray(minutes) * STEP - fits.epoch[orbit], method="dop853"
    )
    index, of = np.repeat(minutes, len(observers)), np.tile(list(observers), len(minutes))
    unit = np.repeat(states[:, :3], len(observers), axis=0) - scene.observer_position[of, index]
    unit /= np.linalg.norm(unit, axis=1)[:, None]
    unit += np.deg2rad(offset_deg) * np.cross(unit, [0.0, 0.0, 1.0])
    unit /= np.linalg.norm(unit, axis=1)[:, None]
    fields = FieldHistory(index, of, unit, np.full(index.size, 0.026))
    limits = sensor_limits(sensor, scene.observer_position.shape[0])
    return Watch(fields, scene, limits, 0.4, DetectionProcess().detection_loss, 1200.0), states


def test_an_orbit_that_fields_miss_is_lost_and_one_that_they_do_not_cover_is_not():
    angles, fits, _ = arcs((-20.0, 30.0, 5.0))
    fits, sure = fits.take([0, 1, 2]), [True, True, True]
    given = {"forces": EARTH_MOON, "region": REGION, "linking": LinkingSettings()}
    minutes, often = np.arange(200, 600, 25), LineageSettings(maneuvers_per_day=1)
    seen, track = watch(0, minutes, fits)
    found = maneuvered_orbits(linked(fits, sure), angles, settings=often, watch=seen, **given)
    assert found.status == (LOST, CURRENT, CURRENT)
    assert found.orbits.confirmed.tolist() == [False, True, True]
    aside, _ = watch(0, minutes, fits, offset_deg=4.0)
    # toward a single observer, of the two that have a clear view, the body may be dark
    single, _ = watch(0, minutes, fits, observers=[0])
    for other in (aside, single, None):
        same = maneuvered_orbits(linked(fits, sure), angles, settings=often, watch=other, **given)
        assert same.status == (CURRENT,) * 3 and same.orbits.confirmed.all()
    # an object behind the Moon, as seen from the Sun, cannot be detected
    shadow = seen.scene.primaries.copy()
    way = seen.scene.sun_position[minutes] - track[:, :3]
    shadow[minutes, 1] = track[:, :3] + 0.5 * way / np.linalg.norm(way, axis=1)[:, None]
    hidden = seen._replace(scene=seen.scene._replace(primaries=shadow))
    same = maneuvered_orbits(linked(fits, sure), angles, settings=often, watch=hidden, **given)
    assert same.status == (CURRENT,) * 3
    # an object that is too faint would not have been detected either
    faint = angles._replace(magnitude=angles.magnitude + 8.0)
    dark = maneuvered_orbits(linked(fits, sure), faint, settings=often, watch=seen, **given)
    assert dark.status == (CURRENT,) * 3


def test_the_probability_of_no_detection_is_that_of_single_exposures():
    from cislunar.orbit_determination import implied_size
    from cislunar.survey.maneuvers import log_missed

    angles, fits, _ = arcs((-20.0, 30.0, 5.0))
    minutes = np.array([140, 155, 165, 200, 260])
    seen, states = watch(0, minutes, fits, observers=[0, 1])
    paths = orbit_paths(fits, BEFORE[-1] * STEP, minutes[-1] * STEP, forces=EARTH_MOON)
    missed = log_missed(fits, angles, np.array([0]), paths, **seen._asdict())
    own = slice(fits.begin[0], fits.begin[1])
    size = implied_size(fits.position[own], angles.rows(fits.row[own]))[0]
    sigma, offsets = np.sqrt(seen.limits.noise_variance[0, 0]), np.linspace(-3.2, 3.2, 4001)
    each = np.ones_like(offsets)
    for o in (0, 1):
        missed_at = []
        for k, state in zip(minutes.tolist(), states, strict=True):
            margin = views(seen.scene, seen.limits, k, state[None, :3]).margin[o] - offsets
            missed_at.append(1.0 - 0.9 * detection_probability(margin, size, sigma, seen.loss))
        # blocks of 20 minutes: 140 and 155, 165, 200, 260
        blocks = np.prod([np.minimum(*missed_at[:2]), *missed_at[2:]], axis=0)
        each *= 0.05 + 0.95 * blocks
    density = np.exp(-0.5 * (offsets / 0.4) ** 2) / (0.4 * np.sqrt(2.0 * np.pi))
    expected = np.log(np.sum(density * each) * (offsets[1] - offsets[0]))
    assert missed[0] == pytest.approx(expected, abs=0.05)
    assert missed[0] < -2.0


def test_the_orbit_after_a_maneuver_replaces_the_one_before():
    """A candidate after the maneuver is confirmed, with its state from both orbits."""
    angles, fits, _ = arcs((-20.0, 30.0, 5.0))
    given = {"forces": EARTH_MOON, "region": REGION, "linking": LinkingSettings()}
    sure = [True, True, True, False, True]
    orbits, status, found = maneuvered_orbits(
        linked(fits, sure), angles, settings=SETTINGS, **given
    )
    assert status[0] == SUPERSEDED and status[3] == CURRENT
    assert not orbits.confirmed[0] and orbits.confirmed[3]
    pair = found.after.tolist().index(3)
    np.testing.assert_array_equal(orbits.fits.state[3], found.state[pair])
    root = orbits.fits.root[3]
    np.testing.assert_allclose(root.T @ root, found.covariance[pair], rtol=1e-9)
    np.testing.assert_array_equal(orbits.fits.state[2], fits.state[2])
    # a candidate whose predecessor is not confirmed stays one
    orbits, status, found = maneuvered_orbits(
        linked(fits, [False, True, True, False, True]), angles, settings=SETTINGS, **given
    )
    assert not orbits.confirmed[3] and status[0] == CURRENT


def test_the_detections_of_overlapping_orbits_are_divided_at_the_maneuver():
    """The orbit after a small maneuver has taken the last detections from before it."""
    angles, fits, _ = arcs((0.2, -0.4, 0.1))
    before, after = fits.row[fits.begin[0] : fits.begin[1]], fits.row[fits.begin[3] :]
    after = after[: fits.begin[4] - fits.begin[3]]
    moved_rows = before[-3:]
    mixed = fit_orbits(
        angles, [before[:-3], np.union1d(moved_rows, after)], fits.state[[0, 3]],
        fits.epoch[[0, 3]], forces=EARTH_MOON,
    )  # fmt: skip
    both = replaced(fits, (0, 3), mixed)
    paths = orbit_paths(both, 0.0, AFTER[-1] * STEP, forces=EARTH_MOON)
    assert (0, 3) in overlapping_pairs(both, angles, paths, 300.0)

    def fit(rows, state, epoch):
        return fit_orbits(angles, rows, state, epoch, forces=EARTH_MOON)

    parts = divided(both, angles, (0, 3), 1e-4, fit)
    assert parts.chi_squared.sum() <= mixed.chi_squared.sum()
    # no detection from after the maneuver is before it; the few from before may be on either side
    assert angles.time[parts.row[: parts.begin[1]]].max() <= BEFORE[-1] * STEP
    # by brute force over all divisions of the rows next to the ends
    rows, totals = np.union1d(before, after), {}
    for k in range(before.size - 6, before.size + 7):
        one = fit([rows[:k], rows[k:]], fits.state[[0, 3]], fits.epoch[[0, 3]])
        if angles.time[rows[k]] > angles.time[rows[k - 1]]:
            totals[k] = one.chi_squared.sum()
    assert parts.chi_squared.sum() <= min(totals.values()) * (1.0 + 1e-6)


def test_nothing_changes_for_objects_that_do_not_maneuver():
    """A survey with and without assumed maneuvers."""
    off = surveyed()
    on = surveyed(settings=SURVEY.model_copy(update={"lineage": SETTINGS}))
    assert on.states.equals(off.states) and on.orbits.equals(off.orbits)
    assert off.states["confirmed"].iloc[-1] >= 3


def whole_arc(change_m_s, seed, maneuver=MANEUVER, minutes=WHOLE):
    """Orbit fitted to the angles of the first object from before and after a change of velocity."""
    rng, scene = np.random.default_rng(seed), PROBLEM.scene
    change = np.concatenate([np.zeros(3), np.asarray(change_m_s) / VELOCITY_UNIT_M_S])
    met = moved(PROBLEM.epoch[0], [maneuver])[0] + change
    early = minutes < maneuver
    states = np.concatenate([
        moved(PROBLEM.epoch[0], minutes[early]),
        propagate(met, (minutes[~early] - maneuver) * STEP, method="dop853"),
    ])  # fmt: skip
    minute, observer = (each.ravel() for each in np.meshgrid(minutes, range(3), indexing="ij"))
    here = scene.observer_position[observer, minute]
    unit = np.repeat(states[:, :3], 3, axis=0) - here
    unit /= np.linalg.norm(unit, axis=1)[:, None]
    unit += SIGMA * rng.standard_normal(unit.shape)
    angles = make_angles(minute * STEP, observer, here, unit, SIGMA)
    rows = [np.arange(minute.size)]
    fits = fit_orbits(angles, rows, states[-1:], minutes[-1] * STEP, forces=EARTH_MOON)
    return angles, fits, states[-1]


def within(angles, fits, settings=SETTINGS):
    return maneuvers_within(fits, angles, forces=EARTH_MOON, settings=settings)


def test_an_orbit_whose_detections_hide_a_maneuver_has_the_state_after_it():
    """Against single fits, which are biased by far more than their covariance."""
    settings = LineageSettings(maneuvers_per_day=1.5, scales_m_s=(0.3,))
    rng, squared, given = np.random.default_rng(8), [], []
    for seed in range(40):
        moves = seed % 2 == 0
        change, minute = 0.3 * moves * rng.standard_normal(3), rng.uniform(60.0, 480.0)
        angles, fits, truth = whole_arc(change, seed, minute)
        orbits, found = within(angles, fits, settings)
        if not found.before.size:
            continue
        assert moves
        np.testing.assert_array_equal(found.before, found.after)
        for one, out in ((orbits, squared), (fits, given)):
            error = one.state[0] - truth
            out.append(error @ np.linalg.solve(one.covariance[0], error) / 6.0)
        assert abs(found.time[0] - minute * STEP) < 5.0 * found.time_sigma[0]
        off = found.velocity_m_s[0] - change
        assert off @ np.linalg.solve(found.velocity_covariance[0], off) < 25.0
    assert 0.5 < np.mean(squared) < 1.6 and np.mean(given) > 20.0 and len(squared) >= 12


def test_the_ratio_for_a_maneuver_within_an_orbit_is_that_of_normal_distributions():
    """Densities of the residuals with derivatives by differences, and a wide prior of the state."""
    angles, fits, _ = whole_arc((2.0, -1.0, 3.0), 3, 100.3, np.arange(0, 181, 20))
    settings = SETTINGS.model_copy(update={"scales_m_s": (0.5,), "least_probability": 0.5 + 1e-9})
    _, found = within(angles, fits, settings)
    state, epoch = fits.state[0], float(fits.epoch[0])

    def offsets(start, impulse=None):
        """Standardized offsets of predicted directions; the impulse (time, velocity) undone before
        its time."""
        paths = propagate_many(start[None], angles.time - epoch, method="dop853")[0]
        if impulse is not None:
            met = propagate(start, [impulse[0] - epoch], method="dop853")[0]
            met = met - np.concatenate([np.zeros(3), impulse[1]])
            early = angles.time < impulse[0]
            since = angles.time[early] - impulse[0]
            paths[early] = propagate_many(met[None], since, method="dop853")[0]
        way = paths[:, :3] - angles.observer_position
        along = np.sum(way * angles.direction, axis=1)[:, None]
        return (np.einsum("nac,nc->na", angles.basis, way) / along / SIGMA).ravel()

    base = offsets(state)
    by_state = np.array([
        (offsets(state + h) - offsets(state - h)) / 2e-7 for h in 1e-7 * np.eye(6)
    ]).T  # fmt: skip
    wide = by_state @ np.diag([1e-3] * 3 + [1e-2] * 3) ** 2 @ by_state.T + np.eye(base.size)
    none = multivariate_normal(cov=wide).logpdf(-base)
    span = angles.time[-1] - angles.time[0]
    count = int(np.ceil(span * TIME_UNIT_S / 60.0))
    logs = []
    for time in angles.time[0] + span * (np.arange(count) + 0.5) / count:
        ends = [
            [offsets(state, (time, side * h)) for side in (1.0, -1.0)] for h in 1e-6 * np.eye(3)
        ]
        by_velocity = np.array([(one - other) / 2e-6 for one, other in ends]).T
        more = (0.5 / VELOCITY_UNIT_M_S) ** 2 * by_velocity @ by_velocity.T
        logs.append(multivariate_normal(cov=wide + more).logpdf(-base) - none)
    rate = SETTINGS.maneuvers_per_day * TIME_UNIT_S / SECONDS_PER_DAY
    expected = np.log(rate * span * np.mean(np.exp(logs)))
    assert found.log_ratio[0] == pytest.approx(expected, abs=0.05)
