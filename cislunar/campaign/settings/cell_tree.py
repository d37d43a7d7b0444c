"""The settings of one cell of sensor tasking and tracking: how targets are observed and estimated.

The settings of the library are sections of a cell as they are.
"""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from cislunar.association.model import AssociationModel
from cislunar.attitude.torque_model import TorqueModel
from cislunar.errors import ConfigurationError
from cislunar.estimation.fusion.methods import FUSIONS
from cislunar.estimation.initial_sigma import InitialSigma, ProcessNoise
from cislunar.estimation.light_curves.batch_settings import BatchSettings
from cislunar.estimation.maneuvers.detection_settings import ManeuverDetection
from cislunar.estimation.navigation.errors import ObserverErrors
from cislunar.evaluation.custody import Custody
from cislunar.observation import REFLECTION_LAW, BodyParameterPrior, BodySpec, Sensor
from cislunar.observation.sensor import Atmosphere
from cislunar.photometry.materials import REFLECTION_LAWS, Material, PhotometryReading, Reflection
from cislunar.runtime.settings_fields import (
    Count,
    Flag,
    NotNegative,
    Partial,
    Positive,
    Section,
    Three,
    number,
    partial,
    setting,
    several,
    whole,
)
from cislunar.targets.maneuver_model import ManeuverModel
from cislunar.tasking.communication.model import CommunicationModel
from cislunar.tasking.planning import DetectionModel, ScheduleModel

# fmt: off

GroupName = Annotated[str, Field(pattern="^[a-z0-9][a-z0-9-]*$")]
History = Literal["errors", "bound"]
Recordable = Literal[
    "truth", "estimates", "covariance", "measurements", "pointing", "visibility", "observers"
]


class Tasking(ScheduleModel):
    """Method of tasking, slots, learned detection, and what scheduling assumes of brightness."""

    omitted = ("detection", "learned", *ScheduleModel.model_fields)

    mode: Literal["paper", "recommended"] = setting(
        "`recommended` sets `detection: learned`, `slot_minutes: 20` and "
        "`expected_measurements: 20`, except those that the configuration sets (docs/tasking.md)",
        paper="paper", default="paper")
    method: Literal["exact", "tpe", "tpe-compiled", "greedy", "random"] = setting(
        "assignment of observers to targets: `exact` (linear assignment, optimal), `tpe` (the "
        "paper's, by Hyperopt), `tpe-compiled` (the same algorithm, compiled), `greedy`, `random`",
        paper="tpe")
    max_evaluations: Count = setting(
        "maximum number of assignments that a search evaluates at an epoch", "1", "5000")
    early_stop: Count = setting(
        "number of assignments without improvement after which a search ends", "1", "700")
    states: Literal["translation", "full"] = setting(
        "states whose information counts: `translation`, by the two angles, or `full`, all twelve "
        "states by angles and magnitude", paper="translation")
    expected_measurements: Count = setting(
        "number of measurements, each as informative as the first, that tasking expects of an "
        "assigned pair", "1", "1", default=1)
    pointing_uncertainty_gate: Flag = setting(
        "true: a target whose predicted direction is uncertain by more than half the field of view "
        "gives no information", paper="not in the paper", default=True)
    diffuse_reflection_coefficient: Positive | None = setting(
        "C_d of the sphere by which tasking judges whether a target is visible; the sphere has the "
        "surface area of the target. null: as the photometry of the scenario states", "1",
        "not given", default=None)
    detection: Literal["sphere", "learned"] = setting(
        "model by which tasking judges who can detect a target: the `sphere` alone, or detection "
        "probabilities that are `learned` from the observations and weight the information of a "
        "pair", paper="sphere", default="sphere")
    learned: DetectionModel = setting("", default=DetectionModel())


class SensorGroup(Section):
    """Observers with a telescope of their own, and the properties in which it differs."""

    observers: Annotated[several(whole(ge=0)), Field(min_length=1)] = setting(
        "observers with a telescope of their own, counted from 0 like `observer` in a cell's file")
    sensor: partial(Sensor) = setting(
        "properties in which this telescope differs; keys of `sensor`")


class Station(Atmosphere):
    """A ground station: its place, its atmosphere, and the properties of its telescope."""

    latitude_deg: number(ge=-90, le=90) = setting("geodetic latitude", "deg")
    longitude_deg: number(ge=-180, le=360) = setting("longitude, positive to the east", "deg")
    height_m: number(ge=-500, le=9000) = setting("height above the ellipsoid", "m", default=0)
    sensor: partial(Sensor) = setting(
        "properties in which the station's telescope differs; keys of `sensor`",
        default=partial(Sensor)())


