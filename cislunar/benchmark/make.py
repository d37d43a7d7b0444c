"""Making of a benchmark: a survey of unknown objects, its public files and its sealed truth.

The survey is that of `cislunar.survey.run_survey`, in ephemeris dynamics. Half of the objects are
on periodic orbits of the families of tracked targets, and half are outside of these families
(`cislunar.targets.objects_outside_families`). Some of both make maneuvers. Every exposure has one
false alarm in the mean. The planner of the survey selects the pointing from the prior and from
detections without origins.
"""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
import yaml
from numpy.typing import NDArray

from cislunar.architecture import PUBLISHED
from cislunar.benchmark import files
from cislunar.benchmark.files import BenchmarkScenario, dates, icrf_scene
from cislunar.campaign.data.inputs import variables
from cislunar.constants import LENGTH_UNIT_KM, SECONDS_PER_DAY
from cislunar.detection import FALSE_ALARM, detection_table, exposure_table
from cislunar.dynamics import EphemerisForces, inertial_states, propagate
from cislunar.ephemeris import read_table
from cislunar.errors import ConfigurationError
from cislunar.exchange import ades_text, inertial_arc, oem_text
from cislunar.observation import Scene, Sensor
from cislunar.observation.target_surfaces import target_surfaces
from cislunar.orbits import OrbitSet, observer_library, tracked_targets
from cislunar.orbits.ephemeris_refined import reference_states
from cislunar.photometry import Material, icosahedron
from cislunar.runtime.arguments import Array, require_choice
from cislunar.runtime.netcdf import write_dataset, write_text
from cislunar.runtime.provenance import provenance
from cislunar.runtime.seeds import generator
from cislunar.survey import (
    BlockRecord,
    ObjectDensity,
    PriorSources,
    SurveySettings,
    in_propagation_frame,
    run_survey,
    sample_prior,
)
from cislunar.targets import DrawnManeuvers, objects_outside_families
from cislunar.tasking import TruthModel

EPOCH = "2027-03-01T00:00:00"
DEFAULT_SEED = 2027

_STEP_S, _EVERY = 30.0, 20
"""Step of the exposures, and steps between the states of observers and of the truth."""

_STATION_KEEPING = DrawnManeuvers(share=0.1, smallest_m_s=0.1, largest_m_s=2, interval_hours=12)
_TRANSFER = DrawnManeuvers(share=0.1, smallest_m_s=5, largest_m_s=50)

_KNOWN_MANEUVERS = (
    "a tenth of the objects keep station by impulses of 0.1 to 2 m/s, at most two a day, and a "
    "tenth make one impulse of 5 to 50 m/s, in the mean"
)
_KNOWN_BODIES = (
    "icosahedra of the default material of the library in unknown rotation; magnitudes are those "
    "of the reflected sunlight"
)


class BenchmarkSize(NamedTuple):
    """Size of a benchmark.

    Attributes
    ----------
    objects : int
    slots : tuple of (str, int)
        Families of observer orbits, and number of satellites on an orbit of each.
    days : float
    scoring_hours : float
        Time between scoring epochs.
    """

    objects: int
    slots: tuple[tuple[str, int], ...]
    days: float
    scoring_hours: float


SIZES = {
    "small": BenchmarkSize(
        20, (("Halo_L1_S", 1), ("Halo_L2_N", 1), ("Halo_L3_N", 1), ("Halo_L3_S", 1)), 0.5, 4.0
    ),
    "medium": BenchmarkSize(202, PUBLISHED["A"], 1.0, 4.0),
    "large": BenchmarkSize(1000, PUBLISHED["B"], 7.0, 12.0),
}
"""Sizes by name; the observers of the larger two are on orbits of the families of Paul & Fan,
table 2, scenarios A and B."""


def make_benchmark(
    folder: str | Path,
    size: str | BenchmarkSize = "small",
    seed: int = DEFAULT_SEED,
    *,
    progress: Callable[[int, int], None] | None = None,
) -> BenchmarkScenario:
    """Make a benchmark and write its files.

    Parameters
    ----------
    folder : str or Path
        New or empty folder.
    size : str or BenchmarkSize
        A name of `SIZES`, or a size of the user.
    seed : int
        Of all random numbers. It determines the truth, and is written into the truth only.
    progress : callable, optional
        Called with (blocks done, all blocks) of the survey.

    Returns
    -------
    BenchmarkScenario

    Raises
    ------
    ConfigurationError, InputFileError
        If the size is unknown, the seed negative, or the folder not empty.
    """
    if isinstance(size, str):
        require_choice("size", size, SIZES)
    if seed < 0:
        raise ConfigurationError(f"seed = {seed} must not be negative")
    root = files.new_folder(folder)
    chosen = SIZES[size] if isinstance(size, str) else size
    scenario = _scenario(size if isinstance(size, str) else "custom", chosen)
    forces = scenario.forces()
    library = observer_library()
    tracks = _observer_tracks(library, chosen, scenario, forces)
    elapsed = _STEP_S * np.arange(tracks.shape[1])
    bodies = read_table(forces.table, forces.epoch + elapsed)[0] / LENGTH_UNIT_KM
    scene = icrf_scene(tracks[..., :3], bodies, _STEP_S)
    families, states = _objects(chosen, forces, seed)
    recorded = _Recorder(scene, forces, scenario)
    settings = SurveySettings(
        **{key: getattr(scenario.survey, key) for key in type(scenario.survey).model_fields}
    )
    truth = TruthModel(
        target_surfaces(icosahedron(), Material(), chosen.objects),
        scenario.sensor.noise,
        np.zeros(3),
        forces=forces,
        drawn_maneuvers=(_STATION_KEEPING, _TRANSFER),
    )
    run_survey(
        scene,
        truth,
        inertial_states(states, forces.table, forces.epoch)[0],
        np.arange(chosen.objects),
        seed,
        _density(library, settings, forces, seed),
        settings,
        sensor=scenario.sensor,
        forces=forces,
        progress=progress,
        record=recorded,
    )
    _write(root, scenario, tracks, recorded)
    write_dataset(_truth(recorded, families, seed), root / files.TRUTH)
    files.write_manifest(root)
    return scenario


