"""Objects of the library from the settings of a campaign, for jobs."""

from collections.abc import Iterable, Sequence

import numpy as np
import xarray as xr

from cislunar.architecture.information.tables import ObservationSettings
from cislunar.attitude import TorqueModel, inertia_matrix
from cislunar.campaign.settings import cell_tree, tree
from cislunar.campaign.settings.cell_settings import true_settings
from cislunar.estimation import EstimatorFactory, estimator_named
from cislunar.estimation.fusion.catalogs import catalogs
from cislunar.estimation.maneuvers.factory import monitored
from cislunar.estimation.navigation.factory import navigated
from cislunar.observation import BodyParameterPrior, body_from_spec, equal_sphere_of
from cislunar.observation.body_spec import bodies_of_targets
from cislunar.observation.target_surfaces import TargetSurfaces, target_surfaces
from cislunar.orbits.extent import CATALOG_EXTENT, Extent
from cislunar.photometry.materials import REFLECTION_LAWS, PhotometryModel
from cislunar.tasking.closed_loop import LoopSettings
from cislunar.tasking.planning.information import TaskingModel
from cislunar.tasking.truth import TruthModel


def family_extent(orbits: tree.Orbits) -> Extent:
    """Range in which families of observer orbits are followed."""
    return Extent(orbits.keep_out) if orbits.extent == "keep_out" else CATALOG_EXTENT


def observation_settings(cell: cell_tree.CellSettings) -> ObservationSettings:
    """Observation of moving targets in the selection of architectures by information."""
    model = _tasking_model(cell)
    return ObservationSettings(
        sensor=cell.sensor,
        radius_m=model.radius_m,
        diffuse_reflection_coefficient=model.diffuse_reflection_coefficient,
        per_hour=3600.0 / cell.step_s,
        initial=cell.initial_sigma,
    )


def _photometry(
    cell: cell_tree.CellSettings, reflection: str = REFLECTION_LAWS[0]
) -> PhotometryModel:
    """The reading of the photometric equations; the physical law if none is stated."""
    return PhotometryModel(**dict(cell.photometry), reflection=reflection)


def _tasking_model(cell: cell_tree.CellSettings) -> TaskingModel:
    """The model that tasking assumes, a sphere with the surface area of the body."""
    chosen = cell.tasking
    body = body_from_spec(cell.body, cell.material)
    radius, coefficient = equal_sphere_of(body, _photometry(cell))
    if chosen.diffuse_reflection_coefficient is not None:
        coefficient = chosen.diffuse_reflection_coefficient
    return TaskingModel(
        diffuse_reflection_coefficient=coefficient,
        radius_m=radius,
        states=chosen.states,
        pointing_uncertainty_gate=chosen.pointing_uncertainty_gate,
        measurements=chosen.expected_measurements,
        detection=None if chosen.detection == "sphere" else chosen.learned,
    )


def nominal_surfaces(
    cell: cell_tree.CellSettings,
    names: Sequence[Sequence[str]],
    reflection: str = REFLECTION_LAWS[0],
) -> TargetSurfaces:
    """Shape, material and inertia of targets as the settings state them, without deviations;
    `names` has the names of each target in a table."""
    material = cell.material
    specs = bodies_of_targets(cell.body, names)
    bodies = {each: body_from_spec(each, material) for each in dict.fromkeys(specs)}
    return target_surfaces(
        [bodies[each] for each in specs],
        material,
        len(specs),
        _photometry(cell, reflection),
        inertia=np.array([inertia_matrix(each.inertia or 1.0) for each in specs]),
    )


def target_names(tracked: xr.Dataset, rows: Iterable[int]) -> list[list[str]]:
    """Names of targets: their rows in ``orbits/tracked.nc``, and their own names."""
    own = tracked["name"].values if "name" in tracked else None
    return [[str(row)] + ([] if own is None else [str(own[row])]) for row in rows]


def truth_model(cell: cell_tree.CellSettings, names: Sequence[Sequence[str]]) -> TruthModel:
    """True properties of the targets and true noise, as `truth` states them."""
    deg_h2 = np.array(cell.truth.angular_acceleration_deg_h2, dtype=float)
    true = true_settings(cell)
    return TruthModel(
        nominal_surfaces(true, names, cell.truth.reflection),
        true.sensor.noise,
        np.deg2rad(deg_h2) / 3600.0**2,
        parameter_sigma=BodyParameterPrior(**cell.truth.parameter_sigma.model_dump()),
        parameter_freedom=cell.truth.parameter_freedom,
        torque=TorqueModel(**cell.truth.torque.model_dump()),
        observer_sigma=cell.observer_errors.truth,
        drawn_maneuvers=tuple(cell.truth.maneuvers.drawn or ()),
    )


def loop_settings(
    cell: cell_tree.CellSettings, interval_minutes: int, *, keep_information: bool = False
) -> LoopSettings:
    """Settings of the closed loop; `keep_information` keeps the information of all pairs."""
    tasking = cell.tasking
    return LoopSettings(
        step_s=cell.step_s,
        interval_minutes=interval_minutes,
        duration_hours=cell.duration_hours,
        method=tasking.method,
        max_evaluations=tasking.max_evaluations,
        early_stop=tasking.early_stop,
        sensor=cell.sensor,
        tasking=_tasking_model(cell),
        schedule=tasking,
        communication=cell.communication,
        association=cell.association,
        eclipse=cell.eclipse,
        initial=cell.initial_sigma,
        custody=cell.custody,
        record_every=round(60.0 * cell.record_minutes / cell.step_s),
        keep_information=keep_information,
        histories=tuple(cell.histories),
        record=tuple(cell.record),
    )


def estimator_factory(name: str, cell: cell_tree.CellSettings) -> EstimatorFactory:
    """The estimator of a cell, by its name in the configuration key `task2.estimators`."""
    common = estimator_named(
        name,
        process_noise=cell.process_noise,
        splitting=cell.filter.splitting,
        batch_settings=cell.batch,
        use_magnitude=cell.filter.use_magnitude,
        extra_magnitude_noise=cell.filter.extra_magnitude_noise,
        noise_memory=cell.filter.noise_memory,
        estimated_parameters=(
            cell.batch.estimated_parameters if cell.filter.estimate_parameters else None
        ),
    )
    errors = cell.observer_errors
    given = common, errors.treatment, errors.assumed
    treated = navigated(*given, process_noise=cell.process_noise)
    tested = monitored(treated, cell.maneuver_detection, process_noise=cell.process_noise)
    return catalogs(tested, cell.fusion)
