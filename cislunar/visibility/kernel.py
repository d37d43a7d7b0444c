"""Counts of observations of static targets, one row per satellite track (compiled).

For each (track, time, target) the kernels test whether the sphere is bright enough, and whether the
line of sight is outside of the exclusion angles of Sun, Moon and Earth. The inner loop runs over
targets in single precision, so that it vectorizes. It marks every pair within rounding of a
threshold; these pairs are decided again in double precision. The counts therefore equal those of
plain NumPy.

The brightness test is Phi(alpha) > K r^2 (`faintness_per_squared_range`). With c = cos(alpha),
Phi = pi max(c, 0) + (1 - |c|)^(3/2) k(|c|), where k is smooth: a short polynomial replaces the
inverse cosine.
"""

import numpy as np
from numba import prange
from numpy.typing import NDArray

from cislunar.compiled import njit
from cislunar.dynamics.cr3bp import primary_positions
from cislunar.observation.sightline import outside_exclusion, sphere_brighter

_BLOCK = 128
_TILE = 1024
_FIT_DEGREE = 8

# Fused multiply-adds and reciprocals in the inner loop stay within the bounds below.
# Bounds on single-precision rounding: relative, and per nondimensional length of the line of sight.
_ROUNDING = np.float32(2e-6)


def _fit_phase_remainder(degree: int) -> NDArray[np.float32]:
    """Power-series coefficients of k(x) = (sqrt(1-x^2) - x acos x) / (1-x)^(3/2) on [0, 1]."""
    node = 0.5 + 0.5 * np.cos(np.pi * (np.arange(4 * degree) + 0.5) / (4 * degree))
    value = (np.sqrt(1.0 - node**2) - node * np.arccos(node)) / (1.0 - node) ** 1.5
    series = np.polynomial.Chebyshev.fit(node, value, degree, domain=[0.0, 1.0])
    return series.convert(kind=np.polynomial.Polynomial).coef.astype(np.float32)


_K0, _K1, _K2, _K3, _K4, _K5, _K6, _K7, _K8 = _fit_phase_remainder(_FIT_DEGREE)


@njit(cache=True, inline="always")
def _unit(x, y, z):
    norm = np.sqrt(x * x + y * y + z * z)
    return x / norm, y / norm, z / norm


@njit(cache=True, error_model="numpy", fastmath={"contract", "arcp"})
def _test_block(origin, px, py, pz, ux, uy, uz, bodies, cosines, faintness, seen, undecided):
    """Single-precision test of a block of targets; marks and counts the undecided ones. The loop
    starts at zero because with a variable start the compiler provides for negative indices and does
    not vectorize."""
    zero = np.float32(0.0)
    one = np.float32(1.0)
    pi = np.float32(np.pi)
    ox, oy, oz = origin[0], origin[1], origin[2]
    sx, sy, sz = bodies[0, 0], bodies[0, 1], bodies[0, 2]
    mx, my, mz = bodies[1, 0], bodies[1, 1], bodies[1, 2]
    ex, ey, ez = bodies[2, 0], bodies[2, 1], bodies[2, 2]
    cs, cm, ce = cosines[0], cosines[1], cosines[2]
    n_undecided = np.int32(0)
    for i in range(seen.size):
        dx = px[i] - ox
        dy = py[i] - oy
        dz = pz[i] - oz
        squared = dx * dx + dy * dy + dz * dz
        inverse = one / np.sqrt(squared)
        distance = squared * inverse
        cosine = (dx * ux[i] + dy * uy[i] + dz * uz[i]) * inverse
        x = abs(cosine)
        rest = max(one - x, zero)
        k = _K5 + x * (_K6 + x * (_K7 + x * _K8))
        k = _K0 + x * (_K1 + x * (_K2 + x * (_K3 + x * (_K4 + x * k))))
        phase = pi * max(cosine, zero) + rest * np.sqrt(rest) * k
        needed = faintness * squared
        near_sun = dx * sx + dy * sy + dz * sz - distance * cs
        near_moon = dx * mx + dy * my + dz * mz - distance * cm
        near_earth = dx * ex + dy * ey + dz * ez - distance * ce
        nearest = max(near_sun, max(near_moon, near_earth))
        seen[i] = (phase > needed) & (nearest < zero)
        # The distance of a very near target rounds to zero and gives NaN, which must not decide.
        decided = (abs(phase - needed) > _ROUNDING * (one + inverse + needed)) & (
            abs(nearest) > _ROUNDING * (one + distance)
        )
        undecided[i] = not decided
        # without the conversion the sum has 64 bits, and a register half as many targets
        n_undecided = np.int32(n_undecided + np.int32(not decided))
    return n_undecided


@njit(cache=True)
def _load_tile(tile, sun, single):
    """Fill a tile in single precision: coordinates, and unit vectors from the Sun."""
    for i in range(tile.shape[0]):
        u = _unit(tile[i, 0] - sun[0], tile[i, 1] - sun[1], tile[i, 2] - sun[2])
        for axis in range(3):
            single[axis, i] = np.float32(tile[i, axis])
            single[3 + axis, i] = np.float32(u[axis])


