"""Settings of a study: those of one cell of a campaign, with the epoch and the estimator.

The keys are those of `cislunar.campaign.settings.cell_tree.CellSettings`, which `config/README.md`
explains. A study states what differs from the defaults.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, get_args

from cislunar.campaign.settings.cell_settings import cell_files, cell_settings
from cislunar.campaign.settings.cell_tree import CellSettings, Tasking
from cislunar.campaign.settings.reading import merged, read_yaml, typed, with_types
from cislunar.campaign.settings.tree import Date, EphemerisSettings
from cislunar.constants import EPOCH_JD
from cislunar.ephemeris.kernel import PACKAGED, kernel_path
from cislunar.errors import ConfigurationError
from cislunar.estimation.initial_sigma import InitialSigma
from cislunar.observation.body_spec import ICOSAHEDRON, BodySpec
from cislunar.observation.sensor import Sensor
from cislunar.runtime.settings_fields import (
    Count,
    Positive,
    Section,
    setting,
    several,
    whole,
)
from cislunar.tasking.settings import RECORDABLE, LoopSettings

EstimatorName = Literal["mukf", "batch"]
_LOOP = LoopSettings()

# fmt: off


class StudySettings(CellSettings):
    """Settings of a study.

    Times and uncertainties are by default those of `cislunar.tasking.settings.LoopSettings`, and
    tasking is the optimal assignment. Brightness falls with the square of the distance, and tasking
    assumes the sphere that is as bright as the body.
    """

    seeds: whole(ge=1, le=10_000) = setting("number of realizations of truth and noise", default=1)
    duration_hours: Positive = setting("duration of the run", "h", default=_LOOP.duration_hours)
    step_s: Positive = setting(
        "time between measurements, and time step of filter and truth", "s", default=_LOOP.step_s)
    record: several(Literal[RECORDABLE]) = setting(
        "quantities besides those that results of a study always keep: `pointing`, `visibility` or "
        "`observers`", default=list(RECORDABLE[:4]))
    tasking: Tasking = Tasking(
        method=_LOOP.method, max_evaluations=_LOOP.max_evaluations, early_stop=_LOOP.early_stop,
        states=_LOOP.tasking.states)
    sensor: Sensor = Sensor()
    initial_sigma: InitialSigma = _LOOP.initial
    body: BodySpec = BodySpec(ICOSAHEDRON)
    epoch: Date = setting(
        "epoch, UTC: ISO 8601 like 2024-10-01T00:00:00, or a Julian date", default=EPOCH_JD)
    kernel: str = setting(
        "`de421`, `de440` or the path of an SPK file", default=EphemerisSettings().kernel)
    estimator: EstimatorName = setting(
        "`batch`, the batch estimator, or `mukf`, the multiplicative unscented Kalman filter",
        default="batch")
    interval_minutes: Count = setting("tasking interval, a multiple of the step", "min", default=60)
    seed: whole(ge=0) = setting("seed of all random numbers", "1", default=1)
    # fmt: on


def study_settings(given: Mapping[str, Any]) -> StudySettings:
    """Complete settings of a study from those that differ from the defaults.

    Parameters
    ----------
    given : mapping
        Settings by their keys; sections are mappings or objects of their classes, and quantities of
        `astropy.units` are converted to the units of their keys.

    Returns
    -------
    StudySettings

    Raises
    ------
    ConfigurationError
        If a key is unknown, or a value cannot be used; the message has a line for each.
    """
    written = with_types(_written(given, StudySettings), StudySettings)
    chosen = typed(merged(StudySettings().model_dump(), written), StudySettings)
    # results need these, whatever else is kept
    record = list(dict.fromkeys([*RECORDABLE[:4], *chosen.record]))
    histories = list(dict.fromkeys(["errors", *chosen.histories]))
    return chosen.model_copy(update={"record": record, "histories": histories})


def study_files(path: str | Path) -> list[str]:
    """Files on which the results of a study depend.

    Parameters
    ----------
    path : str or Path
        A study in YAML that `cislunar.study.read_study` accepts.

    Returns
    -------
    list of str
        The study itself, and the tables, messages, observations, kernel and meshes that it names,
        as it names them.

    Raises
    ------
    ConfigurationError, InputFileError
        If a file or a setting cannot be read.
    """
    given = read_yaml(path, "a study")
    own = study_settings({k: v for k, v in given.items() if k in StudySettings.model_fields})
    found = [str(path)]
    for objects in (given["observers"], given["targets"]):
        several = objects.values() if isinstance(objects, Mapping) else objects
        for each in [several] if isinstance(several, str) else several:
            # other texts are orbits by name
            if isinstance(each, str) and Path(each).suffix.lower() in (".csv", ".oem"):
                found.append(each)
            elif isinstance(each, Mapping) and "oem" in each:
                found.append(each["oem"])
    found += [given["observations"]] if given.get("observations") else []
    found += [] if own.kernel in PACKAGED else [str(kernel_path(own.kernel))]
    return list(dict.fromkeys([*found, *cell_files(cell_settings(own.model_dump()))]))


def _written(given: Any, model: type[Section] | None, place: str = "") -> Any:
    """Settings as a file states them: mappings, lists, texts and numbers."""
    if isinstance(given, Section):
        if model is not None and not isinstance(given, model):
            raise ConfigurationError(
                f"{place} = {type(given).__name__}(...): give a {model.__name__}"
            )
        return given.model_dump()
    if not isinstance(given, Mapping):
        return list(given) if isinstance(given, tuple) else given
    found = {}
    for key, value in given.items():
        if model is not None and isinstance(key, str):
            value = model.in_own_unit(key, value)
        field = model.model_fields.get(key) if model is not None else None
        kinds = (field.annotation, *get_args(field.annotation)) if field else ()
        inner = [each for each in kinds if isinstance(each, type) and issubclass(each, Section)]
        found[key] = _written(value, inner[0] if inner else None, str(key))
    return found
