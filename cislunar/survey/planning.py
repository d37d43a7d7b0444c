"""Plan of fields and visits: the search for undetected objects and the follow-up of known ones.

A plan covers a block of time. Every observer takes some fields and visits them in turn, in as many
rounds as there are visits, so that the detections of an object form a tracklet. Fields are chosen
by their worth,

    sum over particles of w_i p_i  +  c sum over orbits of p_j I_j,                             (1)

the expected number of detections of undetected objects plus the expected information on known
orbits, in nats, times the number c of detections of new objects that one nat is worth. The
information is that of a measured direction with the noise R on the predicted position with the
covariance P (Cover & Thomas 2006, Elements of Information Theory, section 9.4),

    I = ln det(1 + H P H' R^-1) / 2,                                                            (2)

which is large for an orbit whose range is undetermined if a second observer measures it, and small
if the same observer does. With `SearchSettings.characterization_worth` each orbit with n detections
also has the worth of a further magnitude with the noise sigma,

    ln(1 + min(s^2 / sigma^2, 6 / n)) / 2,                                                      (3)

times that number, with the scatter s of an object's magnitudes: the information on a single
quantity, but at most that on six parameters of a rotation which n magnitudes have determined.
Observers choose one after the other. Each choice lowers the weights of
the particles in the field and the covariances of the orbits in it, so that another observer takes
the same field only for what is left. If fewer than half of the positions that an orbit may have
will be detected, the probabilities of the other positions remain. The covariances with the planned
measurements are kept until orbits are linked again. The observer that begins changes from block to
block. If the search ends before the survey (`SearchSettings.search_days`), the first sum is then
left out.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.compiled import njit
from cislunar.constants import SECONDS_PER_DAY
from cislunar.detection import Exposures
from cislunar.dynamics import libration_points
from cislunar.errors import ConfigurationError
from cislunar.observation import Scene, SensorLimits, angles_of_vectors, unit_vectors
from cislunar.runtime import Array, Indices
from cislunar.runtime.settings_fields import require_multiple
from cislunar.survey.catalog import Predictions
from cislunar.survey.fields import FieldGrid, Views, views
from cislunar.survey.settings import DENSITY, STARING, SWEEP, SearchSettings

_CONSIDERED = 4
"""Fields that are considered for a round, over those for which it has time."""

_ROTATION = 6.0
"""Parameters of a rotation."""

_AHEAD = 40
"""Fields of a sweep that are looked ahead for clear ones, over the fields of a round."""


class Visits(NamedTuple):
    """Planned exposures, sorted by step and observer. `step` counts from the first of the block;
    `field` is the number in the observer's grid."""

    step: Indices
    observer: Indices
    field: Indices


