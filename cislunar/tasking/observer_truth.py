"""True errors of the positions, the pointing and the clocks of observers. See
`cislunar.estimation.navigation.errors` for the components.

Targets are observed from the true positions. Measured right ascension and declination contain the
zero-point offsets of the observer, and refer to a time that differs from the time stamp by the
clock error. Estimators, association and tasking use the assumed positions.

Assumptions and limitations
---------------------------
- Over the clock error, the motion of target and observer is uniform: at 1 s and in a low lunar
  orbit, the position is inexact by less than 1 m.
- Magnitude, occultation and the field of view are those of the time stamp.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cislunar.detection.exposures import FALSE_ALARM, Detections, Exposures
from cislunar.errors import ConfigurationError
from cislunar.estimation.navigation.errors import ERROR_UNITS, N_PARAMETERS, ObserverErrorSigma
from cislunar.estimation.navigation.rates import frame_rotation, observer_velocities
from cislunar.observation import Scene, angles_of_vectors, wrapped
from cislunar.runtime import Array, Indices, array_of
from cislunar.tasking.initial_conditions import OBSERVER, stream


class ObserverTruth(NamedTuple):
    """True errors (observer, time, 6) of the observers in a realization, true minus assumed values,
    in the order of `OBSERVER_PARAMETERS`; nondimensional, rad and s."""

    error: Array

    def at(self, index: int) -> Array:
        """Errors (observer, 6) at a time of the scene; m, arcsec and s."""
        return self.error[:, index] / ERROR_UNITS

    def scene(self, assumed: Scene) -> Scene:
        """The scene with the true positions of the observers."""
        return assumed._replace(
            observer_position=np.ascontiguousarray(assumed.observer_position + self.error[..., :3])
        )

    def offsets(self, scene: Scene, observer: Indices, index: Indices, translation: Array) -> Array:
        """Differences (row, 2), rad, of measured from true angles without noise, at time indices of
        the `scene` with the true positions, of targets with true states (row, 6)."""
        error = self.error[observer, index]
        clock = error[:, 5] * (scene.step / scene.step_s)
        if not np.any(clock):
            return error[:, 3:5].copy()
        way = translation[:, :3] - scene.observer_position[observer, index]
        velocity = translation[:, 3:] - observer_velocities(scene)[observer, index]
        velocity += np.cross(frame_rotation(scene), way)
        axes = scene.observer_axes[index]
        later = way + clock[:, None] * velocity
        before, after = (
            angles_of_vectors(np.einsum("nij,nj->ni", axes, each)) for each in (way, later)
        )
        return error[:, 3:5] + wrapped(after - before)

    def measured(
        self,
        scene: Scene,
        start: int,
        translation: Array,
        exposures: Exposures,
        detections: Detections,
        origin: Indices,
    ) -> tuple[Detections, Indices]:
        """Detections with the angles that the observers measure, and their origins. `translation`
        are the true states (target, time, 6) from the index `start` on, the time before the first
        step; detections have angles relative to the true axes."""
        step, observer = (each[detections.exposure] for each in exposures[:2])
        # a false alarm has no motion, so that the clock does not matter to it
        offset = self.error[observer, start + 1 + step][:, 3:5]
        real = np.flatnonzero(origin != FALSE_ALARM)
        index, states = start + 1 + step[real], translation[origin[real], step[real] + 1]
        offset[real] = self.offsets(scene, observer[real], index, states)
        value = shifted_angles(detections.value, offset)
        order = np.lexsort((value[:, 1], detections.exposure))
        exposure, variance = detections.exposure[order], detections.variance[order]
        return Detections(exposure, value[order], variance), origin[order]


def shifted_angles(value: Array, offset: Array) -> Array:
    """Measurements (row, 3) whose angles are increased by offsets (row, 2)."""
    out = value.copy()
    out[:, 1] = wrapped(out[:, 1] + offset[:, 0])
    out[:, 2] += offset[:, 1]
    return out


def draw_observer_errors(
    sigma: ObserverErrorSigma, constant: ArrayLike | None, scene: Scene, seed: int
) -> ObserverTruth | None:
    """Sample the errors of the observers of a realization; None if there are none. `constant`
    (observer, 6) is added to the random errors; m, arcsec and s. The `seed` and the index of an
    observer select its random numbers. ConfigurationError if `constant` has another shape or is not
    finite."""
    n_observers, n_times = scene.observer_position.shape[:2]
    given = np.zeros((n_observers, N_PARAMETERS))
    if constant is not None:
        given = array_of("observer_errors", constant, ("observer", N_PARAMETERS))
        if given.shape[0] != n_observers:
            raise ConfigurationError(
                f"observer_errors are those of {given.shape[0]} observers; give {n_observers} rows"
            )
    if not sigma.present and not np.any(given):
        return None
    error = np.empty((n_observers, n_times, N_PARAMETERS))
    step_s = scene.step_s
    for o in range(n_observers):
        drawn = sigma.constant() * stream(OBSERVER, seed, o).standard_normal(N_PARAMETERS)
        error[o] = given[o] * ERROR_UNITS + drawn
        steps = stream(OBSERVER, seed, o, 1).standard_normal((n_times - 1, N_PARAMETERS))
        error[o, 1:] += np.cumsum(sigma.walk(step_s) * steps, axis=0)
    return ObserverTruth(error)
