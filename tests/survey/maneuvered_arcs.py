"""Orbits fitted to simulated detections before and after a maneuver."""

import numpy as np

from cislunar.dynamics import EARTH_MOON, VELOCITY_UNIT_M_S, propagate
from cislunar.orbit_determination import AdmissibleRegion, LinkedOrbits, fit_orbits, make_angles
from cislunar.survey import LineageSettings
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


def linked(fits, confirmed):
    n = fits.epoch.size
    return LinkedOrbits(
        fits, np.full(n, 100.0), ("orbit",) * n, np.zeros(n, int), np.asarray(confirmed),
        (fits.take([]),) * n, {},
    )  # fmt: skip
