"""Labels in words for what the campaign names by identifiers; every figure and table takes them.

Nothing here needs matplotlib, so that generated tables use the same words as the figures.
"""

import re
from typing import NamedTuple

import numpy as np
import xarray as xr

from cislunar.campaign.settings.cells import Cell
from cislunar.campaign.tracking.realizations import PRACTICAL_UNITS

REALIZATION = 0
"""Realization that is drawn where the paper draws its single run."""

AXES = ("x", "y", "z")

ARCHITECTURES = {
    "tpe": "TPE",
    "random": "random search",
    "atpe": "adaptive TPE",
    "exact": "exact search",
    "published": "paper's orbit families",
    "J": "maximum J",
    "coverage": "maximum coverage",
    "information": "maximum orbit information",
    "stable": "maximum orbit information, stability index up to 2",
    "half-days": "maximum orbit information, windows of 12 h, 202 targets",
    "attitude": "maximum attitude information",
    "tpe-coverage": "maximum coverage, TPE",
    "hyperopt-coverage": "maximum coverage, TPE of hyperopt",
    "tpe-information": "maximum orbit information, TPE",
    "random-information": "maximum orbit information, random search",
    "chance": "random architecture",
}
"""Optimizers, and designs by their name without the number of satellites."""

OBJECTIVES = {
    "J": "J",
    "coverage": "coverage",
    "target-days": "target-days",
    "search": "search",
    "longest-gap": "longest gap",
    "mean-gap": "mean gap",
    "mean-wait": "mean wait",
    "information": "orbit information",
    "attitude": "attitude information",
    "chance": "random architecture",
}

ASSOCIATORS = {
    "known-identity": "known identity",
    "nearest-neighbor": "global nearest neighbor",
    "joint-probabilities": "joint probabilistic data association",
    "multiple-frames": "assignment over several exposures",
    "multiple-frames-unconfirmed": (
        "assignment over several exposures, confirmation by 1 of 5 exposures"
    ),
    "tasked target": "tasked target alone",
}

ESTIMATORS = {"mukf": "paper's filter (MUKF)", "batch": "batch estimator"}

TASKING_METHODS = {
    "exact": "exact assignment",
    "greedy": "greedy assignment",
    "tpe": "TPE",
    "tpe-compiled": "compiled TPE",
    "random": "random search",
}

MODEL_ERRORS = {
    "material.diffuse_weight": "diffuse weight",
    "material.specular_weight": "specular weight",
    "material.diffuse_albedo": "diffuse albedo",
    "material.rms_slope": "slope of microfacets",
    "material.normal_reflectance": "normal reflectance",
    "body.axis_scale": "axis scale of the shape",
    "body.radius_m": "size of the shape",
    "body.inertia": "axial inertia",
    "sensor.magnitude_noise": "magnitude noise",
    "sensor.angle_noise_arcsec": "angle noise",
    "angular_acceleration_deg_h2": "torque",
}
"""Kinds of model errors, by the key within `task2.truth`."""

BODY_PARAMETERS = {
    "log_albedo": "albedo",
    "log_slope": "slope",
    "logit_reflectance": "reflectance",
    "logit_specular_share": "specular share",
    "log_scale": "total brightness",
    "log_axis_scale": "axis scale",
    "log_facets": "facet reflectivity",
    "log_inertia": "inertia",
    "angular_acceleration_deg_h2": "torque",
}
"""Estimated parameters, by the key of `task2.batch.estimated_parameters`."""

_RECOMMENDED, _PAPER = "recommended pipeline", "paper's pipeline, ephemeris filter"

