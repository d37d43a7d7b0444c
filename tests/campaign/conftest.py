"""Fixture of the input data sets of small cells."""

import numpy as np
import pytest
import xarray as xr

from cislunar.constants import TIME_UNIT_S
from cislunar.tasking.demonstration import _ORBITS as ORBITS


def _orbits(rows, dim):
    state = np.zeros((len(rows), 6))
    state[:, 0], state[:, 2], state[:, 4] = rows[:, 0], rows[:, 1], rows[:, 2]
    return xr.Dataset(
        {
            "state": ((dim, "component"), state),
            "period": (dim, rows[:, 3]),
            "family": (dim, [f"Orbit_{k}" for k in range(len(rows))]),
        }
    )


@pytest.fixture(scope="session")
def sources():
    elapsed = np.arange(0.0, 86_401.0, 600.0)
    angle = -elapsed / TIME_UNIT_S + 3.0
    sun = 389.0 * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=-1)
    return {
        "architecture": xr.Dataset(
            {"orbit": ("slot", [2, 3]), "satellites": ("slot", [2, 1])},
        ),
        "orbits": _orbits(ORBITS, "orbit"),
        "tracked": _orbits(ORBITS, "target"),
        "sun": xr.Dataset(
            {"sun_position": (("time", "axis"), sun), "et": ("time", elapsed)},
            attrs={"time_unit_s": TIME_UNIT_S},
        ),
    }
