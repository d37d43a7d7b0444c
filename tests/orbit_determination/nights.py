"""Simulated detections of objects by three observers in the CR3BP, with false alarms."""

import numpy as np

from cislunar.constants import TIME_UNIT_S
from cislunar.dynamics import propagate
from cislunar.orbit_determination import make_angles

SIGMA = np.pi / 648_000.0
HOUR = 3600.0 / TIME_UNIT_S
OBJECTS = np.array(
    [[1.125424, 0.0, -0.1817, 0.0, -0.225458, 0.0], [1.05, 0.1, 0.0, 0.0, -0.4, 0.02],
     [0.82, 0.0, 0.05, 0.0, 0.15, 0.0], [0.5, 0.8, 0.05, 0.0, 0.0, 0.1]]
)  # fmt: skip
OBSERVERS = np.array(
    [[0.92, 0.0, 0.0, 0.0, 0.501, 0.0], [0.85, 0.1, 0.17, 0.0, 0.26, 0.0],
     [1.15, -0.1, 0.1, 0.0, -0.2, 0.0]]
)  # fmt: skip
LOG_CLUTTER = np.log(1.0 / np.deg2rad(3.0) ** 2)


def night(objects, hours, alarms, seed, visits=(0.0, 10.0)):
    """Detections of objects by all observers, at some hours and some minutes; false alarms
    within three degrees of the objects; and the origins."""
    rng, rows = np.random.default_rng(seed), []
    for hour in hours:
        for number, observer in enumerate(OBSERVERS):
            for visit in visits:
                t = (hour + (visit + 3.0 * number) / 60.0) * HOUR
                here = propagate(observer, [t], method="dop853")[0, :3]
                for origin, state in enumerate(objects):
                    way = propagate(state, [t], method="dop853")[0, :3] - here
                    unit = way / np.linalg.norm(way)
                    rows.append([t, number, origin, *here, *(unit + SIGMA * rng.normal(size=3))])
                    for _ in range(rng.poisson(alarms)):
                        off = unit + np.deg2rad(1.5) * rng.uniform(-1.0, 1.0, 3)
                        rows.append([t, number, -1, *here, *off])
    table = np.array(rows)
    table = table[np.argsort(table[:, 0], kind="stable")]
    angles = make_angles(table[:, 0], table[:, 1].astype(int), table[:, 3:6], table[:, 6:], SIGMA)
    return angles, table[:, 2].astype(int)
