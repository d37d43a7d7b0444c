"""Estimates of a study from observations without truth, and their residuals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from cislunar.campaign.data.inputs import variables
from cislunar.campaign.tracking.records import EPHEMERIS_FRAME, RECORD_COORDINATES, ROTATING
from cislunar.observation.measurement import measure
from cislunar.observation.records import Schedule
from cislunar.observation.scene import Scene
from cislunar.observation.sensor import ARCSECOND, sensors_of
from cislunar.observation.sightline import wrapped
from cislunar.runtime.arguments import Array
from cislunar.runtime.progress import Progress
from cislunar.study.messages import check_seed
from cislunar.study.observed import Observed, Reduced, reduce_interval
from cislunar.study.results import StudyResult, sigma_columns
from cislunar.tasking.histories import HISTORIES
from cislunar.tasking.initial_conditions import ESTIMATOR, stream
from cislunar.tasking.state import SimulationInputs

_ESTIMATED = (
    *("estimated_translation", "estimated_quaternion", "estimated_angular_velocity", "sigma"),
    "covariance",
)
"""Histories of the estimates."""
RESIDUALS = ("residual_magnitude", "residual_right_ascension", "residual_declination")
"""Variables of the residuals."""

_UNLIMITED_MAG = 99.0


def estimate(
    inputs: SimulationInputs,
    observed: Observed,
    rotation: Array | None,
    seed: int,
    progress: Progress,
    *,
    light_time: bool = True,
) -> xr.Dataset:
    """Estimates at the recorded times, and residuals of all observations.

    Parameters
    ----------
    inputs : SimulationInputs
        Scene, assumed bodies, settings, estimator and initial estimates; its truth is not used.
    observed : Observed
        The observations.
    rotation : ndarray, shape (3, 3), or None
        Rotation from the ICRF to the rotating frame at the epoch; None if the propagation frame has
        the axes of the ICRF.
    seed : int
        Seed of the random numbers of the estimator.
    progress : callable
        Called with (intervals done, all intervals).
    light_time : bool
        Whether to correct for light time; False for geometric directions.

    Returns
    -------
    Dataset
        Estimated states (nondimensional, propagation frame), attitudes, angular velocities and
        standard deviations by realization (one), time and target, and residuals by observation.
    """
    settings, forces = inputs.settings, inputs.forces
    turning = rotation is not None
    icrf = rotation.T @ inputs.scene.frame_axes if turning else np.eye(3)
    axes = np.empty_like(inputs.scene.observer_axes)
    axes[:] = icrf
    scene = inputs.scene._replace(observer_axes=axes)
    given = settings.sensor, inputs.initial, stream(ESTIMATOR, seed), forces
    estimator = inputs.factory(scene, inputs.surfaces, *given)
    kept: dict[str, list[Array]] = {}
    residual, used = np.full(observed.value.shape, np.nan), np.zeros(observed.target.size, bool)
    for number, start in enumerate(settings.epochs.tolist()):
        n_steps = min(settings.steps_per_interval, settings.n_steps - start)
        reduced = reduce_interval(
            observed, scene, float(turning), estimator, forces, start, n_steps, light_time
        )
        found = estimator.advance(reduced.measurements, covariance=True)
        residual[reduced.rows] = _residuals(inputs, scene, reduced, found, start)
        used[reduced.rows] = found.used
        some = settings.recorded_within(start, n_steps)
        for name in _ESTIMATED:
            values = getattr(found, name.removeprefix("estimated_"))
            kept.setdefault(name, []).append(values[:, some].swapaxes(0, 1))
        progress(number + 1, settings.epochs.size)
    frame = ROTATING if turning else EPHEMERIS_FRAME
    described: dict[str, tuple] = {}
    for name, parts in kept.items():
        each = HISTORIES[name]
        words = each.long_name.format(frame=frame)
        dims = "seed", each.along, *each.dims
        described[name] = dims, np.concatenate(parts)[None], each.unit, words
    data = variables(
        **described,
        failed=("target", estimator.failed.copy(), "1", "0, or the reason for a failed estimate"),
        observation_target=("observation", observed.target, "1", "index of the target"),
        observation_observer=("observation", observed.observer, "1", "index of the observer"),
        observation_magnitude=("observation", observed.value[:, 0], "mag", "measured magnitude"),
        observation_right_ascension=("observation", observed.value[:, 1], "rad",
                                     "measured right ascension, ICRF"),
        observation_declination=("observation", observed.value[:, 2], "rad",
                                 "measured declination, ICRF"),
        observation_elapsed=("observation", observed.elapsed_s, "s", "time since the epoch"),
        observation_used=("observation", used.astype(np.int8), "1", "1 if it was used"),
        residual_magnitude=("observation", residual[:, 0], "mag", "measured less estimated"),
        residual_right_ascension=("observation", residual[:, 1] / ARCSECOND, "arcsec",
                                  "measured less estimated, times cos(declination)"),
        residual_declination=("observation", residual[:, 2] / ARCSECOND, "arcsec",
                              "measured less estimated"),
        observer_position=(("observer", "step", "axis"), scene.observer_position[:, 1:], "1",
                           f"position of the observer, nondimensional, {frame}"),
    )  # fmt: skip
    elapsed = settings.step_s * (settings.recorded + 1.0)
    since = "time since the epoch"
    coords = variables(
        time=("time", elapsed, "s", since), step=("step", settings.elapsed_s[1:], "s", since)
    )
    dims = {dim for each in data.values() for dim in each.dims}
    coords |= variables(**{k: v for k, v in RECORD_COORDINATES.items() if k in dims})
    return xr.Dataset(data, coords)


def _residuals(
    inputs: SimulationInputs, scene: Scene, reduced: Reduced, found: Any, start: int
) -> Array:
    """Measured less estimated magnitude, right ascension (times cos(declination)) and declination
    of the measurements of an interval, (row, 3)."""
    rows = reduced.measurements
    sensors = sensors_of(inputs.settings.sensor, scene.observer_position.shape[0])
    open_limits = {"limiting_magnitude": _UNLIMITED_MAG}
    most = max(1, int(np.diff(rows.offset, axis=1).max(initial=0)))
    expected, _ = measure(
        start + 1,
        Schedule(rows.offset, rows.observer),
        scene,
        inputs.surfaces,
        tuple(each.model_copy(update=open_limits) for each in sensors),
        np.ascontiguousarray(found.translation),
        np.ascontiguousarray(found.quaternion),
        np.zeros((*found.translation.shape[:2], most, 3)),
        origin=start + 1,
    )
    apart = rows.value - expected.value
    apart[:, 1] = wrapped(apart[:, 1])
    apart[:, 1] *= np.cos(expected.value[:, 2])
    return apart


class ObservedResult(StudyResult):
    """Result of a study of real observations: estimates and residuals, and no errors."""

    plots = ("residuals", "geometry")

    def summary(self) -> pd.DataFrame:
        """One row for each target.

        Returns
        -------
        DataFrame
            By the name of the target: numbers of observations and of those that were used, date of
            the last one (UTC), root mean square residuals (arcsec, mag), and the standard
            deviations at the end.
        """
        cell = self.cell
        of, used = (cell[f"observation_{name}"].values for name in ("target", "used"))
        elapsed = cell["observation_elapsed"].values
        angles = np.hypot(
            cell["residual_right_ascension"].values, cell["residual_declination"].values
        )
        rows = []
        for j in range(len(self.targets)):
            own = of == j
            good = own & (used > 0)
            last = self.utc(elapsed[own][-1:])[0] if own.any() else pd.NaT
            residuals = _rms(angles[good]), _rms(cell["residual_magnitude"].values[good])
            rows.append((int(own.sum()), int(good.sum()), last, *residuals))
        names = ("observations", "used", "last", "residual_arcsec", "residual_mag")
        found = dict(zip(names, map(list, zip(*rows, strict=True)), strict=True))
        columns = found | sigma_columns(cell["sigma"].values[:, -1])
        return pd.DataFrame(columns, index=pd.Index(self.targets, name="target"))

    def observations(self, seed: int = 0) -> pd.DataFrame:
        """The observations that the study was given."""
        check_seed(self.cell, seed)
        return self.study.observations

    def _observed(self) -> tuple[Array, dict[str, Any]]:
        cell = self.cell
        names = ("observation_magnitude", "observation_used", *RESIDUALS)
        found = {name: (cell[name].dims, cell[name].values, cell[name].attrs) for name in names}
        return cell["observation_elapsed"].values, found

    def plot(self, kind: str = "residuals", target: str | None = None) -> Any:
        """Draw residuals over time, or the orbits ("geometry"); see `StudyResult.plot`."""
        return super().plot(kind, target)

    def _drawn(self, kind: str, target: int | None) -> Any:
        from cislunar.figures.tracking.single_run import residuals_figure

        return residuals_figure(self.cell, self.study.observer_names, target)


def _rms(values: Array) -> float:
    kept = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(kept**2))) if kept.size else float("nan")