_UNMATCHED = {
    "matched": "bodies as assumed",
    "priors-half": "half the assumed spread of bodies",
    "priors-double": "twice the assumed spread of bodies",
    "priors-heavy": "heavy-tailed spread of bodies",
    "priors-wide": "prior of twice the spread of bodies",
    "stretched": "bodies stretched by 1.1, 1 and 0.95",
    "stretched-random": "bodies stretched at random by 10 %",
    "facets-20": "facets' reflectivity at random by 20 %",
    "shape-cylinder": "cylinders, assumed icosahedra",
    "shape-box": "boxes, assumed icosahedra",
    "shape-cube": "cubes, assumed icosahedra",
    "shape-prism": "hexagonal prisms, assumed icosahedra",
    "shape-wings": "boxes with wings, assumed icosahedra",
    "law-phong": "Lambert-Phong reflection",
    "law-seeliger-phong": "Lommel-Seeliger and Phong reflection",
    "law-ggx": "Lommel-Seeliger and GGX reflection",
    "law-tabulated": "tabulated reflection law",
    "torque-sunlight": "torque of sunlight",
    "torque-random": "random torque",
}
"""Truths that differ from the assumed model."""

_FILTERS = {
    "filter-material": "material as further states",
    "filter-bodies": "material, inertia and torque as further states",
    "filter-inflated": "larger magnitude noise assumed",
    "filter-adaptive": "magnitude noise estimated",
    "filter-strongest": "all additions",
    "filter-position": "angles alone",
}
"""Variants of the paper's filter that account for errors of the predicted brightness."""

_OBSERVER_ERRORS = {
    "bias-3arcsec": "a pointing bias of 3 arcsec",
    "bias-1km": "a position bias of 1 km",
    "bias-3arcsec-100m": "biases of 3 arcsec and 100 m",
    "walk-1km": "a random walk of 1 km in a day",
    "clock-1s": "a clock error of 1 s",
}
_TREATMENTS = {"": "ignored", "-considered": "considered", "-calibrated": "calibrated"}

OBSERVER_ERRORS = {
    name + ending: (label, treatment)
    for name, label in _OBSERVER_ERRORS.items()
    for ending, treatment in _TREATMENTS.items()
}
"""Variants with errors of observers: the errors and how the estimator treats them."""

BODY_TRUTHS = {
    prefix + name: (label, model)
    for name, label in _UNMATCHED.items()
    for prefix, model in {"": "assumed", "selected-": "selected"}.items()
}
"""Variants whose bodies differ from the assumed ones: the bodies, and whether the model that
estimates them is the assumed one or is selected from several."""

PIPELINES = {
    ("information", "batch", ""): _RECOMMENDED,
    ("information", "batch", "week"): f"{_RECOMMENDED}, seven days",
    ("published", "batch", ""): f"{_RECOMMENDED} on the paper's satellites",
    ("information", "mukf", ""): f"{_RECOMMENDED} with the paper's attitude filter",
    ("information", "batch", "without-unknowns"): f"{_RECOMMENDED}, no body parameters estimated",
    ("information", "batch", "without-learning"): f"{_RECOMMENDED}, detection not learned",
    ("information", "batch", "without-slots"): f"{_RECOMMENDED}, no slots of 20 min",
    ("information", "batch", "without-both"): f"{_RECOMMENDED}, the paper's tasking",
    ("information", "batch", "without-mixtures"): f"{_RECOMMENDED}, one Gaussian for each orbit",
    ("information", "batch", "without-noise"): f"{_RECOMMENDED}, no process noise",
    ("information", "batch", "without-ephemeris"): f"{_RECOMMENDED}, CR3BP filter",
    ("information", "batch", "without-pending"): f"{_RECOMMENDED}, pending measurements ignored",
    ("published", "mukf", "paper"): "paper's pipeline, CR3BP filter",
    ("published", "mukf", "paper-ephemeris"): _PAPER,
    ("published", "mukf", "week-paper"): f"{_PAPER}, seven days",
    ("information", "mukf", "with-orbits"): f"{_PAPER}, recommended satellites",
    ("published", "mukf", "with-tasking"): f"{_PAPER}, recommended tasking",
    ("published", "mukf", "with-mixtures"): f"{_PAPER}, Gaussian mixtures of orbits",
    ("published", "batch", "with-batch"): f"{_PAPER}, batch estimator",
    ("published", "mukf", ""): f"{_PAPER}, recommended tasking, mixtures and process noise",
    **{
        ("information", "batch", name): f"{_RECOMMENDED}, {label}, {model} model"
        for name, (label, model) in BODY_TRUTHS.items()
    },
    **{("published", "mukf", name): f"{_PAPER}, {label}" for name, label in _FILTERS.items()},
    **{
        ("information", "mukf", name): f"observers with {label}, {treatment}"
        for name, (label, treatment) in OBSERVER_ERRORS.items()
    },
}
"""Pipelines of ``config/real.yaml``: design without its number, estimator and variant."""

