"""The posterior Cramer-Rao bound of a run (Tichavsky, Muravchik & Nehorai 1998).

No estimator knows the state better, on average over its errors, than the inverse of the Bayesian
information matrix: that of the initial distribution plus that of the measurements. Linearised at
the truth it obeys the covariance recursion of an extended Kalman filter that is handed the true
states, and without process noise

    J(t) = Phi(t, 0)^-T (P0^-1 + sum_k Phi(t_k, 0)^T H_k^T R^-1 H_k Phi(t_k, 0)) Phi(t, 0)^-1.

States, order and units are those of `cislunar.evaluation.metrics`. A measurement at t_k is carried
back to a reference time by the transition matrix and updates the Cholesky factor there, so that
between measurements nothing is propagated but that matrix; without process noise the reference time
stays the epoch. Process noise moves it on at every step.

Assumptions and limitations
---------------------------
- The bound is that of the measurements that were used. What the absence of a measurement tells (the
  target was too faint, say) is not counted.
- It is that of an estimator that knows what the targets are and how noisy the measurements; one
  that believes otherwise may fall short of it.
- A torque is known by what it does to the true angular velocity from step to step.
- It belongs to one true trajectory; the bound proper is an average over trajectories.
- Where the light curve is far from linear over the uncertainty, as that of a faceted body is, the
  bound may lie well below what any estimator can reach.
- It ends where the true trajectory enters the Earth or the Moon.
"""

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from cislunar.attitude.inertia import is_spherical
from cislunar.attitude.rigid_body import spherical_transition
from cislunar.attitude.short_steps import rigid_transition
from cislunar.dynamics.cr3bp import EARTH_MOON
from cislunar.dynamics.runge_kutta import step_dop853
from cislunar.errors import ConfigurationError
from cislunar.estimation.triangular import cholesky
from cislunar.estimation.unscented import square_root_update
from cislunar.observation.measurement import EARTH_RADIUS, MOON_RADIUS
from cislunar.observation.measurement_derivatives import measurement_rows
from cislunar.observation.scene import Scene, TargetSurfaces

Array = NDArray[np.float64]

SIZE = 12


@njit(cache=True, error_model="numpy")
def _outside_primaries(state, mu):
    """Whether a state is finite and outside the Earth and the Moon."""
    x, y, z = state[0], state[1], state[2]
    off_axis = y * y + z * z
    return (x + mu) ** 2 + off_axis > EARTH_RADIUS * EARTH_RADIUS and (
        x - 1.0 + mu
    ) ** 2 + off_axis > MOON_RADIUS * MOON_RADIUS


@njit(cache=True, error_model="numpy")
def _use(rows, turn, motion, root, noise_variance, work):
    """Update the factor at the reference time with a measurement.

    `turn` (6, 6) and `motion` (6 x 6 in a row) lead from the reference time to the measurement.
    """
    gradient, cross, even, innovation, correction, scratch = work
    for a in range(3):
        for c in range(6):
            gradient[c, a] = 0.0
            gradient[6 + c, a] = 0.0
            for i in range(3):
                gradient[c, a] += rows[a, i] * turn[i, c]
                gradient[6 + c, a] += rows[a, 3 + i] * motion[6 * i + c]
    for a in range(3):
        for i in range(SIZE):
            cross[i, a] = 0.0
        for c in range(SIZE):
            for i in range(c + 1):
                cross[i, a] += root[c, i] * gradient[c, a]
        for b in range(3):
            even[a, b] = 0.0
        even[a, a] = noise_variance[a]
        innovation[a] = 0.0
    return square_root_update(root, cross, even, innovation, correction, scratch)


@njit(cache=True, error_model="numpy")
def _carry(turn, motion, root, carried):
    """Root of the covariance now, shape (12, 12) and not triangular, into `carried`."""
    for i in range(6):
        for c in range(6):
            total = 0.0
            for d in range(c, 6):
                total += turn[i, d] * root[d, c]
            carried[i, c] = total
            carried[i, 6 + c] = 0.0
        for c in range(SIZE):
            total = 0.0
            for d in range(max(0, c - 6), 6):
                total += motion[6 * i + d] * root[6 + d, c]
            carried[6 + i, c] = total


@njit(cache=True, error_model="numpy")
def _restart(turn, motion):
    """Identity as the transition from a new reference time."""
    turn[:, :] = 0.0
    motion[:] = 0.0
    for i in range(6):
        turn[i, i] = 1.0
        motion[7 * i] = 1.0


@njit(cache=True, error_model="numpy")
def _move_reference(turn, motion, root, carried, process_variance):
    """Move the reference time to now and add process noise; False if definiteness is lost."""
    _carry(turn, motion, root, carried)
    for a in range(SIZE):
        for b in range(a + 1):
            total = 0.0
            for c in range(SIZE):
                total += carried[a, c] * carried[b, c]
            root[a, b] = total
        root[a, a] += process_variance[a]
    _restart(turn, motion)
    return cholesky(root)


