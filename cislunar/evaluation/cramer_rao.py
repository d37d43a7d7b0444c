"""The posterior Cramer-Rao bound of a run (Tichavsky, Muravchik & Nehorai 1998).

docs/bound.md derives it. States, order and units are those of `cislunar.evaluation.metrics`. A
measurement is carried back to a reference time by the transition matrix and updates the Cholesky
factor there, so that only that matrix is propagated between measurements. The reference time is the
epoch. The matrix of the translation comes from the continuous extension of long steps.

Assumptions and limitations
---------------------------
- The bound is that of the used measurements. Information from the absence of a measurement (for
  example, that the target was too faint) is not included.
- It holds for an estimator that knows the bodies and the noise, or estimates body parameters
  (`BodyParameterPrior`) from the right prior; an estimator with a wrong model may not reach it. To
  this order, estimating the noise variance as well costs nothing.
- A torque is known by its effect on the true angular velocity from step to step.
- It belongs to one true trajectory; the bound proper is an average over trajectories.
- If the light curve is far from linear over the uncertainty, as that of a faceted body is, the
  bound may be far below the error of any estimator.
- It ends where the true trajectory enters the Earth or the Moon.
"""

from copy import copy
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.attitude.inertia import rigid_bodies
from cislunar.attitude.parameter_deviations import parameter_transition
from cislunar.attitude.rigid_body import spherical_transition
from cislunar.compiled import copy_into, njit, njit_alloc, njit_noalloc
from cislunar.dynamics.adaptive.runge_kutta import DOP853, OK, integrate
from cislunar.dynamics.cr3bp import EARTH_MOON
from cislunar.dynamics.forces import of_state
from cislunar.errors import ConfigurationError
from cislunar.estimation.unscented import square_root_update
from cislunar.observation.body_parameters import BodyParameterPrior
from cislunar.observation.body_sampling import surface_table
from cislunar.observation.measurement_derivatives import deviation_row, measurement_rows
from cislunar.observation.records import Measurements
from cislunar.observation.scene import Scene, require_measurements
from cislunar.observation.sightline import inside_primary
from cislunar.observation.target_surfaces import TargetSurfaces
from cislunar.runtime import Array, array_of
from cislunar.runtime.threads import share_out

SIZE = 12

_RTOL, _ATOL = 1e-13, 1e-13
"""Tolerances of the translation's transition matrix, per step of its integration."""


class _BoundState(NamedTuple):
    """State of the recursion: covariance root (target, n, n) at the reference time, of the twelve
    states and the body parameters in prior standard deviations; transition matrices of rotation
    (target, 6, 6 + m) and translation (target, 36) to the present; whether the bound has ended."""

    root: Array
    turn: Array
    motion: Array
    ended: NDArray[np.bool_]


@njit_noalloc
def _use(rows, deviations, turn, motion, root, noise_variance, work):
    """Update the factor at the reference time with a measurement, given the transition matrices
    `turn` and `motion` to it; `deviations` are the derivatives of the magnitude by the surface
    deviations."""
    gradient, cross, even, innovation, correction, scratch = work
    for a in range(3):
        for c in range(6):
            gradient[c, a] = 0.0
            gradient[6 + c, a] = 0.0
            for i in range(3):
                gradient[c, a] += rows[a, i] * turn[i, c]
                gradient[6 + c, a] += rows[a, 3 + i] * motion[6 * i + c]
    n_rotation = turn.shape[1] - 6
    for c in range(n_rotation):
        gradient[SIZE + c] = 0.0
        for i in range(3):
            gradient[SIZE + c, 0] += rows[0, i] * turn[i, 6 + c]
    for c in range(deviations.shape[0]):
        gradient[SIZE + n_rotation + c] = 0.0
        gradient[SIZE + n_rotation + c, 0] = deviations[c]
    for a in range(3):
        for i in range(root.shape[0]):
            cross[i, a] = 0.0
        for c in range(root.shape[0]):
            for i in range(c + 1):
                cross[i, a] += root[c, i] * gradient[c, a]
        for b in range(3):
            even[a, b] = 0.0
        even[a, a] = noise_variance[a]
        innovation[a] = 0.0
    return square_root_update(root, cross, even, innovation, correction, scratch)


@njit_noalloc
def _carry(turn, motion, root, carried):
    """Root of the present covariance, shape (n, n) and not triangular, into `carried`."""
    copy_into(carried[:, SIZE:], root[:, SIZE:])
    copy_into(carried[SIZE:], root[SIZE:])
    for i in range(6):
        for c in range(6):
            total = 0.0
            for d in range(c, 6):
                total += turn[i, d] * root[d, c]
            carried[i, c] = total
            carried[i, 6 + c] = 0.0
        for d in range(turn.shape[1] - 6):
            for c in range(SIZE + d + 1):
                carried[i, c] += turn[i, 6 + d] * root[SIZE + d, c]
        for c in range(SIZE):
            total = 0.0
            for d in range(max(0, c - 6), 6):
                total += motion[6 * i + d] * root[6 + d, c]
            carried[6 + i, c] = total