@njit(cache=True)
def _observe_tile(origin, sun, tile, single, cosines, faintness, mu, seen):
    """Determine which targets of a tile one satellite observes at one time."""
    bodies, primaries = np.empty((3, 3)), primary_positions(mu)
    x, y, z = origin[0], origin[1], origin[2]
    bodies[0] = _unit(sun[0] - x, sun[1] - y, sun[2] - z)
    bodies[1] = _unit(1.0 - mu - x, -y, -z)
    bodies[2] = _unit(-mu - x, -y, -z)
    single_bodies = bodies.astype(np.float32)
    single_origin = origin.astype(np.float32)
    single_cosines = cosines.astype(np.float32)
    undecided = np.empty(_BLOCK, dtype=np.bool_)
    size = tile.shape[0]
    for first in range(0, size, _BLOCK):
        last = min(first + _BLOCK, size)
        block = slice(first, last)
        n_undecided = _test_block(
            single_origin,
            single[0, block], single[1, block], single[2, block],
            single[3, block], single[4, block], single[5, block],
            single_bodies, single_cosines, np.float32(faintness), seen[block], undecided,
        )  # fmt: skip
        if n_undecided > 0:
            for i in range(first, last):
                if undecided[i - first]:
                    tx, ty, tz = tile[i, 0], tile[i, 1], tile[i, 2]
                    dx, dy, dz = tx - x, ty - y, tz - z
                    fx, fy, fz = tx - sun[0], ty - sun[1], tz - sun[2]
                    clear = outside_exclusion(x, y, z, dx, dy, dz, sun, cosines, primaries)
                    seen[i] = clear and sphere_brighter(dx, dy, dz, fx, fy, fz, faintness)


@njit(parallel=True, cache=True)
def count_observations(track, target, sun, cosines, faintness, mu):
    """Number of times each track observes each target: int32 (orbit, phase, target).

    `track` (orbit, phase, time, 3), `target` (target, 3) and `sun` (time, 3) are nondimensional, in
    the rotating frame. `cosines` are those of the Sun, Moon and Earth exclusion angles. `faintness`
    (time,) is K of `faintness_per_squared_range` per squared nondimensional length."""
    n_orbits, n_phases, n_times, _ = track.shape
    n_targets = target.shape[0]
    counts = np.zeros((n_orbits, n_phases, n_targets), dtype=np.int32)
    for orbit in prange(n_orbits):
        single = np.empty((6, _TILE), dtype=np.float32)
        seen = np.empty(_TILE, dtype=np.bool_)
        for start in range(0, n_targets, _TILE):
            size = min(_TILE, n_targets - start)
            tile = target[start : start + size]
            for t in range(n_times):
                _load_tile(tile, sun[t], single)
                for phase in range(n_phases):
                    _observe_tile(
                        track[orbit, phase, t], sun[t], tile, single,
                        cosines, faintness[t], mu, seen,
                    )  # fmt: skip
                    row = counts[orbit, phase, start : start + size]
                    for i in range(size):
                        row[i] += seen[i]
    return counts


@njit(parallel=True, cache=True)
def count_observers(track, target, sun, cosines, faintness, mu):
    """Number of satellites (satellite, time, 3) that observe each target: uint16 (time, target).
    For the other arguments see `count_observations`."""
    n_satellites, n_times, _ = track.shape
    n_targets = target.shape[0]
    observers = np.zeros((n_times, n_targets), dtype=np.uint16)
    for t in prange(n_times):
        single = np.empty((6, _TILE), dtype=np.float32)
        seen = np.empty(_TILE, dtype=np.bool_)
        for start in range(0, n_targets, _TILE):
            size = min(_TILE, n_targets - start)
            tile = target[start : start + size]
            _load_tile(tile, sun[t], single)
            row = observers[t, start : start + size]
            for satellite in range(n_satellites):
                _observe_tile(
                    track[satellite, t], sun[t], tile, single,
                    cosines, faintness[t], mu, seen,
                )  # fmt: skip
                for i in range(size):
                    row[i] += seen[i]
    return observers


@njit(parallel=True, cache=True)
def mark_observations(track, target, sun, cosines, faintness, mu):
    """Which targets each track observes at each time, as bits: uint8 (orbit, phase, byte). Pair
    (time, target) is bit ``time * n_targets + target``, the lowest bit of a byte first. For the
    arguments see `count_observations`."""
    n_orbits, n_phases, n_times, _ = track.shape
    n_targets = target.shape[0]
    bits = np.zeros((n_orbits, n_phases, (n_times * n_targets + 7) // 8), dtype=np.uint8)
    for orbit in prange(n_orbits):
        single = np.empty((6, _TILE), dtype=np.float32)
        seen = np.empty(_TILE, dtype=np.bool_)
        for start in range(0, n_targets, _TILE):
            size = min(_TILE, n_targets - start)
            tile = target[start : start + size]
            for t in range(n_times):
                _load_tile(tile, sun[t], single)
                for phase in range(n_phases):
                    _observe_tile(
                        track[orbit, phase, t], sun[t], tile, single,
                        cosines, faintness[t], mu, seen,
                    )  # fmt: skip
                    row = bits[orbit, phase]
                    for i in range(size):
                        at = t * n_targets + start + i
                        row[at >> 3] |= np.uint8(seen[i]) << np.uint8(at & 7)
    return bits