IN_TABLES_ALONE = {
    PIPELINES["published", "mukf", name] for name in _FILTERS if name != "filter-strongest"
}
"""Pipelines that no figure shows: filters with some of the additions."""

_TRUTH_AND_FILTER = {
    "cr3bp": "CR3BP truth and filter",
    "real": "ephemeris truth and filter",
    "real-cr3bp": "ephemeris truth, CR3BP filter",
    "real-cr3bp-noise": "ephemeris truth, CR3BP filter, process noise",
    "real-no-light": "ephemeris, filter without radiation",
    "real-no-light-noise": "ephemeris, filter without radiation, process noise",
    "real-light-20": "ephemeris, radiation 20 % too strong in the filter",
}

VALUES = {
    "as-in-the-paper": "paper's tasking",
    "learned-by-spheres": "learned detection, brightness of a sphere",
    "learned": "learned detection",
    "slots": "slots of 20 min",
    "slots-20-measurements": "slots of 20 min, 20 measurements counted",
    "recommended": "recommended (learned detection and slots)",
    "recommended-turning": "recommended, observers slew at 0.1 deg/s",
    "recommended-bounded": "recommended, bound on every schedule",
    "two-observers": "learned detection, two observers per target",
    "at-once": "no delay",
    "contact": "no contact behind the Moon or near the Sun",
    "delay-10": "delay of 10 min",
    "delay-60": "delay of 60 min",
    "delay-60-pending-ignored": "delay of 60 min, pending measurements ignored",
    "delay-180": "delay of 180 min",
    "one-epoch": "one epoch",
    "three-epochs": "three epochs",
    "six-epochs": "six epochs",
    "common": "one common estimate",
    "alone": "one catalog per observer",
    "covariance-intersection": "catalogs fused by covariance intersection",
    "all-at-18": "all telescopes to magnitude 18",
    "half-at-16": "half of the telescopes to magnitude 16",
    "half-at-16-learned": "half to magnitude 16, learned detection",
    "photons-15-cm": "photon noise, aperture of 15 cm",
    "photons-30-cm": "photon noise, aperture of 30 cm",
    "two-stations": "with two ground stations",
    **_TRUTH_AND_FILTER,
    **{f"perigee-{key}": text for key, text in _TRUTH_AND_FILTER.items()},
    **{f"batch-{key}": text for key, text in _TRUTH_AND_FILTER.items()},
    **{f"batch-perigee-{key}": f"{text}, perigee" for key, text in _TRUTH_AND_FILTER.items()},
    **{f"one-gaussian-{key}": text for key, text in _TRUTH_AND_FILTER.items()},
}
"""Values of the shipped sweeps."""

_FAMILIES = {
    "Halo_L1_N": "L1 halo N",
    "Halo_L1_S": "L1 halo S",
    "Halo_L2_N": "L2 halo N",
    "Halo_L2_S": "L2 halo S",
    "NRHO_4:1": "4:1 NRHO",
    "NRHO_9:2": "9:2 NRHO",
    "Resonant_3:1": "3:1 resonant",
    "Resonant_3:1b": "3:1 resonant (b)",
}


