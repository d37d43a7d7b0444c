"""A benchmark of eight objects and six hours: its size, its commands, and states of its truth."""

import numpy as np
from click.testing import CliRunner

from cislunar.benchmark import BenchmarkSize
from cislunar.command.main import cislunar
from cislunar.exchange import Segment

SIZE = BenchmarkSize(
    8, (("Halo_L1_S", 1), ("Halo_L2_N", 1), ("Halo_L3_N", 1), ("Halo_L3_S", 1)), 0.25, 3.0
)


def call(*arguments):
    return CliRunner().invoke(cislunar, ["benchmark", *map(str, arguments)])


def arcs(scenario, truth, which, shift=(0.0,) * 6, covariance=None, rows=None):
    """Segments of objects of the truth at the scoring epochs, shifted; km and km/s."""
    times = scenario.scoring_tdb if rows is None else scenario.scoring_tdb[rows]
    at = [int(np.argmin(np.abs(truth["time"].values - each))) for each in times]
    found = []
    for j in which:
        given = Segment(f"mine {j}", f"mine {j}", "EARTH", times, truth["state"].values[j, at])
        given = given._replace(state=given.state + shift)
        if covariance is not None:
            matrices = np.tile(covariance, (times.size, 1, 1))
            given = given._replace(covariance_tdb_s=times, covariance=matrices)
        found.append(given)
    return found
