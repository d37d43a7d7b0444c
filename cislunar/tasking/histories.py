"""The histories of a run: every quantity that it keeps at its epochs, steps or recorded times.

Each history is declared once, in `HISTORIES`. `cislunar.tasking.closed_loop.LoopResult` has each as
an attribute, and the data set of a cell as a variable of the same name. `OBSERVATION_COLUMNS` does
the same for single observations.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.runtime import Array
from cislunar.tasking.settings import LoopSettings


class Outputs(NamedTuple):
    """What an estimator returns besides the motion: estimated body parameters, the status of the
    attitude, and tests for maneuvers."""

    parameters: bool = False
    status: bool = False
    maneuvers: bool = False


class History(NamedTuple):
    """A quantity that a run keeps of every realization.
    `along`: time axis, "epoch" (tasking epochs), "step" (measurement times) or "time" (recorded
    times); `dims`: dimensions after realization and time; `dtype`: NumPy type; `unit`: "1" if there
    is none; `long_name`: description, in which ``{frame}`` stands for the unit and frame of
    positions and velocities; `kept`: the condition, in `_KEPT` or among the records, under which a
    run keeps the quantity."""

    along: str
    dims: tuple[str, ...]
    dtype: str
    unit: str
    long_name: str
    kept: str


_KEPT: dict[str, Callable[[LoopSettings, Outputs], bool]] = {
    "always": lambda settings, outputs: True,
    "errors": lambda settings, outputs: "errors" in settings.histories,
    "bound": lambda settings, outputs: "bound" in settings.histories,
    "pairs": lambda settings, outputs: settings.keep_information,
    "bounded": lambda settings, outputs: settings.schedule.bounded,
    "learned": lambda settings, outputs: settings.tasking.detection is not None,
    "associated": lambda settings, outputs: settings.association.in_field,
    "estimated": lambda settings, outputs: outputs.parameters,
    "status": lambda settings, outputs: outputs.status,
    "tested": lambda settings, outputs: outputs.maneuvers,
}
"""Whether a run keeps a history, by a name for the condition; other names are those of
``settings.record``."""

_STATE, _PARAMETER = ("target", "component"), ("target", "parameter")
_STATE_UNIT, _PARAMETER_UNIT = "see component_unit", "see parameter_unit"
_OBSERVER, _OBSERVER_UNIT = ("observer", "observer_parameter"), "see observer_parameter"
_FRAME = "{frame}"


def _motion(word: str, record: str) -> dict[str, History]:
    """Histories of the true or estimated motion."""
    return {
        f"{word}_translation": History(
            "time", ("target", "translation"), "f8", "1",
            f"{word} position and velocity, {_FRAME}", record),
        f"{word}_quaternion": History(
            "time", ("target", "quaternion"), "f8", "1",
            f"{word} attitude, inertial frame to body frame", record),
        f"{word}_angular_velocity": History(
            "time", ("target", "body_axis"), "f8", "rad s-1",
            f"{word} angular velocity, body frame", record),
    }  # fmt: skip


HISTORIES = {
    "assignment": History(
        "epoch", ("observer",), "i4", "1",
        "index of the target along dimension target, -1 for an idle observer", "always"),
    "information": History(
        "epoch", (), "f8", "nat", "mutual information of the tasking", "always"),
    "evaluations": History("epoch", (), "i4", "1", "taskings evaluated", "always"),
    "outcome": History(
        "step", ("target",), "u1", "1",
        "detection outcome; of several observations the furthest in the order of the flags",
        "always"),
    "error": History(
        "time", _STATE, "f4", _STATE_UNIT, "truth less estimate (attitude: GRP)",
        "errors"),
    "sigma": History(
        "time", _STATE, "f4", _STATE_UNIT, "standard deviation of the estimate",
        "errors"),
    "bound": History(
        "time", _STATE, "f4", _STATE_UNIT,
        "standard deviation of the posterior Cramer-Rao bound", "bound"),
    "pair_information": History(
        "epoch", ("observer", "target"), "f8", "nat", "mutual information of every pair",
        "pairs"),
    "brightness_offset": History(
        "epoch", ("target",), "f4", "mag",
        "magnitude of the target less the expected magnitude, learned after the interval",
        "learned"),
    "brightness_offset_sigma": History(
        "epoch", ("target",), "f4", "mag", "standard deviation of brightness_offset", "learned"),
    "planning_gap": History(
        "epoch", (), "f8", "1",
        "relative amount by which the schedule may fall short of the best: largest gap of the set "
        "packings, or the gap to the bound of all slots with task2.tasking.bound_steps",
        "bounded"),
    "parameter_error": History(
        "epoch", _PARAMETER, "f4", _PARAMETER_UNIT,
        "truth less estimate of the body-parameter deviations, after the interval", "estimated"),
    "parameter_sigma": History(
        "epoch", _PARAMETER, "f4", _PARAMETER_UNIT,
        "standard deviation of the estimated body-parameter deviations", "estimated"),
    "searches": History(
        "epoch", ("target",), "i4", "1", "searches for the modes of the fits up to the epoch",
        "estimated"),
    "attitude_status": History(
        "epoch", ("target",), "u1", "1",
        "status of the attitude after the interval: 0 unique, 1 ambiguous, 2 unknown since the "
        "shape probably differs from the assumed one or no model explains the light curve",
        "status"),
    **_motion("true", "truth"),
    **_motion("estimated", "estimates"),
    "covariance": History(
        "time", ("target", "translation", "translation_2"), "f8", "1",
        f"covariance of the estimated position and velocity, {_FRAME}", "covariance"),
    "pointing": History(
        "time", ("observer", "angle"), "f8", "rad",
        "direction of the target's estimated position, observer's body frame; NaN for an observer "
        "that is idle or slews", "pointing"),
    "associations": History(
        "epoch", ("target",), "i4", "1",
        "detections that the track has taken in the interval", "associated"),
    "wrong_associations": History(
        "epoch", ("target",), "i4", "1",
        "detections of another target, or false alarms, that the track has taken in the interval",
        "associated"),
    "association_origin": History(
        "epoch", ("target",), "i4", "1",
        "index of the target that most of the track's detections in the interval are of; -1 for "
        "false alarms, -2 without a detection", "associated"),
    "existence": History(
        "epoch", ("target",), "f4", "1",
        "probability that the track is of an object, after the interval", "associated"),
    "track_status": History(
        "epoch", ("target",), "u1", "1",
        "status of the track after the interval: 0 tentative, 1 confirmed, 2 lost, 3 deleted",
        "associated"),
    "gospa": History(
        "epoch", ("gospa_part",), "f8", "see gospa_part",
        "GOSPA metric (p = 2, alpha = 2) of the positions of tracks against those of targets, "
        "after the interval: distance (km), and its parts localization, missed and false (km^2)",
        "associated"),
    "observer_error": History(
        "epoch", _OBSERVER, "f8", _OBSERVER_UNIT,
        "error of the observer after the interval, true minus assumed values",
        "observers"),
    "estimated_observer_error": History(
        "epoch", _OBSERVER, "f8", _OBSERVER_UNIT,
        "estimated error of the observer after the interval; NaN if errors are not treated",
        "observers"),
    "observer_error_covariance": History(
        "epoch", (*_OBSERVER, "observer_parameter_2"), "f8", "products of those of "
        "observer_parameter", "covariance of the estimated error of the observer",
        "observers"),
    "maneuver_alarm": History(
        "epoch", ("target",), "bool", "1",
        "1 where a maneuver was detected in the interval: maneuver_statistic exceeds its threshold",
        "tested"),
    "maneuver_statistic": History(
        "epoch", ("target",), "f8", "1",
        "largest statistic in the interval of the generalized likelihood ratio test for a "
        "maneuver; 0 without an observation", "tested"),
    "maneuver_estimated_time": History(
        "epoch", ("target",), "f8", "s",
        "hypothesized time of the maneuver of maneuver_statistic since the start of the run",
        "tested"),
    "maneuver_tested_time": History(
        "epoch", ("target",), "f8", "s",
        "time of the observation of maneuver_statistic since the start of the run", "tested"),
    "maneuver_estimate": History(
        "epoch", ("target", "axis"), "f8", "m s-1",
        "change of velocity by the maneuver of maneuver_statistic, axes of the propagation frame",
        "tested"),
    "maneuver_estimate_covariance": History(
        "epoch", ("target", "axis", "axis_2"), "f8", "m2 s-2",
        "covariance of maneuver_estimate given its time", "tested"),
    "visible": History(
        "epoch", ("target",), "bool", "1",
        "1 where any observer could have detected the target in the interval, at its true "
        "brightness and without noise", "visibility"),
}  # fmt: skip
"""Histories by name."""


def kept_histories(settings: LoopSettings, outputs: Outputs) -> dict[str, History]:
    """The histories that a run keeps, with the dimension of the slots if intervals have slots.

    Parameters
    ----------
    settings : LoopSettings
    outputs : Outputs
        What the estimator returns besides the motion.
    """
    holds = {*settings.record, *(name for name, of in _KEPT.items() if of(settings, outputs))}
    found = {name: each for name, each in HISTORIES.items() if each.kept in holds}
    if settings.slots is not None:
        found["assignment"] = found["assignment"]._replace(dims=("slot", "observer"))
    return found


def histories_text() -> str:
    """The histories as numpydoc attributes."""
    lines = []
    for name, each in HISTORIES.items():
        unit = "" if each.unit == "1" else f" [{each.unit}]"
        shape = ", ".join(("seed", each.along, *each.dims))
        meaning = each.long_name.format(frame="nondimensional, propagation frame")
        lines.append(
            f"    {name} : ndarray of {each.dtype}, shape ({shape})\n        {meaning}{unit}"
        )
    return "\n".join(lines)


class ObservationLog(NamedTuple):
    """All observations of a run, by seed, interval, target and step; arrays, shape (row, ...). Step
    0 is the first measurement time. `value` and `variance` (row, 3) are NaN where nothing was
    detected; `outcome` is an index into `cislunar.tasking.realization.OUTCOME_NAMES`."""

    seed: NDArray[np.int64]
    step: NDArray[np.int64]
    target: NDArray[np.int64]
    observer: NDArray[np.int64]
    value: Array
    variance: Array
    outcome: NDArray[np.uint8]


class ManeuverLog(NamedTuple):
    """True maneuvers of a run, by seed, start and target; arrays, shape (maneuver, ...). Starts are
    since the start of the run; the duration of an impulse is 0. `velocity_m_s` (maneuver, 3) is the
    change of velocity, propagation frame."""

    seed: NDArray[np.int64]
    target: NDArray[np.int64]
    start_s: Array
    duration_s: Array
    velocity_m_s: Array


class RecoveredLog(NamedTuple):
    """Estimated maneuvers of a run, by seed and alarm; arrays, shape (maneuver, ...). `seed` is the
    index of the realization; the others are those of
    `cislunar.estimation.maneuvers.recovering_estimator.RecoveredManeuvers`."""

    seed: NDArray[np.int64]
    target: NDArray[np.int64]
    alarm_s: Array
    time_s: Array
    time_sigma_s: Array
    velocity_m_s: Array
    covariance: Array
    probability: Array


def log_variables(log: ManeuverLog | RecoveredLog) -> dict[str, tuple]:
    """Dimensions, values, unit and description by the names of the variables of a log."""
    given = (
        ("maneuver", MANEUVER_VARIABLES)
        if isinstance(log, ManeuverLog)
        else ("recovered_maneuver", RECOVERED_VARIABLES)
    )
    columns = zip(given[1].items(), log, strict=True)
    return {name: ((given[0], *dims), each, *rest) for (name, (dims, *rest)), each in columns}


MANEUVER_VARIABLES = {
    "maneuver_seed": ((), "1", "index of the realization"),
    "maneuver_target": ((), "1", "index of the target along dimension target"),
    "maneuver_start": ((), "s", "start of the true maneuver since the start of the run"),
    "maneuver_duration": ((), "s", "duration of the true maneuver; 0 for an impulse"),
    "maneuver_velocity": (
        ("axis",), "m s-1",
        "change of velocity by the true maneuver, axes of the propagation frame"),
}  # fmt: skip
"""Variables of `ManeuverLog` in its order: dimensions after that of the maneuvers, unit and
description."""

RECOVERED_VARIABLES = {
    "recovered_seed": ((), "1", "index of the realization"),
    "recovered_target": ((), "1", "index of the target along dimension target"),
    "recovered_alarm": ((), "s", "observation with the alarm, since the start of the run"),
    "recovered_time": ((), "s", "estimated time of the maneuver since the start of the run"),
    "recovered_time_sigma": ((), "s", "standard deviation of the estimated time"),
    "recovered_velocity": (
        ("axis",), "m s-1", "estimated change of velocity, axes of the propagation frame"),
    "recovered_covariance": (
        ("axis", "axis_2"), "m2 s-2", "covariance of the estimated change of velocity"),
    "recovered_probability": ((), "1", "probability that the target has maneuvered"),
}  # fmt: skip
"""Variables of `RecoveredLog`, as `MANEUVER_VARIABLES`."""


class _ObservationColumn(NamedTuple):
    """A variable of the observations in a data set: type, unit, description and values."""

    dtype: str
    unit: str
    long_name: str
    values: Callable[[ObservationLog], NDArray]


OBSERVATION_COLUMNS = {
    "observation_seed": _ObservationColumn(
        "i8", "1", "index of the realization", lambda log: log.seed),
    "observation_step": _ObservationColumn(
        "i8", "1", "index along dimension step", lambda log: log.step),
    "observation_target": _ObservationColumn(
        "i8", "1", "index of the target along dimension target", lambda log: log.target),
    "observation_observer": _ObservationColumn(
        "i8", "1", "index of the observer", lambda log: log.observer),
    "observation_outcome": _ObservationColumn(
        "u1", "1", "detection outcome of the observation", lambda log: log.outcome),
    "observation_magnitude": _ObservationColumn(
        "f8", "mag", "measured magnitude, NaN if nothing was detected",
        lambda log: log.value[:, 0]),
    "observation_right_ascension": _ObservationColumn(
        "f8", "rad", "measured right ascension, observer's body frame",
        lambda log: log.value[:, 1]),
    "observation_declination": _ObservationColumn(
        "f8", "rad", "measured declination, observer's body frame", lambda log: log.value[:, 2]),
    "observation_magnitude_variance": _ObservationColumn(
        "f8", "mag2", "variance of the measured magnitude", lambda log: log.variance[:, 0]),
    "observation_angle_variance": _ObservationColumn(
        "f8", "rad2", "variance of right ascension and of declination",
        lambda log: log.variance[:, 1]),
}  # fmt: skip
"""Variables of `ObservationLog` by name."""
