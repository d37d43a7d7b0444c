"""Stand-ins for the data sets of tracking cells, for the tests of their figures."""

import numpy as np
import xarray as xr

from cislunar.campaign.settings.cells import Cell
from cislunar.evaluation.metrics import (
    INCONSISTENT,
    NEVER_OBSERVED,
    TRACKED,
)

SEEDS, STEPS, RECORDS = 5, 24, 12
SIZES = np.repeat([0.1, 1e-5, 1e-5, 1e-4], 3)
"""Typical error of each component."""


def cell_data(targets, seed=0):
    """A stand-in for a tracking cell: target 0 never observed, target 1 with lost rotation."""
    rng = np.random.default_rng([seed, targets])
    dims, status = ("seed", "target", "component"), ("seed", "target")
    shape = (SEEDS, targets)
    time = (SEEDS, RECORDS, targets, 12)
    sigma = SIZES * np.geomspace(1.0, 0.02, RECORDS)[:, None, None] * np.ones(time)
    error = sigma * rng.normal(size=time)
    rotation = np.full(shape, TRACKED, dtype=np.uint8)
    rotation[:, 0], rotation[:, 1] = NEVER_OBSERVED, INCONSISTENT
    translation = np.where(rotation == INCONSISTENT, TRACKED, rotation)
    error[:, :, 1, :6] *= 40.0
    data = {
        "error": (("seed", "time", "target", "component"), error),
        "sigma": (("seed", "time", "target", "component"), sigma),
        "bound": (("seed", "time", "target", "component"), 0.5 * sigma),
        "bound_ratio": (("seed", "target", "part"), rng.lognormal(1.0, 0.3, (*shape, 4))),
        "bound_attitude": (status, rng.uniform(0.1, 0.5, shape)),
        "coverage": (dims, rng.uniform(0.3, 1.0, (*shape, 12))),
        "final_coverage": (dims, np.full((*shape, 12), 0.9)),
        "custody": (status, (rotation == TRACKED).astype(int)),
        "anees": (dims, rng.lognormal(0.0, 1.0, (*shape, 12))),
        "rmse": (dims, SIZES * rng.lognormal(0.0, 0.5, (*shape, 12))),
        "status": (status, rotation),
        "status_rotation": (status, rotation),
        "status_translation": (status, translation),
        "final_attitude_error": (status, rng.uniform(0.5, 5.0, shape)),
        "outcome": (("seed", "step", "target"), rng.integers(0, 2, (SEEDS, STEPS, targets))),
        "information": (("seed", "epoch"), rng.uniform(5.0, 9.0, (SEEDS, 2))),
        "updates": (status, rng.integers(1, STEPS, shape)),
        **{
            name: (status, np.zeros(shape, dtype=int))
            for name in ("out_of_field", "undetectable_sigma_points", "cholesky_failures", "failed")
        },
        "assignment": (("seed", "epoch", "observer"), np.zeros((SEEDS, 2, 4), dtype=int)),
    }
    coords = {
        "time": 600.0 * np.arange(1, RECORDS + 1),
        "step": 300 * np.arange(1, STEPS + 1),
        "target_id": ("target", np.arange(targets) + 40),
        "family": ("target", ["Halo_L2_N", "DRO", "Polar_KPLO_insertion"] * (targets // 3)),
    }
    cell = xr.Dataset(data, coords)
    cell["outcome"].attrs["flag_meanings"] = "not_tasked used"
    return cell


def cells(scenario, counts, minutes=(60,), architecture="tpe"):
    return {
        Cell(scenario, architecture, "mukf", n, m): cell_data(n, m) for n in counts for m in minutes
    }
