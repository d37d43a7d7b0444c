"""Every setting of the campaign, stated once: type, range, unit, the paper's value, meaning.

Where the paper gives a value, the campaign has to state one (``config/config.yaml`` does); what it
leaves open has its default here. The schema for editors, the tables of ``config/README.md``, every
message and what the library is handed are made from these classes.
"""

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, WithJsonSchema, create_model, model_validator

from cislunar.campaign.settings.fields import (
    Angle,
    Count,
    Flag,
    NotNegative,
    Number,
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
from cislunar.estimation.light_curves.batch_settings import BatchSettings
from cislunar.photometry.materials import Material as LibraryMaterial
from cislunar.photometry.materials import PhotometryModel

FAMILIES = (
    *("Butterfly_N", "Butterfly_S", "Dragonfly_N", "Dragonfly_S", "Halo_L1_N", "Halo_L1_S"),
    *("Halo_L2_N", "Halo_L2_S", "Halo_L3_N", "Halo_L3_S", "Lyap_L1", "Lyap_L2", "Lyap_L3"),
)
Architecture = Literal["tpe", "random", "atpe", "exact", "published"]
Labels = Literal["family_position", "index", "stability_rank", "categorical"]
ScenarioName = Annotated[str, Field(pattern="^[A-Za-z][A-Za-z0-9.-]*$")]
SweepName = Annotated[str, Field(pattern="^[a-z][a-z0-9-]*$")]
VariantName = Annotated[str, Field(pattern="^[a-z][a-z0-9.-]*$")]
TargetCounts = several(whole(ge=1))
CountsByScenario = dict[str, TargetCounts]
Estimators = Annotated[several(Literal["mukf", "batch"]), Field(min_length=1)]


class Exclusion(Section):
    sun: Angle = setting("least angle between the line of sight and the Sun", "deg", "35")
    moon: Angle = setting("the same for the centre of the Moon", "deg", "5")
    earth: Angle = setting("the same for the centre of the Earth", "deg", "15")


class Ephemeris(Section):
    kernel: Text = setting(
        "`de421` (the file of the package skyfield-data) or the path of any SPK file that has Sun, "
        "Earth and Moon",
        paper="SPICE",
        default="de421",
    )
    step_minutes: number(gt=0, le=60) = setting(
        "spacing of the samples in `ephemeris/sun.nc`; read linearly in between", "min", default=10
    )


class KeepOut(Section):
    perilune_altitude_km: NotNegative = setting(
        "least altitude over the Moon (extent `keep_out`)", "km", default=100
    )
    perigee_altitude_km: NotNegative = setting(
        "least altitude over the Earth (extent `keep_out`)", "km", default=200
    )


class Orbits(Section):
    extent: Literal["keep_out", "catalog"] = setting(
        "`keep_out`: families end where they meet a body; `catalog`: they go as far as published "
        "catalogues list them, through the bodies",
        default="keep_out",
    )
    keep_out: KeepOut = KeepOut()
    members: create_model(
        "Members",
        __base__=Section,
        **{name: (whole(ge=0, le=500), setting("")) for name in FAMILIES},
    ) = setting(
        "orbits of each of the 13 families; 0 leaves a family out",
        paper="about 23, 302 in all",
        name="FAMILY",
    )


class Targets(Section):
    missions: Text = setting("table with the columns `mission` and `jacobi`", "path", "64 missions")
    centers: Annotated[
        several(Literal["moon", "earth", "barycenter", "L1", "L2", "L3", "L4", "L5"]),
        Field(min_length=1),
    ] = setting("centres of the angular grids", default=["moon", "earth"])
    region: Literal["moon", "earth", "bodies", "all"] = setting(
        "which part of the region within a zero-velocity surface: the component of the `moon`, of "
        "the `earth`, of both `bodies`, or `all`",
        default="moon",
    )
    angular_step_deg: number(ge=0.1, le=90) = setting(
        "step in longitude and latitude", "deg", "equiangular", default=15
    )
    radial_points: whole(ge=1, le=10_000) = setting("points along each ray", default=8)
    radial_step_km: number(ge=1) | None = setting(
        "length of a radial step in place of `radial_points`; null = not used", "km", default=None
    )
    outer_radius_km: number(gt=384_400, le=10_000_000) = setting(
        "distance from the barycentre beyond which nothing is sampled", "km", default=700_000
    )
    seeding: Literal["k-means++", "greedy k-means++", "random"] = setting(
        "how k-means is seeded; see `cislunar/targets/clustering.py`",
        paper="k-means",
        default="greedy k-means++",
    )


class Visibility(Section):
    duration_days: number(gt=0, le=36_525) = setting("horizon", "d", "30")
    step_hours: Positive = setting("spacing of the evaluation times (721 of them)", "h", "1")
    limiting_magnitude: Number = setting("a target must be brighter", "mag", "18")
    target_radius_m: Positive = setting("radius of the spherical targets", "m", "1")
    diffuse_reflection_coefficient: Positive = setting(
        "C_d of the sphere; 1 brings out the paper's J, see `docs/deviations.md`", default=1
    )
    exclusion_deg: Exclusion = setting("")


class Certificate(Section):
    within: number(ge=0, lt=1) = setting(
        "every architecture with J within this share of the optimum is listed", default=0.01
    )
    time_limit_s: Positive = setting(
        "after this time the bound reached is reported instead of a proof", "s", default=600
    )


class Front(Section):
    fewest: whole(ge=1) = setting("least satellite total of the front of best J", default=10)
    most: whole(ge=1) = setting("greatest satellite total of the front", default=60)
    restarts: whole(ge=0) = setting(
        "random starts for each total, beside the solution of the total before", default=4
    )


class LabelComparison(Section):
    scenario: str | None = setting("scenario on which ways of labelling are compared", default="A")
    labels: several(Labels) = setting(
        "ways compared with `architecture.labels`",
        default=["family_position", "index", "categorical"],
    )


class Readings(Section):
    scenario: str | None = setting(
        "scenario rerun under each reading of the paper (`tables/readings_architecture.csv`)",
        default="A",
    )


class Search(Section):
    optimizers: Annotated[several(Architecture), Field(min_length=1)] = setting(
        "how architectures are found; `atpe` needs the package lightgbm", paper="tpe, random"
    )
    slots: whole(ge=1, le=1000) = setting("distinct orbits of an architecture", paper="10")
    max_satellites: whole(ge=1, le=90) = setting("most satellites on one orbit", paper="10")
    max_evaluations: Count = setting("evaluations of a search", paper="10 000")
    early_stop: Count = setting("evaluations without improvement that end a search", paper="500")
    labels: Labels = setting(
        "how an orbit is labelled for Hyperopt; see `docs/deviations.md`", default="stability_rank"
    )
    runs: whole(ge=1, le=1000) = setting(
        "searches with different random numbers; the best becomes the architecture, all make the "
        "spread",
        paper="1",
        default=5,
    )
    restarts: whole(ge=1, le=1_000_000) = setting(
        "starts of the coordinate search (`exact`, `published`)", default=10
    )
    certificate: Certificate = Certificate()
    front: Front = Front()
    label_comparison: LabelComparison = LabelComparison()
    readings: Readings = Readings()


# Sensor tasking and tracking: what sets one cell


class Tasking(Section):
    method: Literal["exact", "tpe", "greedy", "random"] = setting(
        "assignment of observers: `exact` (linear assignment, optimal), `tpe` (the paper's), "
        "`greedy`, `random`",
        paper="tpe",
    )
    max_evaluations: Count = setting("taskings `tpe` and `random` try at an epoch", "1", "5000")
    early_stop: Count = setting("taskings without progress after which they end", "1", "700")
    states: Literal["translation", "full"] = setting(
        "whose information counts: `translation` by the two angles, or `full`, all twelve states "
        "by angles and magnitude",
        paper="translation",
    )
    credited_measurements: Count = setting(
        "measurements, each as informative as the first, a pair is credited with",
        "1",
        "1",
        default=1,
    )
    track_gate: Flag = setting(
        "true: no information from a target whose predicted direction is uncertain by more than "
        "half the field of view",
        paper="not in the paper",
        default=True,
    )
    diffuse_reflection_coefficient: Positive = setting(
        "C_d of the sphere that stands for a target when tasking judges its visibility; its radius "
        "is that of equal area",
        "1",
        "not given",
        default=0.5,
    )


class Sensor(Section):
    magnitude_noise: Positive = setting(
        "standard deviation of the measured magnitude", "mag", "0.1"
    )
    angle_noise_arcsec: Positive = setting(
        "standard deviation of right ascension and of declination", "arcsec", "3"
    )
    field_of_view_deg: number(gt=0, le=180) = setting(
        "full width; measurements beyond half of it from the expected direction are rejected",
        "deg",
        "3",
    )
    limiting_magnitude: Number = setting(
        "faintest measured magnitude that counts, and the limit tasking assumes", "mag", "18"
    )
    exclusion_deg: Exclusion = setting("")
    occultation: Flag = setting(
        "true: targets behind the disc of Earth or Moon are hidden",
        paper="not in the paper",
        default=True,
    )


class InitialSigma(Section):
    attitude_deg: Positive = setting(
        "initial standard deviation of each attitude error angle", "deg", "5 (variance 5^2)"
    )
    angular_velocity_deg_h: Positive = setting(
        "of each component of the angular velocity", "deg/h", "2.4 (variance (0.1 x 24)^2)"
    )
    position_km: Positive = setting(
        "of each component of the position", "km", "31.6 (variance 0.1 x 100000^2 m^2)"
    )
    velocity_m_s: Positive = setting(
        "of each component of the velocity", "m/s", "0.0316 (variance 0.1 x 0.1^2)"
    )


class ProcessNoise(Section):
    attitude_deg: NotNegative = setting(
        "standard deviation of the attitude that accumulates in 60 s; 0.03 in the variant "
        "`process-noise`",
        "deg",
        "not given",
        default=0,
    )
    angular_velocity_deg_h: NotNegative = setting(
        "of the angular velocity", "deg/h", "not given", default=0
    )
    position_km: NotNegative = setting("of the position", "km", "not given", default=0)
    velocity_m_s: NotNegative = setting("of the velocity", "m/s", "not given", default=0)


class Batch(Section):
    modes: Count = setting(
        "of the estimator `batch`: most modes of the attitude's posterior kept (16 in the preset "
        "`accurate`)",
        default=BatchSettings.modes,
    )
    starts: whole(ge=0) = setting(
        "starts of a fit besides the live modes (8 in `accurate`)", default=BatchSettings.starts
    )
    first_starts: whole(ge=0) = setting(
        "starts of the first fit (16 in `accurate`)", default=BatchSettings.first_starts
    )
    pool: whole(ge=0) = setting(
        "random points out of which the starts are chosen, at least as many as starts (128 in "
        "`accurate`)",
        default=BatchSettings.pool,
    )
    refit_growth: NotNegative = setting(
        "share by which a light curve has to grow to be fitted anew between tasking epochs; 0: at "
        "tasking epochs only (0.1 in `accurate`)",
        "1",
        default=BatchSettings.refit_growth,
    )
    window_hours: Positive | None = setting(
        "age beyond which measurements are condensed into a Gaussian per mode; null keeps all",
        "h",
        default=BatchSettings.window_hours,
    )
    memory_hours: Positive | None = setting(
        "time in which what is known from condensed measurements fades by e; null forgets nothing; "
        "needs `window_hours`",
        "h",
        default=BatchSettings.memory_hours,
    )
    use_non_detections: Flag = setting(
        "a tasked target in clear view that is not seen counts as fainter than the limit",
        default=BatchSettings.use_non_detections,
    )
    magnitude_noise_factor: Positive = setting(
        "factor on the magnitude noise the attitude is fitted with, for inexact models",
        "1",
        default=int(BatchSettings.magnitude_noise_factor),
    )
    magnitude_offset: NotNegative = setting(
        "standard deviation of an unknown offset common to a target's magnitudes",
        "mag",
        default=int(BatchSettings.magnitude_offset),
    )

    @model_validator(mode="after")
    def _possible(self) -> "Batch":
        BatchSettings(**dict(self))
        return self


class Body(Section):
    shape: Annotated[str, Field(pattern="^icosahedron$|[.]([oO][bB][jJ]|[sS][tT][lL])$")] = setting(
        "`icosahedron`, or a closed convex triangle mesh (`.obj`, `.stl`)", paper="icosahedron"
    )
    radius_m: Positive | None = setting(
        "the shape is scaled to the surface area of this sphere; null keeps the size of a mesh "
        "file",
        "m",
        "1",
    )
    metres_per_unit: Positive = setting("length of the mesh file's unit", "m", default=1)
    stretch: ThreePositive = setting(
        "factors by which the shape is stretched along its body axes, before it is scaled to "
        "`radius_m`",
        "1",
        default=[1, 1, 1],
    )
    inertia: ThreePositive | None = setting(
        "principal moments of inertia along the body axes, in any unit since bodies turn freely; "
        "null = spherical",
        paper="spherical",
        default=None,
    )


class Material(Section):
    diffuse_weight: NotNegative = setting(
        "d, weight of the diffuse share", "1", "not given", default=LibraryMaterial.diffuse_weight
    )
    specular_weight: NotNegative = setting(
        "s, weight of the specular share", "1", "not given", default=LibraryMaterial.specular_weight
    )
    diffuse_albedo: number(ge=0, le=1) = setting(
        "rho", "1", "not given", default=LibraryMaterial.diffuse_albedo
    )
    rms_slope: Positive = setting(
        "delta_RMS of the microfacets", "1", "not given", default=LibraryMaterial.rms_slope
    )
    normal_reflectance: number(ge=0, lt=1) = setting(
        "F_0", "1", "not given", default=LibraryMaterial.normal_reflectance
    )


class Photometry(Section):
    irradiance: Literal["4pi", "1/r^2"] = setting(
        "spreading of a facet's light: `4pi` for 1/(4 pi r^2) as printed, `1/r^2` in line with the "
        "sphere model",
        paper="4pi",
        default=PhotometryModel.irradiance,
    )
    fresnel: Literal["sqrt", "printed"] = setting(
        "`sqrt` as in Cook & Torrance, `printed` without the root",
        paper="printed",
        default=PhotometryModel.fresnel,
    )


class Truth(Partial):
    material: partial(Material) = None
    body: partial(Body) = None
    sensor: partial(Sensor, ("magnitude_noise", "angle_noise_arcsec")) = None
    angular_acceleration_deg_h2: Three = None


class Cell(Section):
    """What sets a cell, and what a variant may change."""

    seeds: whole(ge=1, le=10_000) = setting(
        "realizations of truth and noise of every cell; the same in all cells, and the first ones "
        "stay the same when the number is raised",
        "1",
        "1 (a single run)",
        default=10,
    )
    monitored_seed: whole(ge=0) = setting(
        "chooses which targets are monitored (smaller sets are contained in larger ones) and where "
        "on their orbits they start",
        "1",
        '"a fixed random seed"',
        default=20241001,
    )
    duration_hours: Positive = setting(
        "length of a run; at most `visibility.duration_days`", "h", "24"
    )
    step_s: Positive = setting(
        "time between measurements, and step of filter and truth",
        "s",
        "60 (table 3; 30 in the text)",
    )
    record_minutes: Positive = setting(
        "time between the errors and deviations kept in a cell's file (the last state always is); "
        "the metrics use every step",
        "min",
        default=10,
    )
    tasking: Tasking = setting("")
    sensor: Sensor = setting("")
    initial_sigma: InitialSigma = setting("")
    process_noise: ProcessNoise = ProcessNoise()
    batch: Batch = Batch()
    body: Body = setting("")
    material: Material = Material()
    photometry: Photometry = Photometry()
    truth: Truth = setting(
        "what targets and sensors truly are where the estimators believe otherwise: any of "
        "`material`, `body` (keys as above), `sensor.magnitude_noise`, "
        "`sensor.angle_noise_arcsec`, and `angular_acceleration_deg_h2`, three numbers in deg/h^2 "
        "along the body axes that a constant torque gives every target. `{}` = nothing. The random "
        "numbers stay the same",
        default=Truth(),
    )


CellChange = partial(Cell)


# What the campaign is made of


def _values(value: Any) -> Any:
    """Values of a family: a list of different ones, or their variants' names with them."""
    simple = isinstance(value, list) and all(isinstance(v, int | float | str) for v in value)
    if not value or not (simple or isinstance(value, dict)):
        raise ValueError("must be a list of numbers, texts or true and false, or name: value")
    if simple and len(set(value)) < len(value):
        raise ValueError("holds a value twice")
    return value


_CHOICE = {"type": ["array", "object"]}
Values = Annotated[Any, AfterValidator(_values), WithJsonSchema(_CHOICE)]


def _optional(meaning: str, unit: str = "") -> Any:
    """A key that may be left out."""
    return setting(meaning, unit, default=None)


class Family(Partial):
    """One key with values, each of which makes a variant or a scenario."""

    scenario: str = _optional("scenario that is varied; left out: that of all variants")
    architecture: Architecture = _optional("whose observers track; left out: those of all variants")
    targets: TargetCounts = _optional("numbers of targets that are tracked", "1")
    estimators: Estimators = _optional("estimators; left out: the first of `task2.estimators`")
    key: Text = _optional("dotted key of a cell that takes `values`, such as `truth.body.inertia`")
    values: Values = _optional("its values by the names of the variants")


class VariantFamily(Family):
    """A family that may also be stated as named changes, or as combinations of variants."""

    changes: dict[VariantName, CellChange] = setting(
        "in place of `key` and `values`: settings that differ, in the form of the keys above, by "
        "the names of the variants",
        default=None,
        name="",
    )
    combine: dict[VariantName, several(VariantName)] = setting(
        "in place of both: variants that this one is added to; each is called "
        "`{one of them}-{variant}`",
        default=None,
        name="",
    )


class Sweep(Family):
    """A family whose values are compared in a table and a figure of their own."""

    scenario: str = setting("scenario that is varied")
    architecture: Architecture = setting("architecture that is compared")
    targets: TargetCounts = _optional(
        "numbers of moving targets that are tracked; empty or left out for a sweep of "
        "architectures alone",
        "1",
    )
    estimators: Estimators = _optional("estimators; left out: `task2.estimators`")
    key: Text = setting(
        "dotted key within `scenarios.NAME`, such as `settings.visibility.limiting_magnitude`, "
        "`settings.task2.sensor.magnitude_noise`, `targets`, `tracked`"
    )
    values: Values = setting(
        "its values. Of `settings.task2`, each is a variant of the scenario's cells "
        "(`_{sweep}-{value}.nc`); else a scenario of its own (`{scenario}-{sweep}-{value}`), with "
        "its own architecture"
    )
    label: Annotated[str, Field(min_length=1, max_length=80)] = _optional(
        "what the values are, with their unit, below the figure; the key if left out"
    )


class Variants(Section):
    scenario: str | None = setting("where settings are changed, unless a family says otherwise")
    architecture: Architecture = setting("whose observers track there")
    only: several(VariantName) | None = setting(
        "variants that have cells; null: all. Any cell can be had with any variant by its name, "
        "`nt50_dt60_{variant}.nc`",
        default=None,
    )
    targets: TargetCounts | None = setting(
        "their numbers of targets in place of the families' own; null: those", "1", default=None
    )
    families: dict[VariantName, VariantFamily] = setting("", default={}, name="{family}")


class Intervals(Section):
    minutes: several(Count) = setting(
        "tasking intervals of the second sweep", "min", "30, 60, 120, 180, 240"
    )
    target_counts: CountsByScenario = setting(
        "numbers of targets of the second sweep", "1", "A 20 and 50, B 33", name="{scenario}"
    )


class TaskingComparison(Section):
    scenario: str | None = setting("cells on which the tasking methods are compared; null: none")
    architecture: Architecture = setting("whose observers")
    targets: TargetCounts = setting("numbers of targets", "1")
    epochs: Annotated[several(whole(ge=0)), Field(min_length=1)] = setting(
        "tasking epochs compared, counted from 0", "1"
    )
    runs: Count = setting("searches of each kind at each epoch", "1")
    evaluations: Annotated[several(Count), Field(min_length=1)] = setting(
        "budgets, each a search of its own with its own clock", "1", "5000"
    )
    tpe_evaluations: Count = setting(
        "largest budget of TPE, whose time grows faster than its evaluations; "
        "`config/paper_tpe.yaml` has the paper's",
        "1",
        "5000",
    )
    early_stop: Count = setting(
        "evaluations without progress after which a search ends", "1", "700"
    )


class Task2(Cell):
    architectures: several(Architecture) = setting(
        "architectures of both sweeps", paper="the TPE result"
    )
    estimators: Estimators = setting(
        "estimators; `mukf` is the paper's error-state multiplicative UKF", paper="mukf"
    )
    interval_minutes: Count = setting(
        "tasking interval of the sweep over the number of targets, a multiple of the step",
        "min",
        "60",
    )
    target_counts: CountsByScenario = setting(
        "numbers of monitored targets, at most 202 (or the rows of the scenario's own table)",
        "1",
        "A 20 .. 202, B 33 .. 202, C 43 .. 202",
        name="{scenario}",
    )
    intervals: Intervals = setting("")
    other_architectures: dict[Architecture, CountsByScenario] = setting(
        "numbers of targets tracked by a further architecture, to set beside the others",
        "1",
        default={},
        name="{architecture}.{scenario}",
    )
    variants: Variants = setting("")
    tasking_comparison: TaskingComparison = setting("")


class Surroundings(Section):
    """What a scenario may set for itself."""

    epoch_jd: number(ge=2_441_317.5) = setting("initial epoch, UTC", "JD", "2460584.5 (2024-10-01)")
    ephemeris: Ephemeris = Ephemeris()
    targets: Targets = setting("")
    visibility: Visibility = setting("")
    task2: Cell = setting("")


class Scenario(Partial):
    targets: whole(ge=1, le=10_000_000) = setting(
        "clusters (static targets) of the scenario; the paper has A, B and C",
        paper="100, 2 000, 10 000",
        default=None,
    )
    static_targets: Text = setting(
        "in place of `targets`: table of static targets (columns `id`, `x`, `y`, `z` or `x_km`, "
        "`y_km`, `z_km`; see `cislunar/targets/tables.py`)",
        "path",
        default=None,
    )
    tracked: Text = setting(
        "table of moving targets in place of the 202 orbits: `id`, position as above, velocity "
        "`vx`, `vy`, `vz` or `vx_km_s`, `vy_km_s`, `vz_km_s`, at the epoch in the rotating frame; "
        "optional `period` or `period_days`, and `family`",
        "path",
        default=None,
    )
    settings: partial(Surroundings) = _optional(
        "what the scenario sets otherwise: any of `epoch_jd`, `ephemeris`, `targets`, `visibility` "
        "and, of `task2`, the keys that set a cell, in the form they have here"
    )


class Campaign(Surroundings):
    """The configuration of a campaign."""

    results: Text = setting(
        "folder of every result; another folder is another campaign", "path", default="results"
    )
    seed: whole(ge=0) = setting("seed of all random numbers (each job derives its own stream)")
    propagator: Literal["dopri5", "dop853"] = setting(
        "how observers are propagated: `dopri5` (5(4) at 1e-10) or `dop853` (at 1e-13)",
        paper="dopri5",
    )
    orbits: Orbits = setting("")
    scenarios: Annotated[dict[ScenarioName, Scenario | None], Field(min_length=1)] = setting(
        "static targets and all that is done with them; null leaves the scenario out, with all "
        "that refers to it",
        paper="A, B, C",
    )
    sweeps: dict[SweepName, Sweep] = setting("", default={})
    architecture: Search = setting("")
    task2: Task2 = setting("")
