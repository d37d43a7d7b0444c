"""Estimators of targets whose observers have errors, which are considered or calibrated.

A filter assumes observers without errors. Given the errors c of the observers, its estimate m of a
target has the covariance D. A second recursion, linear about the corrected estimate, determines the
effect of c.

Calibrated. Given c, the true state has the mean m + V c and the covariance D. An innovation of the
filter is G c plus white noise of covariance S, with G = H V + J, where H and J are the derivatives
of the measured angles by the state and by c, and V <- (I - K H) Phi V - K J (separated bias,
Friedland 1969). Targets are independent given c. At the end of every block of steps, the
information is therefore the sum over the measurements of all targets

    I = P_c^-1 + sum of G^T S^-1 G,

in which the terms of target j sum to P_cj^-1 - P_c^-1, with P_cj the covariance of c after the
measurements of that target alone. Within a block, the estimate of target j is m + V c_j with the
covariance D + V P_cj V^T, where c_j uses all targets in earlier blocks and target j in the present
one. For linear models and constant errors, the result at the end of a block is that of one filter
of all targets and errors. A random walk adds Q to P_c. V is then replaced by V P_c (P_c + Q)^-1,
and D increases by V (P_c - P_c (P_c + Q)^-1 P_c) V^T; the resulting correlation between targets,
given c, is neglected.

Considered. The gain is that of the Schmidt-Kalman filter (Schmidt 1966; Jazwinski 1970, section
8.4). It contains the covariance of the errors and their correlation with the state. The estimated
errors remain zero, with their prior covariance.

Assumptions and limitations
---------------------------
- The recursions use the angles alone, since the magnitude determines the orbit much less. They
  neglect the effect of the errors on attitudes and body parameters.
- The measured angles are linear over the errors, whose second-order effect is added to the noise.
  It is large near an observer and near the pole of the frame in which it measures.
- A Gaussian mixture is represented by its mean and covariance, and a random walk does not increase
  the covariances of its components.
- Errors along the axes of the propagation frame are constant or a random walk. The position error
  of an observer in free fall is neither over more than a part of its period, which the random walk
  has to cover.
- A clock error displaces a direction by the relative velocity, to first order in time. The attitude
  of the observer is measured during the exposure and does not depend on the clock.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.constants import TIME_UNIT_S
from cislunar.dynamics.forces import of_targets
from cislunar.errors import ConfigurationError
from cislunar.estimation.estimator import (
    HEALTHY,
    Estimates,
    Estimator,
    OrbitEstimates,
    Prediction,
)
from cislunar.estimation.initial_sigma import ProcessNoise, noise_of_step
from cislunar.estimation.linearization import SIZE, ObserverModel, carry_corrections
from cislunar.estimation.navigation.calibration import calibrate
from cislunar.estimation.navigation.errors import (
    ERROR_UNITS,
    N_PARAMETERS,
    ObserverErrorSigma,
    ObserverEstimate,
)
from cislunar.estimation.navigation.rates import frame_rotation, observer_velocities
from cislunar.estimation.navigation.schmidt import consider
from cislunar.estimation.track_arrays import remaining_tracks, widened_roots
from cislunar.estimation.wrapped_estimator import WrappedEstimator
from cislunar.observation.records import Measurements, rows_of
from cislunar.observation.scene import Scene
from cislunar.runtime import Array
from cislunar.runtime.threads import share_out, single_threaded_algebra

_BLOCK_S = 600.0
"""Duration of a block, s, in which the observers' errors are constant."""

_LARGEST_BEND = 0.1
"""Largest second-order displacement of an orbit by the errors of observers, in standard deviations
of the orbit given the errors, with which their correlation counts as linear."""