class Part(NamedTuple):
    """Three components of the state: name and practical unit.

    `factor` leads from the unit of the data sets to `unit`; a GRP of the attitude error is the
    angle in radians where it is small.
    """

    name: str
    unit: str
    factor: float
    columns: slice


PARTS = tuple(
    Part(name, unit, float(factor), slice(3 * number, 3 * number + 3))
    for number, (name, unit, (_, factor)) in enumerate(
        zip(
            ("attitude", "angular velocity", "position", "velocity"),
            ("deg", "deg/h", "km", "m/s"),
            PRACTICAL_UNITS.values(),
            strict=True,
        )
    )
)
"""In the order of the components of a cell's data set."""


def words(name: str) -> str:
    """An identifier without its hyphens and underscores; anything else, as a path, unchanged."""
    return re.sub("[_-]+", " ", name) if re.fullmatch(r"[^\W\d][\w-]*", name) else name


def plain(name: str) -> str:
    """A user's name for Matplotlib, which takes what is between two dollar signs for a formula."""
    return name.replace("$", r"\$")


def without_number(architecture: str) -> str:
    """Name of a design without its number of satellites."""
    return re.sub(r"-?\d+$", "", architecture)


def architecture_label(architecture: str) -> str:
    """An optimizer, or what a design is chosen by and its number of satellites if it has one."""
    stem = without_number(architecture)
    if stem not in ARCHITECTURES:
        return words(architecture)
    number = architecture[len(stem) :].strip("-")
    return f"{ARCHITECTURES[stem]}, {number} satellites" if number else ARCHITECTURES[stem]


def estimator_label(estimator: str) -> str:
    """The paper's filter or the batch estimator."""
    return ESTIMATORS.get(estimator, words(estimator))


def pipeline_label(architecture: str, estimator: str, variant: str = "") -> str:
    """A pipeline, whatever its number of satellites: architecture, estimator and variant."""
    stem = without_number(architecture)
    known = PIPELINES.get((stem, estimator, variant))
    if known is not None:
        return known
    parts = (architecture_label(stem), estimator_label(estimator), words(variant))
    return ", ".join(filter(None, parts))


def value_label(value: str) -> str:
    """A value of a sweep that is no number."""
    return VALUES.get(value, words(value))


def interval_text(minutes: int) -> str:
    """A tasking interval, in hours where it is a whole number of them."""
    return f"{minutes // 60} h" if minutes % 60 == 0 else f"{minutes} min"


def family_text(family: str) -> str:
    """Orbit class of a target."""
    if family.startswith("Polar_"):
        return f"polar, {family.removeprefix('Polar_').split('_')[0]}"
    return _FAMILIES.get(family, family.replace("_", " "))


def target_text(cell: xr.Dataset, index: int) -> str:
    """Name of a target of a cell in figures: the id in the user's table, else orbit class and
    identity."""
    family, number = str(cell["family"].values[index]), int(cell["target_id"][index])
    if "target_name" in cell:
        name = str(cell["target_name"].values[index])
        if name != f"{family} {number}":
            return plain(name)
    return f"{plain(family_text(family))} {number}"


def observers_text(cell: Cell, data: xr.Dataset, *, architecture: bool = True) -> str:
    """Scenario, number of observers and architecture of a cell, at the beginning of a title."""
    text = f"Scenario {cell.scenario}, {data.sizes['observer']} observers"
    if not architecture:
        return text
    return f"{text} (architecture: {architecture_label(cell.architecture)})"


def realization_text(data: xr.Dataset) -> str:
    """Number of the realization that is drawn."""
    return f"realization {REALIZATION + 1} of {data.sizes['seed']}"


def shown(data: xr.Dataset, name: str) -> np.ndarray:
    """A variable of the realization that is drawn."""
    return data[name].isel(seed=REALIZATION).values
