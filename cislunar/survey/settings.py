"""Settings of a survey. Nothing here needs compiled kernels."""

from typing import Annotated, Literal

from pydantic import Field

from cislunar.detection.process import DetectionProcess
from cislunar.errors import ConfigurationError
from cislunar.orbit_determination.tracklets.settings import TrackletSettings
from cislunar.runtime.settings_fields import (
    Count,
    NotNegative,
    Positive,
    Section,
    number,
    setting,
    whole,
)

SOURCES = ("families", "zero_velocity", "table", "uniform")
"""Sources of a prior, by the names of its shares."""

DENSITY, SWEEP, STARING = "density", "uniform-sweep", "fixed-staring"


class DensityPrior(Section):
    """Sources of the samples of undetected objects, and their brightness."""

    # fmt: off

    families: NotNegative = setting(
        "share of periodic orbits of the library at random phases", "1", default=0.4)
    zero_velocity: NotNegative = setting(
        "share of points within zero-velocity surfaces, at rest and then propagated", "1",
        default=0.3)
    table: NotNegative = setting("share of states of a table of the user", "1", default=0)
    uniform: NotNegative = setting(
        "share of states that are uniform over the phase-space volume of the admissible region",
        "1", default=0.3)
    particles: Count = setting("number of samples", "1", default=4000)
    expected_objects: Positive = setting(
        "expected number of undetected objects at the start", "1", default=200)
    births_per_day: NotNegative = setting(
        "expected number of objects that enter the region in a day, by which the density grows in "
        "proportion to itself at the start", "1/day", default=0)
    drift_days: Positive = setting(
        "longest time for which samples of zero-velocity surfaces are propagated", "day",
        default=10)
    median_size_m2: Positive = setting(
        "median of the product of diffuse reflection coefficient and squared radius of the sphere "
        "that is as bright as an object", "m^2", default=0.5)
    size_sigma_mag: NotNegative = setting(
        "standard deviation of that size, as a magnitude", "mag", default=0.75)

    # fmt: on

    @property
    def shares(self) -> dict[str, float]:
        """Share of each source, with the sum 1; raises a `ConfigurationError` if all are zero."""
        given = {name: float(getattr(self, name)) for name in SOURCES}
        total = sum(given.values())
        if not total > 0.0:
            raise ConfigurationError(
                f"prior: the shares {', '.join(SOURCES)} are all zero; give a positive one"
            )
        return {name: share / total for name, share in given.items()}


class SearchSettings(Section):
    """Strategy and timing of the search."""

    # fmt: off

    strategy: Literal["density", "uniform-sweep", "fixed-staring"] = setting(
        "choice of fields: by `density` and information, a `uniform-sweep` over the sky, or "
        "`fixed-staring` at the libration points L1 and L2", default=DENSITY)
    search_days: Positive | None = setting(
        "time after which plans follow known orbits alone; null: they search to the end", "day",
        default=None)
    block_minutes: Positive = setting("time that a plan covers", "min", default=20)
    visits: Count = setting("exposures of a field in a block", "1", default=2)
    detection_weight: number(gt=0, le=1) = setting(
        "share of an object's worth that a detection uses up: below 1, since an orbit needs "
        "several tracklets", "1", default=0.5)
    information_worth: NotNegative = setting(
        "worth of one nat of information on a known orbit, in detections of new objects; 0: "
        "without follow-up", "1", default=0.1)
    characterization_worth: NotNegative = setting(
        "worth of one nat of information on the light curve of a known orbit, in detections of new "
        "objects; 0: plans disregard light curves", "1", default=0)
    exposure_s: Positive = setting("duration of an exposure", "s", default=10)
    slew_rate_deg_s: Positive = setting("rate at which a telescope turns", "deg/s", default=2)
    settle_s: NotNegative = setting("time to settle after a turn", "s", default=5)

    # fmt: on


class LineageSettings(Section):
    """Maneuvers of cataloged objects: orbits before and after, and orbits that are lost."""

    # fmt: off

    maneuvers_per_day: NotNegative = setting(
        "assumed number of maneuvers of an object in a day; 0: the catalog assumes that no object "
        "maneuvers", "1/day", default=0)
    scales_m_s: Annotated[tuple[Positive, ...], Field(min_length=1)] = setting(
        "standard deviations of a component of a change of velocity, equally probable", "m/s",
        default=(0.1, 1, 20, 300))
    longest_gap_h: Positive = setting(
        "longest time without a detection in which a maneuver is sought", "h", default=48)
    least_probability: number(gt=0.5, lt=1) = setting(
        "least probability with which two orbits are taken to be of one object, before and after "
        "a maneuver or at one time, or an orbit to be lost", "1", default=0.99)

    # fmt: on


