"""Files of a benchmark: the public ones, the sealed truth, and their checksums.

===================  ===============================================================================
file                 content
===================  ===============================================================================
``scenario.yaml``    what is known: epoch, scoring, sensors, false alarms, prior, dynamics
``exposures.csv``    time, observer with its position, pointing, field of view, limiting magnitude
``detections.csv``   time, observer with its position, direction, magnitude, standard deviations
``detections.psv``   the same detections in the format ADES
``observers.oem``    ephemerides of the observers
``manifest.json``    SHA-256 of each file, that of the truth included
``truth/truth.nc``   states of all objects, origins of the detections, maneuvers
===================  ===============================================================================

Directions and positions are in the ICRF, and dates in UTC. Only `read_truth` opens the truth.
"""

import hashlib
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
import yaml

from cislunar.constants import SECONDS_PER_DAY, TIME_UNIT_S
from cislunar.dynamics import EphemerisForces, forces_between
from cislunar.ephemeris import BODY_COLUMNS, clock_text, tdb_seconds, tdb_to_clock
from cislunar.errors import ConfigurationError, InputFileError
from cislunar.exchange import checked, observation_table, read_text
from cislunar.observation import Scene, Sensor, make_scene
from cislunar.orbit_determination import Angles, angles_from_table
from cislunar.runtime import Array, require_path
from cislunar.runtime.netcdf import make_folder, read_dataset, write_text
from cislunar.runtime.settings_fields import Positive, Section, Text, setting
from cislunar.survey import SurveyModel

SCENARIO, EXPOSURES, DETECTIONS = "scenario.yaml", "exposures.csv", "detections.csv"
OBSERVERS, ADES, MANIFEST = "observers.oem", "detections.psv", "manifest.json"
TRUTH = "truth/truth.nc"
_PUBLIC = (SCENARIO, EXPOSURES, DETECTIONS, ADES, OBSERVERS)


def new_folder(path: str | Path) -> Path:
    """Make a folder for results, before they are computed.

    Raises
    ------
    InputFileError
        If there are files in it, or it cannot be made.
    """
    folder = Path(path)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputFileError(f"{folder}: is not an empty folder; give a new one")
    make_folder(folder, f"{folder}: cannot be made")
    return folder


_HOUR_S = 3600.0
_SPARE_S = 600.0
"""Time after the end that the force model covers."""


class BenchmarkScenario(Section):
    """What is known of a benchmark: the content of ``scenario.yaml``."""

    # fmt: off

    size: Text = setting("name of the size")
    epoch: Text = setting("begin, ISO 8601, UTC")
    frame: Literal["ICRF"] = setting("axes of directions and states", default="ICRF")
    time_scale: Literal["UTC"] = setting("time scale of dates", default="UTC")
    directions: Text = setting(
        "definition of the directions", default="geometric, without light time and aberration")
    dynamics: Text = setting("forces on the objects", default=(
        "point masses of Earth, Moon and Sun at the positions of DE421, J2 and C22 of the Moon, no "
        "radiation pressure"))
    maneuvers: Text = setting("what is known of maneuvers", default="unknown")
    bodies: Text = setting("what is known of bodies", default="unknown")
    step_s: Positive = setting("step of the exposures", "s", default=60)
    observers: list[Text] = setting("names of the observers in the files")
    sensor: Sensor = setting("telescope of each observer")
    survey: SurveyModel = setting("duration, schedule, false alarms and prior")

    # fmt: on

    @property
    def epoch_tdb(self) -> float:
        """Epoch, TDB seconds past J2000."""
        return tdb_seconds(self.epoch)

    @property
    def scoring_tdb(self) -> Array:
        """Scoring epochs, TDB seconds past J2000: every `survey.link_hours` until the end."""
        step = self.survey.link_hours * _HOUR_S
        count = int(self.survey.duration_days * SECONDS_PER_DAY / step + 1e-9)
        return self.epoch_tdb + step * np.arange(1, count + 1)

    def forces(self) -> EphemerisForces:
        """Force model of the objects, whose time zero is the epoch."""
        last = self.epoch_tdb + self.survey.duration_days * SECONDS_PER_DAY + _SPARE_S
        return forces_between(self.epoch, dates([last])[0])


class PublicData(NamedTuple):
    """Exposures and detections of a benchmark.

    Attributes
    ----------
    exposures : DataFrame
        `cislunar.detection.EXPOSURE_COLUMNS` and ``tdb``, TDB seconds past J2000.
    detections : DataFrame
        `cislunar.detection.DETECTION_COLUMNS` and positions of the observers.
    tdb : ndarray, shape (detection,)
        Times of the detections, TDB seconds past J2000.
    angles : Angles
        The detections in the propagation frame of the force model.
    """

    exposures: pd.DataFrame
    detections: pd.DataFrame
    tdb: Array
    angles: Angles


