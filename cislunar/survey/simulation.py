"""Survey from an empty catalog: plan, exposures, linking, and the quality of the catalog in time.

The truth is known to the simulation of the exposures and to `cislunar.survey.quality` only. The
estimation side starts from a prior density (`cislunar.survey.priors`), plans fields
(`cislunar.survey.planning`), receives detections without origins and links them
(`cislunar.survey.catalog`). Confirmed orbits are tracked by the same least squares, with their
detections of the last days (`LinkingSettings.longest_arc_days`).

Assumptions and limitations
---------------------------
- Light time is neglected, on both sides. Fields are observed where they are commanded, whatever the
  pointing error.
- Exposures are much shorter than the steps of the scene; nothing trails.
"""

from collections import deque
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from cislunar.constants import SECONDS_PER_DAY
from cislunar.detection import FALSE_ALARM, Detections, Exposures
from cislunar.errors import ConfigurationError
from cislunar.estimation.navigation import ObserverErrors
from cislunar.observation import Scene, Sensors, TargetSurfaces, sensor_limits, unit_vectors
from cislunar.orbit_determination import AdmissibleRegion, Angles, LinkingSettings, is_admissible
from cislunar.runtime import counted
from cislunar.runtime.arguments import Array, Indices, array_of
from cislunar.runtime.seeds import generator
from cislunar.runtime.settings_fields import setting
from cislunar.survey.catalog import Predictions, SurveyCatalog
from cislunar.survey.characterization import CharacterizedOrbit, characterize_orbits
from cislunar.survey.density import ObjectDensity
from cislunar.survey.fields import Views, detection_probability, views
from cislunar.survey.planning import SearchPlanner, Visits
from cislunar.survey.quality import (
    CatalogState,
    catalog_state,
    characterization_quality,
    orbit_table,
    right_objects,
    true_tracklets,
)
from cislunar.survey.results import BlockRecord, CatalogRecord, SurveyResult
from cislunar.survey.settings import SurveyModel
from cislunar.survey.true_objects import TrueObjects
from cislunar.tasking import TruthModel

_DRAWS = 8
"""Positions that represent a known orbit's uncertainty in a plan."""


class SurveySettings(SurveyModel):
    """Survey from an empty catalog, with the settings of orbit determination."""

    region: AdmissibleRegion = setting("", default=AdmissibleRegion())
    linking: LinkingSettings = setting("", default=LinkingSettings())


def run_survey(
    scene: Scene,
    truth: TruthModel,
    state: ArrayLike,
    target_ids: ArrayLike,
    seed: int,
    density: ObjectDensity,
    settings: SurveySettings | None = None,
    *,
    sensor: Sensors,
    forces: tuple,
    outside: ArrayLike | None = None,
    appears_hours: ArrayLike | None = None,
    eclipse: bool = False,
    observer_errors: ObserverErrors | None = None,
    body: TargetSurfaces | None = None,
    progress: Callable[[int, int], None] | None = None,
    record: Callable[[BlockRecord], None] | None = None,
) -> SurveyResult:
    """Simulate a survey that starts without a catalog.

    Parameters
    ----------
    scene : Scene
        Observers and Sun at every step of the survey.
    truth : TruthModel
        True bodies, forces and sensors.
    state : array_like, shape (object, 6)
        True states at the start, nondimensional, propagation frame.
    target_ids : array_like of int, shape (object,)
        Identity of each object, see `TrueObjects`.
    seed : int
        Of attitudes, measurement errors and false alarms.
    density : ObjectDensity
        Undetected objects at the start; changed in place.
    settings : SurveySettings, optional
    sensor : Sensor or sequence of Sensor
        Assumed telescopes.
    forces : NamedTuple
        Assumed force model, CR3BP or ephemeris forces.
    outside : array_like of bool, shape (object,), optional
        Which objects are on no orbit of the families; only the quality of the catalog depends on
        it. None if omitted.
    appears_hours : array_like, shape (object,), optional
        Hours after the start from which each object exists; all exist from the start if omitted.
    eclipse : bool
        Whether shadows of Earth and Moon dim objects, which plans take into account.
    observer_errors : ObserverErrors, optional
        How the catalog treats errors of the observers, and their assumed standard deviations. The
        true errors are those of `truth`. No treatment if omitted.
    body : TargetSurfaces, optional
        Assumed body of all objects, its first, for their characterization; required if
        `characterization.least_detections` is above 0.
    progress : callable, optional
        Called with (blocks done, all blocks), and at the end with the same numbers to which the
        orbits that have been and that are to be characterized are added.
    record : callable, optional
        Called with the exposures of each block, their detections, the truth, and the catalog.

    Returns
    -------
    SurveyResult

    Raises
    ------
    ConfigurationError
        If the scene is shorter than the survey, a time is no multiple of another, data arrive later
        than the catalog is linked, or no undetected object is within the admissible region.
    """
    settings = SurveySettings() if settings is None else settings
    errors = ObserverErrors() if observer_errors is None else observer_errors
    survey = _Survey(
        scene, truth, state, target_ids, seed, density, settings, sensor, forces, outside, record,
        appears_hours, eclipse, errors, body,
    )  # fmt: skip
    for block in counted(range(survey.n_blocks), progress):
        survey.advance(block)
    return survey.result(progress)


