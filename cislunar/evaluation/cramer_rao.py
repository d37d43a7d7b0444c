"""The posterior Cramer-Rao bound of a run (Tichavsky, Muravchik & Nehorai 1998).

No estimator knows the state better, on average over its errors, than the inverse of the Bayesian
information matrix: that of the initial distribution plus that of the measurements. Linearised at
the truth it obeys the covariance recursion of an extended Kalman filter that is handed the true
states, and without process noise

    J(t) = Phi(t, 0)^-T (P0^-1 + sum_k Phi(t_k, 0)^T H_k^T R^-1 H_k Phi(t_k, 0)) Phi(t, 0)^-1.

States, order and units are those of `cislunar.evaluation.metrics`. A measurement at t_k is carried
back to a reference time by the transition matrix and updates the Cholesky factor there, so that
between measurements nothing is propagated but that matrix; without process noise the reference
time stays the epoch. Process noise moves it on at every step. The matrix of the translation is
taken from the continuous extension of long steps where it is needed (docs/bound.md).

Assumptions and limitations
---------------------------
- The bound is that of the measurements that were used. What the absence of a measurement tells (the
  target was too faint, say) is not counted.
- It is that of an estimator that knows what the targets are and how noisy the measurements, or has
  to estimate some of it (`BodySpread`) from the right prior; one that believes otherwise may fall
  short of it. That the noise's variance has to be estimated as well costs nothing to this order.
- A torque is known by what it does to the true angular velocity from step to step.
- It belongs to one true trajectory; the bound proper is an average over trajectories.
- Where the light curve is far from linear over the uncertainty, as that of a faceted body is, the
  bound may lie well below what any estimator can reach.
- It ends where the true trajectory enters the Earth or the Moon.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from cislunar.attitude.departures import departing_transition
from cislunar.attitude.inertia import rigid_bodies
from cislunar.attitude.rigid_body import spherical_transition
from cislunar.compiled import allocating, borrowing, put
from cislunar.dynamics.adaptive.runge_kutta import DOP853, OK, integrate
from cislunar.dynamics.cr3bp import EARTH_MOON
from cislunar.dynamics.forces import of_state
from cislunar.errors import ConfigurationError
from cislunar.estimation.triangular import cholesky
from cislunar.estimation.unscented import square_root_update
from cislunar.observation.body_spread import BodySpread
from cislunar.observation.drawn_bodies import surface_table
from cislunar.observation.measurement_derivatives import departure_row, measurement_rows
from cislunar.observation.records import Measurements
from cislunar.observation.scene import Scene, TargetSurfaces
from cislunar.observation.sightline import inside_primary
from cislunar.threads import share_out

Array = NDArray[np.float64]

SIZE = 12

RTOL, ATOL = 1e-13, 1e-13
"""Tolerances of the translation's transition matrix, per step of its integration."""


class _BoundState(NamedTuple):
    """What is carried on of each target.

    `root` (target, n, n) is the Cholesky factor of the covariance at the reference time, of the
    twelve states and of what is not known of the body, in its standard deviations. From there
    `turn` (target, 6, 6 + m) and `motion` (target, 36), row by row, lead to now.
    """

    root: Array
    turn: Array
    motion: Array
    ended: NDArray[np.bool_]


@borrowing
def _use(rows, departures, turn, motion, root, noise_variance, work):
    """Update the factor at the reference time with a measurement.

    `turn` (6, 6 + m) and `motion` (6 x 6 in a row) lead from the reference time to the measurement;
    `departures` are the derivatives of the magnitude by what is not known of the surface.
    """
    gradient, cross, even, innovation, correction, scratch = work
    for a in range(3):
        for c in range(6):
            gradient[c, a] = 0.0
            gradient[6 + c, a] = 0.0
            for i in range(3):
                gradient[c, a] += rows[a, i] * turn[i, c]
                gradient[6 + c, a] += rows[a, 3 + i] * motion[6 * i + c]
    turning = turn.shape[1] - 6
    for c in range(turning):
        gradient[SIZE + c] = 0.0
        for i in range(3):
            gradient[SIZE + c, 0] += rows[0, i] * turn[i, 6 + c]
    for c in range(departures.shape[0]):
        gradient[SIZE + turning + c] = 0.0
        gradient[SIZE + turning + c, 0] = departures[c]
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


