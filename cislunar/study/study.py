"""A study of user-defined observers and targets, from their orbits to figures and messages."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import xarray as xr

from cislunar.campaign.data.inputs import (
    bodies_dataset,
    orbit_set_dataset,
    sun_dataset,
    variables,
)
from cislunar.campaign.kernels import tracking_files
from cislunar.campaign.settings.cell_settings import cell_settings
from cislunar.campaign.settings.cell_tree import CellSettings
from cislunar.campaign.settings.cells import Cell, check_cell
from cislunar.campaign.settings.library import loop_settings
from cislunar.campaign.settings.reading import typed
from cislunar.campaign.settings.tracking_checks import require_consistent
from cislunar.campaign.tracking.cell import CellInputs, cell_ephemeris, cell_loop
from cislunar.campaign.tracking.dataset import SETTING_KEYS, cell_dataset
from cislunar.campaign.tracking.records import frame_epoch
from cislunar.constants import DATE_SYSTEM, TIME_UNIT_S
from cislunar.errors import CislunarError, ConfigurationError
from cislunar.exchange.inertial import epoch_at
from cislunar.exchange.key_values import dates
from cislunar.exchange.observation_files import observation_table
from cislunar.observation.sensor import sensors_of
from cislunar.orbits.families import OrbitSet, concatenate
from cislunar.orbits.observers import orbit_through
from cislunar.quantities import date_of
from cislunar.runtime.arguments import count_of, require_kind
from cislunar.runtime.compilation import announced
from cislunar.runtime.netcdf import write_text
from cislunar.runtime.progress import logger, progress_log, shown
from cislunar.runtime.provenance import provenance
from cislunar.runtime.settings_fields import shortened_interval
from cislunar.study.estimation import ObservedResult, estimate
from cislunar.study.objects import StudyObject, orbits_of_objects, read_objects
from cislunar.study.observed import Observed, read_observations
from cislunar.study.placement import flown_path, place_objects
from cislunar.study.results import StudyResult
from cislunar.study.settings import StudySettings, study_settings
from cislunar.tasking.detection_outcomes import SettingNames

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_NAMES = SettingNames(*(name.replace("task2.", "") for name in SETTING_KEYS))
"""Names of settings in warnings."""

_WORDS = {
    "configuration key ": "setting ",
    "task2.": "",
    "epoch_jd or duration_days": "epoch or duration_hours",
}
"""Words of the campaign, and those of a study."""


class Study:
    """Tasking and tracking of user-defined targets by user-defined observers.

    A scheduler assigns observers to targets, the observers take measurements, and one estimator
    determines orbit and attitude of every target. All arguments are checked before anything runs.

    Parameters
    ----------
    observers, targets : mapping, sequence, array_like, OrbitSet, str or Path
        Orbits by name, such as ``{"eye": "Halo_L2_S,period=6.56"}`` (period in days), states,
        tables or OEM files; see `cislunar.study.objects`. All results use these names.
    epoch : str, float or astropy.time.Time, optional
        UTC, ISO 8601 or Julian date; the paper's epoch if omitted.
    observations : DataFrame, str or Path, optional
        Real observations (`cislunar.study.observed`), a table or a file (CSV, ADES or TDM), from
        which `run` estimates orbits and attitudes, without a simulation. The dynamics are then
        those of the ephemeris unless ``truth`` or ``filter`` of ``dynamics`` state others.
    light_time : bool
        Whether the directions of `observations` are astrometric, that is, those of targets at the
        time at which the light left them; False if they are geometric.
    **settings
        ``duration_hours``, ``interval_minutes``, ``step_s``, ``sensor``, ``body``, ``dynamics``,
        ``estimator``, ``seeds`` and others; see `cislunar.study.settings.StudySettings`. Sections
        are mappings, or objects of their classes such as `cislunar.Sensor`. Quantities of
        `astropy.units` are converted.

    Attributes
    ----------
    observers, targets : list of StudyObject
    settings : StudySettings
    observations : DataFrame or None
        Real observations, as they were given.

    Raises
    ------
    ConfigurationError, InputFileError
        If an object, a setting or a file cannot be used; one line says how to correct it.

    Examples
    --------
    >>> study = Study({"eye": "Halo_L2_S,period=6.56"}, {"a": "Lyap_L2,period=15"})
    >>> study.targets[0].name
    'a'
    """

    def __init__(
        self,
        /,
        observers: Any,
        targets: Any,
        epoch: Any = None,
        *,
        observations: Any = None,
        light_time: bool = True,
        **settings: Any,
    ) -> None:
        given = settings if epoch is None else {**settings, "epoch": date_of(epoch)}
        require_kind("light_time", light_time, bool, "give True or False")
        stated = given.get("dynamics", {})
        if observations is not None and isinstance(stated, Mapping):
            truth = stated.get("truth", "ephemeris")
            given = {**given, "dynamics": {"truth": truth, "filter": truth, **stated}}
        self.observers: list[StudyObject] = []
        with self._own_words():
            chosen = study_settings(given)
            days = chosen.duration_hours / 24.0
            start = epoch_at(chosen.epoch, chosen.kernel)
            self.observers = read_objects("observer", observers, start, days)
            self.targets: list[StudyObject] = read_objects("target", targets, start, days)
            self.settings: StudySettings = self._with_sensors(chosen)
            self._check()
        self.observations: pd.DataFrame | None = None
        self._observed: Observed | None = None
        self._light_time = light_time
        if observations is not None:
            _check_single(chosen.seeds)
            sensors = sensors_of(self._loop(self._inputs())[1].sensor, self.n_observers)
            names = self.observer_names, [each.name for each in self.targets], sensors
            self.observations, *source = observation_table(observations)
            self._observed = read_observations(self.observations, *source, *names, start.tdb_s)
            last = float(self._observed.elapsed_s[-1])
            if last > 3600.0 * chosen.duration_hours:
                raise ConfigurationError(
                    f"observations: the last one is {last / 3600.0:.4g} h after the epoch, but "
                    f"duration_hours = {chosen.duration_hours:g}; raise duration_hours"
                )

    def __repr__(self) -> str:
        own = self.settings
        return (
            f"<Study of {len(self.targets)} targets by {self.n_observers} observers, "
            f"{own.duration_hours:g} h, estimator {own.estimator}>"
        )

    @property
    def n_observers(self) -> int:
        """Number of observers, including those on the ground."""
        return len(self.observers) + len(self.settings.stations)

    @property
    def observer_names(self) -> list[str]:
        """Names of the observers in space, followed by those on the ground."""
        return [*(each.name for each in self.observers), *self.settings.stations]

    def _described(self, found: xr.Dataset, sun: xr.Dataset, title: str) -> xr.Dataset:
        """A data set with its title, its epoch and the names of observers and targets."""
        known = [*(each.designator for each in self.observers), *self.settings.stations]
        words = "OBJECT_ID of its messages, or its name"
        names = variables(
            observer_name=("observer", self.observer_names, "1", "name"),
            observer_designator=("observer", known, "1", words),
            target_name=("target", [each.name for each in self.targets], "1", "name"),
            target_designator=("target", [each.designator for each in self.targets], "1", words),
        )
        (epoch,) = dates([frame_epoch(sun).tdb_s], DATE_SYSTEM)
        return found.assign_coords(names).assign_attrs(title=title, epoch=f"{epoch} {DATE_SYSTEM}")

    def _with_sensors(self, settings: StudySettings) -> StudySettings:
        """The settings with a group of sensors for each observer with a sensor of its own."""
        groups: dict[str, Any] = {}
        for number, each in enumerate(self.observers):
            if each.sensor:
                groups[f"observer-{number}"] = {"observers": [number], "sensor": each.sensor}
        if not groups:
            return settings
        whole = settings.model_dump()
        return study_settings({**whole, "sensors": {**whole["sensors"], **groups}})

    @property
    def _cell(self) -> Cell:
        own = self.settings
        return Cell("study", "own", own.estimator, len(self.targets), own.interval_minutes)

    @property
    def _kept(self) -> dict[str, Any]:
        """Settings of the cell, as results keep them."""
        return cell_settings(self.settings.model_dump())

    def _check(self) -> None:
        """Refuse settings that do not fit each other."""
        own = self.settings
        if own.start_day:
            raise ConfigurationError("start_day: a study begins at its epoch; change epoch")
        twice = {each.name for each in self.observers} & own.stations.keys()
        if twice:
            name = min(twice)
            raise ConfigurationError(f"stations: {name!r} is an observer already; rename one")
        cell = typed(self._kept, CellSettings)
        require_consistent("", cell, own.interval_minutes, self._days, "interval_minutes")
        check_cell(self._cell, cell, len(self.targets))
        # targets, sensors and settings of the loop, which nothing else checks before a run
        self._loop(self._inputs())
        if shortened := shortened_interval(own.duration_hours, own.interval_minutes):
            with shown():
                logger.warning("warning: %s", shortened)

    @contextmanager
    def _own_words(self) -> Iterator[None]:
        """Errors of the campaign with the keys of a study."""
        try:
            yield
        except CislunarError as error:
            message, own = str(error), dict(_WORDS)
            for number, each in enumerate(self.observers):
                own[f"sensors.observer-{number}."] = f"observers.{each.name}."
            for old, new in own.items():
                message = message.replace(old, new)
            raise type(error)(message) from None

    @property
    def _days(self) -> float:
        return self.settings.duration_hours / 24.0

    def _inputs(self) -> CellInputs:
        """Data sets of the cell."""
        own, needs = self.settings, self.settings.dynamics.truth == "ephemeris"
        given = {
            "epoch_jd": own.epoch,
            "ephemeris": {"kernel": own.kernel, "step_minutes": 10},
            "visibility": {"duration_days": self._days},
        }
        bodies = bodies_dataset(given) if needs or own.stations else None
        rows = np.arange(len(self.observers))
        chosen = xr.Dataset({"orbit": ("slot", rows), "satellites": ("slot", np.ones_like(rows))})
        observed = orbits_of_objects(self.observers, "orbit")
        tracked = orbits_of_objects(self.targets, "target")
        return CellInputs(chosen, observed, tracked, sun_dataset(given), bodies)

    def _placement(self, inputs: CellInputs) -> Any:
        own = typed(self._kept, CellSettings)
        ephemeris = cell_ephemeris(inputs.bodies, own) if inputs.bodies is not None else None
        moving = ephemeris if own.dynamics.truth == "ephemeris" else None
        loop = loop_settings(own, self.settings.interval_minutes)
        epoch = frame_epoch(inputs.sun)
        return place_objects(self.observers, self.targets, own, loop, epoch, moving)

    def _loop(self, inputs: CellInputs) -> Any:
        placement = self._placement(inputs)
        given = {"propagator": "dop853", "seed": self.settings.seed, "placement": placement}
        return cell_loop(self._cell, inputs, self._kept, **given)

    def paths(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """Paths of observers and targets, for figures.

        Returns
        -------
        observers, targets : dict of str to (ndarray, ndarray)
            By name, the position at the epoch, shape (3,), and the path, shape (time, 3): one
            period of a closed orbit, else that of the run, of an observer with an ephemeris its
            own; nondimensional, rotating frame of the CR3BP.
        """
        run_s = self.settings.duration_hours * 3600.0
        epoch = epoch_at(self.settings.epoch, self.settings.kernel)
        flown = (flown_path(each, epoch, run_s) for each in self.observers)
        coasting = (each.path(run_s / TIME_UNIT_S) for each in self.targets)
        return tuple(
            {each.name: (each.state[:3], path) for each, path in zip(objects, paths, strict=True)}
            for objects, paths in ((self.observers, flown), (self.targets, coasting))
        )

    def plot(self) -> Figure:
        """Draw the orbits of observers and targets in space.

        Closed orbits are drawn over a period, others over the run, in the rotating frame.

        Returns
        -------
        matplotlib.figure.Figure
        """
        from cislunar.figures.space.geometry import geometry_figure

        return geometry_figure(*self.paths())

    def page(self, path: str | Path | None = None) -> str:
        """Interactive page of the orbits in three dimensions, with targets that move for a day.

        Observers on orbits that are not closed are not shown.

        Parameters
        ----------
        path : str or Path, optional
            File to write; none if omitted.

        Returns
        -------
        str
            HTML.

        Raises
        ------
        InputFileError
            If the file cannot be written.
        """
        from cislunar.figures.space.orbits_page import orbits_page

        given = ((each.name, each.state, each.period) for each in self.observers)
        found = [orbit_through(*each) for each in given if each[2] > 0.0]
        nothing = OrbitSet(np.empty(0, str), np.empty((0, 6)), *np.empty((5, 0)))
        closed = concatenate(found) if found else nothing
        orbits = orbit_set_dataset(closed, "orbit", "Observers of a study", {})
        text = orbits_page(orbits, orbits_of_objects(self.targets, "target"), {}, {})
        if path is not None:
            write_text(text, path)
        return text

    def run(self, seeds: int | None = None) -> StudyResult:
        """Simulate the study, or estimate from its observations.

        Progress with the remaining time is logged to ``cislunar``, or shown on the terminal if no
        logging is configured. Kernels that are not yet compiled are compiled first.

        Parameters
        ----------
        seeds : int, optional
            Number of realizations of truth and noise; ``settings.seeds`` if omitted, and 1 with
            `observations`.

        Returns
        -------
        StudyResult
            With `observations` an `ObservedResult`, which has residuals in place of errors.

        Raises
        ------
        ConfigurationError, InputFileError
            If `seeds` is impossible, or an ephemeris cannot be used.
        """
        count = self.settings.seeds if seeds is None else count_of("seeds", seeds)
        if self._observed is not None:
            _check_single(count)
            return self._estimated()
        inputs, kept = self._inputs(), {**self._kept, "seeds": count}
        with self._own_words(), _shown(kept, self.settings.estimator):
            found = cell_dataset(
                self._cell,
                inputs,
                kept,
                propagator="dop853",
                seed=self.settings.seed,
                progress=progress_log("tasking epochs of all realizations"),
                placement=self._placement(inputs),
                names=_NAMES,
            )
        title = f"Study of {len(self.targets)} targets by {self.n_observers} observers"
        return StudyResult(self, self._described(found, inputs.sun, title), inputs.sun)

    def _estimated(self) -> ObservedResult:
        """Estimates from the observations."""
        inputs, kept = self._inputs(), self._kept
        moving = self.settings.dynamics.truth == "ephemeris"
        rotation = None if moving else frame_epoch(inputs.sun).rotation
        with _shown(kept, self.settings.estimator):
            loop = self._loop(inputs)[0]
            given = self._observed, rotation, self.settings.seed, progress_log("intervals")
            found = estimate(loop.inputs, *given, light_time=self._light_time)
        title = f"Estimates of {len(self.targets)} targets from observations"
        found.attrs |= provenance(title, settings=kept, seed=self.settings.seed)
        return ObservedResult(self, self._described(found, inputs.sun, title), inputs.sun)


def _check_single(seeds: int) -> None:
    """Refuse several realizations of real observations."""
    if seeds != 1:
        raise ConfigurationError(
            f"seeds = {seeds}: observations have one realization; leave it out"
        )


@contextmanager
def _shown(settings: Mapping[str, Any], estimator: str) -> Iterator[None]:
    """Show progress on the terminal if no logging is configured, and that of compilation."""
    with shown(), announced(tracking_files(settings, estimator)):
        yield
