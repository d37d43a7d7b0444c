"""References: catalogs from the public files of a benchmark alone, written as submissions.

The detections are replayed in order of time. At each scoring epoch a catalog links those that have
been made by then, and its orbits are propagated to the epoch. An orbit keeps its name from one
epoch to the next if most of its detections that were in the catalog belonged to an orbit of that
name.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from cislunar.benchmark.baseline import NearestNeighborCatalog
from cislunar.benchmark.files import (
    BenchmarkScenario,
    PublicData,
    dates,
    icrf_scene,
    new_folder,
    read_public_data,
    read_scenario,
)
from cislunar.benchmark.submission import ASSIGNMENTS, OBJECTS
from cislunar.constants import LENGTH_UNIT_KM, TIME_UNIT_S
from cislunar.detection import Exposures
from cislunar.dynamics import EphemerisForces, propagate_stm
from cislunar.ephemeris import BODY_COLUMNS, read_table
from cislunar.errors import CislunarError, ConvergenceError
from cislunar.exchange import Segment, inertial_arc, oem_text
from cislunar.observation import Scene, sensor_limits
from cislunar.orbit_determination import (
    AdmissibleRegion,
    LinkingSettings,
    OrbitFits,
    TrackletSettings,
)
from cislunar.runtime import counted
from cislunar.runtime.arguments import Array, require_choice
from cislunar.runtime.netcdf import write_text
from cislunar.survey import LineageSettings, SurveyCatalog

REFERENCE_METHODS = ("survey-catalog", "nearest-neighbor")
"""Of `cislunar.survey.SurveyCatalog` and of `NearestNeighborCatalog`."""

STATES = "states.oem"


_MANEUVERS = LineageSettings(maneuvers_per_day=0.1)
"""A third of the true rate, as in the study of surveys: a catalog does not know the rate."""


class _ConfirmedOrbits(SurveyCatalog):
    """A catalog of a survey, of which the confirmed orbits are in the submission."""

    def __init__(
        self, scenario: BenchmarkScenario, forces: EphemerisForces, public: PublicData
    ) -> None:
        survey, names = scenario.survey, np.array(scenario.observers)
        linking = LinkingSettings(expected_objects=survey.prior.expected_objects)
        region, tracklets = AdmissibleRegion(), TrackletSettings()
        table = public.exposures
        self.exposures = Exposures(
            np.rint((table["tdb"] - forces.epoch) / scenario.step_s).to_numpy(dtype=np.int64),
            np.searchsorted(names, table["stn"].to_numpy().astype(str)),
            np.deg2rad(table[["ra", "dec"]].to_numpy()),
            np.deg2rad(0.5 * table["fieldDeg"].to_numpy()),
            table["limMag"].to_numpy(),
        )
        scene = _scene(self.exposures, table, names.size, scenario.step_s, forces)
        super().__init__(
            scene, forces, survey.process, region, linking, tracklets, lineage=_MANEUVERS,
            limits=sensor_limits(scenario.sensor, names.size),
            magnitude_sigma=survey.magnitude_sigma,
        )  # fmt: skip

    def confirmed_fits(self) -> OrbitFits:
        """Link all detections so far."""
        orbits = self.link()
        return orbits.fits.take(np.flatnonzero(orbits.confirmed))


def _scene(
    exposures: Exposures, table: pd.DataFrame, n: int, step_s: float, forces: EphemerisForces
) -> Scene:
    """Scene in ICRF axes, with the observers where their exposures state it, and in between."""
    steps = np.arange(int(exposures.step.max()) + 1)
    bodies = read_table(forces.table, forces.epoch + step_s * steps)[0] / LENGTH_UNIT_KM
    place = table[["pos1", "pos2", "pos3"]].to_numpy() / LENGTH_UNIT_KM
    place = place + bodies[exposures.step, BODY_COLUMNS["earth"]]
    tracks = np.zeros((n, steps.size, 3))
    for o in np.unique(exposures.observer).tolist():
        own = exposures.observer == o
        for c in range(3):
            tracks[o, :, c] = np.interp(steps, exposures.step[own], place[own, c])
    return icrf_scene(tracks, bodies, step_s)


def write_reference(
    folder: str | Path,
    output: str | Path,
    method: str = "survey-catalog",
    *,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Make a catalog from the public files of a benchmark, and write it as a submission.

    Parameters
    ----------
    folder : str or Path
        Folder of the benchmark; its truth may be missing and is not read.
    output : str or Path
        New or empty folder of the submission.
    method : str
        One of `REFERENCE_METHODS`.
    progress : callable, optional
        Called with (scoring epochs done, all scoring epochs).

    Raises
    ------
    ConfigurationError, InputFileError
        If the method is unknown, a file of the benchmark was changed, or the output is not empty.
    ConvergenceError
        If the catalog stays empty.
    """
    require_choice("method", method, REFERENCE_METHODS)
    scenario = read_scenario(folder)
    public, forces = read_public_data(folder, scenario), scenario.forces()
    target = new_folder(output)
    catalog = (
        _ConfirmedOrbits(scenario, forces, public)
        if method == "survey-catalog"
        else NearestNeighborCatalog(scenario, forces)
    )
    replay = _Replay(catalog, scenario, public, forces)
    for number in counted(range(scenario.scoring_tdb.size), progress):
        replay.advance(number)
    replay.write(target, method)