class QualitySettings(Section):
    """What counts as correct and as findable."""

    # fmt: off

    right_km: Positive = setting(
        "largest position error of a correct orbit at its last detection", "km", default=500)
    custody_km: Positive = setting(
        "largest position error of an object in custody, at the time of the table", "km",
        default=10)
    findable_tracklets: Count = setting(
        "least number of tracklets of a findable object", "1", default=3)
    known_days: Positive = setting(
        "an object is known if it had a correct confirmed orbit this long before, even if the "
        "orbit has been lost since", "day", default=1)

    # fmt: on


ANGULAR_VELOCITY_SIGMA_DEG_H = 45.0
"""Assumed for new objects; that of simulated objects is smaller (`TrueObjects`)."""


class CharacterizationSettings(Section):
    """Spin period, amplitude, and area times albedo of cataloged objects at the end of a survey."""

    # fmt: off

    least_detections: whole(ge=0) = setting(
        "least number of detections with which the light curve of a confirmed orbit is used; 0: "
        "light curves are not used", "1", default=0)
    largest_noise_mag: Positive = setting(
        "largest median standard deviation of the magnitudes of an object that is bright enough",
        "mag", default=0.2)
    angular_velocity_sigma_deg_h: Positive = setting(
        "assumed standard deviation of each component of the angular velocity, whose mean is zero",
        "deg/h", default=ANGULAR_VELOCITY_SIGMA_DEG_H)
    searches: Count = setting("independent searches for the spin period of an object", "1",
        default=4)
    largest_period_error: Positive = setting(
        "largest half width of the 95 % interval of the logarithm of a period that is determined",
        "1", default=0.2)

    # fmt: on


class SurveyModel(Section):
    """Survey from an empty catalog."""

    # fmt: off

    duration_days: Positive = setting("duration", "day", default=1)
    link_hours: Positive = setting(
        "time between two linking runs, a multiple of `search.block_minutes`", "h", default=4)
    latency_minutes: NotNegative = setting(
        "time after which the data of a block reach the catalog and the planning, a multiple of "
        "`search.block_minutes` and less than `link_hours`", "min", default=0)
    magnitude_sigma: Positive = setting(
        "standard deviation of an object's magnitudes about those of a sphere, which the search "
        "assumes", "mag", default=0.4)
    radiation_sigma: NotNegative = setting(
        "standard deviation of the ratio of the true to the assumed radiation pressure on an "
        "object, which is estimated with the orbit; 0: the ratio is known", "1", default=0)
    kernel_deg: Positive = setting(
        "standard deviation of the directions of objects about that of a particle", "deg",
        default=1)
    search: SearchSettings = setting("", default=SearchSettings())
    prior: DensityPrior = setting("", default=DensityPrior())
    process: DetectionProcess = setting("", default=DetectionProcess())
    tracklets: TrackletSettings = setting("", default=TrackletSettings())
    quality: QualitySettings = setting("", default=QualitySettings())
    lineage: LineageSettings = setting("", default=LineageSettings())
    characterization: CharacterizationSettings = setting("", default=CharacterizationSettings())

    # fmt: on

    @property
    def blocks_per_link(self) -> int:
        """Blocks between two linking runs; raises a `ConfigurationError` if `link_hours` is not
        a multiple of the block."""
        per_link = 60.0 * self.link_hours / self.search.block_minutes
        found = round(per_link)
        if abs(per_link - found) > 1e-9 or found < 1:
            raise ConfigurationError(
                f"link_hours = {self.link_hours} must be a multiple of "
                f"search.block_minutes = {self.search.block_minutes}"
            )
        return found

    @property
    def blocks_late(self) -> int:
        """Blocks after which data reach the catalog; raises a `ConfigurationError` if
        `latency_minutes` is not a multiple of the block or not less than `link_hours`."""
        late = self.latency_minutes / self.search.block_minutes
        found = round(late)
        if abs(late - found) > 1e-9 or found >= self.blocks_per_link:
            raise ConfigurationError(
                f"latency_minutes = {self.latency_minutes} must be a multiple of "
                f"search.block_minutes = {self.search.block_minutes}, and less than link_hours "
                f"= {self.link_hours}"
            )
        return found
