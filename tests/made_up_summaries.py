"""Summaries of tracking with made-up realizations."""

import json

import numpy as np
import xarray as xr

from cislunar.campaign.tracking.summary import PARTS, PER_CELL, PER_PART

SEEDS = 8
GOOD = {
    "coverage": (0.95, 0.95, 0.99, 0.99),
    "anees_median": (1.0,) * 4,
    "anees_mean": (2.0, 2.0, 1.1, 1.1),
    "anees_mean_periodic": (1.5, 1.5, 1.0, 1.0),
    "rmse_median": (0.02, 1e-5, 1e-5, 1e-5),
    "rmse_90": (0.05, 2e-5, 2e-5, 2e-5),
    "final_attitude_error_median": 0.5,
    "tracked_share": 0.9,
    "never_observed": 1.0,
    "inconsistent_rotation": 2.0,
    "inconsistent_rotation_only": 2.0,
}
COUNTS = {"A": (20, 50, 100), "B": (33, 50, 100), "C": (43, 50, 100)}
INTERVALS = {("A", 20), ("B", 33), ("A", 50)}


def spread(value, width=0.01):
    """Realizations about a value with a known, small spread."""
    return np.asarray(value) * (1.0 + width * np.linspace(-1.0, 1.0, SEEDS))


def make_summary(change=lambda *cell: {}, architectures=("published",)):
    """A summary of the paper's sweeps; `change` gives the values that differ in a cell."""
    cells = []
    for architecture in architectures:
        for scenario, counts in COUNTS.items():
            cells += [(scenario, architecture, n, 60) for n in counts]
        cells += [
            (scenario, architecture, n, minutes)
            for scenario, n in sorted(INTERVALS)
            for minutes in (30, 120, 180, 240)
        ]
    values = {name: np.zeros((len(cells), SEEDS, len(PARTS))) for name in PER_PART}
    values |= {name: np.zeros((len(cells), SEEDS)) for name in PER_CELL}
    for k, cell in enumerate(cells):
        for name, value in (GOOD | change(*cell)).items():
            for p in range(len(PARTS)) if name in PER_PART else (None,):
                where = (k, slice(None)) if p is None else (k, slice(None), p)
                one = value if p is None else value[p]
                values[name][where] = one if name.startswith("never") else spread(one)
    columns = list(zip(*cells, strict=True))
    coords = {
        "scenario": ("cell", list(columns[0])),
        "architecture": ("cell", list(columns[1])),
        "estimator": ("cell", ["mukf"] * len(cells)),
        "variant": ("cell", [""] * len(cells)),
        "targets": ("cell", list(columns[2])),
        "interval_minutes": ("cell", list(columns[3])),
        "observers": ("cell", [20] * len(cells)),
        "part": list(PARTS),
        "part_unit": ("part", ["1"] * 4),
    }
    dims = ("cell", "seed", "part")
    tasking = {"method": "exact", "max_evaluations": 5000, "early_stop": 700}
    change = {"tasking": {"method": "tpe", "max_evaluations": 90}}
    task2 = {"tasking": tasking, "variants": {"cells": {"tpe": {"change": change}}}}
    return xr.Dataset(
        {n: (dims[: v.ndim], v) for n, v in values.items()},
        coords,
        {"settings": json.dumps({"task2": task2})},
    )
