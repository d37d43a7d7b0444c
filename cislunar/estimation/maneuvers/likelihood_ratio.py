"""Generalized likelihood ratio test for an impulse at an unknown time (Willsky & Jones 1976).

An impulse v at a time t changes the innovations of a filter that does not know it to G v plus white
noise of covariance S. With the transition matrices Phi, gains K and derivatives H of the filter,
the derivative D of the error of its estimate by v starts at (0, I) at the time t and follows

    D <- Phi D,    G = H D,    D <- D - K G    (the last two at an observation),

and with innovations nu the log-likelihood ratio is largest at the impulse C^-1 d, where

    C = sum G^T S^-1 G,    d = sum G^T S^-1 nu.

Twice its logarithm is the statistic d^T C^-1 d. Without a maneuver it has the chi-squared
distribution with three degrees of freedom, and C^-1 is the Cramér-Rao bound of the impulse given
its time. The test takes the largest statistic of several hypothesized times in a window that moves.

The recursion runs beside any filter from its mean and covariance at every step and does not change
them. It is linear about the filter's mean, and follows the filter over a step by its own gain.

Assumptions and limitations
---------------------------
- The two angles are tested. The magnitude of a target tells little of its orbit.
- C + I / (1 km/s)^2 replaces C, so that an impulse which the observations do not determine has no
  large statistic.
- A Gaussian mixture is represented by its moments.
- Orbits whose covariance is too small while coasting give false alarms.
- An impulse between two hypothesized times is found by the one before or after it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.dynamics.forces import of_targets
from cislunar.dynamics.maneuvers import VELOCITY_UNIT_M_S
from cislunar.errors import ConfigurationError
from cislunar.estimation.estimator import Estimates, OrbitEstimates
from cislunar.estimation.initial_sigma import ProcessNoise, noise_of_step
from cislunar.estimation.linearization import SIZE
from cislunar.estimation.maneuvers.detection_settings import ManeuverDetection
from cislunar.estimation.maneuvers.recursion import scan
from cislunar.estimation.track_arrays import remaining_tracks
from cislunar.observation.records import Measurements, Schedule
from cislunar.observation.scene import Scene
from cislunar.runtime import Array
from cislunar.runtime.arguments import array_of, number_of
from cislunar.runtime.settings_fields import require_multiple
from cislunar.runtime.threads import share_out

_USUAL = ManeuverDetection()

_PRIOR = (VELOCITY_UNIT_M_S / 1000.0) ** 2
"""Prior information on a component of an impulse, nondimensional: that of a standard deviation of
1 km/s."""


class ManeuverEstimates(NamedTuple):
    """The largest statistic of each target in an interval.

    Attributes
    ----------
    statistic : ndarray, shape (target,)
        0 without an observation that was used.
    index, tested : ndarray of int, shape (target,)
        Hypothesized time of the maneuver, and time of the observation; indices of the scene, -1
        without such an observation.
    impulse_m_s : ndarray, shape (target, 3)
        Estimated change of velocity at the hypothesized time, propagation frame.
    covariance : ndarray, shape (target, 3, 3)
        Its covariance given the time, m^2/s^2.
    """

    statistic: Array
    index: NDArray[np.int64]
    tested: NDArray[np.int64]
    impulse_m_s: Array
    covariance: Array


def _arrays(n_targets: int, count: int) -> tuple[Array, Array, Array]:
    """Derivatives, d and C of hypotheses of which none has begun."""
    return (
        np.zeros((n_targets, count, SIZE, 3)),
        np.zeros((n_targets, count, 3)),
        np.zeros((n_targets, count, 3, 3)),
    )


def _best(n_targets: int) -> tuple[Array, NDArray[np.int64], Array, Array]:
    """Largest statistics before the first one."""
    return (
        np.zeros((n_targets, 1)),
        np.full((n_targets, 3), -1, dtype=np.int64),
        np.full((n_targets, 3), np.nan),
        np.zeros((n_targets, 3, 3)),
    )


def _estimates(
    best: tuple[Array, NDArray[np.int64], Array, Array],
) -> ManeuverEstimates:
    """The largest statistics and their impulses in m/s."""
    value, at, impulse, information = best
    covariance = VELOCITY_UNIT_M_S**2 * np.linalg.inv(information + _PRIOR * np.eye(3))
    return ManeuverEstimates(
        value[:, 0], at[:, 0], at[:, 1], VELOCITY_UNIT_M_S * impulse, covariance
    )


def _steps(spacing_minutes: float, step_s: float) -> int:
    """Steps between hypothesized times."""
    require_multiple("spacing_minutes", spacing_minutes, 60.0, step_s)
    return round(60.0 * spacing_minutes / step_s)


class ManeuverTest:
    """The test of all targets, from interval to interval.

    Parameters
    ----------
    scene : Scene
        Believed positions of the observers.
    forces : NamedTuple
        Assumed force model.
    n_targets : int
    process_noise : ProcessNoise, optional
        That of the filter; none if omitted.
    window_hours, spacing_minutes : float
        Time before the present within which maneuvers are hypothesized, and time between them,
        a multiple of the step.

    Raises
    ------
    ConfigurationError
        If a time is not positive, or the spacing is no multiple of the step or longer than the
        window.
    """

    def __init__(
        self,
        scene: Scene,
        forces: tuple,
        n_targets: int,
        *,
        process_noise: ProcessNoise | None = None,
        window_hours: float = _USUAL.window_hours,
        spacing_minutes: float = _USUAL.spacing_minutes,
    ) -> None:
        window = number_of("window_hours", window_hours, positive=True)
        minutes = number_of("spacing_minutes", spacing_minutes, positive=True)
        self._spacing = _steps(minutes, scene.step_s)
        if minutes > 60.0 * window:
            raise ConfigurationError(
                f"spacing_minutes = {minutes:g} must be at most window_hours = {window:g}"
            )
        self._scene, self._forces = scene, forces
        self._process = noise_of_step(process_noise, scene.step_s)
        # within the window are as many hypothesized times as intervals, and one
        self._own = _arrays(n_targets, 1 + int(window * 60.0 / minutes + 1e-9))
        self._own[0][:, 0, 3:] = np.eye(3)  # the first hypothesis begins

    def advance(
        self, start: OrbitEstimates, measurements: Measurements, found: Estimates
    ) -> tuple[ManeuverEstimates, Array]:
        """Test an interval.

        Parameters
        ----------
        start : OrbitEstimates
            Orbits at the time before the interval.
        measurements : Measurements
            Of the interval.
        found : Estimates
            Estimates at its steps, with covariances.

        Returns
        -------
        ManeuverEstimates
            The largest statistic of each target in the interval.
        ndarray, shape (row,)
            Normalized innovations squared of the angles, NaN where a measurement was not used.
        """
        n_targets, count = self._own[1].shape[:2]
        squared, best = np.full(found.used.size, np.nan), _best(n_targets)
        orbits = found.used, start.translation, start.covariance, found.translation
        # kernels are compiled for each memory layout of their arguments
        records = Measurements(*map(np.ascontiguousarray, measurements))
        given = (
            start.index + 1,
            (self._scene, self._forces, self._process),
            records,
            tuple(map(np.ascontiguousarray, (*orbits, found.covariance))),
            self._own,
            (self._spacing, _PRIOR),
            False,
            (squared, np.empty((1, count, 2, 3)), best),
        )
        share_out(lambda first, stop: scan((first, stop), *given), n_targets)
        return _estimates(best), squared

    def nothing(self) -> ManeuverEstimates:
        """The result of an interval without observations."""
        return _estimates(_best(self._own[1].shape[0]))

    def hypotheses(self, index: int) -> ManeuverEstimates:
        """The statistic of every hypothesized time after the last interval.

        Parameters
        ----------
        index : int
            Time of its last step, an index of the scene.

        Returns
        -------
        ManeuverEstimates
            With an axis (hypothesis,) after that of the targets, in the order of time. Those before
            the start of the run have a negative `index`.
        """
        _, gradient, information = self._own
        count, base = gradient.shape[1], index // self._spacing
        steps = base - count + 1 + np.arange(count)
        slots = steps % count
        covariance = np.linalg.inv(information[:, slots] + _PRIOR * np.eye(3))
        impulse = np.einsum("jhab,jhb->jha", covariance, gradient[:, slots])
        shape = gradient.shape[:2]
        return ManeuverEstimates(
            np.sum(gradient[:, slots] * impulse, axis=2),
            np.broadcast_to(self._spacing * steps, shape),
            np.full(shape, index),
            VELOCITY_UNIT_M_S * impulse,
            VELOCITY_UNIT_M_S**2 * covariance,
        )

    def restart(self, targets: ArrayLike) -> None:
        """Forget all hypotheses of some targets, whose orbits have been estimated anew. Maneuvers
        before the next hypothesized time are not tested."""
        for each in self._own:
            each[targets] = 0.0

    def add(self, n_new: int, forces: tuple | None = None) -> None:
        """Add tracks at the end; `forces` is the model of all tracks, if it changes. Maneuvers
        before the next hypothesized time are not tested."""
        self._forces = self._forces if forces is None else forces
        more = _arrays(n_new, self._own[1].shape[1])
        self._own = tuple(map(np.concatenate, zip(self._own, more, strict=True)))

    def remove(self, targets: ArrayLike) -> None:
        """Remove tracks, given by indices; the others keep their order."""
        left = remaining_tracks(self._own[1].shape[0], targets)
        self._forces = of_targets(self._forces, left)
        self._own = tuple(each[left] for each in self._own)


def planned_information(
    scene: Scene,
    forces: tuple,
    state: ArrayLike,
    covariance: ArrayLike,
    schedule: Schedule,
    angle_variance: ArrayLike,
    *,
    process_noise: ProcessNoise | None = None,
    spacing_minutes: float = _USUAL.spacing_minutes,
) -> tuple[Array, Array]:
    """What observations would tell of impulses at hypothesized times, before there is any.

    Parameters
    ----------
    scene, forces, process_noise, spacing_minutes
        See `ManeuverTest`. The hypothesized times begin with the first time of the scene.
    state, covariance : array_like, shapes (target, 6) and (target, 6, 6)
        Expected orbits at the first time of the scene and their covariance, nondimensional,
        propagation frame.
    schedule : Schedule
        Observations at the later times of the scene, all of which are assumed to detect their
        target.
    angle_variance : array_like, shape (row,)
        Variance of right ascension and of declination, rad^2.

    Returns
    -------
    times_s : ndarray, shape (hypothesis,)
        Hypothesized times of an impulse since the first time of the scene.
    whitened : ndarray, shape (row, hypothesis, 2, 3)
        Derivatives of the innovations by the impulse, whitened: the noise has unit covariance, and
        the sum of ``w.T @ w`` over rows is the information on the impulse; (m/s)^-1. Zero where the
        observation is before the impulse.

    Raises
    ------
    ConfigurationError
        If shapes disagree, a value is not finite, or the spacing is no multiple of the step.
    """
    states = array_of("state", state, ("target", SIZE))
    spread = array_of("covariance", covariance, (states.shape[0], SIZE, SIZE))
    variance = array_of("angle_variance", angle_variance, (schedule.observer.size,))
    minutes = number_of("spacing_minutes", spacing_minutes, positive=True)
    n_steps, spacing = schedule.offset.shape[1] - 1, _steps(minutes, scene.step_s)
    own = _arrays(states.shape[0], n_steps // spacing + 1)
    own[0][:, 0, 3:] = np.eye(3)  # the first hypothesis begins
    n_rows, n_targets = variance.size, states.shape[0]
    whitened = np.zeros((n_rows, own[1].shape[1], 2, 3))
    records = Measurements(
        np.ascontiguousarray(schedule.offset),
        np.ascontiguousarray(schedule.observer),
        np.zeros((n_rows, 3)),
        np.repeat(variance[:, None], 3, axis=1),
    )
    path = np.empty((n_targets, n_steps, SIZE)), np.empty((n_targets, n_steps, SIZE, SIZE))
    used = np.ones(n_rows, dtype=bool)
    scan(
        (0, n_targets),
        1,
        (scene, forces, noise_of_step(process_noise, scene.step_s)),
        records,
        (used, np.ascontiguousarray(states), np.ascontiguousarray(spread), *path),
        own,
        (spacing, _PRIOR),
        True,
        (np.empty(n_rows), whitened, _best(n_targets)),
    )
    times_s = scene.step_s * spacing * np.arange(whitened.shape[1])
    return times_s, whitened / VELOCITY_UNIT_M_S