class _Replay:
    """State of a replay."""

    def __init__(
        self,
        catalog: _ConfirmedOrbits | NearestNeighborCatalog,
        scenario: BenchmarkScenario,
        public: PublicData,
        forces: EphemerisForces,
    ) -> None:
        self.catalog, self.public, self.forces = catalog, public, forces
        self.scenario, self.epochs = scenario, scenario.scoring_tdb
        exposures = public.exposures
        side = np.rad2deg(2.0 * np.tan(np.deg2rad(0.5 * exposures["fieldDeg"].to_numpy())))
        self.area = side**2
        limits = pd.Series(exposures["limMag"].to_numpy(), index=exposures["expID"])
        self.limits = limits.loc[public.detections["expID"]].to_numpy()
        self.name_of = np.full(public.tdb.size, -1)
        self.first_epoch: list[int] = []
        self.states: dict[int, list[tuple[float, Array, Array]]] = {}

    def advance(self, number: int) -> None:
        """Link the detections up to a scoring epoch, and note the orbits at that epoch."""
        begin = self.epochs[number - 1] if number else -np.inf
        end = self.epochs[number]
        rows = np.flatnonzero((self.public.tdb > begin) & (self.public.tdb <= end))
        taken = self.public.exposures["tdb"].to_numpy()
        looked = (taken > begin) & (taken <= end)
        area = float(self.area[looked].sum())
        if isinstance(self.catalog, _ConfirmedOrbits):
            self.catalog.add_fields(Exposures(*(e[looked] for e in self.catalog.exposures)), 0)
        self.catalog.add_angles(self.public.angles.rows(rows), self.limits[rows], area)
        fits = self.catalog.confirmed_fits()
        before, self.name_of = self.name_of, np.full(self.public.tdb.size, -1)
        used: set[int] = set()
        for k in range(fits.epoch.size):
            moved = self._at(fits, k, end)
            if moved is None:
                continue
            own = fits.detections(k)
            name = _inherited(before[own], used)
            if name < 0:
                name = len(self.first_epoch)
                self.first_epoch.append(number)
            used.add(name)
            self.name_of[own] = name
            self.states.setdefault(name, []).append((end, *moved))

    def _at(self, fits: OrbitFits, k: int, tdb: float) -> tuple[Array, Array] | None:
        """State and covariance of an orbit at a time, none if it meets a body."""
        start = float(fits.epoch[k])
        elapsed = (tdb - self.forces.epoch) / TIME_UNIT_S - start
        try:
            state, stm = propagate_stm(fits.state[k], elapsed, forces=self.forces, start=start)
        except CislunarError:
            return None
        return state, stm @ fits.covariance[k] @ stm.T

    def write(self, target: Path, method: str) -> None:
        """Write the submission."""
        if not self.states:
            raise ConvergenceError(
                f"method {method}: no orbit is determined at any scoring epoch, and there is no "
                "catalog to write; make a larger benchmark"
            )
        segments: list[Segment] = []
        for name, rows in sorted(self.states.items()):
            times, states, covariances = (np.array(each) for each in zip(*rows, strict=True))
            segments.append(inertial_arc(_label(name), states, times, covariance=covariances))
        comments = (f"Reference {method} of cislunar; ICRF axes, dates in UTC",)
        text = oem_text(segments, created=self.scenario.epoch, comments=comments)
        write_text(text, target / STATES)
        names = self.public.detections["obsID"].astype(str).to_numpy()
        rows = np.flatnonzero(self.name_of >= 0)
        labels = [_label(name) for name in self.name_of[rows].tolist()]
        assigned = pd.DataFrame({"object": labels, "obsID": names[rows]})
        entered = dates(self.epochs[self.first_epoch])
        known = [_label(name) for name in range(len(entered))]
        cataloged = pd.DataFrame({"object": known, "cataloged_utc": entered})
        for file, table in ((ASSIGNMENTS, assigned), (OBJECTS, cataloged)):
            write_text(table.to_csv(index=False), target / file)


def _label(name: int) -> str:
    return f"object {name + 1}"


def _inherited(names: NDArray[np.int64], used: set[int]) -> int:
    """Name of most of the detections at the epoch before, -1 if there is none that is free."""
    known, counts = np.unique(names[names >= 0], return_counts=True)
    for name in known[np.argsort(-counts, kind="stable")].tolist():
        if name not in used:
            return name
    return -1
