"""The settings as the library takes them: its own objects, made here and nowhere else.

It needs the compiled library: jobs import it, the workflow does not.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from cislunar.architecture.information.tables import Looks
from cislunar.attitude.inertia import inertia_matrix
from cislunar.campaign.settings import cell_tree, tree
from cislunar.campaign.settings.cells import SCHEDULE_KEYS, true_settings, wanted_body
from cislunar.campaign.settings.observing.sensors import exclusion, sensor
from cislunar.campaign.settings.reading import typed
from cislunar.estimation.estimator import EstimatorFactory
from cislunar.estimation.fusion.catalogues import catalogues
from cislunar.estimation.registry import estimator_named
from cislunar.estimation.spread import ProcessNoise, Spread
from cislunar.evaluation.metrics import Custody
from cislunar.observation.body_spread import BodySpread
from cislunar.observation.made_bodies import equal_sphere_of, made_body
from cislunar.observation.scene import TargetSurfaces, target_surfaces
from cislunar.observation.wanted_bodies import bodies_of_targets
from cislunar.orbits.extent import CATALOGUE_EXTENT, Extent
from cislunar.photometry.materials import REFLECTION_LAWS, Material, PhotometryModel
from cislunar.targets.sampling import SamplingSettings
from cislunar.tasking.closed_loop import LoopSettings
from cislunar.tasking.communication.model import CommunicationModel
from cislunar.tasking.planning.detection_model import DetectionModel
from cislunar.tasking.planning.information import TaskingModel
from cislunar.tasking.planning.schedule_model import ScheduleModel
from cislunar.tasking.simulation import TruthModel
from cislunar.visibility.counts import VisibilitySettings


def visibility_settings(settings: Mapping[str, Any]) -> VisibilitySettings:
    """Photometry and exclusion angles, from the keys `propagator` and `visibility`."""
    chosen = typed(settings["visibility"], tree.Visibility)
    return VisibilitySettings(
        limiting_magnitude=chosen.limiting_magnitude,
        target_radius_m=chosen.target_radius_m,
        diffuse_reflection_coefficient=chosen.diffuse_reflection_coefficient,
        angles=exclusion(chosen.exclusion_deg),
        propagator=settings["propagator"],
        eclipse=chosen.eclipse,
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


def _photometry(
    cell: cell_tree.CellSettings, reflection: str = REFLECTION_LAWS[0]
) -> PhotometryModel:
    """The reading of the photometric equations; the physical law where none is chosen."""
    chosen = cell.photometry
    return PhotometryModel(chosen.irradiance or "1/r^2", chosen.fresnel, reflection)


def _tasking_model(cell: cell_tree.CellSettings) -> TaskingModel:
    """What tasking believes: the sphere that stands in for the body has its surface area."""
    chosen = cell.tasking
    body = made_body(wanted_body(cell.body.model_dump()), Material(**dict(cell.material)))
    radius, coefficient = equal_sphere_of(body, _photometry(cell))
    if chosen.diffuse_reflection_coefficient is not None:
        coefficient = chosen.diffuse_reflection_coefficient
    return TaskingModel(
        diffuse_reflection_coefficient=coefficient,
        radius_m=radius,
        states=chosen.states,
        track_gate=chosen.track_gate,
        measurements=chosen.credited_measurements,
        detection=None if chosen.detection == "sphere" else DetectionModel(**dict(chosen.learned)),
    )


def believed_surfaces(
    cell: cell_tree.CellSettings,
    names: Sequence[Sequence[str]],
    reflection: str = REFLECTION_LAWS[0],
) -> TargetSurfaces:
    """Shape, material and inertia of targets; `names` has what each may be called in a table."""
    material = Material(**dict(cell.material))
    wanted = bodies_of_targets(wanted_body(cell.body.model_dump()), cell.body.table, names)
    made = {each: made_body(each, material) for each in dict.fromkeys(wanted)}
    return target_surfaces(
        [made[each] for each in wanted],
        material,
        len(wanted),
        _photometry(cell, reflection),
        inertia=np.array([inertia_matrix(each.inertia or 1.0) for each in wanted]),
    )


def target_names(tracked: xr.Dataset, rows: Iterable[int]) -> list[list[str]]:
    """What targets may be called: by their rows in ``orbits/tracked.nc``, and by name."""
    own = tracked["name"].values if "name" in tracked else None
    return [[str(row)] + ([] if own is None else [str(own[row])]) for row in rows]


def truth_model(cell: cell_tree.CellSettings, names: Sequence[Sequence[str]]) -> TruthModel:
    """What the targets truly are, and the true noise, where `truth` says so."""
    true = true_settings(cell.model_dump())
    deg_h2 = np.array(true.pop("angular_acceleration_deg_h2"), dtype=float)
    spread, reflection = BodySpread(**true.pop("spread")), true.pop("reflection")
    truth = typed({**cell.model_dump(), **true}, cell_tree.CellSettings)
    return TruthModel(
        believed_surfaces(truth, names, reflection),
        sensor(truth.sensor).noise,
        np.deg2rad(deg_h2) / 3600.0**2,
        spread=spread,
    )


def loop_settings(
    cell: cell_tree.CellSettings, interval_minutes: int, *, keep_information: bool = False
) -> LoopSettings:
    """Settings of the closed loop; `keep_information` is of all pairs."""
    tasking, links = cell.tasking, dict(cell.communication)
    links |= dict(links.pop("contact"))
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
        communication=CommunicationModel(**links),
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
    common = estimator_named(
        name,
        process_noise=ProcessNoise(**dict(cell.process_noise)),
        splitting=cell.filter.splitting,
        batch_settings=cell_tree.batch_settings(cell.batch),
    )
    return catalogues(common, cell.fusion)
