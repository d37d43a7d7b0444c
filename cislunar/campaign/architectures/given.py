"""Data sets of given architectures: those of the paper, and the observers of a user's table."""

import numpy as np
import xarray as xr

from cislunar.architecture.published import PUBLISHED, choose_members, random_member_values
from cislunar.campaign.architectures.variables import (
    architecture_attributes,
    architecture_variables,
    dimensionless,
    history_variables,
)
from cislunar.campaign.architectures.visibility import cost_function
from cislunar.campaign.settings.scenarios import orbits_of
from cislunar.errors import ConfigurationError
from cislunar.runtime import generator, logger, progress_log


def published_dataset(
    visibility: xr.Dataset, orbits: xr.Dataset, *, scenario: str, seed: int, restarts: int
) -> xr.Dataset:
    """``architecture/{scenario}/published.nc``: the paper's families and counts, best members by J.

    Raises `ConfigurationError` for a scenario that the paper, which has A, B and C, does not have.
    """
    if scenario not in PUBLISHED:
        raise ConfigurationError(
            f"scenario {scenario} is not in the paper, which has {', '.join(PUBLISHED)}: there is "
            "no published architecture to evaluate"
        )
    cost = cost_function(visibility, orbits)
    result = choose_members(
        cost,
        PUBLISHED[scenario],
        rng=generator(seed, scenario, "published"),
        restarts=restarts,
        progress=progress_log("restarts"),
    )
    logger.info("J = %.4e with %d satellites", result.value, result.n_satellites)
    random_values = random_member_values(
        cost, PUBLISHED[scenario], generator(seed, scenario, "published", "members by chance")
    )
    return xr.Dataset(
        architecture_variables(result.orbit, result.satellites, cost)
        | history_variables(result.history, result.satellites_history)
        | dimensionless(
            chance_J=("draw", random_values, "J of random members of the published families")
        ),
        attrs=architecture_attributes(
            visibility,
            f"Scenario {scenario}, published families and counts",
            {"restarts": restarts, "slots": [list(slot) for slot in PUBLISHED[scenario]]},
            seed,
        ),
    )


def own_dataset(
    visibility: xr.Dataset, orbits: xr.Dataset, *, scenario: str, name: str
) -> xr.Dataset:
    """``architecture/{scenario}/{name}.nc``: one satellite on each orbit of a table.

    J is NaN if a path is not closed, since it has no stability index.
    """
    cost, orbit = cost_function(visibility, orbits), np.arange(orbits.sizes["orbit"])
    found = architecture_variables(orbit, np.ones_like(orbit), cost)
    found["orbit"].attrs["long_name"] = f"index into {orbits_of(name, own=True)}"
    seen = visibility["observations"].values[:, 0]
    found |= dimensionless(
        observations=(("slot", "target"), seen, "times the static target is observable")
    )
    title = f"Scenario {scenario}, observers {name}"
    return xr.Dataset(found, attrs=architecture_attributes(visibility, title, {"observers": name}))
