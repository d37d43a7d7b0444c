"""Records of a cell for other tools (`task2.record`): coordinates, observers, arcs to export."""

import json
from collections.abc import Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import ArrayLike
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation

from cislunar.attitude.quaternion import compose, normalize
from cislunar.constants import LENGTH_UNIT_KM, MU, SECONDS_PER_DAY, TIME_UNIT_S
from cislunar.detection import direction_errors, icrf_directions
from cislunar.dynamics import earth_moon_axes
from cislunar.ephemeris import BODY_COLUMNS, DEFAULT_KERNEL, read_table, tabulate_bodies
from cislunar.ephemeris.time_scales import tdb_after
from cislunar.errors import ConfigurationError
from cislunar.estimation.navigation.errors import OBSERVER_PARAMETERS
from cislunar.evaluation.characterization import INTERVAL_PARTS
from cislunar.exchange import AttitudeSegment, Epoch, Segment, arc, icrf_axes, inertial_arc
from cislunar.exchange.observations import POSITION_COLUMNS, observation_dates
from cislunar.observation.scene import Scene
from cislunar.runtime import Array, count_of

_SPLINE_DEGREE = 7
_TRANSLATION = ["x", "y", "z", "vx", "vy", "vz"]
_ANGLES = ("right_ascension", "declination")

_OBSERVER = (
    "component of an observer's error: position along the axes of the propagation frame (m), "
    "right ascension and declination (arcsec), clock (s)"
)
_GOSPA = "GOSPA distance (km), and the parts of its square (km2)"
_INTERVAL = "estimate, and ends of its 95 % interval"