@njit_noalloc
def _turn_on(omega, step_s, bodies, j, of_rotation, scratch, turn):
    """Propagate the rotation's transition matrix (6, 6 + m) over a step, in place. A rate does not
    depend on the attitude, so that the lower left blocks are zero; the last columns are by the
    rotation deviations."""
    kinds, sigma = of_rotation
    step_turn, product = scratch[0], scratch[1]
    inertia, inverse = bodies.inertia[j], bodies.inverse[j]
    if bodies.spherical[j] and kinds.shape[0] == 0:
        spherical_transition(omega, step_s, step_turn)
    else:
        parameter_transition(omega, step_s, inertia, inverse, kinds, step_turn)
    for a in range(6):
        for b in range(turn.shape[1]):
            total = 0.0
            for c in range(0 if a < 3 else 3, 3 if b < 3 else 6):
                total += step_turn[a, c] * turn[c, b]
            product[a, b] = total if b < 6 else total + sigma[b - 6] * step_turn[a, b]
    copy_into(turn, product)


@njit_noalloc
def _steps_outside(translation, primaries):
    """Number of steps until the true position is inside the Earth or the Moon."""
    for step in range(translation.shape[0] - 1):
        x, y, z = translation[step + 1, 0], translation[step + 1, 1], translation[step + 1, 2]
        if not np.isfinite(x + y + z) or inside_primary(x, y, z, primaries[step + 1]):
            return step
    return translation.shape[0] - 1


@njit_alloc
def _motions(forces, start, state, motion, step, steps, out):
    """Transition matrices after some of the steps from time `start` on; False if the integration
    fails. `state` (6,) is the true state at the start, where the matrix is `motion` (36,); `steps`,
    rising, count from 1. The matrices go into the last columns of `out` (steps, 42)."""
    known = np.empty(42)
    known[:6] = state
    known[6:] = motion
    nowhere = np.empty(0)
    given = out, nowhere, nowhere
    status, _ = integrate(DOP853, forces, start, known, step * steps, _RTOL, _ATOL, *given)
    return status == OK


@njit_alloc
def _advance_target(j, first, model, truth, records, selected, forces, state, out):
    """Bound of target j over the steps that follow time `first`, (step, 12), into `out`."""
    scene, surfaces, bodies, of_rotation, (kinds, sigma) = model
    translation, quaternion, omega = truth[0][j], truth[1][j], truth[2][j]
    size = state.root.shape[1]
    rows, deviations, carried = np.empty((3, 6)), np.empty(kinds.shape[1]), np.empty((size, size))
    tall, gain, square = (size, 3), np.empty(size), np.empty((size, size))
    work = np.empty(tall), np.empty(tall), np.empty((3, 3)), np.empty(3), gain, square
    root, turn, motion, offset = state.root[j], state.turn[j], state.motion[j], records.offset[j]
    scratch = np.empty((2, 6, turn.shape[1]))
    out[:, :] = np.nan
    if state.ended[j]:
        return
    state.ended[j] = True  # until all steps are done
    n_steps = _steps_outside(translation, scene.primaries[first:])
    # between these steps the translation's matrix is not needed
    steps = np.flatnonzero(selected[:n_steps] | (offset[1 : n_steps + 1] > offset[:n_steps])) + 1
    if n_steps == out.shape[0] and (steps.size == 0 or steps[-1] < n_steps):
        steps = np.append(steps, n_steps)
    motions = np.empty((steps.size, 42))
    own = of_state(forces, j)
    if not _motions(own, first * scene.step, translation[0], motion, scene.step, steps, motions):
        return
    done = 0
    for step in range(n_steps):
        _turn_on(omega[step], scene.step_s, bodies, j, of_rotation, scratch, turn)
        if done == steps.size or steps[done] != step + 1:
            continue
        motion[:] = motions[done, 6:]
        done += 1
        for row in range(offset[step], offset[step + 1]):
            place = translation[step + 1], quaternion[step + 1]
            observation = (*place, records.observer[row], first + step + 1, j, scene, surfaces)
            measurement_rows(*observation, rows)
            if deviations.shape[0] > 0:
                deviation_row(*observation, kinds[j], sigma[j], deviations)
            if not _use(rows, deviations, turn, motion, root, records.variance[row], work):
                return
        if not selected[step]:
            continue
        _carry(turn, motion, root, carried)
        for a in range(SIZE):
            total = 0.0
            for c in range(size):
                total += carried[a, c] * carried[a, c]
            out[step, a] = np.sqrt(total)
    state.ended[j] = n_steps < out.shape[0]


@njit(cache=True, error_model="numpy", nogil=True)
def _advance(targets, first, model, truth, records, selected, forces, state, out):
    """Bounds of a range of targets, (target, step, 12), into `out`; see
    `CramerRaoBound.advance`."""
    for j in range(targets[0], targets[1]):
        _advance_target(j, first, model, truth, records, selected, forces, state, out[j])


