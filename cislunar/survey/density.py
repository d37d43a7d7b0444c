"""Density of undetected objects, as weighted particles.

The undetected objects are a Poisson process in the space of states, whose intensity is represented
by particles with weights; their sum is the expected number of undetected objects. An exposure
multiplies the intensity by the probability that it does not detect an object there (Williams 2015,
IEEE Transactions on Aerospace and Electronic Systems 51, 1664, equation 35). A detection that no
known orbit explains is of an object whose orbit is not known yet, or a false alarm. The weights of
the particles near its direction are raised in proportion to what each of them explains of it,

    w_i' = (1 - p_i) w_i + sum over detections of p_i w_i g_i / (kappa + sum_j p_j w_j g_j),    (1)

the update of the probability hypothesis density filter (Mahler 2003, IEEE Transactions on Aerospace
and Electronic Systems 39, 1152, equation 4), so that the search returns to such objects. The
density g of directions is a Gaussian that is as wide as the particles are apart. Only what
exposures return is used.
"""

import numpy as np
from numpy.typing import ArrayLike

from cislunar.constants import SECONDS_PER_DAY, TIME_UNIT_S
from cislunar.dynamics import EARTH_MOON, propagate_bundle
from cislunar.errors import ConfigurationError
from cislunar.orbit_determination import AdmissibleRegion, is_admissible
from cislunar.runtime.arguments import array_of, count_of, indices_of, number_of

_STEP_S = 300.0
"""Longest step of the propagation, for orbits of some hours about Earth and Moon."""

_SAME_TIME = 1e-12
"""Times that differ by at most this, nondimensional, are equal but for rounding."""


class ObjectDensity:
    """Particles of undetected objects.

    Parameters
    ----------
    state : array_like, shape (particle, 6)
        States at the start, nondimensional, propagation frame.
    size_m2 : array_like, shape (particle,)
        Diffuse reflection coefficient times squared radius.
    expected : float
        Expected number of undetected objects, equally distributed over the particles.
    forces : NamedTuple
        CR3BP or ephemeris forces.
    region : AdmissibleRegion, optional
        Particles that leave it have no weight from then on.
    births_per_day : float
        Expected number of objects that appear in a day, equally distributed over the particles
        that are in the region.

    Attributes
    ----------
    time : float
        Nondimensional, since the epoch of the force model.
    state, size_m2 : ndarray
    weight : ndarray, shape (particle,)
        Expected number of undetected objects that a particle represents.

    Raises
    ------
    ConfigurationError
        If shapes disagree, a value is not finite, or a size or the expected number is not positive.
    """

    def __init__(
        self,
        state: ArrayLike,
        size_m2: ArrayLike,
        expected: float,
        *,
        forces: tuple = EARTH_MOON,
        region: AdmissibleRegion | None = None,
        births_per_day: float = 0.0,
    ) -> None:
        self.state = array_of("state", state, ("particle", 6)).copy()
        self.size_m2 = array_of("size_m2", size_m2, (len(self.state),)).copy()
        finite = np.isfinite(expected)
        if len(self.state) == 0 or not (np.all(self.size_m2 > 0.0) and finite and expected > 0.0):
            raise ConfigurationError(
                f"density: {len(self.state)} particles, sizes and an expected number of {expected} "
                "must all be positive"
            )
        self.forces, self.births_per_day = forces, number_of("births_per_day", births_per_day)
        self.region = AdmissibleRegion() if region is None else region
        self.time = 0.0
        self.weight = np.full(len(self.state), float(expected) / len(self.state))
        self._inside = np.ones(len(self.state), dtype=bool)

    @property
    def expected(self) -> float:
        """Expected number of undetected objects."""
        return float(self.weight.sum())

    def advance(self, time: float) -> None:
        """Propagate to a later time, nondimensional. Particles that hit a body or leave the region
        lose their weight and stay where they are. A time that is not finite or earlier than the
        last one raises a `ConfigurationError`."""
        span = number_of("time", time) - self.time
        if span < -_SAME_TIME:
            raise ConfigurationError(
                f"time = {time} is before {self.time}; advance in order of time"
            )
        if span <= _SAME_TIME:
            return
        active = np.flatnonzero(self._inside)
        steps = int(np.ceil(span * TIME_UNIT_S / _STEP_S - 1e-9))
        path = propagate_bundle(
            self.state[active], span / steps, steps, forces=self.forces, start=self.time
        )[:, -1]
        self.time = float(time)
        good = np.all(np.isfinite(path), axis=1)
        good[good] = is_admissible(path[good], self.time, self.forces, self.region)
        self.state[active[good]] = path[good]
        self.weight[active[~good]], self._inside[active[~good]] = 0.0, False
        if self.births_per_day > 0.0 and np.any(good):
            born = self.births_per_day * span * TIME_UNIT_S / SECONDS_PER_DAY
            self.weight[active[good]] += born / np.count_nonzero(good)

    def observed(
        self,
        probability: ArrayLike,
        particles: ArrayLike,
        likelihood: ArrayLike,
        false_alarms: float,
        visits: int = 1,
    ) -> None:
        """Update the density after exposures with detections (equation 1).

        Parameters
        ----------
        probability : array_like, shape (particle,)
            See `missed`.
        particles : array_like of int, shape (n,)
            Particles that the detections may be of.
        likelihood : array_like, shape (detection, n)
            Density g of the direction of each detection, given each of these particles, per square
            degree.
        false_alarms : float
            Mean number of false alarms per square degree of an exposure.
        visits : int
            Exposures in which an object has been looked at, each of which may have a detection of
            it.

        Raises
        ------
        ConfigurationError
            If the probabilities have another shape, or one is not between 0 and 1, a particle does
            not exist, the likelihood has another shape or is not finite, or `false_alarms` or
            `visits` is impossible.
        """
        which = indices_of("particles", particles, len(self.weight))
        chance = array_of("probability", probability, (len(self.weight),))
        density = array_of("likelihood", likelihood)
        if density.size:
            array_of("likelihood", density, ("detection", which.size))
        if np.any(density < 0.0):
            raise ConfigurationError("likelihood must not be negative")
        density = density.reshape(-1, which.size) if density.size else np.empty((0, which.size))
        if number_of("false_alarms", false_alarms) < 0.0:
            raise ConfigurationError(f"false_alarms = {false_alarms} must not be negative")
        count_of("visits", visits)
        part = chance[which] * self.weight[which] * density
        total = part.sum(axis=1) + false_alarms
        share = np.where(total > 0.0, 1.0 / np.where(total > 0.0, total, 1.0), 0.0)
        self.missed(chance)
        self.weight[which] += share @ part / visits

    def missed(self, probability: ArrayLike) -> None:
        """Lower the density after an exposure.

        Parameters
        ----------
        probability : array_like, shape (particle,)
            Probability that the exposure would have detected an object there, from 0 to 1.

        Raises
        ------
        ConfigurationError
            If the probabilities have another shape, or one is not between 0 and 1.
        """
        value = array_of("probability", probability, (len(self.weight),))
        if np.any((value < 0.0) | (value > 1.0)):
            raise ConfigurationError("probability must lie between 0 and 1")
        self.weight *= 1.0 - value