def _scenario(name: str, size: BenchmarkSize) -> BenchmarkScenario:
    sensor = Sensor(field_of_view_deg=6, limiting_magnitude=20)
    side = np.rad2deg(2.0 * np.tan(np.deg2rad(0.5 * sensor.field_of_view_deg)))
    count = sum(number for _, number in size.slots)
    return BenchmarkScenario(
        size=name,
        epoch=EPOCH,
        maneuvers=_KNOWN_MANEUVERS,
        bodies=_KNOWN_BODIES,
        step_s=_STEP_S,
        observers=[f"S{number:02d}" for number in range(1, count + 1)],
        sensor=sensor,
        survey={
            "duration_days": size.days,
            "link_hours": size.scoring_hours,
            "process": {"false_alarms_deg2": float(1.0 / side**2)},
            "prior": {
                "families": 0.5,
                "zero_velocity": 0,
                "uniform": 0.5,
                "expected_objects": size.objects,
            },
        },
    )


def _observer_tracks(
    library: OrbitSet, size: BenchmarkSize, scenario: BenchmarkScenario, forces: EphemerisForces
) -> Array:
    """States (observer, time, 6) of the observers, propagation frame. The orbits of a family divide
    it evenly, and satellites divide their orbit."""
    elapsed = _STEP_S * np.arange(
        round(scenario.survey.duration_days * SECONDS_PER_DAY / _STEP_S) + 1
    )
    taken: dict[str, int] = {}
    tracks = []
    for slot, (family, count) in enumerate(size.slots):
        members = np.flatnonzero(np.asarray(library.family) == family)
        several = sum(name == family for name, _ in size.slots)
        taken[family] = taken.get(family, 0) + 1
        row = members[taken[family] * members.size // (several + 1)]
        for number in range(count):
            # slots begin at different phases
            ahead = (0.5 * (np.sqrt(5.0) - 1.0) * slot + number / count) % 1.0
            tracks.append(
                reference_states(
                    forces.table, forces.epoch, library.state[row], float(library.period[row]),
                    elapsed, ahead=ahead,
                )
            )  # fmt: skip
    return np.array(tracks)


def _objects(size: BenchmarkSize, forces: EphemerisForces, seed: int) -> tuple[list[str], Array]:
    """Families or kinds, and states (object, 6), rotating frame: half of the objects at random
    phases of tracked periodic orbits, and then those outside of these families."""
    orbits = tracked_targets()
    closed = np.flatnonzero(np.isfinite(orbits.stability_index))
    n_outside = size.objects // 2
    rng = generator(seed, "families")
    several = size.objects - n_outside > closed.size
    rows = rng.choice(closed, size.objects - n_outside, replace=several)
    phases = rng.random(rows.size)
    inside = [
        propagate(orbits.state[row], [phase * orbits.period[row]], method="dop853")[0]
        for row, phase in zip(rows.tolist(), phases.tolist(), strict=True)
    ]
    others = objects_outside_families(
        orbits.state[closed], orbits.period[closed], generator(seed, "outside"), count=n_outside,
        days=size.days, forces=forces,
    )  # fmt: skip
    families = np.asarray(orbits.family)[rows].astype(str).tolist()
    return [*families, *others.family], np.concatenate([np.array(inside), others.state])


def _density(
    library: OrbitSet, settings: SurveySettings, forces: EphemerisForces, seed: int
) -> ObjectDensity:
    """Density of undetected objects from the prior, which the truth does not enter."""
    sources = PriorSources(orbits=library.state, periods=library.period)
    state, size = sample_prior(
        settings.prior, sources, generator(seed, "prior"), region=settings.region
    )
    return ObjectDensity(
        in_propagation_frame(state, forces), size, settings.prior.expected_objects, forces=forces,
        region=settings.region,
    )  # fmt: skip


class _Recorder:
    """Tables of exposures and detections, and the truth, block by block."""

    def __init__(self, scene: Scene, forces: EphemerisForces, scenario: BenchmarkScenario) -> None:
        self.scene, self.epoch, self.scenario = scene, forces.epoch, scenario
        self.exposures: list[pd.DataFrame] = []
        self.detections: list[pd.DataFrame] = []
        self.origin: list[NDArray[np.int64]] = []
        self.states: list[Array] = []
        self.last: BlockRecord | None = None

    def __call__(self, block: BlockRecord) -> None:
        # the axes of the propagation frame are those of the ICRF
        given = (
            self.scene,
            block.first,
            self.epoch,
            np.broadcast_to(np.eye(3), self.scene.observer_axes.shape),
        )
        rate = self.scenario.survey.process.false_alarms_deg2
        observer, index = block.exposures.observer, block.first + block.exposures.step
        of = block.detections.exposure
        exposures = exposure_table(block.exposures, rate, *given)
        detections = detection_table(block.detections, block.exposures, *given)
        self.exposures.append(self._placed(exposures, observer, index))
        self.detections.append(self._placed(detections, observer[of], index[of]))
        self.origin.append(block.origin)
        # blocks share their ends, and are whole multiples of the steps of the truth
        self.states.append(block.state[:, :-1:_EVERY])
        self.last = block

    def _placed(
        self, table: pd.DataFrame, observer: NDArray[np.int64], index: NDArray[np.int64]
    ) -> pd.DataFrame:
        """The table with names and positions of the observers, its frame and its time scale."""
        scene = self.scene
        place = scene.observer_position[observer, index] - scene.primaries[index, 0]
        columns = dict(zip(("pos1", "pos2", "pos3"), LENGTH_UNIT_KM * place.T, strict=True))
        names = np.array(self.scenario.observers, dtype=object)[observer]
        known = self.scenario
        return table.assign(
            stn=names, sys="ICRF_KM", ctr=399, **columns, frame=known.frame,
            timeScale=known.time_scale,
        )  # fmt: skip


def _write(root: Path, scenario: BenchmarkScenario, tracks: Array, recorded: _Recorder) -> None:
    """Write the public files."""
    detections = pd.concat(recorded.detections, ignore_index=True)
    exposures = pd.concat(recorded.exposures, ignore_index=True)
    epochs = "".join(f"#   {each}\n" for each in dates(scenario.scoring_tdb))
    settings = yaml.safe_dump(scenario.model_dump(mode="json"), sort_keys=False)
    head = "# What is known of a benchmark (docs/benchmark.md). Scoring epochs, UTC:\n"
    write_text(f"{head}{epochs}{settings}", root / files.SCENARIO)
    write_text(exposures.to_csv(index=False), root / files.EXPOSURES)
    write_text(detections.to_csv(index=False), root / files.DETECTIONS)
    # the format requires a name of a tracklet; each detection has one of its own
    tracklets = [f"D{number:07d}" for number in range(len(detections))]
    write_text(ades_text(detections.assign(trkSub=tracklets)), root / files.ADES)
    times = recorded.epoch + _STEP_S * np.arange(tracks.shape[1])[::_EVERY]
    segments = [
        inertial_arc(name, track[::_EVERY], times)
        for name, track in zip(scenario.observers, tracks, strict=True)
    ]
    comments = ("Observers of a benchmark; ICRF axes, dates in UTC",)
    text = oem_text(segments, created=scenario.epoch, comments=comments)
    write_text(text, root / files.OBSERVERS)


def _truth(recorded: _Recorder, families: list[str], seed: int) -> xr.Dataset:
    """The data set of `cislunar.benchmark.read_truth`."""
    last = recorded.last
    path = np.concatenate([*recorded.states, last.state[:, -1:]], axis=1)
    times = recorded.epoch + _STEP_S * _EVERY * np.arange(path.shape[1])
    states = np.array([inertial_arc("", each, times).state for each in path])
    n, flown = len(states), last.maneuvers
    outside = (np.arange(n) >= n - n // 2).astype(np.int8)
    names = pd.concat(recorded.detections)["obsID"].tolist()
    earth, tdb = "ICRF, center of the Earth", "TDB seconds past J2000"
    return xr.Dataset(
        variables(
            state=(("object", "time", "component"), states, "km, km/s", f"state, {earth}"),
            family=("object", families, "1", "family or kind"),
            outside=("object", outside, "1", "1: outside of the families"),
            maneuvers=("object", np.bincount(flown.target, minlength=n), "1", "number of them"),
            origin=("detection", np.concatenate(recorded.origin), "1",
                    f"object of a detection, {FALSE_ALARM} for a false alarm"),
            observation=("detection", names, "1", "obsID of a detection"),
            maneuver_object=("maneuver", flown.target, "1", "object of a maneuver"),
            maneuver_time=("maneuver", recorded.epoch + flown.start_s, "s", tdb),
            velocity_change=(("maneuver", "axis"), last.velocity_changes_m_s, "m/s",
                             "change of velocity, ICRF axes"),
        ),
        coords=variables(time=("time", times, "s", tdb)),
        attrs=provenance("Sealed truth of a benchmark", seed=seed),
    )  # fmt: skip