RECORD_COORDINATES = {
    "translation": ("translation", _TRANSLATION, "1", "position and velocity"),
    "translation_2": ("translation_2", _TRANSLATION, "1", "position and velocity"),
    "axis": ("axis", ["x", "y", "z"], "1", "axis"),
    "axis_2": ("axis_2", ["x", "y", "z"], "1", "axis"),
    "body_axis": ("body_axis", ["x", "y", "z"], "1", "axis of a body frame"),
    "quaternion": ("quaternion", ["q1", "q2", "q3", "q4"], "1", "component, q4 the scalar"),
    "angle": ("angle", [*_ANGLES], "1", "angle in the observer's body"),
    "gospa_part": ("gospa_part", ["distance", "localization", "missed", "false"], "1", _GOSPA),
    "interval_part": ("interval_part", [*INTERVAL_PARTS], "1", _INTERVAL),
    "inertial_axis": ("inertial_axis", ["x", "y", "z"], "1", "axis of the inertial frame"),
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


class FrameOfCell(NamedTuple):
    """Frames and dates of a cell: `epoch` and its axes, `start_s` seconds from the epoch to the
    start of the run, and whether the dynamics are those of an ephemeris (`kernel`)."""

    epoch: Epoch
    start_s: float
    ephemeris: bool
    kernel: str

    def tdb_s(self, time_s: ArrayLike) -> Array:
        """TDB seconds past J2000 of times since the start of the run."""
        elapsed = self.start_s + np.asarray(time_s, dtype=float)
        # ephemeris dynamics count seconds of TDB, the circular problem those of UTC
        return self.epoch.tdb_s + elapsed if self.ephemeris else tdb_after(self.epoch[0], elapsed)

    def to_icrf(self, time_s: ArrayLike) -> Array:
        """Rotations (time, 3, 3) from the propagation frame to the ICRF."""
        if self.ephemeris:
            return np.broadcast_to(np.eye(3), (np.size(time_s), 3, 3))
        return icrf_axes(self.start_s + np.asarray(time_s, dtype=float), self.epoch)

    def instantaneous(self, time_s: ArrayLike) -> tuple[Array, Array, Array]:
        """Rotations (time, 3, 3) from the propagation frame to the rotating frame at each time, and
        the positions (time, 3) of Earth and Moon in it relative to their barycenter, km."""
        if not self.ephemeris:
            turn = np.broadcast_to(np.eye(3), (np.size(time_s), 3, 3))
            earth, moon = (LENGTH_UNIT_KM * place for place in (-MU, 1.0 - MU))
        else:
            tdb = self.tdb_s(time_s)
            table = tabulate_bodies(float(tdb.min()), float(tdb.max()), self.kernel)
            position, velocity, _ = read_table(table, tdb)
            turn = earth_moon_axes(position, velocity)
            earth, moon = (
                np.einsum("ti,ti->t", turn[:, 0], position[:, BODY_COLUMNS[name]])
                for name in ("earth", "moon")
            )
        places = np.zeros((2, np.size(time_s), 3))
        places[0, :, 0], places[1, :, 0] = earth, moon
        return turn, *places

    def inertial_axes(self) -> Array:
        """Rotation (3, 3) from the ICRF to the inertial frame of attitudes: the rotating frame at
        the start of the run."""
        if self.ephemeris:
            return self.instantaneous([0.0])[0][0]
        return icrf_axes([self.start_s], self.epoch)[0].T

    def arc(
        self,
        label: tuple[str, str],
        state: Array,
        time_s: Array,
        center: str,
        covariance: Array | None = None,
    ) -> Segment:
        """An arc of states (time, 6) and covariances (time, 6, 6), propagation frame, with a name
        and an identifier."""
        name, designator = label
        given = {"object_id": designator, "center": center, "covariance": covariance}
        if self.ephemeris:
            return inertial_arc(name, state, self.tdb_s(time_s), **given, kernel=self.kernel)
        return arc(name, state, self.start_s + time_s, self.epoch, **given)


def frame_of(cell: xr.Dataset, sun: xr.Dataset) -> FrameOfCell:
    """Frames and dates of a cell, from its ``ephemeris/sun.nc``."""
    settings = json.loads(sun.attrs.get("settings", "{}"))
    kernel = settings.get("ephemeris", {}).get("kernel", DEFAULT_KERNEL)
    start = SECONDS_PER_DAY * start_day(cell.attrs)
    return FrameOfCell(frame_epoch(sun), start, is_ephemeris(cell), kernel)


def is_ephemeris(cell: xr.Dataset) -> bool:
    """Whether the true dynamics of a cell are those of an ephemeris."""
    return json.loads(cell.attrs["settings"]).get("dynamics", {}).get("truth") == "ephemeris"


_RECORDED = {
    "truth": ("true_translation",),
    "estimates": ("estimated_translation",),
    "covariance": ("covariance",),
    "measurements": ("observation_observer", "observer_position"),
}
"""Variables that a record makes."""


def require_records(cell: xr.Dataset, records: Sequence[str]) -> None:
    """Raise a `ConfigurationError` if a cell lacks a record of `task2.record`.

    Parameters
    ----------
    cell : xarray.Dataset
    records : sequence of str
        Some of truth, estimates, covariance and measurements.
    """
    for record in records:
        for name in _RECORDED[record]:
            if name not in cell:
                what = "observations" if record == "measurements" else name
                raise ConfigurationError(
                    f"the cell contains no {what}: add {record} to 'task2.record' and make it again"
                )


def _recorded(cell: xr.Dataset, name: str, which: str) -> Array:
    """The variable `name` of the truth or of the estimates."""
    require_records(cell, ["truth" if which == "true" else "estimates"])
    return cell[f"{which}_{name}"].values


def _of_realization(values: Array, seed: int) -> Array:
    """Values (realization, ...) of one realization."""
    return values[count_of("seed", seed, 0, len(values) - 1)]


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
        Origin, one of `cislunar.exchange.CENTERS`. In ephemeris dynamics Earth and Moon
        are those of the ephemeris, otherwise those of the circular problem.

    Returns
    -------
    list of Segment
        Named by `target_name` of the cell: the id in the user's table, or orbit class and row. The
        arc of a failed estimate ends where it failed; without two states it is left out.

    Raises
    ------
    ConfigurationError, InputFileError
        If the cell lacks the record, the center is unknown, or the kernel of ephemeris dynamics is
        missing or does not cover the run.
    """
    states = _of_realization(_recorded(cell, "translation", which), seed)
    covariances = None
    if which == "estimated" and "covariance" in cell:
        covariances = cell["covariance"].values[seed]
    frame, times = frame_of(cell, sun), cell["time"].values
    arcs = []
    for j, label in enumerate(_labels(cell, "target", recorded_names(cell))):
        good = np.isfinite(states[:, j]).all(axis=1)
        if good.sum() > 1:
            covariance = None if covariances is None else covariances[good, j]
            arcs.append(frame.arc(label, states[good, j], times[good], center, covariance))
    return arcs


def cell_observer_arcs(
    cell: xr.Dataset, sun: xr.Dataset, *, center: str = "EARTH"
) -> list[Segment]:
    """The observers of a cell as arcs, named as in `cell_observations`.

    Parameters
    ----------
    cell, sun : xarray.Dataset
        A cell made with measurements in `task2.record`, and its ``ephemeris/sun.nc``.
    center : str
        See `cell_arcs`.

    Returns
    -------
    list of Segment
        At every measurement time. Velocities are derivatives of the spline of degree 7 through the
        recorded positions.

    Raises
    ------
    ConfigurationError
        If the cell lacks the record, or has fewer than eight measurement times.
    """
    require_records(cell, ["measurements"])
    times, places = cell["step"].values, cell["observer_position"].values
    if times.size < _SPLINE_DEGREE + 1:
        raise ConfigurationError(
            f"the cell has {times.size} measurement times; velocities of observers need at least "
            f"{_SPLINE_DEGREE + 1}"
        )
    frame = frame_of(cell, sun)
    rate = make_interp_spline(times / TIME_UNIT_S, places, _SPLINE_DEGREE, axis=1).derivative()
    states = np.concatenate([places, rate(times / TIME_UNIT_S)], axis=-1)
    named = zip(_labels(cell, "observer", observer_names(cell)), states, strict=True)
    return [frame.arc(*each, times, center) for each in named]


def cell_attitudes(
    cell: xr.Dataset,
    sun: xr.Dataset,
    which: Literal["estimated", "true"] = "estimated",
    *,
    seed: int = 0,
) -> list[AttitudeSegment]:
    """Attitudes and angular velocities of the targets of a cell relative to the ICRF.

    For the arguments, names and errors see `cell_arcs`.
    """
    quaternions = _of_realization(_recorded(cell, "quaternion", which), seed)
    rates = np.rad2deg(_recorded(cell, "angular_velocity", which)[seed])
    frame, times = frame_of(cell, sun), cell["time"].values
    # the attitude matrix is the transpose of the matrix of SciPy's rotation
    reference = Rotation.from_matrix(frame.inertial_axes().T).as_quat()
    segments = []
    for j, label in enumerate(_labels(cell, "target", recorded_names(cell))):
        good = np.isfinite(quaternions[:, j]).all(axis=1) & np.isfinite(rates[:, j]).all(axis=1)
        if good.any():
            turned = normalize(compose(quaternions[good, j], reference))
            tdb = frame.tdb_s(times[good])
            segments.append(AttitudeSegment(*label, tdb, turned, rates[good, j]))
    return segments


def cell_observations(cell: xr.Dataset, sun: xr.Dataset, *, seed: int = 0) -> pd.DataFrame:
    """Measured directions and magnitudes of a cell.

    Parameters
    ----------
    cell, sun : xarray.Dataset
        A cell made with measurements in `task2.record`, and its ``ephemeris/sun.nc``.
    seed : int
        Index of the realization.

    Returns
    -------
    DataFrame
        In order of time; see `cislunar.exchange.observations`. Directions are those in the ICRF
        from the observer to the target at the same time, without light time and aberration.
        Positions of the observers have ICRF axes, km from the center of the Earth. Observers are
        named by `observer_names`, targets (``artSat``) as in `cell_arcs`.

    Raises
    ------
    ConfigurationError
        If the cell lacks the record.
    """
    require_records(cell, ["measurements"])
    names = ("seed", "step", "target", "observer", "magnitude", "magnitude_variance")
    column = {name: cell[f"observation_{name}"].values for name in names}
    rows = np.flatnonzero((column["seed"] == seed) & np.isfinite(column["magnitude"]))
    rows = rows[np.argsort(column["step"][rows], kind="stable")]
    column = {name: values[rows] for name, values in column.items()}
    step, observer, target = column["step"], column["observer"], column["target"]
    ra, dec, covariance = measured_directions(cell, sun, rows)
    frame, times = frame_of(cell, sun), cell["step"].values
    at_rest = [np.pad(each, ((0, 0), (0, 3))) for each in cell["observer_position"].values]
    tracks = np.array([frame.arc(("", ""), each, times, "EARTH").state[:, :3] for each in at_rest])
    where = tracks[observer, step]
    dates = np.array(observation_dates(frame.tdb_s(times)))
    return pd.DataFrame(
        {
            "obsID": [f"{s}-{o}-{t}" for s, o, t in zip(step, observer, target, strict=True)],
            "stn": np.array(observer_names(cell))[observer],
            "artSat": np.array(recorded_names(cell))[target],
            "sys": "ICRF_KM",
            "ctr": "399",
            **dict(zip(POSITION_COLUMNS, where.T, strict=True)),
            "obsTime": dates[step],
            "ra": ra,
            "dec": dec,
            **direction_errors(covariance),
            "mag": column["magnitude"],
            "rmsMag": np.sqrt(column["magnitude_variance"]),
        }
    )


def measured_directions(
    cell: xr.Dataset, sun: xr.Dataset, rows: ArrayLike
) -> tuple[Array, Array, Array]:
    """Right ascension and declination, deg, ICRF, of observations by their indices (n,), and their
    covariance, see `cislunar.detection.tables.icrf_directions`; NaN where nothing was detected."""
    given = cell[[f"observation_{name}" for name in ("step", *_ANGLES, "angle_variance")]]
    step, ra, dec, variance = (given[name].values[rows] for name in given)
    frame, axes = frame_of(cell, sun), cell["observer_axes"].values
    turn = frame.to_icrf(cell["step"].values)[step] @ axes[step].swapaxes(1, 2)
    both = np.repeat(variance[:, None], 2, axis=1)
    return icrf_directions(np.column_stack([ra, dec]), both, turn)


def observer_names(cell: xr.Dataset) -> list[str]:
    """Names of observers in messages: the user's, or numbers with four characters, which no code of
    an observatory has."""
    if "observer_name" in cell:
        return cell["observer_name"].values.astype(str).tolist()
    return [f"O{number:03d}" for number in range(1, cell.sizes["observer"] + 1)]


def _labels(cell: xr.Dataset, kind: str, names: list[str]) -> list[tuple[str, str]]:
    """Names of targets or observers with their identifiers in messages, or the names again."""
    key = f"{kind}_designator"
    known = cell[key].values.astype(str).tolist() if key in cell else names
    return [*zip(names, known, strict=True)]


def recorded_names(cell: xr.Dataset) -> list[str]:
    """Names of the targets; orbit class and row for a cell of an earlier version."""
    if "target_name" in cell:
        return cell["target_name"].values.astype(str).tolist()
    both = zip(cell["family"].values, cell["target_id"].values, strict=True)
    return [f"{family} {row}" for family, row in both]
