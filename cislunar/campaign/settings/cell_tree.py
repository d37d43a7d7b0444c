"""The settings of one cell of sensor tasking and tracking: how targets are observed and estimated.

Each key is stated as `cislunar.campaign.settings.tree` says.
"""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from cislunar.campaign.settings.fields import (
    Angle,
    Count,
    Flag,
    NotNegative,
    Partial,
    Positive,
    Section,
    Text,
    Three,
    ThreePositive,
    number,
    partial,
    setting,
    several,
    whole,
)
from cislunar.campaign.settings.observing.sensor_tree import (
    GroupName,
    Sensor,
    SensorGroup,
    Station,
)
from cislunar.errors import ConfigurationError
from cislunar.estimation.fusion.ways import FUSIONS
from cislunar.estimation.light_curves.batch_settings import BatchSettings
from cislunar.observation.body_spread import BodySpread
from cislunar.observation.wanted_bodies import ICOSAHEDRON
from cislunar.photometry.materials import REFLECTION_LAWS, PhotometryModel
from cislunar.photometry.materials import Material as LibraryMaterial
from cislunar.photometry.spacecraft import MODELS
from cislunar.tasking.communication.model import CommunicationModel
from cislunar.tasking.planning.detection_model import DetectionModel
from cislunar.tasking.planning.schedule_model import ScheduleModel

# fmt: off

History = Literal["errors", "bound"]
Recordable = Literal[
    "truth", "estimates", "covariance", "measurements", "pointing", "visibility"
]


class Detection(Section):
    brightness: Literal["facets", "sphere"] = setting(
        "what a target's magnitude is expected to be but for an offset of its own: that of its "
        "`facets` in the attitude the estimator expects (of catalogues of one's own, which have no "
        "common one, that of the sphere), or that of the `sphere`",
        default=DetectionModel.brightness)
    prior_mag: Positive = setting(
        "standard deviation of that offset, before the first look (of the `sphere`: 1)",
        "mag", default=DetectionModel.prior_mag)
    flicker_mag: Positive = setting(
        "standard deviation of its magnitude about that (of the `sphere`: 0.5)", "mag",
        default=DetectionModel.flicker_mag)
    never_detected_bonus: NotNegative = setting(
        "what a sure detection of a target that was never detected is worth beyond its information",
        "nat", default=DetectionModel.never_detected_bonus)


class Tasking(Section):
    mode: Literal["paper", "recommended"] = setting(
        "`recommended`: of the keys below, `detection` is `learned`, `slot_minutes` 20 and "
        "`credited_measurements` 20, unless they are set otherwise (docs/tasking.md)",
        paper="paper", default="paper")
    method: Literal["exact", "tpe", "tpe-compiled", "greedy", "random"] = setting(
        "assignment of observers: `exact` (linear assignment, optimal), `tpe` (the paper's, by "
        "Hyperopt), `tpe-compiled` (the same algorithm, compiled), `greedy`, `random`", paper="tpe")
    max_evaluations: Count = setting("taskings a search tries at an epoch", "1", "5000")
    early_stop: Count = setting("taskings without progress after which they end", "1", "700")
    states: Literal["translation", "full"] = setting(
        "whose information counts: `translation` by the two angles, or `full`, all twelve states "
        "by angles and magnitude", paper="translation")
    credited_measurements: Count = setting(
        "measurements, each as informative as the first, a pair is credited with",
        "1", "1", default=1)
    track_gate: Flag = setting(
        "true: no information from a target whose predicted direction is uncertain by more than "
        "half the field of view", paper="not in the paper", default=True)
    diffuse_reflection_coefficient: Positive | None = setting(
        "C_d of the sphere that stands for a target when tasking judges its visibility; its "
        "radius is that of equal area. null: as `scenarios.NAME.photometry` says", "1",
        "not given", default=None)
    detection: Literal["sphere", "learned"] = setting(
        "what tells who can see a target: the `sphere` alone, or how likely looks detect it, which "
        "is `learned` from what they found and weighs the information of a pair",
        paper="sphere", default="sphere")
    learned: Detection = setting("", default=Detection())
    slot_minutes: Positive | None = setting(
        "time after which an observer may turn to another target, a multiple of `step_s`; null: "
        "the tasking interval", "min", "the interval", default=None)
    observers_per_target: whole(ge=1, le=4) = setting(
        "observers that may look at a target at the same time", "1", "1",
        default=ScheduleModel.observers_per_target)
    slew_deg_s: Positive | None = setting(
        "rate at which an observer turns to another target; null: at once", "deg/s",
        "at once", default=None)
    settle_s: NotNegative = setting(
        "time after turning until the first look", "s", "0", default=int(ScheduleModel.settle_s))
    horizon_epochs: whole(ge=1, le=24) = setting(
        "tasking intervals that are planned together at an epoch; the first is carried out", "1",
        "1", default=ScheduleModel.horizon_epochs)
    bound_steps: whole(ge=0) = setting(
        "steps of the prices by which the best joint choice of all slots is bounded "
        "(`planning_gap` in a cell's file; 30 take some tenths of a second an epoch); 0: it is not",
        "1", "not in the paper", default=ScheduleModel.bound_steps)