class NavigatedEstimator(WrappedEstimator):
    """An `Estimator` that runs another one and treats the errors of its observers.

    Parameters
    ----------
    inner : Estimator
        Estimator that assumes observers without errors.
    scene : Scene
        Assumed positions of the observers.
    forces : NamedTuple
        Assumed force model, see `cislunar.dynamics.forces`.
    sigma : ObserverErrorSigma
        Prior standard deviations of the observers' errors.
    treatment : {"considered", "calibrated"}
    process_noise : ProcessNoise, optional
        Process noise of the inner estimator; none if omitted.
    n_targets : int
        Number of targets of the inner estimator.
    """

    def __init__(
        self,
        inner: Estimator,
        scene: Scene,
        forces: tuple,
        sigma: ObserverErrorSigma,
        treatment: str,
        process_noise: ProcessNoise | None,
        n_targets: int,
    ) -> None:
        super().__init__(inner)
        constant, walk = sigma.constant(), sigma.walk()
        scale = np.hypot(constant, walk)
        some = np.flatnonzero(scale > 0.0)
        column = np.full(N_PARAMETERS, -1, dtype=np.int64)
        column[some] = np.arange(some.size)
        self._scene, self._forces = scene, forces
        self._calibrated = treatment == "calibrated"
        self._model = ObserverModel(
            column,
            some.size,
            np.where(scale > 0.0, scale, 1.0),
            np.ascontiguousarray(observer_velocities(scene)),
            frame_rotation(scene),
            TIME_UNIT_S if scene.step == 0.0 else scene.step_s / scene.step,
            noise_of_step(process_noise, scene.step_s),
        )
        n_observers = scene.observer_position.shape[0]
        n = n_observers * some.size
        relative = (constant[some] / scale[some]) ** 2, (walk[some] / scale[some]) ** 2
        prior, self._growth = (np.tile(each, n_observers) for each in relative)
        self._growth = self._growth / 86_400.0  # per second
        self._mean, self._covariance = np.zeros(n), np.diag(prior)
        # calibrated: derivatives V by the errors; considered: covariance with the errors
        self._sensitivity = np.zeros((n_targets, SIZE, n))
        # of the estimates less those of the inner estimator
        self._shift = np.zeros((n_targets, SIZE))
        self._spread = np.zeros((n_targets, SIZE, SIZE))

    def observers(self) -> ObserverEstimate:
        """Estimated errors of the observers at the time of the last processed step."""
        m, unit = self._model.per_observer, self._model.unit / ERROR_UNITS
        some = np.flatnonzero(self._model.column >= 0)
        n_observers = self._scene.observer_position.shape[0]
        mean = np.zeros((n_observers, N_PARAMETERS))
        covariance = np.zeros((n_observers, N_PARAMETERS, N_PARAMETERS))
        mean[:, some] = self._mean.reshape(n_observers, m) * unit[some]
        scale = unit[some] * unit[some][:, None]
        for o in range(n_observers):
            own = slice(m * o, m * o + m)
            covariance[o][np.ix_(some, some)] = scale * self._covariance[own, own]
        return ObserverEstimate(mean, covariance)

    def predict(self) -> Prediction:
        """See `Estimator.predict`. With calibrated errors, the covariance is that given the errors.
        It is the part of the uncertainty that measurements of a target reduce, so that tasking does
        not repeat measurements in order to reduce the other part."""
        ahead, now = self._inner.predict(), self._inner.orbits()
        shift, spread = self._shift.copy(), self._spread.copy()
        carry_corrections(now.index, self._scene, self._forces, now.translation, shift, spread)
        corrected = ahead._replace(translation=ahead.translation + shift)
        if self._calibrated:
            return corrected
        corrected = corrected._replace(covariance=ahead.covariance + spread)
        if ahead.root is None:
            return corrected
        sound = (self.failed == HEALTHY) & np.isfinite(ahead.translation[:, 0])
        return corrected._replace(root=widened_roots(ahead.root, spread, sound))

    def orbits(self) -> OrbitEstimates:
        """See `Estimator.orbits`."""
        now = self._inner.orbits()
        return now._replace(
            translation=now.translation + self._shift, covariance=now.covariance + self._spread
        )

    def advance(
        self,
        measurements: Measurements,
        *,
        covariance: bool = False,
        final: bool = True,
        histories: bool = True,
    ) -> Estimates:
        """See `Estimator.advance`; the orbits at all steps are needed in any case."""
        with single_threaded_algebra():
            found = self._in_blocks(measurements, final)
        return found if covariance else found._replace(covariance=found.covariance[:, :0])

    def _in_blocks(self, measurements: Measurements, final: bool) -> Estimates:
        """Process an interval block by block."""
        n_steps, step_s = measurements.offset.shape[1] - 1, self._scene.step_s
        size = max(1, int(_BLOCK_S / step_s))
        _, step = rows_of(measurements)
        used, several, done = np.empty(step.size, dtype=bool), [], 0
        while done < n_steps or not several:
            stop = min(done + size, n_steps)
            # in a block, the random walk is that of its middle
            self._walk(0.5 * (stop - done) * step_s)
            rows = (step >= done) & (step < stop)
            part = measurements.where(rows)
            part = part._replace(offset=np.ascontiguousarray(part.offset[:, done : stop + 1]))
            found = self._advance(self._with_nonlinearity(part), final and stop == n_steps)
            self._walk(0.5 * (stop - done) * step_s)
            used[rows], done = found.used, stop
            several.append(found[:-1])
        histories = (np.concatenate(each, axis=1) for each in zip(*several, strict=True))
        return Estimates(*histories, used)

    def _with_nonlinearity(self, measurements: Measurements) -> Measurements:
        """The measurements with the variance of the second-order effect of the errors of observer
        and orbit added to that of the angles: at a distance d from the polar axis of the observer's
        frame, a displacement s changes the angles by up to s / d to first order and s^2 / d^2 to
        second order."""
        now, observer = self.orbits(), measurements.observer
        target, step = rows_of(measurements)
        index = now.index + 1 + step
        ahead = (self._scene.step * (1.0 + step))[:, None]
        place = now.translation[target, :3] + ahead * now.translation[target, 3:]
        way = place - self._scene.observer_position[observer, index]
        axis = np.linalg.norm(way, axis=1) * np.cos(measurements.value[:, 2])
        moved = np.trace(self._spread[target, :3, :3], axis1=1, axis2=2)
        unit, column = self._model.unit[:3], self._model.column[:3]
        if column[0] >= 0:
            own = self._model.per_observer * observer[:, None] + column
            variance = np.diag(self._covariance)[own]
            joint = self._joint()[target[:, None], np.arange(3), own]
            moved = moved + variance @ unit**2 - 2.0 * joint @ unit
        bend = np.nan_to_num(np.maximum(moved, 0.0) / axis**2)  # NaN without a measured value
        variance = measurements.variance.copy()
        variance[:, 1:] += bend[:, None] ** 2
        return measurements._replace(variance=variance)

    def _joint(self) -> Array:
        """Covariance (target, 6, n) of the orbits with the errors of the observers."""
        return self._sensitivity @ self._covariance if self._calibrated else self._sensitivity

    def _advance(self, measurements: Measurements, final: bool) -> Estimates:
        """Process steps with constant errors."""
        start = self._inner.orbits()
        found = self._inner.advance(measurements, covariance=True, final=final)
        first, model = start.index + 1, (self._scene, self._forces, self._model)
        orbits = start.translation, start.covariance, found.translation, found.covariance
        out = np.empty_like(found.translation), np.empty_like(found.covariance)
        if self._calibrated:
            self._calibrate(first, model, measurements, found.used, orbits, out)
        else:
            own = self._shift, self._spread, self._sensitivity
            given = first, model, measurements, (found.used, *orbits), own
            variance = np.diag(self._covariance).copy()
            share_out(
                lambda start, stop: consider((start, stop), *given, variance, out),
                self.failed.size,
            )
        self._settle()
        sigma = found.sigma.copy()
        sigma[..., SIZE:] = np.sqrt(np.diagonal(out[1], axis1=2, axis2=3))
        return found._replace(translation=out[0], sigma=sigma, covariance=out[1])

    def _calibrate(
        self,
        first: int,
        model: tuple,
        measurements: Measurements,
        used: NDArray[np.bool_],
        orbits: tuple[Array, ...],
        out: tuple[Array, Array],
    ) -> None:
        """Run the recursion over an interval and update the errors by all of its rows."""
        n, row_of = self._mean.size, np.cumsum(used) - 1
        white, residual = np.empty((used.sum(), 2, n)), np.empty((used.sum(), 2))
        parameters = self._mean, self._covariance
        own = self._shift, self._sensitivity, self._joint()
        given = first, model, measurements, (used, row_of, *orbits), own, parameters
        share_out(
            lambda start, stop: calibrate((start, stop), *given, (*out, white, residual)),
            self.failed.size,
        )
        rows, errors = white.reshape(-1, n), residual.ravel()
        # P = (I + P_c sum G^T S^-1 G)^-1 P_c needs no inverse of the prior, which may be singular
        information = rows.T @ rows
        found = np.linalg.solve(np.eye(n) + self._covariance @ information, self._covariance)
        self._covariance = 0.5 * (found + found.T)
        self._mean = self._mean + self._covariance @ (rows.T @ (errors - rows @ self._mean))
        self._shift += self._sensitivity @ self._mean
        self._spread = self._of_errors(self._covariance)

    def _settle(self) -> None:
        """Correct the inner estimator, so that it stays near the corrected estimates. Where the
        correlation with the errors is no longer linear it is dropped, and the inner estimator gets
        the whole covariance. A displacement s along an orbit of radius R differs from one along the
        tangent by s^2 / (2 R)."""
        now = self._inner.orbits()
        place = now.translation[:, None, :3] - self._scene.primaries[now.index]
        radius = np.linalg.norm(place, axis=2).min(axis=1)
        displaced, known = (
            np.trace(each[:, :3, :3], axis1=1, axis2=2) for each in (self._spread, now.covariance)
        )
        curved = displaced > _LARGEST_BEND * 2.0 * radius * np.sqrt(known)  # false for NaN
        corrected = self._inner.correct(
            self._shift, np.where(curved[:, None, None], self._spread, 0.0)
        )
        self._shift[corrected] = 0.0
        self._sensitivity[corrected & curved], self._spread[corrected & curved] = 0.0, 0.0

    def _of_errors(self, covariance: Array) -> Array:
        """Covariance (target, 6, 6) of the estimates due to a covariance (n, n) of the errors."""
        return self._sensitivity @ covariance @ self._sensitivity.swapaxes(1, 2)

    def _walk(self, elapsed_s: float) -> None:
        """Add the random walk of a time to the errors."""
        added, before = self._growth * elapsed_s, self._covariance
        if not np.any(added > 0.0):
            return
        self._covariance = before + np.diag(added)
        if not self._calibrated:
            return
        kept = np.linalg.solve(self._covariance, before).T  # P_c (P_c + Q)^-1
        gained = before - kept @ before
        gained = self._of_errors(0.5 * (gained + gained.T))
        corrected = self._inner.correct(np.zeros_like(self._shift), gained)
        # the others keep an estimate that moves with the errors, of a larger variance
        self._sensitivity[corrected] = self._sensitivity[corrected] @ kept
        self._spread = self._of_errors(self._covariance)

    def replace_orbits(self, targets: ArrayLike, translation: Array, covariance: Array) -> None:
        """Raise ConfigurationError: orbits with errors of observers cannot be replaced."""
        raise ConfigurationError(
            "orbits cannot be replaced where errors of observers are treated; choose one of both"
        )

    def _added(self, n_new: int, forces: tuple | None) -> None:
        """See `WrappedEstimator`. The estimates of new tracks are independent of the errors."""
        self._forces = self._forces if forces is None else forces
        for name in ("_sensitivity", "_shift", "_spread"):
            old = getattr(self, name)
            setattr(self, name, np.concatenate([old, np.zeros((n_new, *old.shape[1:]))]))

    def remove(self, targets: ArrayLike) -> None:
        """See `Estimator.remove`."""
        left = remaining_tracks(self.failed.size, targets)
        self._inner.remove(targets)
        self._forces = of_targets(self._forces, left)
        for name in ("_sensitivity", "_shift", "_spread"):
            setattr(self, name, getattr(self, name)[left])
