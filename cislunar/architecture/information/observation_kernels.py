"""Information of observations of moving targets, for one orbit slot at a time (compiled).

Symmetric 6 x 6 matrices are stored as the 21 entries of the lower triangle, row by row.
"""

import numpy as np

from cislunar.architecture.information.brightness import bright_share
from cislunar.compiled import njit, njit_inline
from cislunar.observation.sightline import METERS, in_clear_view, lit_directions, sphere_brighter
from cislunar.observation.target_surfaces import body_of
from cislunar.photometry.body_blocks import body_magnitude_derivatives

PACKED = 21


@njit_inline
def _difference(start, end):
    """Vector from one position to another."""
    return end[0] - start[0], end[1] - start[1], end[2] - start[2]


@njit(cache=True, error_model="numpy")
def _mark_seen(observer, target, sun, view, seen):
    """Mark the targets (target, 3) that an observer sees at one time; returns their number."""
    limits, faintness, primaries = view
    x, y, z = observer[0], observer[1], observer[2]
    count = 0
    for j in range(seen.size):
        dx, dy, dz = _difference(observer, target[j])
        fx, fy, fz = _difference(sun, target[j])
        seen[j] = sphere_brighter(dx, dy, dz, fx, fy, fz, faintness) and in_clear_view(
            x, y, z, dx, dy, dz, sun, limits, primaries
        )
        count += seen[j]
    return count


@njit(cache=True, error_model="numpy")
def add_directions(track, target, motion, sun, view, squared_ranges, observations, out):
    """Add the information of directions about position and velocity; see `orbit_information`.
    `track` (time, 3), `target` (time, target, 3), `motion` (time, target, 3, 6) the derivative of
    the position by the whitened state at the start, `sun` (time, 3), `view` limits, faintness and
    primaries, `squared_ranges` from `brightness.squared_detection_ranges` or of no target,
    `observations` the number of observations per step over the variance of an angle (rad^2); `out`
    (target, 21). An observation along the unit vector u at the distance r has the information
    (I - u u^T) / (sigma r)^2 about the position, times the share of attitudes in which the target
    is bright enough."""
    n_targets = target.shape[1]
    seen, along = np.empty(n_targets, np.bool_), np.empty(6)
    for k in range(track.shape[0]):
        count = _mark_seen(track[k], target[k], sun[k], view, seen)
        for j in range(n_targets):
            if not seen[j]:
                continue
            dx, dy, dz = _difference(track[k], target[k, j])
            squared = dx * dx + dy * dy + dz * dz
            share = 1.0
            if squared_ranges.shape[0] > 0:
                fx, fy, fz = _difference(sun[k], target[k, j])
                share = bright_share(dx, dy, dz, fx, fy, fz, squared_ranges[j])
                if share == 0.0:
                    continue
            weight, per_square = share * observations / (count * squared), 1.0 / squared
            rows = motion[k, j]
            for a in range(6):
                along[a] = dx * rows[0, a] + dy * rows[1, a] + dz * rows[2, a]
            at = 0
            for a in range(6):
                for b in range(a + 1):
                    both = rows[0, a] * rows[0, b] + rows[1, a] * rows[1, b]
                    both += rows[2, a] * rows[2, b] - along[a] * along[b] * per_square
                    out[j, at] += weight * both
                    at += 1


@njit(cache=True, error_model="numpy")
def add_magnitudes(track, target, sun, view, turning, surfaces, limit, observations, out):
    """Add the information of magnitudes about angular velocity and attitude; see
    `attitude_information`. For most arguments see `add_directions`. `turning` holds the rotation to
    the inertial frame (time, 3, 3), the attitudes (time, target, attitude, 4) and the derivative
    (time, 6, 6) of the current small rotation by whitened angular velocity and small rotation at
    the start, whose last three rows are not used. `limit` is the limiting magnitude, `out` (target,
    attitude, 21)."""
    to_inertial, attitude, growth = turning
    n_targets, n_attitudes = target.shape[1], attitude.shape[2]
    seen, slope = np.empty(n_targets, np.bool_), np.empty(6)
    for k in range(track.shape[0]):
        count = _mark_seen(track[k], target[k], sun[k], view, seen)
        for j in range(n_targets):
            if not seen[j]:
                continue
            light, toward, distance, _ = lit_directions(
                target[k, j], track[k], sun[k], to_inertial[k]
            )
            body = body_of(surfaces, j)
            for s in range(n_attitudes):
                q = attitude[k, j, s]
                magnitude, turn, _, _, _ = body_magnitude_derivatives(
                    (q[0], q[1], q[2], q[3]), light, toward, distance * METERS,
                    body, surfaces.irradiance_4pi, surfaces.fresnel_sqrt,
                )  # fmt: skip
                if not magnitude < limit:
                    continue
                for a in range(6):
                    slope[a] = turn[0] * growth[k, 0, a] + turn[1] * growth[k, 1, a]
                    slope[a] += turn[2] * growth[k, 2, a]
                at = 0
                for a in range(6):
                    for b in range(a + 1):
                        out[j, s, at] += observations / count * slope[a] * slope[b]
                        at += 1
