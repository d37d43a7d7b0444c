"""Data sets of architectures that need no sampling: proven, published, by number of satellites."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from cislunar.architecture.coordinate_search import satellite_front
from cislunar.architecture.cost import CostFunction
from cislunar.architecture.optimality.certificate import certify
from cislunar.architecture.optimize import optimize
from cislunar.architecture.published import PUBLISHED
from cislunar.architecture.tables import ArchitectureTables
from cislunar.campaign.architectures.observability import architecture_coverage
from cislunar.campaign.architectures.optimization import (
    architecture_attributes,
    architecture_variables,
    generator,
    history_variables,
)
from cislunar.campaign.data.netcdf import variable
from cislunar.campaign.data.progress import Progress, logger, progress_log
from cislunar.errors import ConfigurationError


def exact_dataset(
    tables: ArchitectureTables,
    visibility: xr.Dataset,
    *,
    scenario: str,
    seed: int,
    slots: int,
    restarts: int,
    certificate: Mapping[str, float],
    threads: int = 1,
) -> xr.Dataset:
    """The best architecture by coordinate search, and the proof that nothing beats it.

    Parameters
    ----------
    tables : ArchitectureTables
        Tables of the scenario.
    visibility : xarray.Dataset
        ``visibility/{scenario}.nc``, for its attributes.
    scenario : str
        Its name.
    seed, slots, restarts : int
        Seed of the campaign, number of orbits, starts of the coordinate search.
    certificate : mapping
        Configuration key `architecture.certificate`.
    threads : int
        Subtrees searched at once; they do not change the outcome.

    Returns
    -------
    xarray.Dataset
        ``architecture/{scenario}/exact.nc``.
    """
    rng = generator(seed, scenario, "exact")
    found = optimize(
        tables,
        method="exact",
        rng=rng,
        n_slots=slots,
        restarts=restarts,
        progress=progress_log("restarts"),
    )
    logger.info("J = %.6e with %d satellites", found.cost.value, found.n_satellites)
    proof = certify(
        tables,
        rng,
        n_slots=slots,
        incumbent=(found.orbit, found.satellites),
        epsilon=certificate["within"],
        restarts=0,
        threads=threads,
        time_limit=certificate["time_limit_s"],
        progress=progress_log("thousandths of the tree"),
    )
    logger.info(
        "J = %.6e is %s; gap %.3g, %d nodes, %.1f s, %d architectures within %g of it",
        proof.cost,
        "proven optimal" if proof.proven else "not proven optimal",
        proof.gap,
        proof.nodes,
        proof.seconds,
        len(proof.near_cost),
        certificate["within"],
    )
    cost = CostFunction(tables)(proof.orbit, proof.satellites)
    attributes = architecture_attributes(
        visibility,
        f"Scenario {scenario}, best architecture with its certificate",
        {"slots": slots, "restarts": restarts, "certificate": dict(certificate)},
        seed,
    )
    # The time of the proof is no result: as an attribute it leaves the variables reproducible.
    attributes |= {"proven": int(proof.proven), "certificate_seconds": proof.seconds}
    return xr.Dataset(
        architecture_variables(proof.orbit, proof.satellites, cost)
        | history_variables(found.history, found.satellites_history)
        | _certificate_variables(proof),
        attrs=attributes,
    )


def _certificate_variables(proof) -> dict[str, xr.Variable]:
    """Bound, nodes and near-optimal architectures of a certificate."""
    return {
        "bound": variable((), proof.bound, "1", "upper bound on J over all architectures"),
        "gap": variable((), proof.gap, "1", "bound / J - 1"),
        "nodes": variable((), proof.nodes, "1", "nodes of the branch and bound"),
        "near_J": variable("near_optimal", proof.near_cost, "1", "J of near-optimal architectures"),
        "near_orbit": variable(
            ("near_optimal", "slot"), proof.near_orbit, "1", "index into orbits/families.nc"
        ),
        "near_satellites": variable(
            ("near_optimal", "slot"), proof.near_satellites, "1", "satellites on the orbit"
        ),
    }


def published_dataset(
    tables: ArchitectureTables, visibility: xr.Dataset, *, scenario: str, seed: int, restarts: int
) -> xr.Dataset:
    """The paper's families and counts, with the members that serve J best.

    Parameters
    ----------
    tables : ArchitectureTables
        Tables of the scenario.
    visibility : xarray.Dataset
        ``visibility/{scenario}.nc``, for its attributes.
    scenario : str
        Scenario; the paper has A, B and C.
    seed, restarts : int
        Seed of the campaign and number of starts.

    Returns
    -------
    xarray.Dataset
        ``architecture/{scenario}/published.nc``.

    Raises
    ------
    ConfigurationError
        If the paper has no such scenario.
    """
    if scenario not in PUBLISHED:
        raise ConfigurationError(
            f"scenario {scenario} is not in the paper, which has {', '.join(PUBLISHED)}: there is "
            "no published architecture to evaluate"
        )
    result = optimize(
        tables,
        method="published",
        rng=generator(seed, scenario, "published"),
        published=PUBLISHED[scenario],
        restarts=restarts,
        progress=progress_log("restarts"),
    )
    logger.info("J = %.4e with %d satellites", result.cost.value, result.n_satellites)
    return xr.Dataset(
        architecture_variables(result.orbit, result.satellites, result.cost)
        | history_variables(result.history, result.satellites_history),
        attrs=architecture_attributes(
            visibility,
            f"Scenario {scenario}, published families and counts",
            {"restarts": restarts, "slots": [list(slot) for slot in PUBLISHED[scenario]]},
            seed,
        ),
    )


def front_dataset(
    tables: ArchitectureTables,
    visibility: xr.Dataset,
    orbits: xr.Dataset,
    targets: xr.Dataset,
    sun: xr.Dataset,
    *,
    scenario: str,
    seed: int,
    slots: int,
    front: Mapping[str, int],
    settings: Mapping[str, Any],
    progress: Progress | None = None,
) -> xr.Dataset:
    """Best J found for each number of satellites, and what such an architecture covers.

    Parameters
    ----------
    tables : ArchitectureTables
        Tables of the scenario.
    visibility, orbits, targets, sun : xarray.Dataset
        Data sets of the scenario.
    scenario : str
        Its name.
    seed, slots : int
        Seed of the campaign and number of orbits.
    front : mapping
        Configuration key `architecture.front`.
    settings : mapping
        Configuration keys `propagator` and `visibility`.
    progress : callable, optional
        Called with (totals done, totals).

    Returns
    -------
    xarray.Dataset
        ``architecture/{scenario}/front.nc``.
    """
    totals = list(range(front["fewest"], front["most"] + 1))
    found = satellite_front(
        tables,
        totals,
        generator(seed, scenario, "front"),
        n_slots=slots,
        restarts=front["restarts"],
        progress=progress,
    )
    covered = [
        architecture_coverage(each.orbit, each.satellites, orbits, targets, sun, settings)
        for each in found
    ]
    return xr.Dataset(
        {
            "J": variable("total", [each.cost.value for each in found], "1", "best J found"),
            "orbit": variable(
                ("total", "slot"), np.array([each.orbit for each in found]), "1", "orbit index"
            ),
            "satellites": variable(
                ("total", "slot"),
                np.array([each.satellites for each in found]),
                "1",
                "satellites on the orbit",
            ),
            "union_coverage": variable(
                "total", [c.union_coverage for c in covered], "1", "share of target-hours seen"
            ),
            "target_days": variable(
                "total", [c.target_days for c in covered], "1", "share of target-days seen"
            ),
            "never_seen": variable(
                "total", [c.never_seen for c in covered], "1", "targets never seen"
            ),
        },
        coords={"total": variable("total", totals, "1", "satellites in all")},
        attrs=architecture_attributes(
            visibility,
            f"Scenario {scenario}, best J by number of satellites",
            {"slots": slots, "front": dict(front), **settings},
            seed,
        ),
    )
