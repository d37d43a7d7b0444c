"""Data set of a user's architecture: the observers of a table."""

import numpy as np
import xarray as xr

from cislunar.campaign.architectures.variables import (
    architecture_attributes,
    architecture_variables,
    dimensionless,
)
from cislunar.campaign.architectures.visibility import cost_function
from cislunar.campaign.settings.scenarios import orbits_of


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
