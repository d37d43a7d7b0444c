"""What a cell keeps for other tools (`task2.record`): its variables, and its arcs to export."""

import json
from collections.abc import Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from cislunar.constants import SECONDS_PER_DAY
from cislunar.errors import ConfigurationError
from cislunar.exchange.arcs import arc
from cislunar.exchange.inertial import Epoch
from cislunar.exchange.oem import Segment
from cislunar.observation.scene import Scene
from cislunar.tasking.recording import Looks

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
ROTATING = "nondimensional, rotating frame"
AMONG_BODIES = "nondimensional, frame of J2000 about the Earth-Moon barycenter"
_FRAME = "{frame}"
_LOOK = ("look",)


class Described(NamedTuple):
    """A variable of a cell without its values: dimensions, type, unit and meaning."""

    dims: tuple[str, ...]
    dtype: str
    unit: str
    meaning: str


_MOTION = {
    "translation": ("translation", "1", f"position and velocity, {_FRAME}"),
    "quaternion": ("quaternion", "1", "attitude, inertial to body"),
    "angular_velocity": ("body_axis", "rad s-1", "angular velocity, body frame"),
}


ESTIMATED = tuple(_MOTION)
"""Names within `cislunar.tasking.recording.Records` of what a cell calls estimated."""


def _motion(word: str) -> dict[str, Described]:
    return {
        f"{word}_{name}": Described((*_HISTORY, dim), "f8", unit, f"{word} {meaning}")
        for name, (dim, unit, meaning) in _MOTION.items()
    }


_RECORDABLE = {
    "truth": _motion("true"),
    "estimates": _motion("estimated"),
    "covariance": {
        "covariance": Described(
            (*_HISTORY, "translation", "translation_2"), "f8", "1",
            f"covariance of the estimated position and velocity, {_FRAME}"),
    },
    "pointing": {
        "pointing": Described(
            ("seed", "time", "observer", "angle"), "f8", "rad",
            "direction of the target's estimated place, observer's body frame"),
    },
    "visibility": {
        "visible": Described(
            ("seed", "epoch", "target"), "i1", "1",
            "1 where any observer could have found the target in the interval, at its true "
            "brightness without noise"),
    },
    "measurements": {
        f"look_{name}": Described(_LOOK, dtype, unit, meaning)
        for name, dtype, unit, meaning in (
            ("seed", "i8", "1", "index of the realization"),
            ("step", "i8", "1", "index along dimension step"),
            ("target", "i8", "1", "index of the target along dimension target"),
            ("observer", "i8", "1", "index of the observer"),
            ("fate", "u1", "1", "what became of the look"),
            ("magnitude", "f8", "mag", "measured magnitude, NaN if nothing was found"),
            ("right_ascension", "f8", "rad", "measured in the observer's body frame"),
            ("declination", "f8", "rad", "measured in the observer's body frame"),
            ("magnitude_variance", "f8", "mag2", "of the measured magnitude"),
            ("angle_variance", "f8", "rad2", "of right ascension and declination"),
        )
    },
}  # fmt: skip


def recorded_variables(record: Sequence[str], frame: str = ROTATING) -> dict[str, Described]:
    """What is kept of every realization on request, for these values of `task2.record`."""
    found: dict[str, Described] = {}
    for asked in _RECORDABLE:
        found |= _RECORDABLE[asked] if asked in record else {}
    return {
        name: each._replace(meaning=each.meaning.format(frame=frame))
        for name, each in found.items()
    }


def look_values(looks: Looks) -> dict[str, NDArray]:
    """Values of the variables of looks."""
    return {
        "look_seed": looks.seed,
        "look_step": looks.step,
        "look_target": looks.target,
        "look_observer": looks.observer,
        "look_fate": looks.fate,
        "look_magnitude": looks.value[:, 0],
        "look_right_ascension": looks.value[:, 1],
        "look_declination": looks.value[:, 2],
        "look_magnitude_variance": looks.variance[:, 0],
        "look_angle_variance": looks.variance[:, 1],
    }


def observer_variables(
    record: Sequence[str], scene: Scene, frame: str = ROTATING
) -> dict[str, tuple]:
    """Dimensions, values, unit and meaning of where observers were, if that is needed."""
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
        If the cell was made without what is wanted, or among the bodies as they are.
    """
    if json.loads(cell.attrs["settings"]).get("dynamics", {}).get("truth") == "ephemeris":
        raise ConfigurationError(
            "the states of a cell with 'task2.dynamics.truth' = 'ephemeris' are in axes of J2000 "
            "as they stand, times LENGTH_UNIT_KM and LENGTH_UNIT_KM / TIME_UNIT_S about the "
            "Earth-Moon barycenter; only those of the rotating frame are made into arcs"
        )
    name = f"{which}_translation"
    if name not in cell:
        wanted = "truth" if which == "true" else "estimates"
        raise ConfigurationError(
            f"the cell holds no {name}: add {wanted} to 'task2.record' and make it again"
        )
    own: dict[str, Any] = {name: cell[name].values[seed]}
    if which == "estimated" and "covariance" in cell:
        own["covariance"] = cell["covariance"].values[seed]
    epoch = frame_epoch(sun)
    times = cell["time"].values + SECONDS_PER_DAY * start_day(cell.attrs)
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
