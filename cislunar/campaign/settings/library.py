"""The settings as the library takes them: its own objects, made here and nowhere else.

It needs the compiled library: jobs import it, the workflow does not.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from cislunar.architecture.information.tables import Looks
from cislunar.campaign.settings import cell_tree, tree
from cislunar.campaign.settings.cells import SCHEDULE_KEYS, true_settings
from cislunar.campaign.settings.reading import typed
from cislunar.estimation.estimator import EstimatorFactory
from cislunar.estimation.registry import estimator_named
from cislunar.estimation.spread import ProcessNoise, Spread
from cislunar.evaluation.metrics import Custody
from cislunar.observation.body_spread import BodySpread
from cislunar.observation.scene import TargetSurfaces, target_surfaces
from cislunar.observation.sensor import ExclusionAngles, Sensor
from cislunar.orbits.extent import CATALOGUE_EXTENT, Extent
from cislunar.photometry.materials import Material, PhotometryModel
from cislunar.photometry.mesh_files import load_shape
from cislunar.photometry.returned_light import equal_sphere_coefficient
from cislunar.photometry.shapes import Facets, icosahedron, scale_to_sphere, stretch
from cislunar.targets.sampling import SamplingSettings
from cislunar.tasking.closed_loop import LoopSettings
from cislunar.tasking.planning.detection_model import DetectionModel
from cislunar.tasking.planning.information import TaskingModel
from cislunar.tasking.planning.schedule_model import ScheduleModel
from cislunar.tasking.simulation import TruthModel
from cislunar.visibility.counts import VisibilitySettings


def _exclusion(angles: cell_tree.Exclusion) -> ExclusionAngles:
    return ExclusionAngles(**{f"{body}_deg": angle for body, angle in angles})


def visibility_settings(settings: Mapping[str, Any]) -> VisibilitySettings:
    """Photometry and exclusion angles, from the keys `propagator` and `visibility`."""
    chosen = typed(settings["visibility"], tree.Visibility)
    return VisibilitySettings(
        limiting_magnitude=chosen.limiting_magnitude,
        target_radius_m=chosen.target_radius_m,
        diffuse_reflection_coefficient=chosen.diffuse_reflection_coefficient,
        angles=_exclusion(chosen.exclusion_deg),
        propagator=settings["propagator"],
    )


def family_extent(orbits: tree.Orbits) -> Extent:
    """How far families of observer orbits are followed."""
    return Extent(**dict(orbits.keep_out)) if orbits.extent == "keep_out" else CATALOGUE_EXTENT


def sampling_settings(targets: tree.Targets) -> SamplingSettings:
    """How the region within a zero-velocity surface is sampled."""
    return SamplingSettings(**targets.model_dump(exclude={"missions", "seeding"}))


def information_looks(cell: cell_tree.CellSettings) -> Looks:
    """How moving targets are looked at when architectures are chosen by information."""
    model = _tasking_model(cell)
    return Looks(
        sensor=sensor(cell.sensor),
        radius_m=model.radius_m,
        diffuse_reflection_coefficient=model.diffuse_reflection_coefficient,
        per_hour=3600.0 / cell.step_s,
        initial=Spread(**dict(cell.initial_sigma)),
    )


def body_facets(body: cell_tree.Body) -> Facets:
    """Shape of the targets."""
    if body.shape == "icosahedron":
        facets = icosahedron(body.radius_m)
    else:
        facets = load_shape(
            body.shape, metres_per_unit=body.metres_per_unit, radius_m=body.radius_m
        )
    stretched = stretch(facets, body.stretch)
    if stretched is facets or body.radius_m is None:
        return stretched
    return scale_to_sphere(stretched, body.radius_m)


def _photometry(cell: cell_tree.CellSettings) -> PhotometryModel:
    """The reading of the photometric equations; the physical law where none is chosen."""
    return PhotometryModel(cell.photometry.irradiance or "1/r^2", cell.photometry.fresnel)


def _tasking_model(cell: cell_tree.CellSettings) -> TaskingModel:
    """What tasking believes: the sphere that stands in for the body has its surface area."""
    chosen = cell.tasking
    coefficient = chosen.diffuse_reflection_coefficient
    if coefficient is None:
        coefficient = equal_sphere_coefficient(Material(**dict(cell.material)), _photometry(cell))
    return TaskingModel(
        diffuse_reflection_coefficient=coefficient,
        radius_m=body_facets(cell.body).equivalent_radius,
        states=chosen.states,
        track_gate=chosen.track_gate,
        measurements=chosen.credited_measurements,
        detection=None if chosen.detection == "sphere" else DetectionModel(**dict(chosen.learned)),
    )


def believed_surfaces(cell: cell_tree.CellSettings, n_targets: int) -> TargetSurfaces:
    """Shape, material and inertia, the same for all targets."""
    return target_surfaces(
        body_facets(cell.body),
        Material(**dict(cell.material)),
        n_targets,
        _photometry(cell),
        inertia=1.0 if cell.body.inertia is None else cell.body.inertia,
    )


def sensor(chosen: cell_tree.Sensor) -> Sensor:
    """The observers' telescope."""
    given = dict(chosen)
    exclusion = _exclusion(given.pop("exclusion_deg"))
    return Sensor(**given, exclusion=exclusion)


def truth_model(cell: cell_tree.CellSettings, n_targets: int) -> TruthModel:
    """What the targets truly are, and the true noise, where `truth` says so."""
    true = true_settings(cell.model_dump())
    deg_h2 = np.array(true.pop("angular_acceleration_deg_h2"), dtype=float)
    spread = BodySpread(**true.pop("spread"))
    truth = typed({**cell.model_dump(), **true}, cell_tree.CellSettings)
    return TruthModel(
        believed_surfaces(truth, n_targets),
        sensor(truth.sensor).noise,
        np.deg2rad(deg_h2) / 3600.0**2,
        spread=spread,
    )


def loop_settings(
    cell: cell_tree.CellSettings, interval_minutes: int, *, keep_information: bool = False
) -> LoopSettings:
    """Settings of the closed loop; `keep_information` is of all pairs."""
    tasking = cell.tasking
    return LoopSettings(
        step_s=cell.step_s,
        interval_minutes=interval_minutes,
        duration_hours=cell.duration_hours,
        method=tasking.method,
        max_evaluations=tasking.max_evaluations,
        early_stop=tasking.early_stop,
        sensor=sensor(cell.sensor),
        tasking=_tasking_model(cell),
        schedule=ScheduleModel(**{key: getattr(tasking, key) for key in SCHEDULE_KEYS}),
        eclipse=cell.eclipse,
        initial=Spread(**dict(cell.initial_sigma)),
        custody=Custody(**dict(cell.custody)),
        record_every=round(60.0 * cell.record_minutes / cell.step_s),
        keep_information=keep_information,
        histories=tuple(cell.histories),
        record=tuple(cell.record),
    )


def estimator_factory(name: str, cell: cell_tree.CellSettings) -> EstimatorFactory:
    """The estimator of a cell, by its name in the configuration key `task2.estimators`."""
    return estimator_named(
        name,
        process_noise=ProcessNoise(**dict(cell.process_noise)),
        splitting=cell.filter.splitting,
        batch_settings=cell_tree.batch_settings(cell.batch),
    )