@borrowing
def _carry(turn, motion, root, carried):
    """Root of the covariance now, shape (n, n) and not triangular, into `carried`."""
    put(carried[:, SIZE:], root[:, SIZE:])
    put(carried[SIZE:], root[SIZE:])
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


@borrowing
def _restart(turn, motion):
    """Identity as the transition from a new reference time."""
    turn[:, :] = 0.0
    motion[:] = 0.0
    for i in range(6):
        turn[i, i] = 1.0
        motion[7 * i] = 1.0


@borrowing
def _move_reference(turn, motion, root, carried, process_variance):
    """Move the reference time to now and add process noise; False if definiteness is lost."""
    _carry(turn, motion, root, carried)
    size = root.shape[0]
    for a in range(size):
        for b in range(a + 1):
            total = 0.0
            for c in range(size):
                total += carried[a, c] * carried[b, c]
            root[a, b] = total
        if a < SIZE:
            root[a, a] += process_variance[a]
    _restart(turn, motion)
    return cholesky(root)


@borrowing
def _turn_on(omega, step_s, bodies, j, of_rotation, scratch, turn):
    """Carry the rotation's transition matrix (6, 6 + m) over a step, in place.

    A rate does not depend on the attitude, so that the lower left blocks are zero; the last columns
    are by the departures of the rotation that are not known.
    """
    kinds, sigma = of_rotation
    step_turn, product = scratch[0], scratch[1]
    inertia, inverse = bodies.inertia[j], bodies.inverse[j]
    if bodies.spherical[j] and kinds.shape[0] == 0:
        spherical_transition(omega, step_s, step_turn)
    else:
        departing_transition(omega, step_s, inertia, inverse, kinds, step_turn)
    for a in range(6):
        for b in range(turn.shape[1]):
            total = 0.0
            for c in range(0 if a < 3 else 3, 3 if b < 3 else 6):
                total += step_turn[a, c] * turn[c, b]
            product[a, b] = total if b < 6 else total + sigma[b - 6] * step_turn[a, b]
    put(turn, product)


@borrowing
def _steps_outside(translation, primaries):
    """How many of the steps after the first time the truth takes outside Earth and Moon."""
    for step in range(translation.shape[0] - 1):
        x, y, z = translation[step + 1, 0], translation[step + 1, 1], translation[step + 1, 2]
        if not np.isfinite(x + y + z) or inside_primary(x, y, z, primaries[step + 1]):
            return step
    return translation.shape[0] - 1


@allocating
def _motions(forces, start, state, motion, step, steps, out):
    """Transition matrices after some of the steps from time `start` on; False if that fails.

    `state` (6,) is the true one at the start, where the matrix is `motion` (36,); `steps`, rising,
    count from 1. The matrices go into the last columns of `out` (steps, 42).
    """
    known = np.empty(42)
    known[:6] = state
    known[6:] = motion
    nowhere = np.empty(0)
    given = out, nowhere, nowhere
    status, _ = integrate(DOP853, forces, start, known, step * steps, RTOL, ATOL, *given)
    return status == OK