class InitialSigma(Section):
    attitude_deg: Positive = setting(
        "initial standard deviation of each attitude error angle", "deg", "5 (variance 5^2)")
    angular_velocity_deg_h: Positive = setting(
        "of each component of the angular velocity", "deg/h", "2.4 (variance (0.1 x 24)^2)")
    position_km: Positive = setting(
        "of each component of the position", "km", "31.6 (variance 0.1 x 100000^2 m^2)")
    velocity_m_s: Positive = setting(
        "of each component of the velocity", "m/s", "0.0316 (variance 0.1 x 0.1^2)")


class Custody(Section):
    position_km: Positive = setting(
        "largest position error at the end of a run of a target that counts as held",
        "km", "not in the paper", default=10)
    attitude_deg: Positive = setting(
        "largest attitude error of such a target", "deg", "not in the paper", default=5)


class Contact(Section):
    moon: Flag = setting(
        "true: behind the Moon's disc an observer is out of contact with the Earth",
        default=CommunicationModel.moon)
    sun_deg: Angle = setting(
        "angle at the Earth between Sun and observer below which there is no contact", "deg",
        default=int(CommunicationModel.sun_deg))


class Communication(Section):
    delay_minutes: NotNegative = setting(
        "time until the common estimate has what an observer in contact measures, shorter than the "
        "run", "min", "0", default=int(CommunicationModel.delay_minutes))
    contact: Contact = Contact()
    update_minutes: Positive | None = setting(
        "time between the instants at which the common estimate takes in what comes late; null: "
        "the tasking interval", "min", default=CommunicationModel.update_minutes)
    credit_under_way: Flag = setting(
        "tasking counts on looks taken and not yet received",
        default=CommunicationModel.credit_under_way)


class ProcessNoise(Section):
    attitude_deg: NotNegative = setting(
        "standard deviation of the attitude that accumulates in 60 s; 0.03 in the variant "
        "`process-noise`", "deg", "not given", default=0)
    angular_velocity_deg_h: NotNegative = setting(
        "of the angular velocity", "deg/h", "not given", default=0)
    position_km: NotNegative = setting("of the position", "km", "not given", default=0)
    velocity_m_s: NotNegative = setting("of the velocity", "m/s", "not given", default=0)
    acceleration_m2_s3: NotNegative = setting(
        "spectral density of white acceleration on each axis", "m^2/s^3", "not given", default=0)