def dates(tdb_s: Iterable[float]) -> list[str]:
    """Dates, ISO 8601, UTC, to the second, at TDB seconds past J2000."""
    clock = np.rint(tdb_to_clock(np.asarray(list(tdb_s), dtype=float), "UTC"))
    return [clock_text(each)[:19] + "Z" for each in clock.tolist()]


def icrf_scene(position: Array, bodies: Array, step_s: float) -> Scene:
    """Scene of observers whose axes are those of the ICRF, from their positions (observer, step, 3)
    and those of the bodies (step, body, 3) in the order of the ephemeris, nondimensional."""
    primaries = np.stack(
        [bodies[:, BODY_COLUMNS["earth"]], bodies[:, BODY_COLUMNS["moon"]]], axis=1
    )
    return make_scene(
        position, bodies[:, BODY_COLUMNS["sun"]], step_s, observer_rate_deg_h=np.zeros(3),
        axes=np.eye(3), primaries=primaries,
    )  # fmt: skip


def checksum(path: Path) -> str:
    """SHA-256 of a file; an `InputFileError` if it cannot be read."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise InputFileError(
            f"{path}: cannot be read ({error.strerror}); get the complete benchmark"
        ) from error


def write_manifest(folder: Path) -> None:
    """Write the checksums of all files of a benchmark."""
    sums = {name: checksum(folder / name) for name in (*_PUBLIC, TRUTH)}
    write_text(json.dumps({"sha256": sums}, indent=2) + "\n", folder / MANIFEST)


def _require_unchanged(folder: Path, names: Iterable[str], remedy: str) -> None:
    """Refuse a file whose checksum is not that of the manifest."""
    place = folder / MANIFEST
    try:
        sums = json.loads(read_text(place, "a benchmark's manifest"))["sha256"]
        expected = {name: sums[name] for name in names}
    except (ValueError, TypeError, KeyError) as error:
        raise InputFileError(
            f"{place}: is no manifest of a benchmark ({error}); get the original file"
        ) from error
    for name, value in expected.items():
        if checksum(folder / name) != value:
            raise InputFileError(
                f"{folder / name}: differs from its checksum in {MANIFEST}; {remedy}"
            )


def read_scenario(folder: str | Path) -> BenchmarkScenario:
    """Read what is known of a benchmark, after a check of all its public files.

    Parameters
    ----------
    folder : str or Path
        Folder of the benchmark.

    Returns
    -------
    BenchmarkScenario

    Raises
    ------
    ConfigurationError, InputFileError
        If `folder` is not a path, a file is missing or was changed, or the scenario has an unknown
        or impossible value.
    """
    require_path("folder", folder)
    path = Path(folder) / SCENARIO
    text = read_text(path, "a benchmark's scenario")
    _require_unchanged(Path(folder), _PUBLIC, "get the original file")
    try:
        given: Any = yaml.safe_load(text)
        return BenchmarkScenario(**given)
    except (yaml.YAMLError, TypeError, ConfigurationError) as error:
        raise InputFileError(f"{path}: {' '.join(str(error).split())}") from error


def read_public_data(folder: str | Path, scenario: BenchmarkScenario) -> PublicData:
    """Read the exposures and detections of a benchmark.

    Parameters
    ----------
    folder : str or Path
        Folder of the benchmark.
    scenario : BenchmarkScenario

    Returns
    -------
    PublicData

    Raises
    ------
    ConfigurationError, InputFileError
        If a file or a column is missing, a value is impossible, or the kernel of the scenario
        cannot be used.
    """
    table, place, fault = observation_table(Path(folder) / EXPOSURES)
    exposures = table.assign(tdb=checked(table, (), fault=fault, place=place)["tdb"])
    path, forces = Path(folder) / DETECTIONS, scenario.forces()
    angles = angles_from_table(path, forces, light_time=False)
    tdb = forces.epoch + angles.time * TIME_UNIT_S
    return PublicData(exposures, observation_table(path)[0], tdb, angles)


def read_truth(folder: str | Path) -> xr.Dataset:
    """Read the truth of a benchmark, if its seal is intact.

    Parameters
    ----------
    folder : str or Path
        Folder of the benchmark.

    Returns
    -------
    Dataset
        ``state`` (object, time, component): km and km/s, ICRF, center of the Earth; ``time``: TDB
        seconds past J2000; ``origin`` (detection): object of each detection, -1 for a false alarm;
        ``family``, ``outside`` and ``maneuvers`` of each object, and the maneuvers.

    Raises
    ------
    InputFileError
        If the file is missing, was changed, or is not alone in its folder.
    """
    path = Path(folder) / TRUTH
    if not path.is_file():
        raise InputFileError(
            f"{path}: no such file; scores need the sealed truth: put it there as it was made"
        )
    others = sorted(each.name for each in path.parent.iterdir() if each != path)
    if others:
        raise InputFileError(
            f"{path.parent}: contains {others[0]} besides {path.name}, so that the truth was "
            "opened; keep only the sealed file"
        )
    _require_unchanged(Path(folder), [TRUTH], "the seal is broken: get the original truth")
    return read_dataset(path)
