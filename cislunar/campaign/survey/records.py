"""Record of a realization of a survey, in the layout of a cell, for its replay and for exports.

Each object has a row with the confirmed orbit that most of its detections belong to, if there is
one. Further confirmed orbits, those of false alarms and second ones of an object, have rows after
those of the objects. The truth assigns rows to orbits, and nothing else of the record that is not
named true depends on it.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from cislunar.campaign.tracking.cell import Problem
from cislunar.campaign.tracking.records import (
    EPHEMERIS_FRAME,
    RECORD_COORDINATES,
    ROTATING,
    observer_variables,
)
from cislunar.detection import FALSE_ALARM
from cislunar.dynamics import EphemerisForces
from cislunar.orbit_determination import OrbitStates, orbits_at
from cislunar.runtime import Indices, variable
from cislunar.runtime.arguments import Array
from cislunar.survey import BlockRecord, CatalogRecord
from cislunar.tasking import MANEUVER_VARIABLES, OBSERVATION_COLUMNS, RECOVERED_VARIABLES

ORBIT_STATUSES = ("no_orbit", "candidate", "confirmed")
"""Meaning of the variable ``track_status`` of the record of a survey."""


class SurveyRecorder:
    """Collects the blocks of a survey (`cislunar.survey.run_survey`) as its argument `record`.

    Parameters
    ----------
    problem : Problem
    names : sequence of str
        Of the objects.
    appears_hours : ndarray, shape (object,)
        Hours after the start from which each object exists.
    attributes : mapping
        Global attributes of the data set.
    minutes : float
        Time between two recorded states.
    radiation_sigma : float
        Standard deviation of the factor of the radiation pressure on an object, for predictions.
    """

    def __init__(
        self,
        problem: Problem,
        names: Sequence[str],
        appears_hours: Array,
        attributes: Mapping[str, Any],
        minutes: float = 5.0,
        radiation_sigma: float = 0.0,
    ) -> None:
        self._radiation_sigma = radiation_sigma
        self._scene, self._forces, self._ids = problem.scene, problem.forces, problem.target_ids
        self._names, self._attributes = list(names), dict(attributes)
        self._appears_s = 3600.0 * np.asarray(appears_hours, dtype=float)
        self._every = max(1, round(60.0 * minutes / self._scene.step_s))
        self._index: list[int] = []
        self._truth: list[Array] = []
        self._estimates: list[tuple[Indices, Array, Array]] = []
        self._pointing: list[Array] = []
        self._detections: list[tuple[Indices, Indices, Array, Array]] = []
        self._links: list[tuple[int, Indices]] = []
        self._held: dict[int, int] = {}
        self._rows = np.empty(0, dtype=np.int64)
        self._starts = OrbitStates(
            np.empty(0), np.empty((0, 6)), np.empty((0, 6, 6)), np.empty((0, 6))
        )
        self._catalog: CatalogRecord | None = None
        self._block: BlockRecord | None = None

    def __call__(self, block: BlockRecord) -> None:
        """Take up a block."""
        start, exposures = block.first - 1, block.exposures
        last = start + block.state.shape[1] - 1
        for index in range(start + self._every - start % self._every, last + 1, self._every):
            self._index.append(index)
            self._truth.append(block.state[:, index - start].copy())
            self._estimates.append(self._predicted(index))
            # the last field of an observer since the recorded time before
            recent = (block.first + exposures.step <= index) & (
                block.first + exposures.step > index - self._every
            )
            aims = np.full((self._scene.observer_position.shape[0], 2), np.nan)
            aims[exposures.observer[recent]] = exposures.boresight[recent]
            self._pointing.append(aims)
        of = block.detections.exposure
        self._detections.append(
            (start + exposures.step[of], exposures.observer[of], block.detections.value,
             block.detections.variance)
        )  # fmt: skip
        self._block = block._replace(state=block.state[:, -1:].copy())
        if block.catalog is not None:
            self._take(block.catalog, last)

    def _predicted(self, index: int) -> tuple[Indices, Array, Array]:
        """Rows, states and covariances of the confirmed orbits at a time."""
        time = index * self._scene.step
        states, kept = orbits_at(self._starts, time, self._forces, self._radiation_sigma)
        self._rows, self._starts = self._rows[kept], states
        return self._rows, states.state, states.covariance

    def _take(self, catalog: CatalogRecord, index: int) -> None:
        """Take up the catalog after a linking run, with the rows of its orbits."""
        n, fits = len(self._names), catalog.orbits.fits
        status, rows, further = np.zeros(n, dtype=np.int64), {}, n
        for k, owner in enumerate(catalog.owner.tolist()):
            if not catalog.orbits.confirmed[k]:
                continue
            if owner == FALSE_ALARM or status[owner] == 2:
                rows[k], further = further, further + 1
            else:
                rows[k], status[owner] = owner, 2
        candidates = catalog.owner[~catalog.orbits.confirmed & (catalog.owner != FALSE_ALARM)]
        status[candidates] = np.maximum(status[candidates], 1)
        self._links.append((index, np.append(status, np.full(further - n, 2))))
        self._rows = np.array(list(rows.values()), dtype=np.int64)
        self._starts = OrbitStates.of(fits.take(list(rows)))
        self._held, self._catalog = rows, catalog

    def dataset(self) -> xr.Dataset:
        """The record, with the variables of a cell that has one realization.

        Returns
        -------
        xarray.Dataset
            ``observation_target`` is the row of the orbit that has the detection in the end, or -1.
            ``epoch`` are the times since which detections are linked together, and ``track_status``
            is the state of each row (`ORBIT_STATUSES`) after the linking run. Maneuvers that are
            found are those of the last catalog.
        """
        scene, n = self._scene, len(self._names)
        width = max([n, *(status.size for _, status in self._links)])
        count, index = len(self._index), np.array(self._index)
        times = scene.step_s * index
        truth, state = (np.full((1, count, width, 6), np.nan) for _ in range(2))
        covariance = np.full((1, count, width, 6, 6), np.nan)
        for k, (rows, states, covariances) in enumerate(self._estimates):
            truth[0, k, :n] = np.where(
                (times[k] >= self._appears_s)[:, None], self._truth[k], np.nan
            )
            state[0, k, rows], covariance[0, k, rows] = states, covariances
        status = np.zeros((1, len(self._links), width), dtype=np.uint8)
        for k, (_, own) in enumerate(self._links):
            status[0, k, : own.size] = own
        ends = scene.step_s * np.array([0, *(link for link, _ in self._links)])
        frame = EPHEMERIS_FRAME if isinstance(self._forces, EphemerisForces) else ROTATING
        names = [*self._names, *(f"further orbit {k + 1}" for k in range(width - n))]
        place = ("seed", "time", "target")
        flags = {
            "flag_values": np.arange(3, dtype=np.uint8), "flag_meanings": " ".join(ORBIT_STATUSES)
        }  # fmt: skip
        variables = {
            "target_name": variable("target", np.array(names), "1", "name of the object or orbit"),
            "target_id": variable(
                "target", np.append(self._ids, np.full(width - n, -1)), "1",
                "row of the object among the moving targets; -1 for further orbits"),
            "true_translation": variable(
                (*place, "translation"), truth, "1", f"true position and velocity, {frame}"),
            "estimated_translation": variable(
                (*place, "translation"), state, "1",
                f"position and velocity of the confirmed orbit, {frame}"),
            "covariance": variable(
                (*place, "translation", "translation_2"), covariance, "1",
                f"covariance of the estimated position and velocity, {frame}"),
            "pointing": variable(
                ("seed", "time", "observer", "angle"), np.array(self._pointing)[None], "rad",
                "direction of the last field, observer's body frame; NaN for an idle observer"),
            "track_status": variable(
                ("seed", "epoch", "target"), status, "1", "orbit in the catalog", **flags),
        }  # fmt: skip
        variables |= self._observations() | self._maneuvers()
        variables |= {
            name: variable(*each)
            for name, each in observer_variables(["measurements"], scene, frame).items()
        }
        steps = scene.step_s * np.arange(1, scene.sun_position.shape[0])
        coords = {
            "time": variable("time", times, "s", "time since the start"),
            "step": variable("step", steps, "s", "time since the start"),
            "epoch": variable("epoch", ends[:-1], "s", "start of an interval between two links"),
        }
        dims = {dim for each in variables.values() for dim in each.dims}
        coords |= {
            name: variable(*each) for name, each in RECORD_COORDINATES.items() if name in dims
        }
        return xr.Dataset(variables, coords=coords, attrs=self._attributes)

    def _observations(self) -> dict[str, xr.Variable]:
        """Detections, each with the row of the orbit that has it in the end."""
        step, observer, value, variance = (
            np.concatenate(each) for each in zip(*self._detections, strict=True)
        )
        target = np.full(step.size, -1, dtype=np.int64)
        if self._catalog is not None:
            for k, row in self._held.items():
                target[self._catalog.orbits.detections(k)] = row
        columns = {
            "seed": np.zeros_like(step), "step": step, "target": target, "observer": observer,
            "magnitude": value[:, 0], "right_ascension": value[:, 1], "declination": value[:, 2],
            "magnitude_variance": variance[:, 0], "angle_variance": variance[:, 1],
        }  # fmt: skip
        described = {name: OBSERVATION_COLUMNS[f"observation_{name}"] for name in columns}
        return {
            f"observation_{name}": variable(
                "observation", values, described[name].unit, described[name].long_name
            )
            for name, values in columns.items()
        }

    def _maneuvers(self) -> dict[str, xr.Variable]:
        """True maneuvers, and those that the last catalog has."""
        flown, made = self._block.maneuvers, self._block.velocity_changes_m_s
        zero = np.zeros_like(flown.target)
        columns = dict(zip(
            MANEUVER_VARIABLES, (zero, flown.target, flown.start_s, flown.duration_s, made),
            strict=True,
        ))  # fmt: skip
        found = {key: ("maneuver", each) for key, each in columns.items()}
        lineage = None if self._catalog is None else self._catalog.maneuvers
        if lineage is not None:
            owner = self._catalog.owner
            rows = np.array(
                [self._held.get(k, owner[k]) for k in lineage.after.tolist()], dtype=np.int64
            )
            known = np.flatnonzero(rows >= 0)
            per_s = self._scene.step_s / self._scene.step
            columns = {
                "recovered_seed": np.zeros_like(known), "recovered_target": rows[known],
                "recovered_time": per_s * lineage.time[known],
                "recovered_time_sigma": per_s * lineage.time_sigma[known],
                "recovered_velocity": lineage.velocity_m_s[known],
                "recovered_covariance": lineage.velocity_covariance[known],
                "recovered_probability": lineage.probability[known],
            }  # fmt: skip
            found |= {key: ("recovered_maneuver", each) for key, each in columns.items()}
        described = MANEUVER_VARIABLES | RECOVERED_VARIABLES
        return {
            key: variable((dim, *described[key][0]), each, *described[key][1:])
            for key, (dim, each) in found.items()
        }