class Radiation(Section):
    area_to_mass: NotNegative = setting(
        "cross-section by mass; 0: sunlight does not push", "m^2/kg", default=0.01)
    reflectivity: NotNegative = setting(
        "coefficient C_R of radiation pressure: 1 absorbs, 2 reflects back", "1", default=1.3)
    believed_factor: NotNegative = setting(
        "the push a filter of the ephemeris model believes in, by the true one", "1", default=1)


class Dynamics(Section):
    truth: Literal["cr3bp", "ephemeris"] = setting(
        "what moves the targets: the `cr3bp`, or Earth, Moon and Sun where they are",
        paper="cr3bp", default="cr3bp")
    filter: Literal["cr3bp", "ephemeris"] = setting(
        "what the estimators believe in; a filter of the CR3BP among real bodies has the "
        "instantaneous rotating frame", paper="cr3bp", default="cr3bp")
    observers: Literal["refined", "reference"] = setting(
        "observers among real bodies: `reference` holds them on their orbits of the CR3BP, "
        "`refined` finds paths beside these that take no fuel", default="reference")
    unrefined: Literal["held", "refused"] = setting("observers without such a path", default="held")
    srp: Radiation = Radiation()
    lunar_harmonics: Flag = setting("true: J2 and C22 of the Moon act there", default=True)

    @model_validator(mode="after")
    def _possible(self) -> "Dynamics":
        if self.filter == "ephemeris" and self.truth == "cr3bp":
            raise ConfigurationError("filter = 'ephemeris' with truth = 'cr3bp': no body is where "
                                     "the ephemeris has it; set truth to 'ephemeris'")
        return self


class Filter(Section):
    splitting: Flag = setting(
        "true: both estimators take an orbit for a mixture of Gaussians where, after a gap between "
        "measurements or at short range, one is not enough (docs/dynamics.md)",
        paper="one Gaussian", default=True)


class Unknowns(Section):
    log_albedo: NotNegative = setting(
        "standard deviation of the logarithm of the diffuse albedo, 0.25 for some 25 %",
        "1", default=0)
    log_slope: NotNegative = setting("of the microfacets' slope", "1", default=0)
    logit_reflectance: NotNegative = setting(
        "of the logarithm of the odds F_0 / (1 - F_0)", "1", default=0)
    logit_specular_share: NotNegative = setting(
        "of that of the odds s / d, whose sum is kept", "1", default=0)
    log_scale: NotNegative = setting(
        "of the logarithm of all light thrown back; 1 is 1.09 mag", "1", default=0)
    log_stretch: NotNegative = setting(
        "of that of the length along each body axis", "1", default=0)
    log_facets: NotNegative = setting(
        "of that of the light each facet throws back", "1", default=0)
    log_inertia: NotNegative = setting(
        "of those of the moments along the second and third body axis over that along the first",
        "1", default=0)
    angular_acceleration_deg_h2: NotNegative = setting(
        "of what a torque constant in the body frame gives, along each of its axes",
        "deg/h^2", default=0)


