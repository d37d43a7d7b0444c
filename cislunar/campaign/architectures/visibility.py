"""Data sets of visibility, and the cost and the coverage of architectures from them."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from cislunar.architecture.cost import CostFunction
from cislunar.architecture.coverage.measures import Coverage, architecture_tracks, coverage
from cislunar.architecture.tables import ArchitectureTables
from cislunar.campaign.data.inputs import horizon, sun_at
from cislunar.campaign.data.netcdf import variable
from cislunar.campaign.data.progress import Progress, logger
from cislunar.campaign.data.provenance import provenance
from cislunar.campaign.settings.library import visibility_settings
from cislunar.visibility.counts import count_visibility


def visibility_dataset(
    orbits: xr.Dataset,
    targets: xr.Dataset,
    sun: xr.Dataset,
    settings: Mapping[str, Any],
    max_satellites: int,
    progress: Progress | None = None,
) -> xr.Dataset:
    """``visibility/{scenario}.nc``: observations by orbit and satellite count.

    From ``orbits/families.nc``, ``targets/static_{scenario}.nc`` and ``ephemeris/sun.nc``, up to a
    number of satellites on one orbit. `settings` has the configuration keys `epoch_jd`,
    `propagator` and `visibility`; `progress` counts orbits.
    """
    chosen = visibility_settings(settings)
    times = horizon(settings)
    counts = count_visibility(
        orbits["state"].values,
        orbits["period"].values,
        targets["position"].values,
        times,
        sun_at(sun, times),
        chosen,
        max_satellites=max_satellites,
        progress=progress,
    )
    if not counts.observations.any():
        logger.warning(
            "warning: no static target is ever seen from any orbit, so that J is 0 and there is "
            "nothing to choose by; raise visibility.limiting_magnitude = %g or "
            "visibility.target_radius_m = %g, or lower visibility.exclusion_deg",
            chosen.limiting_magnitude,
            chosen.target_radius_m,
        )
    attributes = provenance("Observations of static targets", settings=dict(settings))
    attributes.update(
        diffuse_reflection_coefficient=float(chosen.diffuse_reflection_coefficient),
        visibility_magnitude=float(chosen.limiting_magnitude),
        n_steps=len(times),
    )
    return xr.Dataset(
        {
            "observations": variable(
                ("orbit", "satellites", "target"),
                counts.observations,
                "1",
                "times the target is observable, summed over satellites and times",
            ),
            "distance": variable(
                ("orbit", "satellites"),
                counts.distance,
                "1",
                "Earth plus Moon distance summed over satellites and times, nondimensional",
            ),
        },
        coords={
            "satellites": variable(
                "satellites", np.arange(1, max_satellites + 1), "1", "satellites on the orbit"
            )
        },
        attrs=attributes,
    )


def cost_function(visibility: xr.Dataset, orbits: xr.Dataset) -> CostFunction:
    """J on the tables of ``visibility/{scenario}.nc`` and ``orbits/families.nc``."""
    tables = ArchitectureTables(
        observations=visibility["observations"].values,
        distance=visibility["distance"].values,
        stability_index=orbits["stability_index"].values,
        family=orbits["family"].values.astype(str),
        n_steps=int(visibility.attrs["n_steps"]),
    )
    return CostFunction(tables)


def architecture_coverage(
    orbit: np.ndarray,
    satellites: np.ndarray,
    orbits: xr.Dataset,
    targets: xr.Dataset,
    sun: xr.Dataset,
    settings: Mapping[str, Any],
    phase: ArrayLike = 0.0,
) -> Coverage:
    """Union coverage of one architecture (slot,), data sets and settings as for visibility.

    `phase` (slot,) as of `phases_of`.
    """
    chosen = visibility_settings(settings)
    times = horizon(settings)
    track = architecture_tracks(
        orbits["state"].values[orbit],
        orbits["period"].values[orbit],
        satellites,
        times,
        phase=phase,
        propagator=chosen.propagator,
    )
    return coverage(track, targets["position"].values, times, sun_at(sun, times), chosen)