@allocating
def _advance_target(j, first, world, truth, records, wanted, process_variance, forces, state, out):
    """Bound of target j over the steps that follow time `first`, (step, 12), into `out`."""
    scene, surfaces, bodies, of_rotation, (kinds, sigma) = world
    translation, quaternion, omega = truth[0][j], truth[1][j], truth[2][j]
    noisy = np.any(process_variance > 0.0)
    size = state.root.shape[1]
    rows, departures, carried = np.empty((3, 6)), np.empty(kinds.shape[1]), np.empty((size, size))
    tall, gain, square = (size, 3), np.empty(size), np.empty((size, size))
    work = np.empty(tall), np.empty(tall), np.empty((3, 3)), np.empty(3), gain, square
    root, turn, motion, offset = state.root[j], state.turn[j], state.motion[j], records.offset[j]
    scratch = np.empty((2, 6, turn.shape[1]))
    out[:, :] = np.nan
    if state.ended[j]:
        return
    state.ended[j] = True  # until all steps are done
    n_steps = _steps_outside(translation, scene.primaries[first:])
    # between these the translation's matrix is not wanted
    steps = np.flatnonzero(wanted[:n_steps] | (offset[1 : n_steps + 1] > offset[:n_steps])) + 1
    if n_steps == out.shape[0] and (steps.size == 0 or steps[-1] < n_steps):
        steps = np.append(steps, n_steps)
    motions, one = np.empty((steps.size, 42)), np.ones(1)
    own = of_state(forces, j)
    if not noisy and not _motions(
        own, first * scene.step, translation[0], motion, scene.step, steps, motions
    ):
        return
    done = 0
    for step in range(n_steps):
        _turn_on(omega[step], scene.step_s, bodies, j, of_rotation, scratch, turn)
        at_hand = done < steps.size and steps[done] == step + 1
        if noisy:
            start = (first + step) * scene.step
            if not _motions(own, start, translation[step], motion, scene.step, one, motions[:1]):
                return
            motion[:] = motions[0, 6:]
            if not _move_reference(turn, motion, root, carried, process_variance):
                return
        elif at_hand:
            motion[:] = motions[done, 6:]
        if not at_hand:
            continue
        done += 1
        for row in range(offset[step], offset[step + 1]):
            place = translation[step + 1], quaternion[step + 1]
            look = (*place, records.observer[row], first + step + 1, j, scene, surfaces)
            measurement_rows(*look, rows)
            if departures.shape[0] > 0:
                departure_row(*look, kinds[j], sigma[j], departures)
            if not _use(rows, departures, turn, motion, root, records.variance[row], work):
                return
        if not wanted[step]:
            continue
        _carry(turn, motion, root, carried)
        for a in range(SIZE):
            total = 0.0
            for c in range(size):
                total += carried[a, c] * carried[a, c]
            out[step, a] = np.sqrt(total)
    state.ended[j] = n_steps < out.shape[0]


@njit(cache=True, error_model="numpy", nogil=True)
def _advance(targets, first, world, truth, records, wanted, process_variance, forces, state, out):
    """Bounds of targets, from one to before another, (target, step, 12), into `out`.

    See `CramerRaoBound.advance`.
    """
    given = process_variance, forces, state
    for j in range(targets[0], targets[1]):
        _advance_target(j, first, world, truth, records, wanted, *given, out[j])


