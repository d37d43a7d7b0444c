"""Settings of a closed-loop run."""

from dataclasses import dataclass, field
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from cislunar.association.model import AssociationModel
from cislunar.errors import ConfigurationError
from cislunar.estimation.initial_sigma import PAPER_INITIAL_SIGMA, InitialSigma
from cislunar.evaluation.metrics import Custody
from cislunar.observation.sensor import GroundSensor, Sensor
from cislunar.runtime import Array, count_of, number_of, require_kind, require_multiple
from cislunar.runtime.arguments import require_choice
from cislunar.tasking.communication.model import CommunicationModel
from cislunar.tasking.planning import EARLY_STOP, MAX_EVALUATIONS, METHODS, TaskingModel
from cislunar.tasking.planning.schedule_model import ScheduleModel

HISTORIES = ("errors", "bound")
"""Histories that a run keeps by default."""

RECORDABLE = (
    "truth",
    "estimates",
    "covariance",
    "measurements",
    "pointing",
    "visibility",
    "observers",
)
"""Further quantities that a run can keep."""


@dataclass(frozen=True)
class LoopSettings:
    """Settings of a closed-loop run; the defaults are the paper's values where it gives any.

    Attributes
    ----------
    step_s, interval_minutes, duration_hours : float
        Time between measurements, s, and between tasking epochs, min; duration of a run, h.
    method : str
        Method of the assignment, see `cislunar.tasking.planning.assignment.assign`.
    max_evaluations, early_stop : int
        Budget of the methods that search.
    sensor : Sensor or tuple of Sensor
        Telescope of all observers, or of each.
    tasking : TaskingModel
        Model of the targets that tasking assumes.
    schedule : ScheduleModel
        Slots of an interval, and observers per target.
    communication : CommunicationModel
        Links of the observers to the Earth.
    association : AssociationModel
        What exposures return, and how detections are associated with tracks.
    eclipse : bool
        Whether the shadows of Earth and Moon dim targets, for tasking as well. A magnitude measured
        in the penumbra is corrected for the dimming that is expected at the estimated position
        (`cislunar.estimation.eclipses`).
    initial : InitialSigma
        Uncertainty of the targets at the epoch.
    custody : Custody
        Largest errors at the end of a run with which a target counts as in custody.
    record_every : int
        Steps between the times at which errors and standard deviations are kept; metrics use every
        step.
    keep_information : bool
        Whether the information of all pairs is kept at every epoch.
    histories : tuple of str
        Kept histories, of `HISTORIES`: errors with standard deviations, and the bound. Metrics need
        neither.
    record : tuple of str
        Further kept quantities, of `RECORDABLE`.

    Raises
    ------
    ConfigurationError
        If a value is unknown, of another kind or impossible, or settings exclude each other.
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
    association: AssociationModel = field(default_factory=AssociationModel)
    eclipse: bool = False
    initial: InitialSigma = PAPER_INITIAL_SIGMA
    custody: Custody = field(default_factory=Custody)
    record_every: int = 1
    keep_information: bool = False
    histories: tuple[str, ...] = HISTORIES
    record: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for key in ("step_s", "interval_minutes", "duration_hours"):
            number_of(key, getattr(self, key), positive=True)
        require_multiple("interval_minutes", self.interval_minutes, 60.0, self.step_s)
        require_multiple("duration_hours", self.duration_hours, 3600.0, self.step_s)
        require_choice("method", self.method, METHODS)
        for key in ("max_evaluations", "early_stop", "record_every"):
            count_of(key, getattr(self, key))
        for key, kind in (
            ("sensor", Sensor | tuple | list),
            ("tasking", TaskingModel),
            ("schedule", ScheduleModel),
            ("communication", CommunicationModel),
            ("association", AssociationModel),
            ("initial", InitialSigma),
            ("custody", Custody),
            ("histories", tuple | list | set),
            ("record", tuple | list | set),
        ):
            named = " or ".join(getattr(each, "__name__", "") for each in get_args(kind) or (kind,))
            require_kind(key, getattr(self, key), kind, f"give a {named}")
        for key, possible in (("histories", HISTORIES), ("record", RECORDABLE)):
            if not {*getattr(self, key)} <= {*possible}:
                raise ConfigurationError(f"{key} = {getattr(self, key)} must be some of {possible}")
        states = self.tasking.states
        self.schedule.require_possible(self.step_s, self.method, states)
        self.communication.require_possible(self.step_s, self.duration_hours, states)
        sensors = [self.sensor] if isinstance(self.sensor, Sensor) else self.sensor
        dimmed = self.eclipse or any(isinstance(one, GroundSensor) for one in sensors)
        bounded = self.schedule.bound_steps
        self.association.require_possible(self.communication.late, dimmed, bounded)

    @property
    def steps_between_updates(self) -> int:
        """Steps between the instants at which late measurements are processed."""
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
        """Indices of `recorded` among the `n_steps` times from `start` on, counted from `start`."""
        first, last = np.searchsorted(self.recorded, [start, start + n_steps])
        return self.recorded[first:last] - start