class Radiation(Section):
    area_to_mass: NotNegative = setting(
        "cross-section divided by mass; 0: no solar radiation pressure", "m^2/kg", default=0.01)
    reflectivity: NotNegative = setting(
        "coefficient C_R of solar radiation pressure: 1 for absorption, 2 for mirror reflection",
        "1", default=1.3)
    assumed_factor: NotNegative = setting(
        "solar radiation pressure that a filter with `dynamics.filter: ephemeris` assumes, divided "
        "by the true one", "1", default=1)


class Dynamics(Section):
    """Dynamics of the truth and of the filter, and motion of the observers."""

    truth: Literal["cr3bp", "ephemeris"] = setting(
        "true dynamics of the targets: the `cr3bp`, or `ephemeris` dynamics with Earth, Moon and "
        "Sun from `ephemeris.kernel`", paper="cr3bp", default="cr3bp")
    filter: Literal["cr3bp", "ephemeris"] = setting(
        "dynamics that the estimators assume; `cr3bp` under an `ephemeris` truth is the "
        "instantaneous-frame CR3BP", paper="cr3bp", default="cr3bp")
    observers: Literal["refined", "reference"] = setting(
        "observers in `ephemeris` dynamics: `reference` keeps each on its CR3BP orbit, `refined` "
        "finds a natural path next to it", default="reference")
    unrefined: Literal["reference", "refused"] = setting(
        "observers for which no natural path is found: `reference` keeps them on their CR3BP "
        "orbits, `refused` refuses the run", default="reference")
    srp: Radiation = Radiation()
    lunar_harmonics: Flag = setting(
        "true: `ephemeris` dynamics include J2 and C22 of the Moon", default=True)

    @model_validator(mode="after")
    def _possible(self) -> "Dynamics":
        if self.filter == "ephemeris" and self.truth == "cr3bp":
            raise ConfigurationError("filter = 'ephemeris' with truth = 'cr3bp': no body is where "
                                     "the ephemeris has it; set truth to 'ephemeris'")
        return self


class Filter(Section):
    omitted = ("use_magnitude", "extra_magnitude_noise", "noise_memory", "estimate_parameters")

    splitting: Flag = setting(
        "true: both estimators represent an orbit by a Gaussian mixture where a single Gaussian "
        "does not suffice, as after a gap between measurements or at short range "
        "(docs/dynamics.md)", paper="one Gaussian", default=True)
    use_magnitude: Flag = setting(
        "false: the estimator `mukf` uses the two angles of a measurement alone. Its attitude "
        "estimate is then the propagated initial estimate", paper="true", default=True)
    extra_magnitude_noise: NotNegative = setting(
        "standard deviation of brightness-model errors, which the estimator `mukf` adds in "
        "quadrature to the magnitude noise of the sensor", "mag", default=0)
    noise_memory: number(gt=1) | None = setting(
        "number of magnitudes over which the estimator `mukf` estimates their noise variance, for "
        "each target, by the variational Bayesian filter of Sarkka & Nummenmaa (2009); null: the "
        "variance is known", "1", default=None)
    estimate_parameters: Flag = setting(
        "true: the estimator `mukf` estimates the body parameters of `batch.estimated_parameters` "
        "as further states", default=False)

    @model_validator(mode="after")
    def _possible(self) -> "Filter":
        if not self.use_magnitude:
            for key, usual in (
                ("extra_magnitude_noise", 0), ("noise_memory", None), ("estimate_parameters", False)
            ):
                if getattr(self, key) != usual:
                    raise ConfigurationError(
                        f"use_magnitude = False and {key} = {getattr(self, key)} exclude each "
                        "other: without magnitudes there is neither brightness nor its noise"
                    )
        return self


_TrueDeviations = partial(
    BodyParameterPrior,
    tuple(key for key in BodyParameterPrior.model_fields if key not in REFLECTION_LAW),
)
"""A true body has one reflection law."""


class Truth(Partial):
    material: partial(Material) = None
    body: partial(BodySpec) = None
    sensor: partial(Sensor, ("magnitude_noise", "angle_noise_arcsec")) = None
    reflection: Reflection = REFLECTION_LAWS[0]
    angular_acceleration_deg_h2: Three = Field([0, 0, 0])
    parameter_sigma: _TrueDeviations = _TrueDeviations()
    parameter_freedom: number(gt=2) | None = None
    torque: partial(TorqueModel) = partial(TorqueModel)()
    maneuvers: partial(ManeuverModel) = partial(ManeuverModel)()


