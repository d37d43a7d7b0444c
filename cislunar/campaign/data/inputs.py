"""Initial data sets of the campaign: ephemeris, orbit library, static targets."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from cislunar.campaign.settings import Orbits, Targets, Visibility, family_extent, typed
from cislunar.constants import SECONDS_PER_DAY
from cislunar.ephemeris import BODY_COLUMNS, NODE_SPACING_S, BodyTable, tabulate_bodies, utc_to_tdb
from cislunar.ephemeris.sampling import interpolate_sun, sample_ephemeris
from cislunar.orbits.families import OrbitSet, observer_library
from cislunar.runtime import Progress, logger, progress_log, variable
from cislunar.runtime.provenance import provenance
from cislunar.targets import cluster, distinct_points, load_missions, sample_zero_velocity
from cislunar.visibility.counts import observation_times

AXES = ("x", "y", "z")
COMPONENTS = ("x", "y", "z", "vx", "vy", "vz")


def variables(**described: tuple) -> dict[str, xr.Variable]:
    """Variables by name, from dimensions, values, unit and meaning."""
    return {name: variable(*each) for name, each in described.items()}


def _label(dim: str, values, meaning: str) -> tuple:
    return dim, list(values), "1", meaning


def sun_dataset(settings: Mapping[str, Any]) -> xr.Dataset:
    """Make ``ephemeris/sun.nc``, from the keys `epoch_jd`, `ephemeris` and `visibility`."""
    sampled = sample_ephemeris(
        settings["epoch_jd"],
        settings["visibility"]["duration_days"],
        settings["ephemeris"]["step_minutes"],
        settings["ephemeris"]["kernel"],
    )
    meaning = "Sun from the Earth-Moon barycenter, rotating frame, in units of length_unit_km"
    return xr.Dataset(
        variables(
            sun_position=(("time", "axis"), sampled.sun_position, "1", meaning),
            moon_rotation=(("time", "axis", "axis_j2000"), sampled.moon_rotation, "1",
                           "rotation from J2000 to the rotating frame"),
            et=("time", sampled.et, "s", "TDB seconds past J2000"),
        ),
        coords=variables(
            time=("time", sampled.time_utc_jd, "d", "Julian date, UTC"),
            axis=_label("axis", AXES, "axis of the rotating frame"),
            axis_j2000=_label("axis_j2000", AXES, "axis of J2000"),
        ),
        attrs=provenance("Sun and rotating frame from SPICE", settings=settings),
    )  # fmt: skip


def bodies_dataset(settings: Mapping[str, Any]) -> xr.Dataset:
    """Make ``ephemeris/bodies.nc``, from the keys `epoch_jd`, `ephemeris` and `visibility`."""
    epoch = float(utc_to_tdb(settings["epoch_jd"]))
    length = settings["visibility"]["duration_days"] * SECONDS_PER_DAY
    table = tabulate_bodies(epoch, epoch + length, settings["ephemeris"]["kernel"])
    node = table.start + table.spacing * np.arange(len(table.coefficients))
    bodies = [f"{body}_{axis}" for body in BODY_COLUMNS for axis in AXES]
    meaning = (
        "coefficient of a power of the fraction of an interval: position, barycentric frame with "
        "J2000 axes"
    )
    return xr.Dataset(
        variables(
            coefficient=(("interval", "power", "coordinate"), table.coefficients, "km", meaning),
            epoch_et=((), epoch, "s", "epoch, TDB seconds past J2000"),
        ),
        coords=variables(
            et=("interval", node, "s", "start of an interval, TDB seconds past J2000"),
            power=("power", np.arange(4), "1", "power"),
            coordinate=_label("coordinate", bodies, "body and axis of J2000"),
        ),
        attrs=provenance("Earth, Moon and Sun from SPICE", settings=settings),
    )


def body_table(bodies: xr.Dataset) -> BodyTable:
    """The table in ``ephemeris/bodies.nc``."""
    return BodyTable(
        float(bodies["et"].values[0]),
        NODE_SPACING_S,
        np.ascontiguousarray(bodies["coefficient"].values),
    )


def sun_at(sun: xr.Dataset, times: np.ndarray) -> np.ndarray:
    """Sun at times since the epoch, shape (time, 3), in the rotating frame; all nondimensional."""
    elapsed = (sun["et"].values - sun["et"].values[0]) / sun.attrs["time_unit_s"]
    return interpolate_sun(times, elapsed, sun["sun_position"].values)


def families_dataset(settings: Mapping[str, Any], progress: Progress | None = None) -> xr.Dataset:
    """Make ``orbits/families.nc``, the candidate observer orbits, from the key `orbits`."""
    orbits = typed(settings["orbits"], Orbits)
    members = {family: count for family, count in orbits.members if count > 0}
    library = observer_library(members, family_extent(orbits), progress=progress)
    return orbit_set_dataset(library, "orbit", "Candidate observer orbits", settings)


def orbit_set_dataset(
    orbits: OrbitSet, dim: str, title: str, settings: Mapping[str, Any]
) -> xr.Dataset:
    """A set of periodic orbits as a data set along `dim`; `settings` are for provenance."""
    distance = "least distance to the center of the"
    return xr.Dataset(
        variables(
            family=_label(dim, [str(name) for name in orbits.family], "orbit family"),
            state=((dim, "component"), orbits.state, "1",
                   "epoch state at y = 0, nondimensional, rotating frame"),
            period=(dim, orbits.period, "1", "period in units of time_unit_s"),
            jacobi=(dim, orbits.jacobi, "1", "Jacobi constant"),
            stability_index=(dim, orbits.stability_index, "1", "stability index"),
            perilune_km=(dim, orbits.perilune_km, "km", f"{distance} Moon"),
            perigee_km=(dim, orbits.perigee_km, "km", f"{distance} Earth"),
        ),
        coords=variables(component=_label("component", COMPONENTS, "component of the state")),
        attrs=provenance(title, settings=settings),
    )  # fmt: skip


def zvs_points_dataset(missions_path: str | Path, settings: Mapping[str, Any]) -> xr.Dataset:
    """Make ``targets/zvs_points.nc`` for a table of missions, from the key `targets`."""
    missions = load_missions(missions_path)
    sampling = typed(settings["targets"], Targets)
    names = missions["mission"].tolist()
    points = sample_zero_velocity(
        missions["jacobi"].to_numpy(), sampling, names=names, progress=progress_log("missions")
    )
    logger.info("%d points within the surfaces of %d missions", len(points.position), len(names))
    return xr.Dataset(
        variables(
            position=(("point", "axis"), points.position, "1", "nondimensional, rotating frame"),
            mission=("point", points.mission, "1", "index into mission_name"),
            jacobi=("point", points.jacobi, "1", "Jacobi constant of the mission"),
            mission_name=_label("mission_index", names, "mission"),
        ),
        coords=variables(axis=_label("axis", AXES, "axis of the rotating frame")),
        attrs=provenance("Points sampled within zero-velocity surfaces", settings=settings)
        | {"distinct_points": len(distinct_points(points.position)[0])},
    )


def static_targets_dataset(
    points: xr.Dataset, scenario: str, targets: int, seeding: str, seed: int
) -> xr.Dataset:
    """Make ``targets/static_{scenario}.nc``: clusters of the sampled points."""
    clusters = cluster(
        points["position"].values, targets, seed=seed, seeding=seeding, progress=progress_log
    )
    logger.info("inertia %.6g", clusters.inertia)
    chosen = {"scenario": scenario, "targets": targets, "seeding": seeding}
    inertia = "sum of squared distances of points to their target"
    return xr.Dataset(
        variables(
            position=(("target", "axis"), clusters.center, "1", "nondimensional, rotating frame"),
            members=("target", clusters.members, "1", "number of sampled points in the cluster"),
            inertia=((), clusters.inertia, "1", inertia),
        ),
        coords=variables(axis=_label("axis", AXES, "axis of the rotating frame")),
        attrs=provenance(f"Static targets of scenario {scenario}", settings=chosen, seed=seed),
    )


def horizon(settings: Mapping[str, Any]) -> np.ndarray:
    """Nondimensional evaluation times (time,) of the architecture optimization."""
    chosen = typed(settings["visibility"], Visibility)
    return observation_times(chosen.duration_days, chosen.step_hours)
