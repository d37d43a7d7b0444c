"""Survey from an empty catalog: plan, exposures, linking, and the quality of the catalog in time.

The truth is known to the simulation of the exposures and to `cislunar.survey.quality` only. The
estimation side starts from a prior density (`cislunar.survey.priors`), plans fields
(`cislunar.survey.planning`), receives detections without origins and links them
(`cislunar.survey.catalog`). Confirmed orbits are tracked by the same least squares, with all their
detections.

Assumptions and limitations
---------------------------
- Positions and attitudes of observers are known; light time is neglected, on both sides.
- Exposures are much shorter than the steps of the scene; nothing trails.
"""

from collections.abc import Callable

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from cislunar.constants import SECONDS_PER_DAY
from cislunar.detection import FALSE_ALARM, Detections, Exposures, expose
from cislunar.errors import ConfigurationError
from cislunar.estimation.estimator import InitialEstimate
from cislunar.observation import Scene, Sensors, sensor_limits
from cislunar.orbit_determination import (
    AdmissibleRegion,
    Angles,
    LinkingSettings,
    TrackletSettings,
)
from cislunar.runtime.arguments import array_of
from cislunar.runtime.seeds import generator
from cislunar.runtime.settings_fields import setting
from cislunar.survey.catalog import Predictions, SurveyCatalog
from cislunar.survey.density import ObjectDensity
from cislunar.survey.fields import Views, detection_probability, unit_vectors, views
from cislunar.survey.planning import KnownOrbits, SearchPlanner, Visits
from cislunar.survey.quality import (
    CatalogState,
    catalog_state,
    orbit_table,
    true_tracklets,
)
from cislunar.survey.results import BlockRecord, SurveyResult
from cislunar.survey.settings import SurveyModel
from cislunar.tasking import TrueMotion, TruthModel

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_DRAWS = 8
"""Positions that represent a known orbit's uncertainty in a plan."""


