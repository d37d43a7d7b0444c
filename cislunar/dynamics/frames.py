"""Transformations between the rotating frame of the CR3BP and J2000 axes at given times.

Both transformations are linear in the state at a given time. With the axes C (rows,
`rotating_frame`), a length L and its rate, an angular velocity w in those axes and a unit of time
T,

    r = o + L C' p,    v = o' + C' (L' p + L w x p + L / T p')

for a nondimensional state (p, p').

- `pulsating_frame` takes the axes, distance and rates of Earth and Moon at that time, and
  ``T = t* (L / l*)^1.5``. Both primaries of the CR3BP then coincide with the bodies in position and
  velocity (Gomez, Masdemont & Mondelo 2002, Astron. Astrophys. 390, 733; Dei Tos & Topputo 2017,
  Adv. Space Res. 59, 2117).
- `lunar_frame` keeps l* and t* and coincides with the Moon's center. It suits low lunar orbits,
  whose altitude and inertial velocity relative to the Moon it preserves.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cislunar.constants import LENGTH_UNIT_KM, MU, TIME_UNIT_S
from cislunar.ephemeris.bodies import BODY_COLUMNS, BodyTable, read_table
from cislunar.ephemeris.sampling import rotating_frame
from cislunar.runtime.arguments import Array, require_choice

BARYCENTER = "barycenter"
CENTERS = (BARYCENTER, *BODY_COLUMNS)


class Frame(NamedTuple):
    """A rotating frame at one or several times.

    `origin` (..., 6): its barycenter, barycentric frame, J2000 axes, km and km/s. `axes` (..., 3,
    3): rotation from J2000 to the frame. `rotation` (..., 3): angular velocity in its axes, rad/s.
    `length`, `length_rate`, `time` (...): unit of length, km, its rate, km/s, and unit of time, s.
    """

    origin: Array
    axes: Array
    rotation: Array
    length: Array
    length_rate: Array
    time: Array

    def matrix(self) -> Array:
        """Derivative of the inertial state by the nondimensional one, shape (..., 6, 6)."""
        back = np.swapaxes(self.axes, -1, -2)
        length = self.length[..., None, None]
        out = np.zeros((*self.length.shape, 6, 6))
        out[..., :3, :3] = length * back
        # Row k of cross(w, identity) is w x e_k, so its transpose is the matrix of w x.
        cross = np.swapaxes(np.cross(self.rotation[..., None, :], np.eye(3)), -1, -2)
        length_rate = self.length_rate[..., None, None] * np.eye(3)
        out[..., 3:, :3] = back @ (length_rate + length * cross)
        out[..., 3:, 3:] = length / self.time[..., None, None] * back
        return out


def pulsating_frame(table: BodyTable, time: ArrayLike) -> Frame:
    """Frame in which Earth and Moon are at rest, with instantaneous units.

    Parameters
    ----------
    table : BodyTable
        Positions of the bodies.
    time : array_like, shape (...)
        TDB seconds past J2000.

    Returns
    -------
    Frame

    Raises
    ------
    ConfigurationError
        If a time lies outside of the table.
    """
    position, velocity, acceleration = read_table(table, time)
    earth, moon = BODY_COLUMNS["earth"], BODY_COLUMNS["moon"]
    r, v, a = (each[..., moon] - each[..., earth] for each in (position, velocity, acceleration))
    axes = rotating_frame(r, v)
    distance = np.linalg.norm(r, axis=-1)
    momentum = np.linalg.norm(np.cross(r, v), axis=-1)
    # The acceleration normal to the plane of r and v rotates that plane about r.
    across = np.sum(axes[..., 2, :] * a, axis=-1)
    rotation = np.stack(
        [distance * across / momentum, np.zeros_like(distance), momentum / distance**2], axis=-1
    )
    origin = [(1.0 - MU) * each[..., earth] + MU * each[..., moon] for each in (position, velocity)]
    return Frame(
        origin=np.concatenate(origin, axis=-1),
        axes=axes,
        rotation=rotation,
        length=distance,
        length_rate=np.sum(axes[..., 0, :] * v, axis=-1),
        time=TIME_UNIT_S * (distance / LENGTH_UNIT_KM) ** 1.5,
    )


def earth_moon_axes(position: Array, velocity: Array) -> Array:
    """Axes of the rotating frame of Earth and Moon.

    Parameters
    ----------
    position, velocity : ndarray, shape (..., 9)
        Of the bodies, see `cislunar.ephemeris.read_table`.

    Returns
    -------
    ndarray, shape (..., 3, 3)
        Rotations from the frame of the positions; the rows are the axes.
    """
    earth, moon = BODY_COLUMNS["earth"], BODY_COLUMNS["moon"]
    return rotating_frame(*(each[..., moon] - each[..., earth] for each in (position, velocity)))


def lunar_frame(table: BodyTable, time: ArrayLike) -> Frame:
    """Frame with constant units that coincides with the Moon's center; for arguments and errors
    see `pulsating_frame`."""
    position, velocity, _ = read_table(table, time)
    axes, moon = earth_moon_axes(position, velocity), BODY_COLUMNS["moon"]
    distance = (1.0 - MU) * LENGTH_UNIT_KM
    origin = [
        position[..., moon] - distance * axes[..., 0, :],
        velocity[..., moon] - distance / TIME_UNIT_S * axes[..., 1, :],
    ]
    one = np.ones(axes.shape[:-2])
    return Frame(
        origin=np.concatenate(origin, axis=-1),
        axes=axes,
        rotation=one[..., None] * np.array([0.0, 0.0, 1.0 / TIME_UNIT_S]),
        length=LENGTH_UNIT_KM * one,
        length_rate=0.0 * one,
        time=TIME_UNIT_S * one,
    )


def to_inertial(state: ArrayLike, frame: Frame) -> Array:
    """Transform states from a rotating frame to the barycentric frame, J2000 axes.

    Parameters
    ----------
    state : array_like, shape (..., 6)
        Nondimensional, rotating frame.
    frame : Frame
        At the times of the states, or at one common time.

    Returns
    -------
    ndarray, shape (..., 6)
        Barycentric frame, J2000 axes, km and km/s; `recenter` changes the origin.
    """
    s = np.asarray(state, dtype=float)
    p = s[..., :3]
    length = frame.length[..., None]
    velocity = frame.length_rate[..., None] * p + length * (
        np.cross(frame.rotation, p) + s[..., 3:] / frame.time[..., None]
    )
    parts = [np.einsum("...ji,...j->...i", frame.axes, each) for each in (length * p, velocity)]
    return frame.origin + np.concatenate(parts, axis=-1)


def from_inertial(state: ArrayLike, frame: Frame) -> Array:
    """Transform states from the barycentric frame, J2000 axes, to a rotating frame.

    Parameters
    ----------
    state : array_like, shape (..., 6)
        Barycentric frame, J2000 axes, km and km/s.
    frame : Frame
        At the times of the states, or at one common time.

    Returns
    -------
    ndarray, shape (..., 6)
        Nondimensional, rotating frame.
    """
    s = np.asarray(state, dtype=float) - frame.origin
    r, v = (np.einsum("...ij,...j->...i", frame.axes, each) for each in (s[..., :3], s[..., 3:]))
    length = frame.length[..., None]
    p = r / length
    v = (v - frame.length_rate[..., None] * p) / length - np.cross(frame.rotation, p)
    return np.concatenate([p, v * frame.time[..., None]], axis=-1)


def recenter(state: ArrayLike, table: BodyTable, time: ArrayLike, *, old: str, new: str) -> Array:
    """States relative to another origin.

    Parameters
    ----------
    state : array_like, shape (..., 6)
        J2000 axes, relative to `old`, km and km/s.
    table : BodyTable
        Positions of the bodies.
    time : array_like, shape (...)
        TDB seconds past J2000.
    old, new : {"barycenter", "earth", "moon", "sun"}
        Origins; the barycenter is that of Earth and Moon.

    Returns
    -------
    ndarray, shape (..., 6)
        J2000 axes, relative to `new`, km and km/s.

    Raises
    ------
    ConfigurationError
        If an origin is unknown, or a time lies outside of the table.
    """
    moved = np.array(state, dtype=float)
    position, velocity, _ = read_table(table, time)
    for name, sign in ((old, 1.0), (new, -1.0)):
        require_choice("center", name, CENTERS)
        if name != BARYCENTER:
            at = BODY_COLUMNS[name]
            moved = moved + sign * np.concatenate([position[..., at], velocity[..., at]], axis=-1)
    return moved