class Batch(Section):
    modes: Count = setting(
        "of the estimator `batch`: most modes of the attitude's posterior kept (16 in the preset "
        "`accurate`)", default=BatchSettings.modes)
    starts: whole(ge=0) = setting(
        "starts of a fit besides the live modes (8 in `accurate`)", default=BatchSettings.starts)
    first_starts: whole(ge=0) = setting(
        "starts of the first fit (16 in `accurate`)", default=BatchSettings.first_starts)
    pool: whole(ge=0) = setting(
        "random points out of which the starts are chosen, at least as many as starts (128 in "
        "`accurate`)", default=BatchSettings.pool)
    refit_growth: NotNegative = setting(
        "share by which a light curve has to grow to be fitted anew between tasking epochs; 0: at "
        "tasking epochs only (0.1 in `accurate`)", "1", default=BatchSettings.refit_growth)
    window_hours: Positive | None = setting(
        "age beyond which measurements are condensed into a Gaussian per mode; null keeps all",
        "h", default=BatchSettings.window_hours)
    memory_hours: Positive | None = setting(
        "time in which what is known from condensed measurements fades by e; null forgets "
        "nothing; needs `window_hours`", "h", default=BatchSettings.memory_hours)
    use_non_detections: Flag = setting(
        "a tasked target in clear view that is not seen counts as fainter than the limit",
        default=BatchSettings.use_non_detections)
    magnitude_noise_factor: Positive = setting(
        "factor on the magnitude noise the attitude is fitted with, for inexact models",
        "1", default=int(BatchSettings.magnitude_noise_factor))
    noise_freedom: Positive | None = setting(
        "degrees of freedom of what is known of the magnitude noise's variance, which is then "
        "integrated out; null: it is known", "1", default=BatchSettings.noise_freedom)
    most_searches: Count = setting(
        "searches of a fit that is in doubt, because its residuals are too large or its modes "
        "disagree", default=BatchSettings.most_searches)
    unknowns: Unknowns = Unknowns()

    @model_validator(mode="after")
    def _possible(self) -> "Batch":
        batch_settings(self)
        return self


def batch_settings(batch: Batch) -> BatchSettings:
    """The same for the library."""
    return BatchSettings(**{**dict(batch), "unknowns": BodySpread(**dict(batch.unknowns))})


SHAPE = f"^({ICOSAHEDRON}|{'|'.join(MODELS)})$|[.]([oO][bB][jJ]|[sS][tT][lL])$"
TABLE = "[.][cC][sS][vV]$"


class Body(Section):
    shape: Annotated[str, Field(pattern=SHAPE)] = setting(
        "`icosahedron`, a model of docs/bodies.md, or a closed triangle mesh (`.obj`, `.stl`); "
        "facets may shadow each other", paper="icosahedron")
    radius_m: Positive | None = setting(
        "the shape is scaled to the surface area of this sphere; null keeps the size of a model or "
        "a mesh file", "m", "1")
    metres_per_unit: Positive = setting("length of the mesh file's unit", "m", default=1)
    stretch: ThreePositive = setting(
        "factors by which the shape is stretched along its body axes, before it is scaled to "
        "`radius_m`", "1", default=[1, 1, 1])
    materials: Text | None = setting(
        "material of each facet group, `group=material; group=material`: `panel`, `foil`, `paint`, "
        "`material` (the keys below) or their five numbers. null: a model's own, else `material` "
        "all over", default=None)
    table: Annotated[str, Field(pattern=TABLE)] | None = setting(
        "table of bodies, a target to a row (docs/bodies.md); a target that is not in it has the "
        "body above, which tasking's sphere stands for", default=None)
    inertia: ThreePositive | None = setting(
        "principal moments of inertia along the body axes, in any unit since bodies turn freely; "
        "null = spherical", paper="spherical", default=None)


class Material(Section):
    diffuse_weight: NotNegative = setting(
        "d, weight of the diffuse share", "1", "not given", default=LibraryMaterial.diffuse_weight)
    specular_weight: NotNegative = setting(
        "s, weight of the specular share",
        "1", "not given", default=LibraryMaterial.specular_weight)
    diffuse_albedo: number(ge=0, le=1) = setting(
        "rho", "1", "not given", default=LibraryMaterial.diffuse_albedo)
    rms_slope: Positive = setting(
        "delta_RMS of the microfacets", "1", "not given", default=LibraryMaterial.rms_slope)
    normal_reflectance: number(ge=0, lt=1) = setting(
        "F_0", "1", "not given", default=LibraryMaterial.normal_reflectance)


class Photometry(Section):
    irradiance: Literal["4pi", "1/r^2"] | None = setting(
        "spreading of a facet's light: `4pi` for 1/(4 pi r^2) as printed, `1/r^2` as light does, "
        "2.75 mag brighter. null: as `scenarios.NAME.photometry` says", paper="4pi", default=None)
    fresnel: Literal["sqrt", "printed"] = setting(
        "`sqrt` as in Cook & Torrance, `printed` without the root",
        paper="printed", default=PhotometryModel.fresnel)