class _Block(NamedTuple):
    """A block whose data have not arrived: its number, index of the time before its first step, and
    index of its middle; what was planned, with the particles and the orbits at that time; and what
    it returned."""

    number: int
    start: int
    middle: int
    visits: Visits
    seen: Views
    fields: Indices
    chance: Array
    now: Predictions
    exposures: Exposures
    detections: Detections
    origin: Indices


class _Survey:
    """State of a survey; `run_survey` has the arguments."""

    def __init__(
        self, scene, truth, state, target_ids, seed, density, settings, sensor, forces, outside,
        record, appears_hours, eclipse, errors, body,
    ) -> None:  # fmt: skip
        states = array_of("state", state, ("object", 6))
        ids = np.asarray(target_ids, dtype=np.int64)
        self.outside = np.zeros(ids.size, dtype=bool) if outside is None else np.asarray(outside)
        if self.outside.shape != ids.shape or self.outside.dtype != bool:
            raise ConfigurationError(
                f"outside has {self.outside.shape} entries of type {self.outside.dtype}; give one "
                f"bool for each of the {ids.size} objects"
            )
        if not np.any(is_admissible(density.state, density.time, forces, density.region)):
            raise ConfigurationError(
                f"density: none of {len(density.state)} particles is within the admissible region; "
                "give states at the start, or widen the region"
            )
        if settings.characterization.least_detections > 0 and body is None:
            raise ConfigurationError(
                "characterization.least_detections is above 0, and body is omitted: give the body "
                "that the catalog assumes"
            )
        self.scene, self.settings, self.seed, self.body = scene, settings, seed, body
        self.density, self.record, self.forces = density, record, forces
        n_observers = scene.observer_position.shape[0]
        limits = sensor_limits(sensor, n_observers)
        self.planner = SearchPlanner(settings.search, scene, limits, settings.magnitude_sigma)
        self.views = partial(views, scene, limits, eclipse=eclipse)
        n = self.planner.n_steps
        total = settings.duration_days * SECONDS_PER_DAY / scene.step_s
        self.n_blocks = round(total / n)
        if abs(self.n_blocks * n - total) > 1e-6 or self.n_blocks < 1:
            raise ConfigurationError(
                f"duration_days = {settings.duration_days} must be a multiple of "
                f"search.block_minutes = {settings.search.block_minutes}"
            )
        if scene.sun_position.shape[0] < self.n_blocks * n + 1:
            raise ConfigurationError(
                f"scene: {scene.sun_position.shape[0]} times are less than the "
                f"{self.n_blocks * n + 1} of duration_days = {settings.duration_days}"
            )
        self.blocks_per_link, self.late = settings.blocks_per_link, settings.blocks_late
        self.pending: deque[_Block] = deque()
        self.world = TrueObjects(
            scene, truth, states, ids, seed, 24.0 * settings.duration_days, settings.process,
            sensor, appears_hours, eclipse,
        )  # fmt: skip
        self.origin: list[Indices] = []
        self.catalog = SurveyCatalog(
            scene, forces, settings.process, settings.region, settings.linking, settings.tracklets,
            lineage=settings.lineage, limits=limits, magnitude_sigma=settings.magnitude_sigma,
            radiation_sigma=settings.radiation_sigma, errors=errors,
        )  # fmt: skip
        self.sigma = np.hypot(settings.magnitude_sigma, np.sqrt(limits.noise_variance[:, :1]))
        self.draws = generator(seed, "draws").standard_normal((_DRAWS // 2, 3))
        self.draws = np.concatenate([self.draws, -self.draws])
        self.states: list[dict] = []
        self.orbits: list[pd.DataFrame] = []
        self.right: list[tuple[float, Indices]] = []
        self.n_exposures = 0
        self.cataloged = np.full(ids.size, np.inf)
        self.tracklets = np.zeros(ids.size, dtype=np.int64)

    def advance(self, block: int) -> None:
        """Plan a block, observe, and link if it is time."""
        n, scene = self.planner.n_steps, self.scene
        start = block * n
        middle = start + (n + 1) // 2
        self.density.advance(middle * scene.step)
        seen = self.views(middle, self.density.state[:, :3])
        chance = self._probability(seen, self.density.size_m2)
        chance[:, self.density.weight == 0.0] = 0.0
        fields = self.planner.fields_of(seen)
        now = self.catalog.predict(middle * scene.step)
        weight = self._without_pending()
        drawn = self._drawn(now, middle)
        visits, planned = self.planner.plan(middle, weight, fields, chance, now, *drawn)
        self.catalog.take_plan(planned)
        exposures = self.planner.exposures(visits, start + 1)
        detections, origin = self.world.observe(block, start, n, exposures)
        self.n_exposures += exposures.step.size
        self.pending.append(
            _Block(block, start, middle, visits, seen, fields, chance, now, exposures, detections,
                   origin)
        )  # fmt: skip
        while self.pending and self.pending[0].number + self.late <= block:
            self._receive(self.pending.popleft())
        catalog = None
        if (block + 1) % self.blocks_per_link == 0 or block + 1 == self.n_blocks:
            catalog = self._link(start + n)
        if self.record is not None:
            made = self.world.record(start + 1, exposures, detections, origin)
            self.record(made._replace(catalog=catalog))

    def _without_pending(self) -> Array:
        """Weights of the particles as plans use them: less for those whose fields have been
        observed and whose data have not arrived."""
        weight = self.density.weight
        for block in self.pending:
            visits, weight = block.visits, weight.copy()
            used = self.settings.search.detection_weight * block.chance
            for o in range(len(self.planner.grids)):
                looked = np.isin(block.fields[o], visits.field[visits.observer == o])
                weight[looked] *= 1.0 - used[o, looked]
        return weight

    def _receive(self, block: _Block) -> None:
        """Take up the data of a block."""
        angles = self.catalog.add(block.exposures, block.detections, block.start + 1)
        self.origin.append(block.origin)
        new = ~self.catalog.explains(angles, block.now, block.middle * self.scene.step)
        self._update(block, block.detections.exposure[new], angles.rows(new))

    def _probability(self, seen: Views, size_m2: ArrayLike) -> Array:
        loss = self.settings.process.detection_loss
        return detection_probability(seen.margin, size_m2, self.sigma, loss)

    def _drawn(self, now: Predictions, middle: int) -> tuple[Indices, Array]:
        """Fields and probabilities (observer, orbit, draw) of samples of predicted orbits."""
        position, covariance = now.state[:, :3], now.covariance[:, :3, :3]
        value, vectors = np.linalg.eigh(covariance)
        root = vectors * np.sqrt(np.maximum(value, 0.0))[:, None]
        sample = position[:, None] + np.einsum("nij,dj->ndi", root, self.draws)
        seen = self.views(middle, sample.reshape(-1, 3))
        chance = self._probability(seen, self.settings.prior.median_size_m2)
        shape = (len(self.planner.grids), len(position), _DRAWS)
        return self.planner.fields_of(seen).reshape(shape), chance.reshape(shape)

    def _update(self, block: _Block, exposure: Indices, angles: Angles) -> None:
        """Update the density by the exposures and the detections that no orbit explains."""
        model, density = self.settings, self.density
        visits, seen, fields, chance = block.visits, block.seen, block.fields, block.chance
        turn = self.scene.frame_axes[np.rint(angles.time / self.scene.step).astype(np.int64)]
        inertial = np.einsum("nij,nj->ni", turn, angles.direction)
        width = model.kernel_deg
        for o in range(len(self.planner.grids)):
            own = visits.field[visits.observer == o]
            looked = np.isin(fields[o], own)
            probability = np.where(looked, chance[o], 0.0)
            rows = np.flatnonzero(angles.observer == o)
            of = visits.field[exposure[rows]]
            near = np.flatnonzero((probability > 0.0) & np.isin(fields[o], of))
            units = unit_vectors(seen.ra[o, near], seen.dec[o, near])
            apart2 = np.rad2deg(1.0) ** 2 * (2.0 - 2.0 * inertial[rows] @ units.T)
            likelihood = np.exp(-0.5 * apart2 / width**2) / (2.0 * np.pi * width**2)
            likelihood *= of[:, None] == fields[o, near]
            density.observed(
                probability, near, likelihood, model.process.false_alarms_deg2,
                model.search.visits,
            )  # fmt: skip

    def _link(self, index: int) -> CatalogRecord:
        """Link, and compare with the truth."""
        scene, day = self.scene, index * self.scene.step_s / SECONDS_PER_DAY
        orbits, angles = self.catalog.link(), self.catalog.angles
        origin = np.concatenate(self.origin)
        table = orbit_table(
            orbits, angles, origin, self.world.states, index, scene.step, day, self.forces,
            self.settings.radiation_sigma, self.catalog.averaged,
        )  # fmt: skip
        self.tracklets = true_tracklets(self.catalog.tracklets, origin, self.cataloged.size)
        right = right_objects(table, self.settings.quality)
        self.right.append((day, right))
        since = day - self.settings.quality.known_days + 1e-9
        known = [each for when, each in self.right if when <= since]
        quality: CatalogState = catalog_state(
            table,
            origin,
            self.tracklets,
            self.settings.quality,
            self.outside,
            self.world.maneuvered(3600.0 * 24.0 * day),
            known[-1] if known else (),
        )
        self.states.append(
            {**quality._asdict(), "day": day, "undetected": self.density.expected,
             "exposures": self.n_exposures, "detections": origin.size,
             "false_alarms": int(np.count_nonzero(origin == FALSE_ALARM))}
        )  # fmt: skip
        self.orbits.append(table)
        holds = np.isin(np.arange(self.cataloged.size), right)
        self.cataloged = np.where(holds, np.minimum(self.cataloged, day), np.inf)
        return CatalogRecord(orbits, table["object"].to_numpy(np.int64), self.catalog.maneuvers)

    def result(self, progress: Callable[[int, int], None] | None) -> SurveyResult:
        """Tables of the survey."""
        origin, angles = np.concatenate(self.origin), self.catalog.angles
        first = np.full(self.cataloged.size, np.inf)
        real = origin != FALSE_ALARM
        per_day = self.scene.step * SECONDS_PER_DAY / self.scene.step_s
        np.minimum.at(first, origin[real], angles.time[real] / per_day)
        objects = pd.DataFrame(
            {"object": np.arange(first.size), "tracklets": self.tracklets, "detected": first,
             "cataloged": self.cataloged, "outside": self.outside}
        )  # fmt: skip
        found, catalog = self._characterized(angles, origin, progress), self.catalog
        states, table = pd.DataFrame(self.states), pd.concat(self.orbits, ignore_index=True)
        return SurveyResult(states, table, objects, catalog.orbits, catalog.averaged, found)

    def _characterized(
        self, angles: Angles, origin: Indices, progress: Callable[[int, int], None] | None
    ) -> tuple[CharacterizedOrbit, ...] | None:
        """What the light curves of the catalog tell, and its comparison with the truth in the last
        state."""
        settings, world = self.settings.characterization, self.world
        if settings.least_detections == 0:
            return None
        given = self.catalog.orbits, angles, self.scene, self.body, settings, self.seed
        before = self.n_blocks
        each = progress and (lambda done, total: progress(before + done, before + total))
        found = characterize_orbits(*given, each)
        truth = world.first_attitude, world.first_rate, world.truth.surfaces
        attitude = world.attitudes()[: origin.size]
        self.states[-1] |= characterization_quality(found, origin, attitude, *truth)._asdict()
        return found