class SurveySettings(SurveyModel):
    """Survey from an empty catalog, with the settings of orbit determination."""

    region: AdmissibleRegion = setting("", default=AdmissibleRegion())
    tracklets: TrackletSettings = setting("", default=TrackletSettings())
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
        Identity of each object, which with the seed selects its random numbers.
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
    progress : callable, optional
        Called with (blocks done, all blocks).
    record : callable, optional
        Called with the exposures of each block, their detections, and the truth.

    Returns
    -------
    SurveyResult

    Raises
    ------
    ConfigurationError
        If the scene is shorter than the survey, or a time is no multiple of another.
    """
    settings = SurveySettings() if settings is None else settings
    survey = _Survey(
        scene, truth, state, target_ids, seed, density, settings, sensor, forces, outside, record
    )
    for block in range(survey.n_blocks):
        survey.advance(block)
        if progress is not None:
            progress(block + 1, survey.n_blocks)
    return survey.result()


class _Survey:
    """State of a survey; `run_survey` has the arguments."""

    def __init__(
        self,
        scene,
        truth,
        state,
        target_ids,
        seed,
        density,
        settings,
        sensor,
        forces,
        outside,
        record,
    ) -> None:
        states = array_of("state", state, ("object", 6))
        ids = np.asarray(target_ids, dtype=np.int64)
        self.outside = np.zeros(ids.size, dtype=bool) if outside is None else np.asarray(outside)
        if self.outside.shape != ids.shape or self.outside.dtype != bool:
            raise ConfigurationError(
                f"outside has {self.outside.shape} entries of type {self.outside.dtype}; give one "
                f"bool for each of the {ids.size} objects"
            )
        self.scene, self.settings, self.seed = scene, settings, seed
        self.sensor, self.density, self.record = sensor, density, record
        n_observers = scene.observer_position.shape[0]
        limits = sensor_limits(sensor, n_observers)
        self.planner = SearchPlanner(settings.search, scene, limits)
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
        per_link = 60.0 * settings.link_hours / settings.search.block_minutes
        self.blocks_per_link = round(per_link)
        if abs(per_link - self.blocks_per_link) > 1e-9 or self.blocks_per_link < 1:
            raise ConfigurationError(
                f"link_hours = {settings.link_hours} must be a multiple of "
                f"search.block_minutes = {settings.search.block_minutes}"
            )
        self.truth = truth.sampled(seed, ids)
        # attitudes are uniform, and unknown to the estimation side
        turns = Rotation.random(ids.size, random_state=generator(seed, "attitude")).as_quat()
        spin = generator(seed, "spin").standard_normal((ids.size, 3)) * np.deg2rad(30.0) / 3600.0
        self.motion = TrueMotion(
            InitialEstimate(turns, spin, states, np.zeros(12)),
            scene,
            np.ones(3) if truth.sensor is not None else truth.noise,
            seed,
            ids,
            forces=truth.forces,
            inertia=self.truth.surfaces.inertia,
            angular_acceleration=self.truth.angular_acceleration,
            torque=self.truth.torque,
            surfaces=self.truth.surfaces,
            observations=n_observers,
            maneuvers=truth.all_maneuvers(seed, ids, 24.0 * settings.duration_days),
        )
        self.path: list[Array] = []
        self.origin: list[Indices] = []
        self.catalog = SurveyCatalog(
            scene, forces, settings.process, settings.region, settings.linking, settings.tracklets,
            lineage=settings.lineage, limits=limits, magnitude_sigma=settings.magnitude_sigma,
        )  # fmt: skip
        self.sigma = np.hypot(settings.magnitude_sigma, np.sqrt(limits.noise_variance[:, :1]))
        self.draws = generator(seed, "draws").standard_normal((_DRAWS // 2, 3))
        self.draws = np.concatenate([self.draws, -self.draws])
        self.states: list[dict] = []
        self.orbits: list[pd.DataFrame] = []
        self.n_exposures = 0
        self.cataloged = np.full(ids.size, np.inf)
        self.tracklets = np.zeros(ids.size, dtype=np.int64)

    def advance(self, block: int) -> None:
        """Plan a block, observe, and link if it is time."""
        n, scene = self.planner.n_steps, self.scene
        start = block * n
        middle = start + (n + 1) // 2
        self.density.advance(middle * scene.step)
        seen = views(scene, self.planner.limits, middle, self.density.state[:, :3])
        chance = self._probability(seen, self.density.size_m2)
        chance[:, self.density.weight == 0.0] = 0.0
        fields = self.planner.fields_of(seen)
        now = self.catalog.predict(middle * scene.step)
        visits = self.planner.plan(
            middle, self.density.weight, fields, chance, *self._known(now, middle)
        )
        exposures = self.planner.exposures(visits, start + 1)
        detections = self._observe(block, start, exposures)
        angles = self.catalog.add(exposures, detections, start + 1)
        self.n_exposures += exposures.step.size
        new = ~self.catalog.explains(angles, now, middle * scene.step)
        self._update(visits, detections.exposure[new], angles.rows(new), seen, fields, chance)
        if (block + 1) % self.blocks_per_link == 0 or block + 1 == self.n_blocks:
            self._link(start + n)

    def _probability(self, seen: Views, size_m2: ArrayLike) -> Array:
        loss = self.settings.process.detection_loss
        return detection_probability(seen.margin, size_m2, self.sigma, loss)

    def _known(self, now: Predictions, middle: int) -> tuple[KnownOrbits, Indices, Array]:
        """Predicted orbits, and the fields and probabilities of their samples."""
        position, covariance = now.state[:, :3], now.covariance[:, :3, :3]
        value, vectors = np.linalg.eigh(covariance)
        root = vectors * np.sqrt(np.maximum(value, 0.0))[:, None]
        sample = position[:, None] + np.einsum("nij,dj->ndi", root, self.draws)
        seen = views(self.scene, self.planner.limits, middle, sample.reshape(-1, 3))
        chance = self._probability(seen, self.settings.prior.median_size_m2)
        shape = (len(self.planner.grids), len(position), _DRAWS)
        fields = self.planner.fields_of(seen).reshape(shape)
        known = KnownOrbits(position, covariance, now.existence, sample)
        return known, fields, chance.reshape(shape)

    def _observe(self, block: int, start: int, exposures: Exposures) -> Detections:
        """Simulate the exposures; the origins stay here."""
        n, n_observers = self.planner.n_steps, len(self.planner.grids)
        moved = self.motion.advance(n)
        self.path.append(moved.translation[:, 1 if block else 0 :])
        n_objects = moved.translation.shape[0]
        loss = generator(self.seed, "loss", block).random((n_objects, n, n_observers))
        detections, origin, _ = expose(
            start + 1,
            exposures,
            self.settings.process,
            self.scene,
            self.truth.surfaces,
            self.sensor,
            moved.translation,
            moved.quaternion,
            moved.noise,
            generator(self.seed, "alarms", block),
            n_steps=n,
            command=np.full((n, n_observers), -1),
            kept=loss >= self.settings.process.detection_loss,
            origin=start,
            true=self.truth.sensor,
        )
        self.origin.append(origin)
        if self.record is not None:
            velocity_changes = self.motion.velocity_changes_m_s
            self.record(
                BlockRecord(
                    start + 1, exposures, detections, origin, moved.translation,
                    self.motion.maneuvers, velocity_changes,
                )
            )  # fmt: skip
        return detections

    def _update(
        self, visits: Visits, exposure: Indices, angles: Angles, seen: Views, fields: Indices,
        chance: Array,
    ) -> None:  # fmt: skip
        """Update the density by the exposures and the detections that no orbit explains."""
        model, density = self.settings, self.density
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

    def _link(self, index: int) -> None:
        """Link, and compare with the truth."""
        scene, day = self.scene, index * self.scene.step_s / SECONDS_PER_DAY
        self.path = [np.concatenate(self.path, axis=1)]
        orbits, angles = self.catalog.link(), self.catalog.angles
        origin = np.concatenate(self.origin)
        table = orbit_table(orbits, angles, origin, self.path[0], scene.step, day)
        self.tracklets = true_tracklets(self.catalog.tracklets, origin, self.cataloged.size)
        quality: CatalogState = catalog_state(
            table, origin, self.tracklets, self.settings.quality, self.outside
        )
        self.states.append(
            {**quality._asdict(), "day": day, "undetected": self.density.expected,
             "exposures": self.n_exposures, "detections": origin.size,
             "false_alarms": int(np.count_nonzero(origin == FALSE_ALARM))}
        )  # fmt: skip
        self.orbits.append(table)
        right = table[
            table["confirmed"]
            & (table["object"] != FALSE_ALARM)
            & (table["error_km"] <= self.settings.quality.right_km)
        ]["object"].to_numpy(dtype=np.int64)
        holds = np.isin(np.arange(self.cataloged.size), right)
        self.cataloged = np.where(holds, np.minimum(self.cataloged, day), np.inf)

    def result(self) -> SurveyResult:
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
        return SurveyResult(
            pd.DataFrame(self.states),
            pd.concat(self.orbits, ignore_index=True),
            objects,
            self.catalog.orbits,
        )
