"""Derivatives of a measurement with respect to the state of a target, in closed form.

Rows are (magnitude, right ascension, declination), columns (attitude error, angular velocity,
position, velocity), in the units of the error state of the filters.
"""

import numpy as np

from cislunar.attitude.rigid_body import matrix_times
from cislunar.compiled import njit, njit_noalloc
from cislunar.observation.sightline import METERS, lit_directions
from cislunar.observation.target_surfaces import body_of
from cislunar.photometry.body_blocks import (
    body_magnitude_derivatives,
    body_magnitude_deviations,
    one_geometry,
)
from cislunar.photometry.facet_blocks import LANES
from cislunar.photometry.materials import AXIS_SCALE, FACET
from cislunar.photometry.parameter_deviations import deviation_rows, with_law


@njit_noalloc
def _across(ux, uy, uz, gx, gy, gz):
    """Component of a vector g perpendicular to the unit vector u."""
    along = ux * gx + uy * gy + uz * gz
    return gx - along * ux, gy - along * uy, gz - along * uz


@njit_noalloc
def angle_rows(dx, dy, dz, axes, rows):
    """Derivatives of right ascension and declination by position, into rows 1 and 2."""
    bx, by, bz = matrix_times(axes, dx, dy, dz)
    flat2 = bx * bx + by * by
    flat = np.sqrt(flat2)
    squared = flat2 + bz * bz
    rows[1, 3], rows[1, 4], rows[1, 5] = matrix_times(axes.T, -by / flat2, bx / flat2, 0.0)
    scale, across = -bz / (flat * squared), flat / squared
    rows[2, 3], rows[2, 4], rows[2, 5] = matrix_times(axes.T, scale * bx, scale * by, across)


@njit_noalloc
def _magnitude_row(place, observer, sun, to_inertial, quaternion, surfaces, j, rows):
    """Derivatives of the magnitude with respect to attitude and position, into row 0. The
    observer's direction V = -d/r, with d from the observer to the target, and the Sun's L = s/|s|
    change with the position by -(I - V V^T)/r and -(I - L L^T)/|s|; the range adds
    (5 / ln 10) d/r^2."""
    light, view, distance, to_sun = lit_directions(place, observer, sun, to_inertial)
    _, turn, by_sun, by_view, by_log_range = body_magnitude_derivatives(
        (quaternion[0], quaternion[1], quaternion[2], quaternion[3]),
        light,
        view,
        distance * METERS,
        body_of(surfaces, j),
        surfaces.irradiance_4pi,
        surfaces.fresnel_sqrt,
    )
    rows[0, 0], rows[0, 1], rows[0, 2] = turn
    vx, vy, vz = view
    ax, ay, az = _across(vx, vy, vz, by_view[0], by_view[1], by_view[2])
    bx, by, bz = _across(light[0], light[1], light[2], by_sun[0], by_sun[1], by_sun[2])
    inward = 1.0 / distance
    sunward = 1.0 / to_sun
    rows[0, 3], rows[0, 4], rows[0, 5] = matrix_times(
        to_inertial.T,
        -inward * (ax + by_log_range * vx) - sunward * bx,
        -inward * (ay + by_log_range * vy) - sunward * by,
        -inward * (az + by_log_range * vz) - sunward * bz,
    )


@njit_noalloc
def measurement_rows(state, quaternion, observer, k, j, scene, surfaces, rows):
    """Derivatives of (magnitude, right ascension, declination), into `rows` (3, 6), with respect to
    attitude (rad, body frame) and position (nondimensional, propagation frame), at one state (6,)
    and attitude (4,) of target j, for an observer at time k."""
    place = scene.observer_position[observer, k]
    dx, dy, dz = state[0] - place[0], state[1] - place[1], state[2] - place[2]
    rows[1:, :3] = 0.0
    angle_rows(dx, dy, dz, scene.observer_axes[k], rows)
    given = scene.sun_position[k], scene.frame_axes[k], quaternion, surfaces, j, rows
    _magnitude_row(state, place, *given)


@njit(cache=True, error_model="numpy")
def deviation_row(state, quaternion, observer, k, j, scene, surfaces, kinds, sigma, row):
    """Derivatives of the magnitude with respect to body-parameter deviations, into `row` (kind,).
    The unit of each of the `kinds` (see `cislunar.photometry.parameter_deviations`) is its `sigma`;
    see `measurement_rows` for the other arguments."""
    place, sun = scene.observer_position[observer, k], scene.sun_position[k]
    light, view, distance, _ = lit_directions(state, place, sun, scene.frame_axes[k])
    body, reading = with_law(kinds, body_of(surfaces, j)), surfaces.fresnel_sqrt
    block = one_geometry(quaternion, light, view, distance * METERS)
    shares = np.empty((body.areas.shape[0] if np.any(kinds >= FACET) else 0, LANES))
    scaled = np.any((kinds >= AXIS_SCALE) & (kinds < FACET))
    given = body, surfaces.irradiance_4pi, reading
    body_magnitude_deviations(block, shares, scaled, np.int64(1), *given)
    rows = np.empty((kinds.shape[0], LANES))
    deviation_rows(block, shares, np.int64(1), kinds, sigma, body, reading, rows)
    row[:] = rows[:, 0]
