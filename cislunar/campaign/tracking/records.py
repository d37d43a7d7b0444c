"""Records of a cell for other tools (`task2.record`): coordinates, observers, arcs to export."""

import json
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
import xarray as xr

from cislunar.constants import SECONDS_PER_DAY
from cislunar.errors import ConfigurationError
from cislunar.estimation.navigation.errors import OBSERVER_PARAMETERS
from cislunar.exchange.arcs import arc
from cislunar.exchange.inertial import Epoch
from cislunar.exchange.oem import Segment
from cislunar.observation.scene import Scene

_TRANSLATION = ["x", "y", "z", "vx", "vy", "vz"]

_OBSERVER = (
    "component of an observer's error: position along the axes of the propagation frame (m), "
    "right ascension and declination (arcsec), clock (s)"
)

RECORD_COORDINATES = {
    "translation": ("translation", _TRANSLATION, "1", "position and velocity"),
    "translation_2": ("translation_2", _TRANSLATION, "1", "position and velocity"),
    "axis": ("axis", ["x", "y", "z"], "1", "axis"),
    "body_axis": ("body_axis", ["x", "y", "z"], "1", "axis of a body frame"),
    "quaternion": ("quaternion", ["q1", "q2", "q3", "q4"], "1", "component, q4 the scalar"),
    "angle": ("angle", ["right_ascension", "declination"], "1", "angle in the observer's body"),
    "gospa_part": (
        "gospa_part",
        ["distance", "localization", "missed", "false"],
        "1",
        "GOSPA distance (km), and the parts of its square (km2)",
    ),
    "observer_parameter": ("observer_parameter", [*OBSERVER_PARAMETERS], "1", _OBSERVER),
    "observer_parameter_2": ("observer_parameter_2", [*OBSERVER_PARAMETERS], "1", _OBSERVER),
}
"""Coordinates of the recorded variables: dimensions, values, unit and description."""

ROTATING = "nondimensional, rotating frame"
EPHEMERIS_FRAME = "nondimensional, barycentric frame with J2000 axes"


def observer_variables(
    record: Sequence[str], scene: Scene, frame: str = ROTATING
) -> dict[str, tuple]:
    """Dimensions, values, unit and description of the observers' positions and axes, if
    recorded."""
    if not {"measurements", "pointing"} & {*record}:
        return {}
    # index 0 of the scene is the epoch, without a measurement
    return {
        "observer_position": (
            ("observer", "step", "axis"), scene.observer_position[:, 1:], "1",
            f"position of the observer, {frame}"),
        "observer_axes": (
            ("step", "body_axis", "axis"), scene.observer_axes[1:], "1",
            f"rotation from the {frame.partition(', ')[2]} to the observers' body frame"),
    }  # fmt: skip


def frame_epoch(sun: xr.Dataset) -> Epoch:
    """Epoch and axes of a campaign, from ``ephemeris/sun.nc``."""
    return Epoch(float(sun["et"].values[0]), sun["moon_rotation"].values[0])


def start_day(attributes: Mapping[str, Any]) -> float:
    """Days from the epoch to the start of a cell with these attributes."""
    return float(json.loads(attributes["settings"]).get("start_day", 0.0))


def cell_arcs(
    cell: xr.Dataset,
    sun: xr.Dataset,
    which: Literal["estimated", "true"] = "estimated",
    *,
    seed: int = 0,
    center: str = "EARTH",
) -> list[Segment]:
    """The targets of a cell as arcs, to be written by `cislunar.exchange`.

    Parameters
    ----------
    cell, sun : xarray.Dataset
        A cell made with `task2.record`, and its ``ephemeris/sun.nc``.
    which : {"estimated", "true"}
        Estimates, with their covariance where the cell has it, or the truth.
    seed : int
        Index of the realization.
    center : str
        Origin, one of `cislunar.exchange.inertial.CENTERS`.

    Returns
    -------
    list of Segment
        Named by `target_name` of the cell: the id in the user's table, or orbit class and row. The
        arc of a failed estimate ends where it failed; without two states it is left out.

    Raises
    ------
    ConfigurationError
        If the cell lacks the record, or its dynamics are those of the ephemeris.
    """
    if json.loads(cell.attrs["settings"]).get("dynamics", {}).get("truth") == "ephemeris":
        raise ConfigurationError(
            "the states of a cell with 'task2.dynamics.truth' = 'ephemeris' are in the barycentric "
            "frame with J2000 axes already; multiply them by LENGTH_UNIT_KM and LENGTH_UNIT_KM / "
            "TIME_UNIT_S: only states in the rotating frame are converted into arcs"
        )
    name = f"{which}_translation"
    if name not in cell:
        key = "truth" if which == "true" else "estimates"
        raise ConfigurationError(
            f"the cell contains no {name}: add {key} to 'task2.record' and make it again"
        )
    own: dict[str, Any] = {name: cell[name].values[seed]}
    if which == "estimated" and "covariance" in cell:
        own["covariance"] = cell["covariance"].values[seed]
    epoch = frame_epoch(sun)
    times = cell["time"].values + SECONDS_PER_DAY * start_day(cell.attrs)
    arcs = []
    for j, label in enumerate(_labels(cell)):
        good = np.isfinite(own[name][:, j]).all(axis=1)
        if good.sum() > 1:
            covariance = own["covariance"][good, j] if "covariance" in own else None
            states = own[name][good, j]
            arcs.append(
                arc(label, states, times[good], epoch, center=center, covariance=covariance)
            )
    return arcs


def _labels(cell: xr.Dataset) -> list[str]:
    """Names of the targets; orbit class and row for a cell of an earlier version."""
    if "target_name" in cell:
        return cell["target_name"].values.astype(str).tolist()
    both = zip(cell["family"].values, cell["target_id"].values, strict=True)
    return [f"{family} {row}" for family, row in both]
