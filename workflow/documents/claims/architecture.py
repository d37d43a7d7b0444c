"""The paper's claims on orbits and architectures, judged by the library and the searches."""

import json
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from cislunar.architecture.published import PUBLISHED, PUBLISHED_COST
from cislunar.campaign.tracking.comparisons import pairs_interval
from cislunar.constants import LENGTH_UNIT_KM
from cislunar.evaluation.intervals import Interval, prediction_interval, share_interval

from .judges import Claim, judge, table


class ClaimInterval(NamedTuple):
    """Median of some runs, and the 95 % prediction interval of one more."""

    median: float
    low: float
    high: float
    count: int

    def __format__(self, form: str) -> str:
        return f"{self.median:{form}} ({self.low:{form}} to {self.high:{form}})"


def _spread(values: xr.DataArray) -> ClaimInterval:
    """Of J, which spans decades, by its logarithm."""
    found = prediction_interval(np.log10(values.values))
    return ClaimInterval(*(float(10.0**each) for each in found[:3]), found.count)


def _counts(values: xr.DataArray, slots: int) -> ClaimInterval:
    """Of satellites, of which each slot has one at least."""
    found = prediction_interval(values.values)
    return ClaimInterval(*found._replace(low=max(float(slots), found.low)))


def _budget(run: xr.Dataset) -> dict[str, int]:
    """Evaluations of a search, and those without improvement that end it."""
    settings = json.loads(run.attrs["settings"])
    return {"evaluations": settings["max_evaluations"], "early_stop": settings["early_stop"]}


def _judged(part: str, **facts: Any) -> list[Claim]:
    return [judge(row, facts) for row in table()[part]]


def library_claims(orbits: xr.Dataset, points: xr.Dataset) -> list[Claim]:
    """Claims on the orbit library and the missions, `points` being ``targets/zvs_points.nc``."""
    family, x = orbits["family"].values.astype(str), orbits["state"].values[:, 0]
    names, sizes = np.unique(family, return_counts=True)
    spacing = {
        str(name): float(np.mean(np.abs(np.diff(x[family == name]))) * LENGTH_UNIT_KM)
        for name in names[sizes > 1]
    }
    least, most = min(spacing, key=spacing.get), max(spacing, key=spacing.get)
    jacobi = points["jacobi"].values
    return _judged(
        "library",
        orbits=len(family),
        families=len(names),
        per_family=sizes.mean(),
        **{"least": least, "least_kind": least.split("_")[0], "least_km": spacing[least]},
        **{"most": most, "most_kind": most.split("_")[0], "most_km": spacing[most]},
        missions=points.sizes["mission_index"],
        jacobi_low=round(float(jacobi.min()), 2),
        jacobi_high=round(float(jacobi.max()), 2),
    )


def cost_claims(scenario: str, architectures: Mapping[str, xr.Dataset]) -> list[Claim]:
    """Claims on J and the number of satellites in one scenario, from architectures by optimizer.

    Scenarios that are not in the paper yield comparisons without a counterpart there.
    """
    claims = []
    for method in ("tpe", "random"):
        if method not in architectures or scenario not in PUBLISHED_COST:
            continue
        value, count = PUBLISHED_COST[scenario][method]
        reached = _spread(architectures[method]["run_J"])
        satellites = _counts(
            architectures[method]["run_satellites"], architectures[method].sizes["slot"]
        )
        claims += _judged(
            "searches",
            scenario=scenario,
            method=method,
            optimizer={"tpe": "TPE", "random": "random search"}[method],
            **{"paper_J": value, "J": reached, "J_ratio": value / reached.median},
            **{"paper_satellites": count, "satellites": satellites},
            satellites_off=count - satellites.median,
            **_budget(architectures[method]),
        )
    if "random" in architectures:
        run = architectures["random"]
        evaluations = int(run["full_evaluations"].max())
        claims += _judged(
            "unstopped", scenario=scenario, J=_spread(run["full_J"]), evaluations=evaluations
        )
    if "published" in architectures:
        ours, paper = float(architectures["published"]["J"]), PUBLISHED_COST[scenario]["tpe"][0]
        claims += _judged(
            "published",
            scenario=scenario,
            J=ours,
            paper_J=paper,
            ratio=ours / paper,
            random_members=float(np.median(architectures["published"]["chance_J"])),
        )
    if "exact" in architectures:
        exact = architectures["exact"]
        value, bound = float(exact["J"]), float(exact["bound"])
        within = f"proven within {bound / value - 1:.1%}"
        claims += _judged(
            "optimum",
            scenario=scenario,
            J=value,
            satellites=int(exact["satellites"].sum()),
            state="proven optimal" if exact.attrs["proven"] else within,
        )
    return claims


def comparison_claims(
    architectures: Mapping[str, Mapping[str, xr.Dataset]], orbits: xr.Dataset
) -> list[Claim]:
    """Claims that compare optimizers over the paper's scenarios, each with its architectures."""
    both = {
        name: (found["tpe"], found["random"]) for name, found in architectures.items()
        if name in PUBLISHED and "tpe" in found and "random" in found
    }  # fmt: skip
    if not both:
        return []

    def pairs(quantity: str, sign: int) -> dict[str, Interval]:
        """Share of (TPE run, random run) pairs in which TPE has more (1) or less (-1)."""
        return {
            name: pairs_interval(*(sign * run[quantity].values for run in runs))
            for name, runs in both.items()
        }

    better, fewer = pairs("run_J", 1), pairs("run_satellites", -1)
    family = orbits["family"].values.astype(str)
    of_runs = [family[tpe["run_orbit"].values] for tpe, _ in both.values()]
    chosen = np.concatenate([each.ravel() for each in of_runs])
    halos = [np.char.startswith(each, "Halo_L2").mean(axis=1) for each in of_runs]
    names, counts = np.unique(chosen, return_counts=True)
    order = np.argsort(-counts, kind="stable")
    return _judged(
        "optimizers",
        **_budget(next(iter(both.values()))[0]),
        better=", ".join(f"{name}: {share:.2f}" for name, share in better.items()),
        better_least=min(share.floor for share in better.values()),
        fewer=", ".join(f"{name}: {share:.2f}" for name, share in fewer.items()),
        fewer_least=min(share.floor for share in fewer.values()),
        share=share_interval(np.concatenate(halos), targets=1),
        of_library=np.mean(np.char.startswith(family, "Halo_L2")),
        most=", ".join(f"{names[i]} {counts[i]}" for i in order[:4]),
        both_lead=set(names[order[:2]]) == {"Halo_L2_N", "Halo_L2_S"},
    )