class CramerRaoBound:
    """Posterior Cramer-Rao bound of all targets, propagated from interval to interval.

    Parameters
    ----------
    scene : Scene
        Observers, Sun and frames; index 0 is the start of the run.
    surfaces : TargetSurfaces
        True shapes, materials and inertia.
    sigma : array_like, shape (12,)
        Initial standard deviations, see `cislunar.estimation.estimator.InitialEstimate`.
    roots : array_like, shape (target, 12, 12), optional
        Cholesky factors of initial covariances that differ from `sigma`.
    estimated_parameters : BodyParameterPrior, optional
        Body parameters that have to be estimated; none, if omitted.
    forces : NamedTuple
        True force model, see `cislunar.dynamics.forces`.

    Raises
    ------
    ConfigurationError
        If `sigma` is not of twelve positive numbers.
    """

    def __init__(
        self,
        scene: Scene,
        surfaces: TargetSurfaces,
        sigma: ArrayLike,
        *,
        roots: ArrayLike | None = None,
        estimated_parameters: BodyParameterPrior | None = None,
        forces: tuple = EARTH_MOON,
    ) -> None:
        deviations = np.array(sigma, dtype=float)
        if deviations.shape != (SIZE,) or not np.all(deviations > 0.0):
            raise ConfigurationError(
                f"sigma = {deviations.tolist()}: {SIZE} positive numbers are needed"
            )
        n_targets = surfaces.inertia.shape[0]
        prior = BodyParameterPrior() if estimated_parameters is None else estimated_parameters
        of_rotation, of_surface = prior.rotation_kinds(), surface_table(prior, surfaces)
        bodies = rigid_bodies(surfaces.inertia)
        self._model = (scene, surfaces, bodies, of_rotation, of_surface)
        n_rotation = of_rotation[0].size
        deviations = np.concatenate([deviations, np.ones(n_rotation + of_surface[0].shape[1])])
        self._forces, self._index = forces, 0
        whole = np.tile(np.diag(deviations), (n_targets, 1, 1))
        if roots is not None:
            whole[:, :SIZE, :SIZE] = array_of("roots", roots, (n_targets, SIZE, SIZE))
        self._state = _BoundState(
            whole,
            np.tile(np.eye(6, 6 + n_rotation), (n_targets, 1, 1)),
            np.tile(np.eye(6).ravel(), (n_targets, 1)),
            np.zeros(n_targets, dtype=bool),
        )

    def __deepcopy__(self, memo: dict[int, Any]) -> "CramerRaoBound":
        """A bound with a state of its own; it shares the constants."""
        new = copy(self)
        new._state = _BoundState(*(part.copy() for part in self._state))
        return new

    def advance(
        self,
        translation: Array,
        quaternion: Array,
        angular_velocity: Array,
        measurements: Measurements,
        selected: ArrayLike | None = None,
    ) -> Array:
        """Process the next steps, which are those of the measurements' offsets.

        Parameters
        ----------
        translation : ndarray, shape (target, step + 1, 6)
            True states, nondimensional, propagation frame, from the end of the last interval on.
        quaternion : ndarray, shape (target, step + 1, 4)
            True attitudes, inertial frame to body frame.
        angular_velocity : ndarray, shape (target, step + 1, 3)
            True angular velocities, rad/s, body frame.
        measurements : Measurements
            Used measurements, with the variances of their errors. Their values do not matter.
        selected : array_like of bool, shape (step,), optional
            Steps at which the bound is computed; all, if omitted.

        Returns
        -------
        ndarray, shape (target, step, 12)
            Standard deviations after the measurements of each step: attitude error (rad, which a
            small GRP vector equals), angular velocity (rad/s), position and velocity
            (nondimensional). NaN at other steps, after the true trajectory has entered the Earth or
            the Moon, and from the first measurement without noise on.

        Raises
        ------
        ConfigurationError
            If measurements, true states and scene do not fit each other, or a variance is negative.
        """
        n_targets, n_offsets = measurements.offset.shape
        require_measurements(measurements, len(self._state.root), self._index, self._model[0])
        if np.any(measurements.variance < 0.0):
            raise ConfigurationError(
                "measurements.variance: a value is negative; give mag^2 and rad^2"
            )
        out = np.empty((n_targets, n_offsets - 1, SIZE))
        given = {"translation": translation, "quaternion": quaternion,
                 "angular_velocity": angular_velocity}  # fmt: skip
        truth = tuple(
            np.ascontiguousarray(array_of(name, each, (n_targets, n_offsets, size), finite=False))
            for (name, each), size in zip(given.items(), (6, 4, 3), strict=True)
        )
        chosen = (
            np.ones(n_offsets - 1, dtype=bool) if selected is None else np.array(selected, bool)
        )
        every = self._index, self._model, truth, measurements, chosen, self._forces
        share_out(lambda start, stop: _advance((start, stop), *every, self._state, out), n_targets)
        self._index += n_offsets - 1
        return out