class SearchPlanner:
    """Plans block by block.

    Parameters
    ----------
    settings : SearchSettings
    scene : Scene
    limits : SensorLimits
        Of all observers.
    magnitude_sigma : float
        Scatter of an object's magnitudes, mag.

    Raises
    ------
    ConfigurationError
        If a block is no whole number of steps or has too few of them for one field, or a field of
        view is not below 60 deg.
    """

    def __init__(
        self,
        settings: SearchSettings,
        scene: Scene,
        limits: SensorLimits,
        magnitude_sigma: float = 0.4,
    ) -> None:
        require_multiple("block_minutes", settings.block_minutes, 60.0, scene.step_s)
        self.settings, self.scene, self.limits = settings, scene, limits
        self.magnitude_sigma = magnitude_sigma
        self.n_steps = round(60.0 * settings.block_minutes / scene.step_s)
        self.round_steps = self.n_steps // settings.visits
        if self.round_steps < 1:
            raise ConfigurationError(
                f"search.block_minutes = {settings.block_minutes} has {self.n_steps} steps of "
                f"{scene.step_s} s for {settings.visits} visits; give at least one step for each"
            )
        longest = settings.exposure_s + 180.0 / settings.slew_rate_deg_s + settings.settle_s
        if longest > self.round_steps * scene.step_s:
            raise ConfigurationError(
                f"search.block_minutes = {settings.block_minutes} leaves "
                f"{self.round_steps * scene.step_s:g} s for each of {settings.visits} visits, less "
                f"than the {longest:g} s of a turn by 180 deg with an exposure; give more"
            )
        width = np.rad2deg(2.0 * limits.half_field)
        each = {float(one): FieldGrid(float(one)) for one in np.unique(width)}
        self.grids = [each[float(one)] for one in width]
        n = len(self.grids)
        self._pointing: list[Array | None] = [None] * n
        self._next = np.zeros(n, dtype=np.int64)
        self._block = 0

    def fields_of(self, seen: Views) -> Indices:
        """Field of each object for each observer, (observer, object)."""
        return np.array(
            [
                grid.field_of(ra, dec)
                for grid, ra, dec in zip(self.grids, seen.ra, seen.dec, strict=True)
            ]
        )

    def plan(
        self,
        index: int,
        weight: Array,
        fields: Indices,
        probability: Array,
        known: Predictions,
        known_fields: Indices,
        known_probability: Array,
    ) -> tuple[Visits, Array]:
        """Choose the exposures of a block.

        Parameters
        ----------
        index : int
            Time of the scene in the middle of the block.
        weight : ndarray, shape (particle,)
            Expected number of undetected objects.
        fields, probability : ndarray, shape (observer, particle)
            Field of each particle, and probability of detecting an object there.
        known : Predictions
            Linked orbits in the middle of the block.
        known_fields, known_probability : ndarray, shape (observer, orbit, draw)
            The same for positions that represent the uncertainty of the known orbits.

        Returns
        -------
        visits : Visits
        planned : ndarray, shape (orbit, 6, 6)
            Covariances of the known orbits with the planned measurements.
        """
        n, last = len(self.grids), self.settings.search_days
        chosen: list[Indices] = [np.empty(0, dtype=np.int64)] * n
        strategy, left, count = self.settings.strategy, weight.copy(), known.detections.copy()
        position, covariance = known.state[:, :3], known.planned.copy()
        draws = known_probability.shape[2]
        mass = np.repeat(known.existence[:, None] / draws, draws, axis=1)
        if last is not None and index * self.scene.step_s > last * SECONDS_PER_DAY:
            strategy, left = DENSITY, np.zeros_like(weight)
        for turn in range(n):
            o = (turn + self._block) % n
            if strategy == SWEEP:
                chosen[o] = self._swept(o, index)
            elif strategy == STARING:
                chosen[o] = self._stared(o, index)
            else:
                gain = self._information(o, index, position, covariance)
                gain += self._brightness_worth(o, count)
                chance = known_probability[o] * mass
                size = len(self.grids[o].center)
                worth = np.bincount(fields[o], left * probability[o], minlength=size)
                worth += np.bincount(
                    known_fields[o].ravel(), (chance * gain[:, None]).ravel(), minlength=size
                )
                chosen[o] = self._best(o, worth)
                within = np.isin(fields[o], chosen[o])
                left[within] *= 1.0 - self.settings.detection_weight * probability[o, within]
                share = np.isin(known_fields[o], chosen[o]) * known_probability[o]
                most = share.mean(axis=1) > 0.5
                taken, other = np.flatnonzero(most), np.flatnonzero(~most)
                count[taken] += self.settings.visits
                covariance[taken] = self._measured(o, index, position[taken], covariance[taken])
                mass[other] *= 1.0 - share[other]
        self._block += 1
        return self._timed(chosen), covariance

    def exposures(self, visits: Visits, first: int) -> Exposures:
        """Exposures of planned visits; `first` is the index of the block's first step."""
        o = visits.observer
        center = np.array(
            [
                self.grids[a].center[f]
                for a, f in zip(o.tolist(), visits.field.tolist(), strict=True)
            ]
        ).reshape(-1, 2)
        k = first + visits.step
        turn = self.scene.observer_axes[k] @ self.scene.frame_axes[k].swapaxes(1, 2)
        boresight = angles_of_vectors(np.einsum("nij,nj->ni", turn, unit_vectors(*center.T)))
        return Exposures(
            visits.step, o, boresight, self.limits.half_field[o], self.limits.limiting_magnitude[o]
        )

    def _tangents(self, o: int, index: int, position: Array) -> tuple[Array, Array]:
        """Derivatives (orbit, 2, 3) of the direction, and its noise variance over the squared
        range, both per squared unit of length."""
        way = position - self.scene.observer_position[o, index]
        distance = np.linalg.norm(way, axis=1)
        unit = way / distance[:, None]
        across = np.cross(unit, np.eye(3)[np.argmin(np.abs(unit), axis=1)])
        across /= np.linalg.norm(across, axis=1)[:, None]
        noise = self.limits.noise_variance[o, 1] * distance**2 / self.settings.visits
        return np.stack([across, np.cross(unit, across)], axis=1), noise

    def _information(self, o: int, index: int, position: Array, covariance: Array) -> Array:
        """Worth of a detection of each orbit, the second sum of equation (1)."""
        if self.settings.information_worth == 0.0 or len(position) == 0:
            return np.zeros(len(position))
        h, noise = self._tangents(o, index, position)
        spread = h @ covariance[:, :3, :3] @ h.swapaxes(1, 2) / noise[:, None, None]
        sign, log_det = np.linalg.slogdet(np.eye(2) + spread)
        # nothing is left to be learned if rounding has made a covariance indefinite
        nats = 0.5 * np.where((sign > 0.0) & np.isfinite(log_det), log_det, 0.0)
        return self.settings.information_worth * nats

    def _brightness_worth(self, o: int, count: Indices) -> Array:
        """Worth of a further magnitude of orbits with a number of detections, equation (3)."""
        if self.settings.characterization_worth == 0.0:
            return np.zeros(count.size)
        ratio = self.magnitude_sigma**2 / self.limits.noise_variance[o, 0]
        known = np.minimum(ratio, _ROTATION / np.maximum(count, 1))
        return self.settings.characterization_worth * 0.5 * np.log1p(known)

    def _measured(self, o: int, index: int, position: Array, covariance: Array) -> Array:
        """Covariances after a measurement by an observer."""
        if len(position) == 0:
            return covariance
        h, noise = self._tangents(o, index, position)
        mapped = covariance[:, :, :3] @ h.swapaxes(1, 2)
        spread = h @ mapped[:, :3] + noise[:, None, None] * np.eye(2)
        return covariance - mapped @ np.linalg.solve(spread, mapped.swapaxes(1, 2))

    def _best(self, o: int, worth: Array) -> Indices:
        """Fields of large worth for their time that fit into a round."""
        order = np.lexsort((np.arange(worth.size), -worth))[: _CONSIDERED * self.round_steps]
        order = order[worth[order] > 0.0]
        return self._route(o, order, worth[order])

    def _steps(self, before: Array, after: Array) -> Indices:
        """Steps from an exposure in one direction to the next in another, in which the telescope
        must turn and settle; both (..., 3), which are broadcast."""
        along = np.clip(np.sum(before * after, axis=-1), -1.0, 1.0)
        angle = np.rad2deg(np.arccos(along))
        needed = self.settings.exposure_s + np.where(
            angle > 1e-3, angle / self.settings.slew_rate_deg_s + self.settings.settle_s, 0.0
        )
        return np.ceil(needed / self.scene.step_s - 1e-6).astype(np.int64)

    def _route(self, o: int, fields: Indices, worth: Array | None = None) -> Indices:
        """As many of the fields as fit into a round, in the order of visits. The next field is the
        one with the most worth for the time by which it lengthens the closed tour, at the place
        where it lengthens the tour least. Without `worth` all fields are worth the same."""
        worth = np.ones(fields.size) if worth is None else worth
        direction, every = self.grids[o].direction[fields], np.arange(fields.size)
        steps = self._steps(direction[:, None], direction)
        here = self._pointing[o]
        start = np.ones_like(every) if here is None else self._steps(here, direction)
        return fields[_tour(steps, start, worth, self.round_steps)]

    def _timed(self, chosen: list[Indices]) -> Visits:
        """Steps of all visits: rounds begin at equal times, each in the same order."""
        parts = []
        for o, tour in enumerate(chosen):
            if tour.size == 0:
                continue
            direction, here = self.grids[o].direction[tour], self._pointing[o]
            first = 1 if here is None else int(self._steps(here, direction[0]))
            within = np.concatenate([[first], self._steps(direction[:-1], direction[1:])])
            within = np.cumsum(within) - 1
            for visit in range(self.settings.visits):
                parts.append((within + visit * self.round_steps, np.full(tour.size, o), tour))
            self._pointing[o] = direction[-1]
        if not parts:
            return Visits(*(np.empty(0, dtype=np.int64) for _ in range(3)))
        step, observer, field = (np.concatenate(each) for each in zip(*parts, strict=True))
        order = np.lexsort((observer, step))
        return Visits(step[order], observer[order], field[order])

    def _clear(self, o: int, index: int, directions: Array) -> NDArray[np.bool_]:
        """Whether directions, in the inertial frame, are free of bright bodies and hidden at no
        distance up to one unit of length."""
        place = self.scene.observer_position[o, index]
        far = place + directions @ self.scene.frame_axes[index]
        return np.isfinite(views(self.scene, self.limits, index, far).margin[o])

    def _swept(self, o: int, index: int) -> Indices:
        """The next fields of a sweep over the sky."""
        count = len(self.grids[o].center)
        order = (self._next[o] + np.arange(min(count, _AHEAD * self.round_steps))) % count
        clear = np.flatnonzero(self._clear(o, index, self.grids[o].direction[order]))
        tour = self._route(o, order[clear[: self.round_steps]])
        # past the last field that is visited, or past those that are not clear
        last = tour if tour.size else order
        self._next[o] = (order[np.isin(order, last)][-1] + 1) % count
        return tour

    def _stared(self, o: int, index: int) -> Indices:
        """The fields of L1 and L2, if they are free."""
        earth, moon = self.scene.primaries[index]
        # shares of the way from the Earth to the Moon
        first = self.scene.primaries[0]
        mu = float(np.linalg.norm(first[0]) / np.linalg.norm(first[1] - first[0]))
        share = libration_points(mu)[:2, 0] + mu
        place = earth + share[:, None] * (moon - earth)
        seen = views(self.scene, self.limits, index, place)
        free = np.isfinite(seen.margin[o])
        near = np.unique(self.grids[o].field_of(seen.ra[o, free], seen.dec[o, free]))
        return self._route(o, near)