class Truth(Partial):
    material: partial(Material) = None
    body: partial(Body) = None
    sensor: partial(Sensor, ("magnitude_noise", "angle_noise_arcsec")) = None
    reflection: Literal[REFLECTION_LAWS] = None
    angular_acceleration_deg_h2: Three = None
    spread: partial(Unknowns) = None


class CellSettings(Section):
    """What sets a cell, and what a variant may change."""

    seeds: whole(ge=1, le=10_000) = setting(
        "realizations of truth and noise of every cell; the same in all cells, and the first ones "
        "stay the same when the number is raised", "1", "1 (a single run)", default=10)
    monitored_seed: whole(ge=0) = setting(
        "chooses which targets are monitored (smaller sets are contained in larger ones) and "
        "where on their orbits they start", "1", '"a fixed random seed"', default=20241001)
    duration_hours: Positive = setting(
        "length of a run, which ends within `visibility.duration_days`", "h", "24")
    start_day: NotNegative = setting(
        "day of the horizon on which a run begins; observers, Sun and targets are where they are "
        "then, those with a period having gone around it", "d", "0", default=0)
    step_s: Positive = setting(
        "time between measurements, and step of filter and truth",
        "s", "60 (table 3; 30 in the text)")
    record_minutes: Positive = setting(
        "time between the errors and deviations kept in a cell's file (the last state always is); "
        "the metrics use every step", "min", default=10)
    histories: several(History) = setting(
        "what a cell keeps of every target at the recorded times: `errors` (and deviations) and "
        "`bound` (Cramér-Rao); metrics, tables and most figures need neither. What became of a "
        "look is kept at every step, a byte each before compression",
        default=["errors", "bound"])
    record: several(Recordable) = setting(
        "what a cell keeps besides, for other tools: any of `truth` and `estimates` (states at the "
        "recorded times), `covariance` (of position and velocity), `measurements` (every look of "
        "every step), `pointing` (where observers look) and `visibility` (which targets any "
        "observer could have found, by interval, for the quantities `never_visible` and `missed`)",
        default=[])
    tasking: Tasking = setting("")
    sensor: Sensor = setting("")
    sensors: dict[GroupName, SensorGroup] = setting("", default={})
    stations: dict[GroupName, Station] = setting("", default={})
    initial_sigma: InitialSigma = setting("")
    eclipse: Flag = setting(
        "true: targets dim in the penumbra of Earth and Moon, and cannot be seen in the umbra; "
        "tasking knows it", paper="not in the paper", default=False)
    communication: Communication = Communication()
    fusion: Literal[FUSIONS] = setting(
        "whose estimates count: one `common` to all observers, or of catalogues that each makes of "
        "its own measurements the best of each target (`alone`), or what they say together",
        paper="common", default=FUSIONS[0])
    process_noise: ProcessNoise = ProcessNoise()
    dynamics: Dynamics = Dynamics()
    filter: Filter = Filter()
    custody: Custody = Custody()
    batch: Batch = Batch()
    body: Body = setting("")
    material: Material = Material()
    photometry: Photometry = Photometry()
    truth: Truth = setting(
        "what targets and sensors truly are where the estimators believe otherwise: any of "
        "`material`, `body` (keys as above), `sensor.magnitude_noise`, "
        "`sensor.angle_noise_arcsec`, `reflection`, the law by which targets reflect "
        "(`cook-torrance` or `lambert-phong`), `angular_acceleration_deg_h2`, three numbers in "
        "deg/h^2 along the body axes that a constant torque gives every target, and `spread`, keys "
        "as of `batch.unknowns`, by which each target departs at random in each realization. "
        "`{}` = nothing. The random numbers stay the same", default=Truth())


CellChange = partial(CellSettings)