class CellSettings(Section):
    """Settings of a cell, which a variant may change."""

    omitted = ("first_realization", "start_day", "histories", "record", "eclipse", "fusion",
               "sensors", "stations", "dynamics", "communication", "association",
               "observer_errors", "maneuver_detection")

    seeds: whole(ge=1, le=10_000) = setting(
        "number of realizations of truth and noise of each cell. All cells have the same "
        "realizations, and a larger number keeps the first ones", "1", "1 (a single run)",
        default=10)
    first_realization: whole(ge=0) = setting(
        "number of the first realization, which selects its random draws of truth and noise. Cells "
        "of different days or targets that are pooled have independent draws if their numbers "
        "differ", "1", default=0)
    monitored_seed: whole(ge=0) = setting(
        "seed that selects the monitored targets (a larger set contains the smaller ones) and "
        "their initial phases on their orbits", "1", '"a fixed random seed"', default=20241001)
    duration_hours: Positive = setting(
        "duration of a run, which ends within `visibility.duration_days`", "h", "24")
    start_day: NotNegative = setting(
        "day of the horizon on which a run starts. Observers, Sun and targets have their states of "
        "that day; periodic targets have advanced on their orbits", "d", "0", default=0)
    step_s: Positive = setting(
        "time between measurements, and time step of filter and truth",
        "s", "60 (table 3; 30 in the text)")
    record_minutes: Positive = setting(
        "time between the errors and standard deviations that a cell's file keeps (always with the "
        "last state); the metrics use every step", "min", default=10)
    histories: several(History) = setting(
        "histories that a cell keeps of every target at the recorded times: `errors` (with "
        "standard deviations) and `bound` (Cramér-Rao). Metrics, tables and most figures need "
        "neither. Detection outcomes are always kept at every step, a byte each before "
        "compression", default=["errors", "bound"])
    record: several(Recordable) = setting(
        "further quantities that a cell keeps for other tools: any of `truth` and `estimates` "
        "(states at the recorded times), `covariance` (of position and velocity), `measurements` "
        "(every observation of every step), `pointing` (directions of the observers), "
        "`visibility` (targets that any observer could have detected, by interval, for the "
        "quantities `never_visible` and `missed`) and `observers` (true and estimated errors of "
        "the observers, by interval)", default=[])
    tasking: Tasking = setting("")
    sensor: Sensor = setting("")
    sensors: dict[GroupName, SensorGroup] = setting("", default={})
    stations: dict[GroupName, Station] = setting("", default={})
    observer_errors: ObserverErrors = ObserverErrors()
    maneuver_detection: ManeuverDetection = ManeuverDetection()
    initial_sigma: InitialSigma = setting("")
    eclipse: Flag = setting(
        "true: targets are dimmer in the penumbra of Earth and Moon and invisible in the umbra, "
        "for tasking as well", paper="not in the paper", default=False)
    communication: CommunicationModel = CommunicationModel()
    association: AssociationModel = AssociationModel()
    fusion: Literal[FUSIONS] = setting(
        "estimates that are evaluated: one `common` estimate of all observers; or, with a catalog "
        "of each observer from its own measurements, the best single catalog of each target "
        "(`alone`), or the `covariance-intersection` of the catalogs", paper="common",
        default=FUSIONS[0])
    process_noise: ProcessNoise = ProcessNoise()
    dynamics: Dynamics = Dynamics()
    filter: Filter = Filter()
    custody: Custody = Custody()
    batch: BatchSettings = BatchSettings()
    body: BodySpec = setting("")
    material: Material = Material()
    photometry: PhotometryReading = PhotometryReading()
    truth: Truth = setting(
        "true properties of targets and sensors that differ from the assumed model: any of "
        "`material`, `body` (their keys), `sensor.magnitude_noise`, `sensor.angle_noise_arcsec`, "
        "`reflection` (law by which targets reflect: `cook-torrance`, `lambert-phong`, "
        "`lommel-seeliger-phong`, `lommel-seeliger-ggx`, or a table of a law, `.csv` or `.nc`), "
        "`angular_acceleration_deg_h2` (three numbers in deg/h^2, the effect on every target of a "
        "torque constant along the body axes), `parameter_sigma` (keys of "
        "`batch.estimated_parameters`, standard deviations of the random body-parameter deviations "
        "of each target in each realization), `parameter_freedom` (degrees of freedom, above 2, of "
        "Student's t distribution of these deviations; null: normal), `torque` (varying torques, "
        "docs/bodies.md: `center_of_pressure_sigma_m`, `mass_kg`, `random_deg_h2`, "
        "`random_hours`) and `maneuvers` (docs/maneuvers.md: a `table`, and `drawn`, a list of "
        "kinds of random maneuvers, each with `share`, `smallest_m_s`, `largest_m_s`, "
        "`interval_hours`, `first_hour`, `last_hour` and `duration_minutes`). "
        "`{}`: no difference. The random numbers stay the same", default=Truth())


CellChange = partial(CellSettings)