class CramerRaoBound:
    """Posterior Cramer-Rao bound of all targets, carried on from interval to interval.

    Parameters
    ----------
    scene : Scene
        Observers, Sun and frames; index 0 is the epoch.
    surfaces : TargetSurfaces
        Shapes, materials and inertia, as they truly are.
    sigma : array_like, shape (12,)
        Standard deviations at the epoch, see `cislunar.estimation.estimator.InitialEstimate`.
    process_variance : array_like, shape (12,), optional
        Added to the covariance's diagonal at each step; none, if omitted.
    unknowns : BodySpread, optional
        What has to be estimated of the targets besides their motion; nothing, if omitted.
    forces : NamedTuple
        Force model, see `cislunar.dynamics.forces`.

    Raises
    ------
    ConfigurationError
        If a variance is negative or a sigma not positive.
    """

    def __init__(
        self,
        scene: Scene,
        surfaces: TargetSurfaces,
        sigma: ArrayLike,
        *,
        process_variance: ArrayLike | None = None,
        unknowns: BodySpread | None = None,
        forces: tuple = EARTH_MOON,
    ) -> None:
        deviations = np.array(sigma, dtype=float)
        process = np.zeros(SIZE) if process_variance is None else np.array(process_variance, float)
        for key, values, good in (
            ("sigma", deviations, deviations > 0.0),
            ("process_variance", process, process >= 0.0),
        ):
            if values.shape != (SIZE,) or not np.all(good):
                raise ConfigurationError(
                    f"{key} = {values.tolist()}: {SIZE} numbers are needed, none negative and no "
                    "sigma zero"
                )
        n_targets = surfaces.inertia.shape[0]
        unknowns = BodySpread() if unknowns is None else unknowns
        of_rotation, of_surface = unknowns.rotation_kinds(), surface_table(unknowns, surfaces)
        bodies = rigid_bodies(surfaces.inertia)
        self._world = (scene, surfaces, bodies, of_rotation, of_surface)
        turning = of_rotation[0].size
        deviations = np.concatenate([deviations, np.ones(turning + of_surface[0].shape[1])])
        self._process_variance, self._forces, self._index = process, forces, 0
        self._state = _BoundState(
            np.tile(np.diag(deviations), (n_targets, 1, 1)),
            np.tile(np.eye(6, 6 + turning), (n_targets, 1, 1)),
            np.tile(np.eye(6).ravel(), (n_targets, 1)),
            np.zeros(n_targets, dtype=bool),
        )

    def advance(
        self,
        translation: Array,
        quaternion: Array,
        angular_velocity: Array,
        measurements: Measurements,
        wanted: ArrayLike | None = None,
    ) -> Array:
        """Work through the next steps, those of the measurements' offsets.

        Parameters
        ----------
        translation : ndarray, shape (target, step + 1, 6)
            True states, nondimensional, rotating frame, from the end of the last interval on.
        quaternion : ndarray, shape (target, step + 1, 4)
            True attitudes, inertial to body.
        angular_velocity : ndarray, shape (target, step + 1, 3)
            True angular velocities, rad/s, body frame.
        measurements : Measurements
            Those that were used, with the variances of their errors. Their values do not matter.
        wanted : array_like of bool, shape (step,), optional
            Steps at which the bound is wanted; all, if omitted.

        Returns
        -------
        ndarray, shape (target, step, 12)
            Standard deviations after the measurements of each step: small turn (rad, which a small
            GRP vector equals), angular velocity (rad/s), position and velocity (nondimensional).
            NaN where they are not wanted, once the true trajectory has entered the Earth or the
            Moon, and from the first measurement without noise on.

        Raises
        ------
        ConfigurationError
            If the shapes do not fit together, or a variance is negative.
        """
        n_targets, n_offsets = measurements.offset.shape
        n_times = self._world[0].sun_position.shape[0] - self._index
        if translation.shape[:2] != (n_targets, n_offsets) or n_offsets > n_times:
            raise ConfigurationError(
                f"measurements at {n_offsets - 1} steps of {n_targets} targets do not fit true "
                f"states of shape {translation.shape} or a scene with {n_times} times to come"
            )
        if np.any(measurements.variance < 0.0):
            raise ConfigurationError("measurements: a variance is negative")
        out = np.empty((n_targets, n_offsets - 1, SIZE))
        truth = tuple(
            np.ascontiguousarray(each, dtype=float)
            for each in (translation, quaternion, angular_velocity)
        )
        asked = np.ones(n_offsets - 1, dtype=bool) if wanted is None else np.array(wanted, bool)
        given = self._world, truth, measurements, asked, self._process_variance, self._forces
        given = (self._index, *given, self._state, out)
        share_out(lambda start, stop: _advance((start, stop), *given), n_targets)
        self._index += n_offsets - 1
        return out
