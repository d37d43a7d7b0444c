"""What a cell keeps for other tools (`task2.record`): its variables, and its arcs to export."""

from typing import Any, Literal

import numpy as np
import xarray as xr

from cislunar.errors import ConfigurationError
from cislunar.exchange.arcs import arc
from cislunar.exchange.inertial import Epoch
from cislunar.exchange.oem import Segment
from cislunar.observation.scene import Scene
from cislunar.tasking.recording import Records

_TRANSLATION = ["x", "y", "z", "vx", "vy", "vz"]

RECORD_COORDINATES = {
    "translation": ("translation", _TRANSLATION, "1", "position and velocity"),
    "translation_2": ("translation_2", _TRANSLATION, "1", "position and velocity"),
    "axis": ("axis", ["x", "y", "z"], "1", "axis"),
    "body_axis": ("body_axis", ["x", "y", "z"], "1", "axis of a body frame"),
    "quaternion": ("quaternion", ["q1", "q2", "q3", "q4"], "1", "component, q4 the scalar"),
    "angle": ("angle", ["right_ascension", "declination"], "1", "angle in the observer's body"),
}
"""Dimensions of the variables; dimensions, values, unit and meaning."""

_HISTORY = ("seed", "time", "target")
_FRAME = "nondimensional, rotating frame"


def recorded_variables(records: Records, scene: Scene) -> dict[str, tuple]:
    """Dimensions, values, unit and meaning of every variable that was asked for.

    Parameters
    ----------
    records : Records
    scene : Scene
        Where the observers were.

    Returns
    -------
    dict
        Empty if nothing was asked for.
    """
    kinds = {
        "translation": ((*_HISTORY, "translation"), "1", f"position and velocity, {_FRAME}"),
        "quaternion": ((*_HISTORY, "quaternion"), "1", "attitude, inertial to body"),
        "angular_velocity": ((*_HISTORY, "body_axis"), "rad s-1", "angular velocity, body frame"),
    }
    found: dict[str, tuple] = {}
    for prefix, field, words in (("true", "true_", "true"), ("estimated", "", "estimated")):
        for name, (dims, unit, meaning) in kinds.items():
            values = getattr(records, f"{field}{name}")
            if values is not None:
                found[f"{prefix}_{name}"] = (dims, values, unit, f"{words} {meaning}")
    if records.covariance is not None:
        dims = (*_HISTORY, "translation", "translation_2")
        meaning = f"covariance of the estimated position and velocity, {_FRAME}"
        found["covariance"] = (dims, records.covariance, "1", meaning)
    if records.pointing is not None:
        meaning = "direction of the target's estimated place, observer's body frame"
        found["pointing"] = (
            ("seed", "time", "observer", "angle"),
            records.pointing,
            "rad",
            meaning,
        )
    looks = records.looks
    if looks is not None:
        for name, values, unit, meaning in (
            ("seed", looks.seed, "1", "index of the realization"),
            ("step", looks.step, "1", "index along dimension step"),
            ("target", looks.target, "1", "index of the target along dimension target"),
            ("observer", looks.observer, "1", "index of the observer"),
            ("fate", looks.fate, "1", "what became of the look"),
            ("magnitude", looks.value[:, 0], "mag", "measured magnitude, NaN if nothing was found"),
            ("right_ascension", looks.value[:, 1], "rad", "measured in the observer's body frame"),
            ("declination", looks.value[:, 2], "rad", "measured in the observer's body frame"),
            ("magnitude_variance", looks.variance[:, 0], "mag2", "of the measured magnitude"),
            ("angle_variance", looks.variance[:, 1], "rad2", "of right ascension and declination"),
        ):
            found[f"look_{name}"] = (("look",), values, unit, meaning)
    if looks is not None or records.pointing is not None:
        # index 0 of the scene is the epoch, without a measurement
        found["observer_position"] = (
            ("observer", "step", "axis"),
            scene.observer_position[:, 1:],
            "1",
            f"position of the observer, {_FRAME}",
        )
        found["observer_axes"] = (
            ("step", "body_axis", "axis"), scene.observer_axes[1:], "1",
            "rotation from the rotating frame to the observers' body frame")  # fmt: skip
    return found


def frame_epoch(sun: xr.Dataset) -> Epoch:
    """Epoch and axes of a campaign, from ``ephemeris/sun.nc``."""
    return Epoch(float(sun["et"].values[0]), sun["moon_rotation"].values[0])


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
        A cell made with `task2.record`, and the ``ephemeris/sun.nc`` it was made with.
    which : {"estimated", "true"}
        Estimates, with their covariance where the cell has it, or the truth.
    seed : int
        Index of the realization.
    center : str
        Origin, one of `cislunar.exchange.inertial.CENTERS`.

    Returns
    -------
    list of Segment
        Named by class and row of the target; a failed estimate ends where it failed, and is left
        out if it has no two states.

    Raises
    ------
    ConfigurationError
        If the cell was made without what is wanted.
    """
    name = f"{which}_translation"
    if name not in cell:
        wanted = "truth" if which == "true" else "estimates"
        raise ConfigurationError(
            f"the cell holds no {name}: add {wanted} to 'task2.record' and make it again"
        )
    own: dict[str, Any] = {name: cell[name].values[seed]}
    if which == "estimated" and "covariance" in cell:
        own["covariance"] = cell["covariance"].values[seed]
    epoch, times = frame_epoch(sun), cell["time"].values
    arcs = []
    for j, (row, family) in enumerate(
        zip(cell["target_id"].values, cell["family"].values, strict=True)
    ):
        good = np.isfinite(own[name][:, j]).all(axis=1)
        if good.sum() > 1:
            covariance = own["covariance"][good, j] if "covariance" in own else None
            label, states = f"{family} {row}", own[name][good, j]
            arcs.append(
                arc(label, states, times[good], epoch, center=center, covariance=covariance)
            )
    return arcs
