"""Data sets of the best architectures found: with a certificate over all, and by number of
satellites."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from cislunar.architecture.coordinate_search import coordinate_search, satellite_front
from cislunar.architecture.optimality.certificate import certify
from cislunar.campaign.architectures.variables import (
    architecture_attributes,
    architecture_variables,
    dimensionless,
    history_variables,
)
from cislunar.campaign.architectures.visibility import architecture_coverage, cost_function
from cislunar.runtime import Progress, generator, logger, progress_log


def exact_dataset(
    visibility: xr.Dataset,
    orbits: xr.Dataset,
    *,
    scenario: str,
    seed: int,
    slots: int,
    restarts: int,
    certificate: Mapping[str, float],
    threads: int = 1,
) -> xr.Dataset:
    """``architecture/{scenario}/exact.nc``: the best architecture found, and its certificate.

    The coordinate search finds it; the certificate bounds all others. `restarts` is the number of
    starts of the coordinate search, `certificate` the configuration key `architecture.certificate`.
    The number of `threads` (subtrees searched in parallel) does not change the result.
    """
    cost, rng = cost_function(visibility, orbits), generator(seed, scenario, "exact")
    found = coordinate_search(
        cost, rng, n_slots=slots, restarts=restarts, progress=progress_log("restarts")
    )
    logger.info("J = %.6e with %d satellites", found.value, found.n_satellites)
    proof = certify(
        cost,
        rng,
        n_slots=slots,
        incumbent=(found.orbit, found.satellites),
        epsilon=certificate["within"],
        restarts=0,
        threads=threads,
        most_nodes=certificate["nodes"],
        progress=progress_log("thousandths of the tree"),
    )
    if not proof.bound:
        logger.warning(
            "warning: J is 0 for every architecture, so that none is better than another"
        )
    logger.info(
        "J = %.6e is %s; gap %.3g, %d nodes, %.1f s, %d architectures within %g of it",
        proof.value,
        "proven optimal" if proof.proven else "not proven optimal",
        proof.gap,
        proof.nodes,
        proof.seconds,
        len(proof.near_value),
        certificate["within"],
    )
    attributes = architecture_attributes(
        visibility,
        f"Scenario {scenario}, best architecture with its certificate",
        {"slots": slots, "restarts": restarts, "certificate": dict(certificate)},
        seed,
    )
    # The time of the proof is no result: as an attribute it leaves the variables reproducible.
    attributes |= {"proven": int(proof.proven), "certificate_seconds": proof.seconds}
    near_slot = ("near_optimal", "slot")
    return xr.Dataset(
        architecture_variables(proof.orbit, proof.satellites, cost)
        | history_variables(*found.evaluation_history())
        | dimensionless(
            bound=((), proof.bound, "upper bound on J over all architectures"),
            gap=((), proof.gap, "bound / J - 1"),
            nodes=((), proof.nodes, "nodes of the branch and bound"),
            near_J=("near_optimal", proof.near_value, "J of near-optimal architectures"),
            near_orbit=(near_slot, proof.near_orbit, "index into orbits/families.nc"),
            near_satellites=(near_slot, proof.near_satellites, "satellites on the orbit"),
        ),
        attrs=attributes,
    )


def front_dataset(
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
    """``architecture/{scenario}/front.nc``: best J by number of satellites, and its coverage.

    `front` is the configuration key `architecture.front`, `settings` has `propagator` and
    `visibility`; `progress` counts numbers of satellites.
    """
    totals = list(range(front["fewest"], front["most"] + 1))
    found = satellite_front(
        cost_function(visibility, orbits),
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
    orbit = np.array([each.orbit for each in found])
    satellites = np.array([each.satellites for each in found])
    observed = [c.union_coverage for c in covered]
    slot = ("total", "slot")
    return xr.Dataset(
        dimensionless(
            J=("total", [each.value for each in found], "best J found"),
            orbit=(slot, orbit, "orbit index"),
            satellites=(slot, satellites, "satellites on the orbit"),
            union_coverage=("total", observed, "share of target-hours seen"),
            target_days=("total", [c.target_days for c in covered], "share of target-days seen"),
            never_seen=("total", [c.never_seen for c in covered], "targets never seen"),
        ),
        coords=dimensionless(total=("total", totals, "satellites in all")),
        attrs=architecture_attributes(
            visibility,
            f"Scenario {scenario}, best J by number of satellites",
            {"slots": slots, "front": dict(front), **settings},
            seed,
        ),
    )
