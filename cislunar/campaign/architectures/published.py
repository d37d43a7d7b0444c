"""Data set of the paper's own architectures."""

import xarray as xr

from cislunar.architecture.published import PUBLISHED, choose_members, random_member_values
from cislunar.campaign.architectures.variables import (
    architecture_attributes,
    architecture_variables,
    dimensionless,
    history_variables,
)
from cislunar.campaign.architectures.visibility import cost_function
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
