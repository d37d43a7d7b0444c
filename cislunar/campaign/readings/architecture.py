"""Effect of each reading of the paper on J: the chain of Task 1 repeated with one choice
changed."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from cislunar.architecture import PUBLISHED, Objective, choose_members
from cislunar.architecture.coordinate_search import coordinate_search
from cislunar.campaign.architectures.visibility import cost_function, visibility_dataset
from cislunar.campaign.data.inputs import (
    families_dataset,
    static_targets_dataset,
    zvs_points_dataset,
)
from cislunar.campaign.settings import merged, nested
from cislunar.runtime import Progress, counted, generator

_READINGS: dict[str, dict[str, Any]] = {
    "as configured": {},
    "C_d = 0.5": {"visibility.diffuse_reflection_coefficient": 0.5},
    "C_d = 0.2": {"visibility.diffuse_reflection_coefficient": 0.2},
    "targets around the Moon alone": {"targets.centers": ["moon"]},
    "targets in the lobes of both bodies": {"targets.region": "bodies"},
    "targets on a barycentric grid": {"targets.centers": ["barycenter"], "targets.region": "all"},
    "targets within 500 000 km": {"targets.outer_radius_km": 500_000.0},
    "another k-means seed": {"seed": 1},
    "orbits as far as catalogs list them": {"orbits.extent": "catalog"},
    "observers by DOP853 at 1e-13": {"propagator": "dop853"},
}
"""Changes to the configuration, by the name of the reading."""


def _random_best(
    objective: Objective, rng: np.random.Generator, *, n_slots: int, draws: int
) -> float:
    """Largest value of `draws` uniformly random architectures."""
    shape = (draws, n_slots)
    orbit = rng.integers(0, objective.n_orbits, shape)
    satellites = rng.integers(1, objective.max_satellites + 1, shape)
    return max(objective.value(o, n) for o, n in zip(orbit, satellites, strict=True))


def _sampled_points(
    setting: Mapping[str, Any], sampled: list[tuple[Mapping[str, Any], xr.Dataset]]
) -> xr.Dataset:
    """The points of the static targets, among those `sampled` before with the same settings."""
    chosen = setting["targets"]
    for before, points in sampled:
        if before == chosen:
            return points
    points = zvs_points_dataset(chosen["missions"], setting)
    sampled.append((chosen, points))
    return points


def readings_table(
    config: Mapping[str, Any],
    scenario: str,
    orbits: xr.Dataset,
    sun: xr.Dataset,
    progress: Progress | None = None,
) -> pd.DataFrame:
    """J of one scenario of the whole configuration under each reading.

    `orbits` and `sun` are those of the configuration as it is. Columns: reading, sampled points, J
    of the published families and counts (where the paper has the scenario), best of random draws,
    and best of the coordinate search with its satellites.
    """
    rows = []
    sampled: list[tuple[Mapping[str, Any], xr.Dataset]] = []
    for name, changes in counted(_READINGS.items(), progress):
        setting = dict(config)
        for key, value in changes.items():
            setting = merged(setting, nested(key, value))
        library = families_dataset(setting) if "orbits.extent" in changes else orbits
        points = _sampled_points(setting, sampled)
        targets = static_targets_dataset(
            points,
            scenario,
            setting["scenarios"][scenario]["targets"],
            setting["targets"]["seeding"],
            setting["seed"],
        )
        chosen = setting["architecture"]
        visibility = visibility_dataset(library, targets, sun, setting, chosen["max_satellites"])
        cost = cost_function(visibility, library)
        rng = generator(config["seed"], scenario, "readings")
        draws = chosen["max_evaluations"]
        best = coordinate_search(cost, rng, n_slots=chosen["slots"], restarts=chosen["restarts"])
        row = {
            "scenario": scenario,
            "reading": name,
            "changes": "; ".join(f"{key} = {value}" for key, value in changes.items()),
            "sampled_points": points.sizes["point"],
            "J_random": _random_best(cost, rng, n_slots=chosen["slots"], draws=draws),
            "random_draws": draws,
            "J_coordinate_search": best.value,
            "satellites_coordinate_search": best.n_satellites,
        }
        if scenario in PUBLISHED:
            published = choose_members(
                cost, PUBLISHED[scenario], rng=rng, restarts=chosen["restarts"]
            )
            row["J_published"] = published.value
        rows.append(row)
    return pd.DataFrame(rows)
