"""Catalog of a survey: detections, tracklets, linked orbits, and their predictions.

The catalog receives exposures and detections without origins, links all tracklets so far, and
predicts its orbits for the next plan. Confirmed orbits and candidates are continued by least
squares with their detections of the last days. An orbit that no longer agrees with its detections
is dissolved, and its detections of the last hours are linked anew, which also re-acquires lost
objects.

If objects may maneuver, an orbit that is followed by or a duplicate of another one of the same
object, an orbit whose detections belong to others, and an orbit whose object is not where it is
predicted are neither confirmed nor predicted any more (`cislunar.survey.maneuvers`).
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.association import gate_threshold
from cislunar.detection import DetectionProcess, Detections, Exposures, boresight_vectors
from cislunar.estimation.navigation import ObserverErrors
from cislunar.observation import Scene, SensorLimits, unit_vectors
from cislunar.orbit_determination import (
    AdmissibleRegion,
    Angles,
    Attributables,
    LinkedOrbits,
    LinkingSettings,
    OrbitFits,
    OrbitStates,
    TrackletSettings,
    attributables,
    fit_orbits,
    form_tracklets,
    frame_rate,
    link,
    make_angles,
    orbits_at,
    tangent_basis,
)
from cislunar.runtime import Array, Indices
from cislunar.survey.maneuvers import (
    CURRENT,
    FieldHistory,
    Lineage,
    Watch,
    maneuvered_orbits,
    maneuvers_within,
    replaced,
)
from cislunar.survey.navigation import (
    ObserverCalibration,
    RemainingErrors,
    calibrate,
    considered,
    corrected_angles,
    uncalibrated,
)
from cislunar.survey.settings import LineageSettings

_LEAST_COSINE = 1e-3
"""Of the declination, for the covariance of right ascension next to the pole."""

_GATE, _CURVATURE = 0.9973, np.deg2rad(0.02)
"""Probability that the gate of a prediction keeps a detection of its object, and what a straight
path over minutes may miss."""


class Predictions(NamedTuple):
    """Orbits at one time: `state` (orbit, 6), `covariance` (orbit, 6, 6), nondimensional,
    propagation frame; `existence` (orbit,), the probability that the orbit is of an object;
    `detections` (orbit,), their number so far; and `planned` (orbit, 6, 6), the covariance with the
    measurements that have been planned since the orbits were linked."""

    state: Array
    covariance: Array
    existence: Array
    detections: Indices
    planned: Array


class SurveyCatalog:
    """Detections and linked orbits of a survey.

    Parameters
    ----------
    scene : Scene
    forces : NamedTuple
        Assumed force model, CR3BP or ephemeris forces.
    process : DetectionProcess
        Assumed false alarms and losses.
    region : AdmissibleRegion
    linking : LinkingSettings
    tracklets : TrackletSettings
    lineage : LineageSettings
        Assumed maneuvers.
    limits : SensorLimits
        Of all observers.
    magnitude_sigma : float
        Standard deviation of magnitudes about those of a sphere, mag, for lost orbits.
    radiation_sigma : float
        Standard deviation of the factor of the radiation pressure on an object.
    errors : ObserverErrors, optional
        Assumed errors of the observers and their treatment; none if omitted.

    Attributes
    ----------
    orbits : LinkedOrbits or None
        As of the last `link`. Orbits that are superseded or lost are not confirmed. The orbit after
        a maneuver that detections alone do not confirm is confirmed, with its state from both.
    averaged : OrbitFits or None
        The same orbits with states and covariances that allow for undetected maneuvers.
    status : tuple of str
        CURRENT, LOST or SUPERSEDED of `cislunar.survey.maneuvers`, of each orbit.
    calibration : ObserverCalibration or None
        Estimated errors of the observers, as of the last `link`; None without a treatment.
    maneuvers : Lineage or None
        Orbits before and after maneuvers, as of the last `link`; None if none is assumed.
    tracklets : Attributables or None
        All tracklets of the last `link`.
    """

    def __init__(
        self,
        scene: Scene,
        forces: tuple,
        process: DetectionProcess,
        region: AdmissibleRegion,
        linking: LinkingSettings,
        tracklets: TrackletSettings,
        *,
        lineage: LineageSettings,
        limits: SensorLimits,
        magnitude_sigma: float,
        radiation_sigma: float = 0.0,
        errors: ObserverErrors | None = None,
    ) -> None:
        self.scene, self.forces, self.process = scene, forces, process
        self.region, self.linking, self.settings = region, linking, tracklets
        self.lineage, self.limits = lineage, limits
        self.magnitude_sigma, self.radiation_sigma = magnitude_sigma, radiation_sigma
        self.errors = ObserverErrors() if errors is None else errors
        self.calibration: ObserverCalibration | None = None
        if self.errors.treatment != "none":
            n_observers = scene.observer_position.shape[0]
            self.calibration = uncalibrated(self.errors.assumed, n_observers)
        self.status: tuple[str, ...] = ()
        self.maneuvers: Lineage | None = None
        self._linked: LinkedOrbits | None = None
        self._fields: list[FieldHistory] = []
        self.tracklets: Attributables | None = None
        self.orbits: LinkedOrbits | None = None
        self.averaged: OrbitFits | None = None
        self._angles: list[Angles] = []
        self._limits: list[Array] = []
        self._area_deg2 = 0.0
        self._predicted: tuple[OrbitStates, Predictions, OrbitStates] | None = None

    def add(self, exposures: Exposures, detections: Detections, first: int) -> Angles:
        """Take up what the exposures of a block have returned, and return it as angles; `first` is
        the index of their first step among the scene's times."""
        scene, of = self.scene, detections.exposure
        self.add_fields(exposures, first)
        area = float(np.sum(np.rad2deg(2.0 * np.tan(exposures.half_field)) ** 2))
        if of.size == 0:
            return self.add_angles(_nothing(), np.empty(0), area)
        # exposures are sorted by step
        k, observer = first + exposures.step[of], exposures.observer[of]
        magnitude, ra, dec = detections.value.T
        body = unit_vectors(ra, dec)
        # from the body frame of the observer to the propagation frame
        turn = scene.observer_axes[k].swapaxes(1, 2)
        variance = detections.variance
        angles = make_angles(
            k * scene.step,
            observer,
            scene.observer_position[observer, k],
            np.einsum("nij,nj->ni", turn, body),
            1.0,
            magnitude=magnitude,
            magnitude_sigma=np.sqrt(variance[:, 0]),
            sun=scene.sun_position[k],
        )
        cosine = np.maximum(np.cos(dec), _LEAST_COSINE)
        covariance = np.zeros((k.size, 2, 2))
        covariance[:, 0, 0] = variance[:, 1] * cosine**2
        covariance[:, 1, 1] = variance[:, 2]
        basis = np.einsum("nij,naj->nai", turn, tangent_basis(body))
        angles = angles._replace(basis=basis, covariance=covariance)
        return self.add_angles(angles, exposures.limiting_magnitude[of], area)

    def add_angles(self, angles: Angles, limiting_magnitude: ArrayLike, area_deg2: float) -> Angles:
        """Take up detections that are angles already, in order of time, with the limiting magnitude
        (row,) of the exposure of each, and return them; `area_deg2` is the area of all exposures,
        those without a detection included. Directions are taken to be geometric: the light delay of
        the angles is set to 0."""
        self._area_deg2 += area_deg2
        if angles.time.size:
            self._angles.append(angles._replace(light_delay=0.0))
            self._limits.append(np.asarray(limiting_magnitude, dtype=float))
        return angles

    def add_fields(self, exposures: Exposures, first: int) -> None:
        """Take up where exposures have looked, with or without detections; as for `add`."""
        if self.lineage.maneuvers_per_day > 0.0:
            self._fields.append(
                FieldHistory(
                    first + exposures.step, exposures.observer,
                    boresight_vectors(exposures, self.scene, first), exposures.half_field,
                )
            )  # fmt: skip

    @property
    def angles(self) -> Angles:
        """All detections so far, in order of time, as they are linked: with the treatment of the
        errors of the observers."""
        if self.calibration is None or not self._angles:
            return self._measured
        return corrected_angles(self._measured, self.scene, self.calibration)

    @property
    def _measured(self) -> Angles:
        """All detections so far, without the treatment; they are joined when this is first read."""
        if not self._angles:
            return _nothing()
        if len(self._angles) > 1:
            parts = zip(*(each[:-1] for each in self._angles), strict=True)
            self._angles = [Angles(*map(np.concatenate, parts), 0.0)]
        return self._angles[0]

    def link(self) -> LinkedOrbits:
        """Link all tracklets so far, continuing the orbits of the last time."""
        angles = self.angles
        rate = frame_rate(self.forces)
        formed = form_tracklets(angles, self.settings, rate=rate)
        # a calibration changes the angles
        same = None if self.errors.treatment == "calibrated" else self.tracklets
        self.tracklets = attributables(angles, formed, rate=rate, known=same)
        limits = np.concatenate([np.empty(0), *self._limits])
        # what is not a false alarm may be of objects that are not linked
        others = angles.time.size / max(self._area_deg2, 1.0) - self.process.false_alarms_deg2
        scored = np.where(np.isnan(angles.sun).any(axis=1), np.nan, angles.magnitude)
        intensity = self.process.log_intensity(scored, limits, max(others, 1e-3))
        self._linked = link(
            angles,
            self.tracklets,
            forces=self.forces,
            region=self.region,
            settings=self.linking,
            log_clutter=intensity,
            known=self._linked,
        )
        self.status = (CURRENT,) * self._linked.log_ratio.size
        self.orbits, averaged = self._linked, None
        remaining = self._remaining
        if remaining is not None:
            self.orbits = self.orbits._replace(
                fits=considered(self.orbits.fits, remaining, forces=self.forces)
            )
        uncertain = {"settings": self.lineage, "radiation_sigma": self.radiation_sigma,
                     "remaining": remaining}  # fmt: skip
        if self.lineage.maneuvers_per_day == 0.0 and self.radiation_sigma > 0.0:
            own, given = np.flatnonzero(self.orbits.confirmed), self.orbits.fits
            found = maneuvers_within(given.take(own), angles, forces=self.forces, **uncertain)
            self.orbits = self.orbits._replace(fits=replaced(given, own, found.fits))
        elif self.lineage.maneuvers_per_day > 0.0 and angles.time.size:
            self.orbits, averaged, self.status, self.maneuvers = maneuvered_orbits(
                self.orbits, angles, forces=self.forces, region=self.region, linking=self.linking,
                **uncertain, watch=self._watch(), fit=self._fit,
            )  # fmt: skip
        self.averaged = self.orbits.fits if averaged is None else averaged
        self._predicted = None
        steady = self.orbits.confirmed.copy()
        if self.maneuvers is not None:
            # an impulse within an orbit is no error of the observers
            steady[self.maneuvers.after[self.maneuvers.before == self.maneuvers.after]] = False
        if self.errors.treatment == "calibrated" and np.any(steady):
            self.calibration = calibrate(
                self.orbits.fits.take(np.flatnonzero(steady)),
                remaining,
                self.errors.assumed,
                forces=self.forces,
                radiation_sigma=self.radiation_sigma,
            )
        return self.orbits

    @property
    def _remaining(self) -> RemainingErrors | None:
        """What remains of the errors of the observers; None without a treatment of them."""
        if self.calibration is None:
            return None
        return RemainingErrors(self._measured, self.scene, self.calibration)

    def _fit(self, angles: Angles, *given: Any, forces: tuple) -> OrbitFits:
        """Orbits with the covariance that considers the errors of the observers."""
        fits = fit_orbits(angles, *given, forces=forces)
        remaining = self._remaining
        return fits if remaining is None else considered(fits, remaining, forces=forces)

    def _watch(self) -> Watch | None:
        """Where exposures have looked, if this is known."""
        if not self._fields:
            return None
        fields = FieldHistory(*(np.concatenate(each) for each in zip(*self._fields, strict=True)))
        given = self.magnitude_sigma, self.process.detection_loss
        return Watch(fields, self.scene, self.limits, *given)

    def predict(self, time: float) -> Predictions:
        """Orbits at a later time than the last detection. Those that meet a body are left out, and
        those whose position is less certain than that of an unknown object."""
        if self.orbits is None:
            none, shape = np.empty(0, dtype=np.int64), (0, 6, 6)
            return Predictions(
                np.empty((0, 6)), np.empty(shape), np.empty(0), none, np.empty(shape)
            )
        if self._predicted is None:
            current = [k for k, each in enumerate(self.status) if each == CURRENT]
            fits = self.orbits.fits.take(current)
            starts = OrbitStates.of(fits)
            existence = 1.0 / (1.0 + np.exp(-np.minimum(self.orbits.log_ratio[current], 50.0)))
            count, planned = np.diff(fits.begin), starts
        else:
            starts, last, planned = self._predicted
            existence, count = last.existence, last.detections
        states, kept = orbits_at(starts, time, self.forces, self.radiation_sigma)
        planned, both = orbits_at(planned.take(kept), time, self.forces)
        states, kept = states.take(both), kept[both]
        spread = np.trace(states.covariance[:, :3, :3], axis1=1, axis2=2)
        certain = np.flatnonzero(spread < 3.0 * self.region.position_sigma**2)
        states, planned, kept = states.take(certain), planned.take(certain), kept[certain]
        found = Predictions(
            states.state, states.covariance, existence[kept], count[kept], planned.covariance
        )
        self._predicted = states, found, planned
        return found

    def take_plan(self, planned: Array) -> None:
        """Take up the covariances (orbit, 6, 6) of the last prediction with what has been planned
        for them."""
        if self._predicted is not None:
            states, found, before = self._predicted
            self._predicted = states, found, before._replace(known_radiation=planned)

    def explains(self, angles: Angles, now: Predictions, time: float) -> NDArray[np.bool_]:
        """Which detections are within the gate of an orbit.

        Parameters
        ----------
        angles : Angles
            Detections within some minutes of `time`.
        now : Predictions
            Orbits at that time.
        time : float
            Nondimensional.

        Returns
        -------
        ndarray of bool, shape (row,)
        """
        out = np.zeros(angles.time.size, dtype=bool)
        if len(now.state) == 0 or angles.time.size == 0:
            return out
        gate = gate_threshold(_GATE, 2)
        since = (angles.time - time)[:, None, None]
        way = now.state[:, :3] + since * now.state[:, 3:] - angles.observer_position[:, None]
        distance = np.linalg.norm(way, axis=2)
        unit = way / distance[..., None]
        apart = np.linalg.norm(unit - angles.direction[:, None], axis=2)
        spread = np.sqrt(np.trace(now.covariance[:, :3, :3], axis1=1, axis2=2))
        # within the circle about the ellipse, of any direction
        ahead = np.einsum("nkc,nc->nk", way, angles.direction) > 0.0
        row, k = np.nonzero(ahead & (apart <= np.sqrt(gate) * (spread / distance + _CURVATURE)))
        basis, direction = tangent_basis(unit[row, k]), angles.direction[row]
        h = basis / distance[row, k][:, None, None]
        s = h @ now.covariance[k, :3, :3] @ h.swapaxes(1, 2) + _CURVATURE**2 * np.eye(2)
        x = np.einsum("nac,nc->na", basis, direction)
        x /= np.einsum("nc,nc->n", unit[row, k], direction)[:, None]
        det = s[:, 0, 0] * s[:, 1, 1] - s[:, 0, 1] ** 2
        squared = s[:, 1, 1] * x[:, 0] ** 2 - 2.0 * s[:, 0, 1] * x[:, 0] * x[:, 1]
        squared += s[:, 0, 0] * x[:, 1] ** 2
        # an orbit whose covariance is singular in double precision explains nothing
        out[row[(det > 0.0) & (squared >= 0.0) & (squared <= gate * det)]] = True
        return out


def _nothing() -> Angles:
    """Angles without a row."""
    return make_angles([0.0], [0], np.zeros((1, 3)), np.ones((1, 3)), 1.0).rows([])
