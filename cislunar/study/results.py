"""Results of a study: summary, labeled data in practical units, figures and messages."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from cislunar.campaign.tracking.records import (
    cell_observations,
    frame_epoch,
    is_ephemeris,
    measured_directions,
)
from cislunar.constants import DATE_SYSTEM, LENGTH_UNIT_KM, TIME_UNIT_S
from cislunar.ephemeris.time_scales import tdb_after
from cislunar.errors import ConfigurationError
from cislunar.evaluation.custody import attitude_angle_deg, rotation_vectors_deg
from cislunar.evaluation.metrics import TARGET_STATUS_NAMES
from cislunar.exchange.key_values import dates
from cislunar.runtime.arguments import Array
from cislunar.runtime.netcdf import variable, write_text
from cislunar.runtime.settings_words import shown
from cislunar.study.messages import CREATED, cell_messages, check_seed
from cislunar.tasking.realization import USED

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Which = Literal["estimated", "true", "observers"]

_SPEED_KM_S = LENGTH_UNIT_KM / TIME_UNIT_S
_DEG_H = float(np.rad2deg(3600.0))
_PARTS = {
    "attitude": (slice(0, 3), np.rad2deg(1.0), "deg"),
    "angular_velocity": (slice(3, 6), _DEG_H, "deg/h"),
    "position": (slice(6, 9), LENGTH_UNIT_KM, "km"),
    "velocity": (slice(9, 12), _SPEED_KM_S, "km/s"),
}
"""Parts of an error: components, and their practical unit."""


class StudyResult:
    """Result of a study.

    Attributes
    ----------
    study : Study
        The study that was run.
    cell : xarray.Dataset
        All results, as the file of a cell of a campaign has them, in its units.
    sun : xarray.Dataset
        Epoch, axes of the rotating frame and Sun.
    plots : tuple of str
        Kinds of figures.
    """

    plots: tuple[str, ...] = ("errors", "schedule", "light_curve", "geometry")

    def __init__(self, study: Any, cell: xr.Dataset, sun: xr.Dataset) -> None:
        self.study, self.cell, self.sun = study, cell, sun

    def __repr__(self) -> str:
        sizes = self.cell.sizes
        return f"<Result of {self.study!r}, {sizes['seed']} realization{'s' * (sizes['seed'] > 1)}>"

    @property
    def targets(self) -> list[str]:
        """Names of the targets."""
        return [each.name for each in self.study.targets]

    def utc(self, elapsed_s: Any) -> NDArray[np.datetime64]:
        """Dates in UTC at times since the epoch, s."""
        tdb_s = tdb_after(frame_epoch(self.sun).tdb_s, elapsed_s)
        return np.array(dates(tdb_s, DATE_SYSTEM), "datetime64[us]")

    def summary(self) -> pd.DataFrame:
        """One row for each target, over all realizations.

        Returns
        -------
        DataFrame
            By the name of the target: orbit family, status by its number of realizations, mean
            number of measurements used, and at the end of the run the root mean square over
            realizations of errors and standard deviations: position (km), velocity (m/s), attitude
            (deg).
        """
        cell = self.cell
        error, sigma = (cell[name].values[:, -1].astype(float) for name in ("error", "sigma"))
        norms = {
            "position_error_km": np.linalg.norm(error[..., 6:9], axis=-1) * LENGTH_UNIT_KM,
            "velocity_error_m_s": np.linalg.norm(error[..., 9:], axis=-1) * 1e3 * _SPEED_KM_S,
            "attitude_error_deg": attitude_angle_deg(error),
        }
        columns = {
            "family": [each.family for each in self.study.targets],
            "status": [_counted(each) for each in cell["status"].values.T],
            "measurements": np.mean(np.sum(cell["outcome"].values == USED, axis=1), axis=0),
            **{key: np.sqrt(np.mean(each**2, axis=0)) for key, each in norms.items()},
            **sigma_columns(sigma),
        }
        return pd.DataFrame(columns, index=pd.Index(self.targets, name="target"))

    def to_xarray(self) -> xr.Dataset:
        """Estimates, errors, assignments and observations, labeled, in practical units.

        Returns
        -------
        Dataset
            Times are dates in UTC, targets and observers have their names. Positions are in km and
            velocities in km/s in the frame that the attribute `frame` states, attitude errors in
            degrees as rotation vectors, angular velocities in deg/h. A covariance is in km^2,
            km^2/s and km^2/s^2. Directions are right ascension and declination, ICRF, deg.
        """
        cell, scale = self.cell, np.repeat([LENGTH_UNIT_KM, _SPEED_KM_S], 3)
        rows, found = ("seed", "time", "target"), {}
        for name, words in (("error", "truth less estimate"), ("sigma", "standard deviation")):
            if name not in cell:
                continue
            for part, (columns, factor, unit) in _PARTS.items():
                values = cell[name].values[..., columns].astype(float)
                turned = (name, part) == ("error", "attitude")
                scaled = rotation_vectors_deg(values) if turned else values * factor
                described = (*rows, "axis"), scaled, unit, f"{part}: {words}"
                found[f"{part}_{name}"] = variable(*described)
        for which in ("true", "estimated"):
            if f"{which}_translation" not in cell:
                continue
            states = cell[f"{which}_translation"].values * scale
            for part, some in (("position", slice(0, 3)), ("velocity", slice(3, 6))):
                described = (*rows, "axis"), states[..., some], _PARTS[part][2], f"{which} {part}"
                found[f"{which}_{part}"] = variable(*described)
            words = f"{which} attitude, inertial frame to body frame"
            values = cell[f"{which}_quaternion"].values
            found[f"{which}_quaternion"] = variable((*rows, "quaternion"), values, "1", words)
        covariance = cell["covariance"].values * np.outer(scale, scale)
        words = "covariance of position and velocity"
        dims = (*rows, "component", "component_2")
        found["covariance"] = variable(dims, covariance, "km, km/s", words)
        if "assignment" in cell:
            given, names = cell["assignment"], np.array([*self.targets, ""])
            described = names[given.values], "1", "target of the observer; empty if it is idle"
            found["assigned_target"] = variable(tuple(given.dims), *described)
        elapsed, more = self._observed()
        found["observation_time"] = "observation", self.utc(elapsed), {"long_name": "date, UTC"}
        for key, own in (("target", self.targets), ("observer", self.study.observer_names)):
            values = np.array(own)[cell[f"observation_{key}"].values]
            found[f"observation_{key}"] = variable("observation", values, "1", f"name of the {key}")
        found |= more
        names = ["x", "y", "z", "vx", "vy", "vz"]
        coords = {
            "time": self.utc(cell["time"].values),
            "target": self.targets,
            "observer": self.study.observer_names,
            "seed": np.arange(cell.sizes["seed"]),
            "axis": ["x", "y", "z"],
            "quaternion": ["q1", "q2", "q3", "q4"],
            "component": names,
            "component_2": names,
        }
        if "epoch" in cell:
            coords["epoch"] = self.utc(cell["epoch"].values)
        frame = (
            "barycentric, J2000 axes" if is_ephemeris(cell) else "rotating, Earth-Moon barycenter"
        )
        attrs = {key: cell.attrs[key] for key in ("title", "source", "settings", "seed")}
        return xr.Dataset(found, coords, {**attrs, "frame": frame, "time_scale": "UTC"})

    def _observed(self) -> tuple[Array, dict[str, Any]]:
        """Times of the observations, s, and their further variables."""
        cell = self.cell
        flags = np.array(cell["observation_outcome"].attrs["flag_meanings"].split())
        outcome = flags[cell["observation_outcome"].values]
        found: dict[str, Any] = {
            "observation_outcome": variable("observation", outcome, "1", "detection outcome"),
            "observation_seed": ("observation", cell["observation_seed"].values, {}),
        }
        steps, given = cell["observation_step"].values, cell["observation_magnitude"]
        ra, dec, _ = measured_directions(cell, self.sun, np.arange(steps.size))
        for key, values, unit, words in (
            ("magnitude", given.values, "mag", given.attrs["long_name"]),
            ("right_ascension", ra, "deg", "measured right ascension, ICRF, without light time"),
            ("declination", dec, "deg", "measured declination, ICRF, without light time"),
        ):
            found[f"observation_{key}"] = variable("observation", values, unit, words)
        return cell["step"].values[steps], found

    def observations(self, seed: int = 0) -> pd.DataFrame:
        """Measurements of a realization, with the names of ADES.

        Parameters
        ----------
        seed : int
            Index of the realization.

        Returns
        -------
        DataFrame
            In order of time: ``obsTime`` (UTC), ``stn`` (observer) with its position, ``artSat``
            (target), ``ra`` and ``dec`` (ICRF, deg), ``mag``, and their standard deviations; see
            `cislunar.exchange.observations`. Directions are geometric, without light time.

        Raises
        ------
        ConfigurationError
            If there is no such realization.
        """
        check_seed(self.cell, seed)
        return cell_observations(self.cell, self.sun, seed=seed)

    def plot(self, kind: str = "errors", target: str | None = None) -> Figure:
        """Draw a figure of the first realization.

        Parameters
        ----------
        kind : {"errors", "schedule", "light_curve", "geometry"}
            Errors with their 3-sigma bounds, targets of the observers over time, measured
            magnitudes over time, or orbits.
        target : str, optional
            Name of the target of errors or light curve; by default a few, or all.

        Returns
        -------
        matplotlib.figure.Figure

        Raises
        ------
        ConfigurationError
            If there is no such figure or target.
        """
        if kind not in self.plots:
            raise ConfigurationError(
                f"kind = {shown(kind)} is no figure of this result: choose one of "
                f"{', '.join(self.plots)}"
            )
        if target is not None and target not in self.targets:
            raise ConfigurationError(
                f"target = {shown(target)} is none of {', '.join(self.targets)}"
            )
        chosen = None if target is None else self.targets.index(target)
        return self.study.plot() if kind == "geometry" else self._drawn(kind, chosen)

    def _drawn(self, kind: str, target: int | None) -> Figure:
        """A figure of the data set."""
        from cislunar.figures.tracking import single_run

        if kind == "errors":
            return single_run.run_errors_figure(self.cell, target)
        names = self.study.observer_names
        if kind == "schedule":
            return single_run.schedule_figure(self.cell, names)
        return single_run.light_curve_figure(self.cell, names, target)

    def _write(self, ending: str, path: str | Path | None, *which: str, **given: Any) -> str:
        """The text of a format, written to a file if there is one."""
        (text,) = cell_messages(self.cell, self.sun, ending, *which, **given).values()
        if path is not None:
            write_text(text, path)
        return text

    def to_oem(self, path: str | Path | None = None, which: Which = "estimated", *, seed: int = 0,
               created: str = CREATED) -> str:  # fmt: skip
        """Write the states of all targets as a CCSDS OEM, estimates with their covariance, or those
        of the observers.

        Parameters
        ----------
        path : str or Path, optional
            File to write; none if omitted.
        which : {"estimated", "true", "observers"}
            Estimates, the simulated truth, or the observers.
        seed : int
            Index of the realization.
        created : str
            CREATION_DATE, ISO 8601, UTC. It is fixed by default, so that the same study gives the
            same file.

        Returns
        -------
        str
            The message.

        Raises
        ------
        ConfigurationError
            If there is no such realization, or `which` is unknown.
        InputFileError
            If the file cannot be written.
        """
        return self._write(".oem", path, which, seed=seed, created=created)

    def to_aem(self, path: str | Path | None = None, which: str = "estimated", *, seed: int = 0,
               created: str = CREATED) -> str:  # fmt: skip
        """Write the attitudes of all targets, estimated or true, as a CCSDS AEM; see `to_oem` for
        arguments and result."""
        return self._write(".aem", path, which, seed=seed, created=created)

    def to_tdm(self, path: str | Path | None = None, *, seed: int = 0, created: str = CREATED
               ) -> str:  # fmt: skip
        """Write the observations of a realization as a CCSDS TDM; see `observations` and
        `to_oem` for arguments and result."""
        table = self.study.observations
        return self._write(".tdm", path, seed=seed, created=created, table=table)

    def to_csv(self, path: str | Path | None = None, which: Which = "estimated", *, seed: int = 0
               ) -> str:  # fmt: skip
        """Write the states of all targets, or of the observers, as a table
        (`cislunar.exchange.state_tables`); see `to_oem` for arguments and result."""
        return self._write(".csv", path, which, seed=seed)

    def to_replay(self, path: str | Path | None = None, *, seed: int = 0) -> str:
        """Write an interactive page that replays a realization: observers with their fields of
        view, detections, tracks with their covariance and, on request, the truth.

        Parameters
        ----------
        path : str or Path, optional
            File to write; none if omitted.
        seed : int
            Index of the realization.

        Returns
        -------
        str
            HTML; see `cislunar.figures.replay`.

        Raises
        ------
        ConfigurationError
            If there is no such realization.
        InputFileError
            If the file cannot be written.
        """
        return self._write(".html", path, seed=seed)


def sigma_columns(sigma: Array) -> dict[str, Array]:
    """Columns (target,) of standard deviations (seed, target, 12), see
    `cislunar.estimation.estimator.Estimates`, in km, m/s and deg: root sums of squares of three
    components, root mean square over realizations."""
    sums = {
        part: factor * np.sqrt(np.mean(np.sum(sigma[..., columns] ** 2, axis=-1), axis=0))
        for part, (columns, factor, _) in _PARTS.items()
    }
    return {
        "position_sigma_km": sums["position"],
        "velocity_sigma_m_s": 1e3 * sums["velocity"],
        "attitude_sigma_deg": sums["attitude"],
    }


def _counted(status: NDArray[np.int64]) -> str:
    """Status of a target in all realizations, in words."""
    counts = {name: int(np.sum(status == k)) for k, name in enumerate(TARGET_STATUS_NAMES)}
    return ", ".join(
        name if count == len(status) else f"{name} ({count})"
        for name, count in counts.items()
        if count
    )
