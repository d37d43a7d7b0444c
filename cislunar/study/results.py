"""Results of a study: summary, labeled data in practical units, figures and messages."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from cislunar.campaign.tracking.records import cell_arcs, cell_observations, observer_names
from cislunar.constants import DATE_SYSTEM, LENGTH_UNIT_KM, TIME_UNIT_S
from cislunar.ephemeris.time_scales import clock_text, tdb_after, tdb_to_clock
from cislunar.errors import ConfigurationError
from cislunar.evaluation.custody import attitude_angle_deg
from cislunar.evaluation.metrics import STATUS_NAMES
from cislunar.exchange.arcs import COMMENTS
from cislunar.exchange.oem import oem_text
from cislunar.exchange.state_tables import segments_csv
from cislunar.exchange.tdm import tdm_text
from cislunar.runtime.netcdf import write_text
from cislunar.runtime.settings_words import shown
from cislunar.tasking.realization import USED

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

_SPEED_KM_S = LENGTH_UNIT_KM / TIME_UNIT_S
_DEG_H = float(np.rad2deg(3600.0))
_CREATED = "2000-01-01T00:00:00"


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
        return np.array([clock_text(each) for each in self._clock(elapsed_s)], "datetime64[us]")

    def _clock(self, elapsed_s: Any) -> Array:
        epoch = float(self.sun["et"].values[0])
        return tdb_to_clock(tdb_after(epoch, elapsed_s), DATE_SYSTEM)

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
        last = {name: cell[name].values[:, -1].astype(float) for name in ("error", "sigma")}
        columns: dict[str, Any] = {"family": [each.family for each in self.study.targets]}
        status = cell["status"].values
        columns["status"] = [
            ", ".join(
                name if count == len(status) else f"{name} ({count})"
                for name, count in (
                    (name, int(np.sum(status[:, j] == k))) for k, name in enumerate(STATUS_NAMES)
                )
                if count
            )
            for j in range(status.shape[1])
        ]
        columns["measurements"] = np.mean(np.sum(cell["outcome"].values == USED, axis=1), axis=0)
        error = last["error"]
        norms = {
            "position_error_km": np.linalg.norm(error[..., 6:9], axis=-1) * LENGTH_UNIT_KM,
            "velocity_error_m_s": np.linalg.norm(error[..., 9:], axis=-1) * 1e3 * _SPEED_KM_S,
            "attitude_error_deg": attitude_angle_deg(error),
        }
        columns |= {key: np.sqrt(np.mean(each**2, axis=0)) for key, each in norms.items()}
        columns |= sigma_columns(last["sigma"])
        return pd.DataFrame(columns, index=pd.Index(self.targets, name="target"))

    def to_xarray(self) -> xr.Dataset:
        """Estimates, errors, assignments and observations, labeled, in practical units.

        Returns
        -------
        Dataset
            Times are dates in UTC, targets and observers have their names. Positions are in km and
            velocities in km/s in the frame that the attribute `frame` states, attitude errors in
            degrees as rotation vectors, angular velocities in deg/h. A covariance is in km^2,
            km^2/s and km^2/s^2.
        """
        cell, scale = self.cell, np.repeat([LENGTH_UNIT_KM, _SPEED_KM_S], 3)
        parts = {
            "attitude": (slice(0, 3), "deg"),
            "angular_velocity": (slice(3, 6), "deg/h"),
            "position": (slice(6, 9), "km"),
            "velocity": (slice(9, 12), "km/s"),
        }
        factors = (np.rad2deg(1.0), _DEG_H, LENGTH_UNIT_KM, _SPEED_KM_S)
        rows, found = ("seed", "time", "target"), {}
        for name, words in (("error", "truth less estimate"), ("sigma", "standard deviation")):
            if name not in cell:
                continue
            for (part, (columns, unit)), factor in zip(parts.items(), factors, strict=True):
                values = cell[name].values[..., columns].astype(float) * factor
                if (name, part) == ("error", "attitude"):
                    values = _rotation_deg(cell[name].values[..., columns].astype(float))
                found[f"{part}_{name}"] = (
                    (*rows, "axis"), values, {"units": unit, "long_name": f"{part}: {words}"}
                )  # fmt: skip
        vectors = ("position", slice(0, 3), "km"), ("velocity", slice(3, 6), "km/s")
        for which in ("true", "estimated"):
            if f"{which}_translation" not in cell:
                continue
            states = cell[f"{which}_translation"].values * scale
            for part, some, unit in vectors:
                described = {"units": unit, "long_name": f"{which} {part}"}
                found[f"{which}_{part}"] = ((*rows, "axis"), states[..., some], described)
            found[f"{which}_quaternion"] = (
                (*rows, "quaternion"), cell[f"{which}_quaternion"].values,
                {"units": "1", "long_name": f"{which} attitude, inertial frame to body frame"},
            )  # fmt: skip
        found["covariance"] = (
            (*rows, "component", "component_2"),
            cell["covariance"].values * np.outer(scale, scale),
            {"units": "km, km/s", "long_name": "covariance of position and velocity"},
        )
        if "assignment" in cell:
            found["assigned_target"] = self._assigned()
        found |= self._observed()
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
        moving = self._inertial
        frame = "barycentric, J2000 axes" if moving else "rotating, Earth-Moon barycenter"
        attrs = {key: cell.attrs[key] for key in ("title", "source", "settings", "seed")}
        return xr.Dataset(found, coords, {**attrs, "frame": frame, "time_scale": "UTC"})

    def _assigned(self) -> tuple:
        """Names of the targets of each observer; empty for an idle one."""
        given = self.cell["assignment"]
        names = np.array([*self.targets, ""])
        dims = tuple(given.dims)
        return dims, names[given.values], {"units": "1", "long_name": "target of the observer"}

    def _observed(self) -> dict[str, tuple]:
        """Columns of the observations."""
        cell = self.cell
        at = cell["observation_step"].values
        names = {"target": self.targets, "observer": self.study.observer_names}
        found: dict[str, tuple] = {
            "observation_time": (
                "observation", self.utc(cell["step"].values)[at], {"long_name": "date, UTC"})
        }  # fmt: skip
        for key, own in names.items():
            found[f"observation_{key}"] = (
                "observation", np.array(own)[cell[f"observation_{key}"].values],
                {"units": "1", "long_name": f"name of the {key}"},
            )  # fmt: skip
        flags = np.array(cell["observation_outcome"].attrs["flag_meanings"].split())
        found["observation_outcome"] = (
            "observation", flags[cell["observation_outcome"].values],
            {"units": "1", "long_name": "detection outcome"},
        )  # fmt: skip
        found["observation_seed"] = ("observation", cell["observation_seed"].values, {})
        for key, unit, factor in (
            ("magnitude", "mag", 1.0),
            ("right_ascension", "deg", np.rad2deg(1.0)),
            ("declination", "deg", np.rad2deg(1.0)),
        ):
            found[f"observation_{key}"] = (
                "observation", cell[f"observation_{key}"].values * factor,
                {"units": unit, "long_name": cell[f"observation_{key}"].attrs["long_name"]},
            )  # fmt: skip
        return found

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
        """
        self._check_seed(seed)
        table = cell_observations(self.cell, self.sun, seed=seed)
        names = self.study.observer_names
        own = dict(zip(observer_names(len(names)), names, strict=True))
        return table.assign(stn=table["stn"].map(own))

    @property
    def _inertial(self) -> bool:
        """Whether the propagation frame has the axes of the ICRF."""
        return self.study.settings.dynamics.truth == "ephemeris"

    def _index(self, target: str | None) -> int | None:
        """Index of a target by its name."""
        if target is not None and target not in self.targets:
            raise ConfigurationError(
                f"target = {shown(target)} is none of {', '.join(self.targets)}"
            )
        return None if target is None else self.targets.index(target)

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
        """
        if kind not in self.plots:
            raise ConfigurationError(
                f"kind = {shown(kind)} is no figure of a study: choose one of "
                f"{', '.join(self.plots)}"
            )
        chosen = self._index(target)
        if kind == "geometry":
            return self.study.plot()
        from cislunar.figures.tracking import single_run

        if kind == "errors":
            return single_run.run_errors_figure(self.cell, chosen)
        names = self.study.observer_names
        if kind == "schedule":
            return single_run.schedule_figure(self.cell, names)
        return single_run.light_curve_figure(self.cell, names, chosen)

    def _check_seed(self, seed: int) -> None:
        if not isinstance(seed, int) or not 0 <= seed < self.cell.sizes["seed"]:
            raise ConfigurationError(
                f"seed = {shown(seed)}: the realizations are 0 .. {self.cell.sizes['seed'] - 1}"
            )

    def _arcs(self, which: str, seed: int) -> list:
        self._check_seed(seed)
        if which not in ("estimated", "true"):
            raise ConfigurationError(f"which = {shown(which)} must be 'estimated' or 'true'")
        return cell_arcs(self.cell, self.sun, which, seed=seed)

    def to_oem(self, path: str | Path | None = None, which: Literal["estimated", "true"] =
               "estimated", *, seed: int = 0, created: str = _CREATED) -> str:  # fmt: skip
        """Write the states of all targets as a CCSDS OEM, estimates with their covariance.

        Parameters
        ----------
        path : str or Path, optional
            File to write; none if omitted.
        which : {"estimated", "true"}
            Estimates, or the simulated truth.
        seed : int
            Index of the realization.
        created : str
            CREATION_DATE, ISO 8601, UTC. It is fixed by default, so that the same study gives the
            same file.

        Returns
        -------
        str
            The message.
        """
        moving = self._inertial
        comments = () if moving else COMMENTS
        text = oem_text(self._arcs(which, seed), created=created, comments=comments)
        return _save(text, path)

    def to_tdm(self, path: str | Path | None = None, *, seed: int = 0, created: str = _CREATED
               ) -> str:  # fmt: skip
        """Write the observations of a realization as a CCSDS TDM; see `observations` and
        `to_oem` for arguments and result."""
        return _save(tdm_text(self.observations(seed), created=created), path)

    def to_csv(self, path: str | Path | None = None, which: Literal["estimated", "true"] =
               "estimated", *, seed: int = 0) -> str:  # fmt: skip
        """Write the states of all targets as a table (`cislunar.exchange.state_tables`); see
        `to_oem` for arguments and result."""
        return _save(segments_csv(self._arcs(which, seed)), path)


def sigma_columns(sigma: Array) -> dict[str, Array]:
    """Columns of standard deviations in practical units.

    Parameters
    ----------
    sigma : ndarray, shape (seed, target, 12)
        See `cislunar.estimation.estimator.Estimates`.

    Returns
    -------
    dict of str to ndarray, shape (target,)
        Root sums of squares of three components, root mean square over realizations.
    """
    given = np.asarray(sigma, dtype=float)
    units = {
        "position_sigma_km": (slice(6, 9), LENGTH_UNIT_KM),
        "velocity_sigma_m_s": (slice(9, 12), 1e3 * _SPEED_KM_S),
        "attitude_sigma_deg": (slice(0, 3), np.rad2deg(1.0)),
    }
    return {
        key: unit * np.sqrt(np.mean(np.sum(given[..., part] ** 2, axis=-1), axis=0))
        for key, (part, unit) in units.items()
    }


def _save(text: str, path: str | Path | None) -> str:
    if path is not None:
        write_text(text, path)
    return text


def _rotation_deg(error: Array) -> Array:
    """Rotation vectors, deg, of attitude errors (GRP)."""
    length = np.linalg.norm(error, axis=-1)
    angle = attitude_angle_deg(error) / np.where(length > 0.0, length, 1.0)
    return error * angle[..., None]
