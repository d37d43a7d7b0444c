"""Contacts of observers with the Earth, and the arrival of their measurements.

Assumptions and limitations
---------------------------
- Ground stations surround the Earth: its center in view is contact.
- An observer sends all stored measurements at the first step of a contact.
- A station on the ground is always in contact.
"""

import numpy as np
from numpy.typing import NDArray

from cislunar.observation import EARTH_RADIUS, MOON_RADIUS, Scene
from cislunar.tasking.communication.model import CommunicationModel

_GRAZING = 1e-9
"""Tolerance of a grazing line of sight, so that it counts as clear on every platform."""


def contacts(model: CommunicationModel, scene: Scene) -> NDArray[np.bool_]:
    """Whether each observer is in contact with the Earth, shape (observer, time)."""
    place, earth, moon = scene.observer_position, scene.primaries[:, 0], scene.primaries[:, 1]
    found = np.ones(place.shape[:2], dtype=bool)
    if model.contact.moon:
        down, aside = earth - place, moon - place
        nearest = np.sum(down * aside, axis=-1) / np.sum(down**2, axis=-1)
        miss = aside - np.clip(nearest, 0.0, 1.0)[..., None] * down
        found &= np.sum(miss**2, axis=-1) >= (1.0 - _GRAZING) * MOON_RADIUS**2
    if model.contact.sun_deg > 0.0:
        way, light = place - earth, scene.sun_position - earth
        lengths = np.linalg.norm(way, axis=-1) * np.linalg.norm(light, axis=-1)
        limit = np.cos(np.deg2rad(model.contact.sun_deg)) + _GRAZING
        found &= np.sum(way * light, axis=-1) <= limit * lengths
    on_ground = np.linalg.norm(place - earth, axis=-1) < 1.01 * EARTH_RADIUS
    return found | on_ground


def arrivals(model: CommunicationModel, scene: Scene) -> NDArray[np.int64]:
    """Step from which on measurements can be used in the common estimate.

    Parameters
    ----------
    model : CommunicationModel
        Contact with the Earth, and delay.
    scene : Scene
        Positions of the observers, of Earth, Moon and Sun.

    Returns
    -------
    ndarray of int, shape (observer, step)
        For a measurement of each step, both counted from 0 at the first measurement; the number of
        steps or more for a measurement that arrives after the end.
    """
    in_contact = contacts(model, scene)[:, 1:]
    n_steps = in_contact.shape[1]
    steps = np.where(in_contact, np.arange(n_steps), n_steps)
    sent = np.minimum.accumulate(steps[:, ::-1], axis=1)[:, ::-1]
    return sent + int(np.ceil(60.0 * model.delay_minutes / scene.step_s - 1e-9))
