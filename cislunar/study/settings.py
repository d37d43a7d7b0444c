"""Settings of a study: those of one cell of a campaign, with the epoch and the estimator.

The keys are those of `cislunar.campaign.settings.cell_tree.CellSettings`, which `config/README.md`
explains. A study states what differs from the defaults.
"""

from collections.abc import Mapping
from typing import Any, Literal, get_args

from cislunar.campaign.settings.cell_tree import CellSettings, Tasking
from cislunar.campaign.settings.reading import merged, typed, with_types
from cislunar.campaign.settings.tree import Date, EphemerisSettings
from cislunar.constants import EPOCH_JD
from cislunar.errors import ConfigurationError
from cislunar.observation.body_spec import ICOSAHEDRON, BodySpec
from cislunar.observation.sensor import Sensor
from cislunar.runtime.settings_fields import Count, Section, setting, whole
from cislunar.tasking.settings import RECORDABLE, LoopSettings

EstimatorName = Literal["mukf", "batch"]

# fmt: off


class StudySettings(CellSettings):
    """Settings of a study."""

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


def default_settings() -> dict[str, Any]:
    """Settings of a study without any setting of its own.

    Times and uncertainties are those of `cislunar.tasking.settings.LoopSettings`, and tasking is
    the optimal assignment. Brightness falls with the square of the distance, and tasking assumes
    the sphere that is as bright as the body.
    """
    loop = LoopSettings()
    tasking = Tasking(method=loop.method, max_evaluations=loop.max_evaluations,
                      early_stop=loop.early_stop, states=loop.tasking.states)  # fmt: skip
    whole_run = StudySettings(
        seeds=1,
        duration_hours=loop.duration_hours,
        step_s=loop.step_s,
        tasking=tasking,
        sensor=Sensor(),
        initial_sigma=loop.initial,
        body=BodySpec(ICOSAHEDRON),
        record=list(RECORDABLE[:4]),
    )
    return whole_run.model_dump()


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
    found = merged(default_settings(), written)
    try:
        chosen = typed(found, StudySettings)
    except ConfigurationError as error:
        words = str(error).replace("configuration key", "setting")
        raise ConfigurationError(words) from None
    # results need these, whatever else is kept
    record = list(dict.fromkeys([*RECORDABLE[:4], *chosen.record]))
    histories = list(dict.fromkeys(["errors", *chosen.histories]))
    return chosen.model_copy(update={"record": record, "histories": histories})


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
