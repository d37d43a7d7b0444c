"""Data sets of visibility, and the cost and the coverage of architectures from them."""

from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from cislunar.architecture import ArchitectureTables, CostFunction
from cislunar.architecture.coverage.measures import Coverage, coverage
from cislunar.campaign.architectures.variables import dimensionless
from cislunar.campaign.data.inputs import horizon, sun_at
from cislunar.campaign.settings import Visibility, merged, typed
from cislunar.campaign.settings.cell_settings import own_sensors
from cislunar.errors import ConfigurationError
from cislunar.runtime.progress import Progress, logger
from cislunar.runtime.provenance import provenance
from cislunar.visibility import VisibilityCounts, architecture_tracks, count_visibility


def visibility_dataset(
    orbits: xr.Dataset,
    targets: xr.Dataset,
    sun: xr.Dataset,
    settings: Mapping[str, Any],
    max_satellites: int,
    progress: Progress | None = None,
) -> xr.Dataset:
    """``visibility/{scenario}.nc``: observations by orbit and satellite count.

    The inputs are ``orbits/families.nc``, ``targets/static_{scenario}.nc`` and
    ``ephemeris/sun.nc``, up to a number of satellites on one orbit; observers of a table have their
    own sensors. In ephemeris dynamics `sun` is ``orbits/paths.nc`` of these orbits. `settings` has
    the configuration keys `epoch_jd`, `propagator` and `visibility`; `progress` counts orbits.
    """
    chosen = typed(settings["visibility"], Visibility)
    times = horizon(settings)
    place, length = _sun_and_unit(sun, times)
    tracks = sun["track"].values if "track" in sun else None
    seen = targets["position"].values, times, place
    given: dict[str, Any] = {"max_satellites": max_satellites, "length": length}
    given["propagator"] = settings["propagator"]
    found = []
    for first, last, own in _by_sensor(chosen, orbits):
        flown = orbits["state"].values[first:last], orbits["period"].values[first:last]
        given["tracks"] = None if tracks is None else tracks[first:last]
        found.append(count_visibility(*flown, *seen, own, **given, progress=progress))
    counts = VisibilityCounts(
        np.concatenate([each.observations for each in found]),
        np.concatenate([each.distance for each in found]),
    )
    if not counts.observations.any():
        logger.warning(
            "warning: no static target is ever seen from any orbit, so that J is 0 for every "
            "architecture; raise visibility.limiting_magnitude = %g or "
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
    observed = "times the target is observable, summed over satellites and times"
    distance = "Earth plus Moon distance summed over satellites and times, nondimensional"
    count = np.arange(1, max_satellites + 1)
    return xr.Dataset(
        dimensionless(
            observations=(("orbit", "satellites", "target"), counts.observations, observed),
            distance=(("orbit", "satellites"), counts.distance, distance),
        ),
        coords=dimensionless(satellites=("satellites", count, "satellites on the orbit")),
        attrs=attributes,
    )


def _sun_and_unit(sun: xr.Dataset, times: np.ndarray) -> tuple[np.ndarray, ArrayLike]:
    """Sun (time, 3) in the rotating frame, and the frame's unit of length over l*."""
    if "track" in sun:
        return sun["sun_position"].values, sun["length"].values
    return sun_at(sun, times), 1.0


def _tracks_of(
    paths: xr.Dataset, orbit: np.ndarray, satellites: np.ndarray, phase: ArrayLike
) -> np.ndarray:
    """Tracks (satellite, time, 3) of an architecture in ``orbits/paths.nc``."""
    ahead = np.broadcast_to(np.asarray(phase, dtype=float), np.shape(orbit))
    rows = np.repeat(orbit, satellites)
    requested = np.concatenate(
        [a + np.arange(n) / n for a, n in zip(ahead, satellites, strict=True)]
    )
    away = np.abs((requested[:, None] - paths["phase"].values + 0.5) % 1.0 - 0.5)
    if np.any(away.min(axis=1) > 1e-9):
        raise ConfigurationError(
            "phases of an architecture are not in orbits/paths.nc, which has those of satellites "
            "evenly spaced from the first; choose such phases"
        )
    return paths["track"].values[rows, np.argmin(away, axis=1)]


def _by_sensor(chosen: Visibility, orbits: xr.Dataset) -> Iterator[tuple[int, int, Visibility]]:
    """Consecutive orbits, first and last, whose observers have the same sensor limits."""
    own = own_sensors(orbits, range(orbits.sizes["orbit"]))
    starts = [0, *(k for k in range(1, len(own)) if own[k] != own[k - 1]), len(own)]
    for first, last in pairwise(starts):
        change = {key: value for key, value in own[first].items() if key in Visibility.model_fields}
        yield first, last, typed(merged(chosen.model_dump(), change), Visibility)


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
    """Union coverage of one architecture (slot,), for data sets and settings as for visibility.

    For `phase` (slot,) see `phases_of`.
    """
    chosen = typed(settings["visibility"], Visibility)
    times = horizon(settings)
    place, length = _sun_and_unit(sun, times)
    if "track" in sun:
        track = _tracks_of(sun, orbit, satellites, phase)
    else:
        track = architecture_tracks(
            orbits["state"].values[orbit],
            orbits["period"].values[orbit],
            satellites,
            times,
            phase=phase,
            propagator=settings["propagator"],
        )
    return coverage(track, targets["position"].values, times, place, chosen, length=length)
