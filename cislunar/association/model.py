"""Settings of detections and their association. Nothing here needs compiled kernels."""

from collections.abc import Callable
from typing import Literal

from cislunar.detection.process import DetectionProcess
from cislunar.errors import ConfigurationError
from cislunar.runtime.settings_fields import Flag, Positive, number, setting, whole

KNOWN, NEAREST, JOINT, MULTIPLE_FRAMES = ASSOCIATORS = (
    "known-identity",
    "nearest-neighbor",
    "joint-probabilities",
    "multiple-frames",
)
"""Methods of association by name."""


class AssociationModel(DetectionProcess):
    """Telescopes that return everything in their field of view, and how detections get tracks."""

    # fmt: off

    detections: Literal["tasked-target", "all-in-field"] = setting(
        "what an exposure returns: a measurement of its own target alone, whose identity is known "
        "(`tasked-target`), or everything in its field of view, with false alarms "
        "(`all-in-field`), which the other keys describe", paper="tasked-target",
        default="tasked-target")
    method: Literal[ASSOCIATORS] = setting(
        "association of detections with tracks: the identity of every detection is known "
        "(`known-identity`, a reference), global nearest neighbor in each exposure "
        "(`nearest-neighbor`), joint probabilistic data association (`joint-probabilities`), or "
        "assignment over a window of exposures (`multiple-frames`)", default=MULTIPLE_FRAMES)
    unknown_deg2: Positive = setting(
        "assumed mean number of detections of objects without a track, per exposure and square "
        "degree", "deg^-2", default=1e-3)
    magnitude_sigma: Positive = setting(
        "assumed standard deviation of the magnitude that a sphere predicts", "mag", default=1.5)
    gate_probability: number(gt=0, lt=1) = setting(
        "probability that the gates keep the detection of a target", "1", default=0.9999)
    window_steps: whole(ge=1, le=100) = setting(
        "consecutive steps whose exposures are associated together", "1", default=12)
    committed_steps: whole(ge=1, le=100) = setting(
        "steps of a window that are decided; the next window begins after them. The other steps "
        "are decided again", "1", default=8)
    confirmations: whole(ge=1) = setting(
        "detections that `multiple-frames` asks of a track in `confirmation_exposures` exposures "
        "before the track takes any", "1", default=3)
    confirmation_exposures: whole(ge=1) = setting(
        "exposures in which `confirmations` are asked for", "1", default=5)
    confirmation_score: Positive = setting(
        "logarithm of the likelihood ratio from which the detections of a track need no "
        "confirmation", "1", default=14)
    hypotheses: whole(ge=2, le=1000) = setting(
        "largest number of hypotheses that `multiple-frames` keeps of a track", "1", default=20)
    lost_gate_factor: number(ge=1) = setting(
        "factor on the standard deviations of a lost track's orbit, for its gates: it is sought in "
        "a wider part of the field", "1", default=5)
    count_neighbors: Flag = setting(
        "true: tasking counts on all tracks in a field of view; false: on the one that it points "
        "at", default=False)
    gospa_cutoff_km: Positive = setting(
        "position error from which the GOSPA metric counts a target as missed and its track as "
        "false", "km", default=100)

    # fmt: on

    @property
    def in_field(self) -> bool:
        """Whether exposures return everything in their field of view."""
        return self.detections == "all-in-field"

    def model_post_init(self, _context: object) -> None:
        """Refuse windows and confirmations that contradict each other."""
        if self.committed_steps > self.window_steps:
            raise ConfigurationError(
                f"committed_steps = {self.committed_steps} must not exceed window_steps = "
                f"{self.window_steps}"
            )
        if self.confirmations > self.confirmation_exposures:
            raise ConfigurationError(
                f"confirmations = {self.confirmations} must not exceed confirmation_exposures = "
                f"{self.confirmation_exposures}"
            )

    def require_possible(
        self,
        late: bool,
        dimmed: bool,
        bound_steps: int,
        named: Callable[[str], str] = "association.{}".format,
    ) -> None:
        """Refuse a run whose measurements can be `late` or `dimmed` by shadows or air, or whose
        schedules are bounded in `bound_steps`, with settings that exclude it. `named` gives the
        name of a key in messages."""
        if self.in_field and late:
            raise ConfigurationError(
                f"{named('detections')} = {self.detections!r}: links with a delay need the "
                "identity of every measurement; set communication.delay_minutes to 0 and leave out "
                "communication.contact"
            )
        if self.in_field and dimmed:
            raise ConfigurationError(
                f"{named('detections')} = {self.detections!r}: the dimming of a target by shadows "
                "or air is removed from its own measurement, which needs an identity; leave out "
                "eclipse and stations"
            )
        if self.count_neighbors and bound_steps > 0:
            raise ConfigurationError(
                f"{named('count_neighbors')}: the bound of a schedule is that of the targets "
                "pointed at alone; set bound_steps to 0"
            )