@njit(cache=True, error_model="numpy")
def _tour(steps, start, worth, most):
    """Order of the fields of `SearchPlanner._route`: `steps` (field, field) from one to another,
    `start` (field,) from the present direction, at most `most` in all."""
    n = worth.size
    left, tour, trial = np.ones(n, np.bool_), np.empty(n, np.int64), np.empty(n, np.int64)
    size = length = 0
    while True:
        new, place, extra, best = -1, 0, 0, -1.0
        for m in range(n):
            if not left[m]:
                continue
            added, at = steps[m, m], 0
            if size == 1:
                added = 2 * steps[tour[0], m] - length
            for i in range(size if size > 1 else 0):
                before, after = tour[i - 1 if i else size - 1], tour[i]
                more = steps[before, m] + steps[m, after] - steps[before, after]
                if i == 0 or more < added:
                    added, at = more, i
            left[m] = length + added <= most
            # a field on the way takes no more time than its exposure, at least one step
            value = worth[m] / max(added, 1)
            if left[m] and value > best:
                new, place, extra, best = m, at, added, value
        if new < 0:
            return tour[:size].copy()
        left[new] = False
        trial[:place], trial[place] = tour[:place], new
        trial[place + 1 : size + 1] = tour[place:size]
        # a round begins with the field that the telescope reaches so that all are in time
        first, least = 0, 0
        for i in range(size + 1):
            end = start[trial[i]] + length + extra - steps[trial[i - 1 if i else size], trial[i]]
            if i == 0 or end < least:
                first, least = i, end
        if least <= most:
            size, length = size + 1, length + extra
            for i in range(size):
                tour[i] = trial[(first + i) % size]