@njit(cache=True, error_model="numpy")
def _bound_of_target(
    j,
    scene,
    surfaces,
    noise_variance,
    translation,
    quaternion,
    omega,
    spherical,
    inverse_inertia,
    observer,
    root,
    process_variance,
    forces,
    out,
):
    """Bound of target j at all steps, (step, 12), into `out` (compiled)."""
    noisy = np.any(process_variance > 0.0)
    rows, carried = np.empty((3, 6)), np.empty((SIZE, SIZE))
    work = (
        np.empty((SIZE, 3)),
        np.empty((SIZE, 3)),
        np.empty((3, 3)),
        np.empty(3),
        np.empty(SIZE),
        np.empty((SIZE, SIZE)),
    )
    turn, step_turn, product = np.empty((6, 6)), np.empty((6, 6)), np.empty((6, 6))
    motion = np.empty(42)  # a state, then its transition matrix row by row
    _restart(turn, motion[6:])
    out[:, :] = np.nan
    for step in range(out.shape[0]):
        motion[:6] = translation[step]
        motion = step_dop853(forces, step * scene.step, motion, scene.step)
        if spherical:
            spherical_transition(omega[step], scene.step_s, step_turn)
        else:
            inertia = surfaces.inertia[j]
            rigid_transition(omega[step], scene.step_s, inertia, inverse_inertia, step_turn)
        for a in range(6):
            for b in range(6):
                total = 0.0
                for c in range(6):
                    total += step_turn[a, c] * turn[c, b]
                product[a, b] = total
        turn[:, :] = product
        if not _outside_primaries(translation[step + 1], forces.mu):
            return
        if noisy and not _move_reference(turn, motion[6:], root, carried, process_variance):
            return
        if observer[step] >= 0:
            measurement_rows(
                translation[step + 1],
                quaternion[step + 1],
                observer[step],
                step + 1,
                j,
                scene,
                surfaces,
                rows,
            )
            if not _use(rows, turn, motion[6:], root, noise_variance, work):
                return
        _carry(turn, motion[6:], root, carried)
        for a in range(SIZE):
            total = 0.0
            for c in range(SIZE):
                total += carried[a, c] * carried[a, c]
            out[step, a] = np.sqrt(total)


@njit(cache=True, error_model="numpy")
def _bounds(
    scene,
    surfaces,
    noise_variance,
    translation,
    quaternion,
    omega,
    spherical,
    inverse_inertia,
    observer,
    sigma,
    process_variance,
    forces,
    out,
):
    """Bounds of all targets (compiled); see `cramer_rao_bound`."""
    for j in range(out.shape[0]):
        _bound_of_target(
            j,
            scene,
            surfaces,
            noise_variance,
            translation[j],
            quaternion[j],
            omega[j],
            spherical[j],
            inverse_inertia[j],
            observer[j],
            np.diag(sigma),
            process_variance,
            forces,
            out[j],
        )


def cramer_rao_bound(
    scene: Scene,
    surfaces: TargetSurfaces,
    noise: ArrayLike,
    translation: Array,
    quaternion: Array,
    angular_velocity: Array,
    observer: ArrayLike,
    sigma: ArrayLike,
    *,
    process_variance: ArrayLike | None = None,
    forces: tuple = EARTH_MOON,
) -> Array:
    """Posterior Cramer-Rao bound of all targets at every step of a run.

    Parameters
    ----------
    scene : Scene
        Observers, Sun and frames; index 0 is the epoch.
    surfaces : TargetSurfaces
        Shapes, materials and inertia, as they truly are.
    noise : array_like, shape (3,)
        Standard deviations of magnitude (mag), right ascension and declination (rad).
    translation : ndarray, shape (target, time, 6)
        True states on the scene's times, nondimensional, rotating frame.
    quaternion : ndarray, shape (target, time, 4)
        True attitudes, inertial to body.
    angular_velocity : ndarray, shape (target, time, 3)
        True angular velocities, rad/s, body frame.
    observer : array_like of int, shape (target, time - 1)
        At each step after the epoch, the observer whose measurement was used, or -1.
    sigma : array_like, shape (12,)
        Standard deviations at the epoch, see `cislunar.estimation.estimator.InitialEstimate`.
    process_variance : array_like, shape (12,), optional
        Added to the covariance's diagonal at each step; none, if omitted.
    forces : NamedTuple
        Force model, see `cislunar.dynamics.forces`.

    Returns
    -------
    ndarray, shape (target, time - 1, 12)
        Standard deviations after the measurement of each step: small turn (rad, which a small GRP
        vector equals), angular velocity (rad/s), position and velocity (nondimensional). NaN once
        the true trajectory has entered the Earth or the Moon, and from the first measurement
        without noise on.

    Raises
    ------
    ConfigurationError
        If the shapes do not fit together, or a deviation or variance is negative or a sigma zero.
    """
    n_targets, n_times = translation.shape[:2]
    steps = (n_targets, n_times - 1)
    seen_from = np.ascontiguousarray(observer, dtype=np.int64)
    deviations, errors = np.array(sigma, dtype=float), np.array(noise, dtype=float)
    process = np.zeros(SIZE) if process_variance is None else np.array(process_variance, float)
    if n_times != scene.sun_position.shape[0] or seen_from.shape != steps:
        raise ConfigurationError(
            f"observer: shape {seen_from.shape} and {n_times} true states of {n_targets} targets "
            f"do not fit each other or a scene of {scene.sun_position.shape[0]} times"
        )
    for key, values, count, good in (
        ("noise", errors, 3, errors >= 0.0),
        ("sigma", deviations, SIZE, deviations > 0.0),
        ("process_variance", process, SIZE, process >= 0.0),
    ):
        if values.shape != (count,) or not np.all(good):
            raise ConfigurationError(
                f"{key} = {values.tolist()}: {count} numbers are needed, none negative and no "
                "sigma zero"
            )
    out = np.empty((*steps, SIZE))
    _bounds(
        scene,
        surfaces,
        errors**2,
        np.ascontiguousarray(translation, dtype=float),
        np.ascontiguousarray(quaternion, dtype=float),
        np.ascontiguousarray(angular_velocity, dtype=float),
        np.array([is_spherical(matrix) for matrix in surfaces.inertia]),
        np.linalg.inv(surfaces.inertia),
        seen_from,
        deviations,
        process,
        forces,
        out,
    )
    return out
