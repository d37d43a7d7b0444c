"""Settings of a closed-loop run."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cislunar.errors import ConfigurationError
from cislunar.estimation.spread import INITIAL_SPREAD, Spread
from cislunar.evaluation.metrics import Custody
from cislunar.observation.sensor import Sensor
from cislunar.tasking.communication.model import CommunicationModel
from cislunar.tasking.planning.assignment import EARLY_STOP, MAX_EVALUATIONS, METHODS
from cislunar.tasking.planning.information import TaskingModel
from cislunar.tasking.planning.schedule_model import ScheduleModel

Array = NDArray[np.float64]


HISTORIES = ("errors", "bound")
"""Histories that are kept unless a run is told otherwise."""

RECORDABLE = ("truth", "estimates", "covariance", "measurements", "pointing", "visibility")
"""What a run can keep besides errors and deviations."""


@dataclass(frozen=True)
class LoopSettings:
    """Settings of a closed-loop run; the defaults are the paper's where it gives any.

    Attributes
    ----------
    step_s : float
        Time between measurements, s.
    interval_minutes : float
        Time between tasking epochs.
    duration_hours : float
        Length of a run.
    method : str
        Of the assignment, see `cislunar.tasking.planning.assignment.assign`.
    max_evaluations, early_stop : int
        Budget of the methods that search.
    sensor : Sensor or tuple of Sensor
        Noise and limits of the observers, of all or of each.
    tasking : TaskingModel
        What the tasking step believes.
    schedule : ScheduleModel
        Slots within an interval, and observers at a target.
    communication : CommunicationModel
        When measurements reach the common estimate.
    eclipse : bool
        Whether the shadows of Earth and Moon dim targets; tasking knows it. A magnitude measured
        in the penumbra has the dimming taken off, which is known far better than the magnitude.
    initial : Spread
        Uncertainty of the targets at the epoch.
    custody : Custody
        How well a target has to be known at the end to count as held.
    record_every : int
        Steps between the times at which errors and deviations are kept; metrics use every step.
    keep_information : bool
        Keep the information of all pairs at every epoch.
    histories : tuple of str
        Which of `HISTORIES` are kept: errors and deviations, the bound. Metrics need neither.
    record : tuple of str
        What else is kept, of `RECORDABLE`; see `cislunar.tasking.recording.Records`.

    Raises
    ------
    ConfigurationError
        If a setting is impossible; the message names it.
    """

    step_s: float = 60.0
    interval_minutes: float = 60.0
    duration_hours: float = 24.0
    method: str = "exact"
    max_evaluations: int = MAX_EVALUATIONS
    early_stop: int = EARLY_STOP
    sensor: Sensor | tuple[Sensor, ...] = field(default_factory=Sensor)
    tasking: TaskingModel = field(default_factory=TaskingModel)
    schedule: ScheduleModel = field(default_factory=ScheduleModel)
    communication: CommunicationModel = field(default_factory=CommunicationModel)
    eclipse: bool = False
    initial: Spread = INITIAL_SPREAD
    custody: Custody = field(default_factory=Custody)
    record_every: int = 1
    keep_information: bool = False
    histories: tuple[str, ...] = HISTORIES
    record: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for key in ("step_s", "interval_minutes", "duration_hours"):
            value = getattr(self, key)
            if not (value > 0.0 and np.isfinite(value)):
                raise ConfigurationError(f"{key} = {value} must be positive and finite")
        for key, seconds in (
            ("interval_minutes", 60.0 * self.interval_minutes),
            ("duration_hours", 3600.0 * self.duration_hours),
        ):
            if abs(seconds / self.step_s - round(seconds / self.step_s)) > 1e-9:
                raise ConfigurationError(
                    f"{key} = {getattr(self, key)} must be a multiple of step_s = {self.step_s} s"
                )
        if self.method not in METHODS:
            raise ConfigurationError(f"method = {self.method!r} is unknown: use one of {METHODS}")
        for key in ("max_evaluations", "early_stop", "record_every"):
            if getattr(self, key) < 1:
                raise ConfigurationError(f"{key} = {getattr(self, key)} must be at least 1")
        for key, possible in (("histories", HISTORIES), ("record", RECORDABLE)):
            if not {*getattr(self, key)} <= {*possible}:
                raise ConfigurationError(f"{key} = {getattr(self, key)} must be some of {possible}")
        self._check_schedule()
        self._check_communication()
        if not np.all(self.initial.components() > 0.0):
            raise ConfigurationError(f"initial = {self.initial} must be positive throughout")

    def _check_schedule(self) -> None:
        """Refuse slots that steps do not fit, and schedules that cannot be planned."""
        minutes = self.schedule.slot_minutes
        if minutes is not None:
            steps = 60.0 * minutes / self.step_s
            if round(steps) < 1 or abs(steps - round(steps)) > 1e-9:
                raise ConfigurationError(
                    f"slot_minutes = {minutes} must be a multiple of step_s = {self.step_s} s"
                )
        if not self.schedule.plain:
            for key, value, needed in (
                ("method", self.method, "exact"),
                ("states", self.tasking.states, "translation"),
            ):
                if value != needed:
                    raise ConfigurationError(
                        f"{key} = {value!r}: slots, several observers at a target, turning times "
                        f"and a horizon need {key} = {needed!r}"
                    )

    def _check_communication(self) -> None:
        """Refuse measurements that never come, and what cannot be had with late ones."""
        model = self.communication
        if model.delay_minutes >= 60.0 * self.duration_hours:
            raise ConfigurationError(
                f"delay_minutes = {model.delay_minutes} is as long as the run of duration_hours = "
                f"{self.duration_hours}: nothing would ever be received; shorten it"
            )
        minutes = model.update_minutes
        if minutes is not None:
            steps = 60.0 * minutes / self.step_s
            if round(steps) < 1 or abs(steps - round(steps)) > 1e-9:
                raise ConfigurationError(
                    f"update_minutes = {minutes} must be a multiple of step_s = {self.step_s} s"
                )
        if model.late and model.credit_under_way and self.tasking.states != "translation":
            raise ConfigurationError(
                f"states = {self.tasking.states!r}: credit_under_way needs states = "
                "'translation'; set one of them"
            )

    @property
    def steps_between_updates(self) -> int:
        """Steps after which what has come late is taken in."""
        minutes = self.communication.update_minutes
        return round(60.0 * (self.interval_minutes if minutes is None else minutes) / self.step_s)

    @property
    def slots(self) -> int | None:
        """Slots of an interval, if it is divided."""
        if self.schedule.slot_minutes is None:
            return None
        return int(np.ceil(self.interval_minutes / self.schedule.slot_minutes - 1e-9))

    @property
    def n_steps(self) -> int:
        """Measurement times of a run, the epoch not counted."""
        return round(3600.0 * self.duration_hours / self.step_s)

    @property
    def steps_per_interval(self) -> int:
        """Measurement times between tasking epochs."""
        return round(60.0 * self.interval_minutes / self.step_s)

    @property
    def epochs(self) -> NDArray[np.int64]:
        """Step indices of the tasking epochs; 0 is the start of the run."""
        return np.arange(0, self.n_steps, self.steps_per_interval)

    @property
    def elapsed_s(self) -> Array:
        """Times of all steps since the start, the epoch included, s, shape (n_steps + 1,)."""
        return self.step_s * np.arange(self.n_steps + 1)

    @property
    def recorded(self) -> NDArray[np.int64]:
        """Indices, among the measurement times, of those at which errors are kept."""
        # Counted from the end, so that the final state is always among them.
        return np.arange(self.n_steps - 1, -1, -self.record_every)[::-1]

    def recorded_within(self, start: int, n_steps: int) -> NDArray[np.int64]:
        """Those of the `n_steps` measurement times from `start` on, counted from there."""
        first, last = np.searchsorted(self.recorded, [start, start + n_steps])
        return self.recorded[first:last] - start
