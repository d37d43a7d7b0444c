"""A plain Kalman filter of angles, and the maneuver test along its estimates."""

from itertools import pairwise

import numpy as np

from cislunar.dynamics.bundle import propagate_bundle
from cislunar.dynamics.cr3bp import EARTH_MOON
from cislunar.dynamics.maneuvers import Impulses, propagate_with_impulses
from cislunar.estimation.estimator import Estimates, OrbitEstimates
from cislunar.estimation.initial_sigma import ProcessNoise
from cislunar.estimation.maneuvers import ManeuverTest
from cislunar.observation.records import Measurements, Schedule, rows_of

SIGMA = np.deg2rad(2.0 / 3600.0)
PRIOR = np.diag([1e-5] * 3 + [1e-5] * 3) ** 2
N_STEPS, SPACING = 180, 30
NO_NOISE = ProcessNoise()
EVERY = 6
"""Steps between observations, which two observers make at the same time."""


def angles(scene, state, k, o):
    """Right ascension and declination of a position."""
    x, y, z = scene.observer_axes[k] @ (state[:3] - scene.observer_position[o, k])
    return np.array([np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))])


def by_state(scene, state, k, o):
    """Derivatives of the angles by the state, by central differences."""
    found = np.zeros((2, 6))
    for c in range(3):
        step = np.zeros(6)
        step[c] = 1e-6
        ahead, behind = angles(scene, state + step, k, o), angles(scene, state - step, k, o)
        found[:, c] = (ahead - behind) / 2e-6
    return found


def observed_steps():
    return [k for k in range(1, N_STEPS + 1) if k % EVERY == 0]


OBSERVERS = 1, 2


def schedule_of(n_targets):
    counts = np.zeros((n_targets, N_STEPS), dtype=np.int64)
    counts[:, [k - 1 for k in observed_steps()]] = len(OBSERVERS)
    ends = np.cumsum(counts).reshape(counts.shape)
    offset = np.column_stack([ends[:, :1] - counts[:, :1], ends])
    return Schedule(offset, np.tile(OBSERVERS, n_targets * len(observed_steps())))


def transitions(path, scene):
    """Transition matrices of every step, by central differences."""
    found = []
    for state in path[:-1]:
        moved = [
            propagate_bundle(state + sign * 1e-6 * np.eye(6), scene.step, 1)[:, 1]
            for sign in (1, -1)
        ]
        found.append((moved[0] - moved[1]).T / 2e-6)
    return found


def kalman(scene, start, phi, values, process):
    """An extended Kalman filter: means and covariances after every step, and NIS per row."""
    mean, spread, squared, row = start.copy(), PRIOR.copy(), [], 0
    means, spreads = [], []
    for k in range(1, N_STEPS + 1):
        mean = propagate_bundle(mean[None], scene.step, 1, start=(k - 1) * scene.step)[0, 1]
        spread = phi[k - 1] @ spread @ phi[k - 1].T + process
        if k in observed_steps():
            for o in OBSERVERS:
                h = by_state(scene, mean, k, o)
                s = h @ spread @ h.T + SIGMA**2 * np.eye(2)
                gain = spread @ h.T @ np.linalg.inv(s)
                residual = values[row] - angles(scene, mean, k, o)
                squared.append(residual @ np.linalg.solve(s, residual))
                mean, spread = mean + gain @ residual, spread - gain @ s @ gain.T
                row += 1
        means.append(mean)
        spreads.append(spread)
    return np.array(means), np.array(spreads), np.array(squared)


def estimates_of(means, spreads, n_rows):
    """Estimates of several targets, (target, step, ...)."""
    shape = means.shape[:2]
    empty = np.empty((*shape, 4)), np.empty((*shape, 3))
    return Estimates(*empty, means, np.empty((*shape, 12)), spreads, np.ones(n_rows, dtype=bool))


def measured(scene, truth, rng):
    """Noisy angles of a path."""
    exact = [angles(scene, truth[k], k, o) for k in observed_steps() for o in OBSERVERS]
    return np.array(exact) + SIGMA * rng.standard_normal((len(exact), 2))


def empty_test(scene, n, process_noise=None):
    """The test of n targets."""
    return ManeuverTest(
        scene,
        EARTH_MOON,
        n,
        process_noise=process_noise,
        window_hours=SPACING * 6 / 60,
        spacing_minutes=SPACING,
    )


def advanced(test, start, runs, first, stop):
    """Advance the test over an interval of filters that start at the same mean; returns its
    results, and the target of each row."""
    n = len(runs)
    means, spreads = (np.array([run[i] for run in runs]) for i in (1, 2))
    values = np.concatenate([run[0] for run in runs])
    schedule = schedule_of(n)
    full = np.column_stack([np.full(len(values), 10.0), values])
    variance = np.full((len(values), 3), SIGMA**2)
    whole = Measurements(schedule.offset, schedule.observer, full, variance)
    target, step = rows_of(whole)
    rows = (step >= first) & (step < stop)
    part = whole.where(rows)
    part = part._replace(offset=part.offset[:, first : stop + 1])
    before = (
        np.tile(start, (n, 1)) if first == 0 else means[:, first - 1],
        np.tile(PRIOR, (n, 1, 1)) if first == 0 else spreads[:, first - 1],
    )
    each = estimates_of(means[:, first:stop], spreads[:, first:stop], rows.sum())
    return *test.advance(OrbitEstimates(first, *before), part, each), target[rows]


def monitored(scene, start, runs, process_noise=None, pieces=1):
    """The test after all intervals, and the results of each."""
    test = empty_test(scene, len(runs), process_noise)
    edges = np.linspace(0, N_STEPS, pieces + 1).astype(int)
    found = [advanced(test, start, runs, *span) for span in pairwise(edges)]
    return test, [each[0] for each in found], [(each[2], each[1]) for each in found]


def filtered(problem, orbit, rng, impulse=None, noise=NO_NOISE):
    """Measurements of a random truth, and a filter of them; the impulse is (step, change)."""
    scene, (start, _, phi) = problem.scene, orbit
    error = np.sqrt(np.diag(PRIOR)) * rng.standard_normal(6)
    impulses = Impulses(np.empty(0, dtype=np.int64), np.empty(0), np.empty((0, 3)))
    if impulse is not None:
        when = np.array([impulse[0] * scene.step])
        impulses = Impulses(np.zeros(1, dtype=np.int64), when, impulse[1][None])
    truth = propagate_with_impulses((start + error)[None], scene.step, N_STEPS, impulses)[0]
    values = measured(scene, truth, rng)
    variance, both = noise.covariance(scene.step_s)
    process = np.diag(variance[6:])
    process[np.arange(3), np.arange(3, 6)] = process[np.arange(3, 6), np.arange(3)] = both
    means, spreads, squared = kalman(scene, start, phi, values, process)
    return values, means, spreads, squared
