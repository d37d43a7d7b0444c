"""Orbits and attitudes from a user's observations, without a simulated truth.

A table of observations has the columns of `cislunar.exchange.observations`: ``obsTime`` (UTC),
``stn`` (name of the observer), ``ra`` and ``dec`` (ICRF, deg) and ``mag``, and the name of the
object in one of `OBJECT_NAMES`. Standard deviations are ``rmsRA`` (of right ascension times
cos(declination)) and ``rmsDec`` in arcsec and ``rmsMag``; where they are missing, those of the
observer's sensor are used. Errors of right ascension and declination are assumed independent.

An estimator works on a grid of times. Each observation is reduced to the nearest of them by the
predicted motion of target and observer, which neglects the error of the predicted rate over at
most half a step. Directions are astrometric: stellar aberration has been removed, and the light
left the target earlier by the light time, for which this module corrects.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from cislunar.constants import LENGTH_UNIT_KM, TIME_UNIT_S
from cislunar.dynamics.bundle import propagate_bundle
from cislunar.ephemeris.time_scales import tdb_since
from cislunar.errors import CislunarError
from cislunar.estimation.estimator import Estimator
from cislunar.exchange.observations import OBJECT_NAMES, REQUIRED, checked, object_of, require
from cislunar.observation.records import Measurements, arranged
from cislunar.observation.scene import Scene
from cislunar.observation.sensor import ARCSECOND, Sensor, noise_at
from cislunar.observation.sightline import angles_of_vectors, wrapped
from cislunar.runtime import Indices
from cislunar.runtime.arguments import Array

_RMS = ("rmsMag", "rmsRA", "rmsDec")
_RMS_UNIT = np.array([1.0, ARCSECOND, ARCSECOND])
_LIGHT_SPEED = 299_792.458 / LENGTH_UNIT_KM * TIME_UNIT_S


class Observed(NamedTuple):
    """Observations in order of time.

    Attributes
    ----------
    elapsed_s : ndarray, shape (row,)
        Times since the epoch, s of UTC.
    observer, target : ndarray of int, shape (row,)
        Indices.
    value, sigma : ndarray, shape (row, 3)
        Magnitude, right ascension and declination (ICRF) with standard deviations; mag, rad. That
        of right ascension is not multiplied by cos(declination).
    """

    elapsed_s: Array
    observer: Indices
    target: Indices
    value: Array
    sigma: Array


def read_observations(
    table: pd.DataFrame,
    place: str,
    fault: type[CislunarError],
    observers: Sequence[str],
    targets: Sequence[str],
    sensors: Sequence[Sensor],
    epoch_tdb: float,
) -> Observed:
    """Check a table of observations, and assign it to observers and targets.

    Parameters
    ----------
    table, place, fault
        Table of the columns of this module, its name and its class of errors, see
        `cislunar.exchange.observation_files.observation_table`.
    observers, targets : sequence of str
        Names. Upper and lower case of the names of observers are equivalent, unless two names
        differ by it alone.
    sensors : sequence of Sensor
        Sensor of each observer.
    epoch_tdb : float
        Epoch, TDB seconds past J2000.

    Returns
    -------
    Observed

    Raises
    ------
    fault
        If a column is missing, or a row cannot be used; the message names it.
    """
    given = checked(table, (*_RMS, *OBJECT_NAMES), (*REQUIRED, "mag"), fault, place)
    given["object"] = object_of(given)
    folded = [name.casefold() for name in observers]
    of_observer = {name: k for k, name in enumerate(folded) if folded.count(name) == 1}
    exact = {name: k for k, name in enumerate(observers)}
    given["place"] = [
        exact.get(name, of_observer.get(name.casefold(), -1)) for name in given["stn"].tolist()
    ]
    of_target = {name: k for k, name in enumerate(targets)}
    elapsed = tdb_since(epoch_tdb, given["tdb"].to_numpy())
    rule = f"be one of the targets {', '.join(targets)}, in {', '.join(OBJECT_NAMES)}"
    once = "differ from those of earlier rows of the same observer and target"
    for name, right, words in (
        ("stn", given["place"] >= 0, f"be one of {', '.join(observers)}"),
        ("object", given["object"].isin(of_target), rule),
        ("obsTime", elapsed > 0.0, "be after the epoch"),
        ("obsTime", ~given.duplicated(["place", "object", "tdb"]), once),
    ):
        require(given, name, right, words, fault, place)
    if given.empty:
        raise fault(f"{place}: contains no observation; add a row per observation")
    observer, target = given["place"], given["object"].map(of_target)
    value = np.column_stack([given["mag"], np.deg2rad(given["ra"]), np.deg2rad(given["dec"])])
    usual = [noise_at(sensors[k], each) for k, each in zip(observer, value[:, 0], strict=True)]
    known = given[[*_RMS]].to_numpy()
    sigma = _RMS_UNIT * np.where(np.isnan(known), np.array(usual) / _RMS_UNIT, known)
    sigma[:, 1] /= np.maximum(np.cos(value[:, 2]), 1e-6)
    found = Observed(elapsed, observer.to_numpy(), target.to_numpy(), value, sigma)
    order = np.argsort(elapsed, kind="stable")
    return Observed(*(column[order] for column in found))


class Reduced(NamedTuple):
    """Observations of the steps of an interval: measurements, and the row of each among all
    observations."""

    measurements: Measurements
    rows: Indices


def reduce_interval(
    observed: Observed,
    scene: Scene,
    rotation: float,
    estimator: Estimator,
    forces: tuple,
    start: int,
    n_steps: int,
    light_time: bool = True,
) -> Reduced:
    """Observations of an interval, reduced to the times of the grid.

    Parameters
    ----------
    observed : Observed
    scene : Scene
        Its `observer_axes` are the rotations from the propagation frame to the ICRF.
    rotation : float
        Angular velocity of the propagation frame about z, nondimensional: 1 in the CR3BP.
    estimator : Estimator
        At the index `start` of the scene.
    forces : NamedTuple
        Assumed force model.
    start, n_steps : int
        Index of the last processed time, and number of steps of the interval.
    light_time : bool
        See `cislunar.study.estimation.estimate`.

    Returns
    -------
    Reduced

    Raises
    ------
    ConfigurationError
        If the force model does not cover the interval.
    """
    nearest = np.maximum(np.rint(observed.elapsed_s / scene.step_s).astype(np.int64), 1)
    rows = np.flatnonzero((nearest > start) & (nearest <= start + n_steps))
    at, target, observer = nearest[rows], observed.target[rows], observed.observer[rows]
    begin = estimator.orbits().translation
    path = propagate_bundle(begin, scene.step, n_steps, forces=forces, start=start * scene.step)
    step = at - start
    low, high = np.maximum(step - 1, 0), np.minimum(step + 1, n_steps)
    speeds = path[target, high, 3:] - path[target, low, 3:]
    bend = speeds / ((high - low) * scene.step)[:, None]
    body = path[target, step, :3], path[target, step, 3:], bend
    place = _observer_motion(scene, observer, at)
    elapsed = observed.elapsed_s[rows] / TIME_UNIT_S - at * scene.step
    light = light_time * np.linalg.norm(body[0] - place[0], axis=1) / _LIGHT_SPEED
    seen = _moved(*body, rotation, elapsed - light) - _moved(*place, rotation, elapsed)
    on_grid, apart = (
        angles_of_vectors(np.einsum("nij,nj->ni", scene.observer_axes[at], each))
        for each in (body[0] - place[0], seen)
    )
    value = observed.value[rows].copy()
    value[:, 1:] += on_grid - apart
    value[:, 1] = wrapped(value[:, 1])
    variance = observed.sigma[rows] ** 2
    found, order = arranged(target, step - 1, observer, value, variance, path.shape[0], n_steps)
    return Reduced(found, rows[order])


def _observer_motion(scene: Scene, observer: Indices, at: Indices) -> tuple[Array, Array, Array]:
    """Position, velocity and acceleration (row, 3) of observers by differences of the grid."""
    last = scene.observer_position.shape[1] - 1
    middle = np.clip(at, 1, last - 1)
    low, here, high = (scene.observer_position[observer, middle + k] for k in (-1, 0, 1))
    bend = (high - 2.0 * here + low) / scene.step**2
    rate = (high - low) / (2.0 * scene.step) + ((at - middle) * scene.step)[:, None] * bend
    return scene.observer_position[observer, at], rate, bend


def _moved(position: Array, rate: Array, bend: Array, rotation: float, elapsed: Array) -> Array:
    """Positions (row, 3) after `elapsed` (row,), to second order, in the axes of the propagation
    frame before, which do not turn with it."""

    def across(vector: Array) -> Array:
        x, y, _ = vector.T
        return rotation * np.stack([-y, x, np.zeros_like(x)], axis=-1)

    after = elapsed[:, None]
    speed = rate + across(position)
    pull = bend + 2.0 * across(rate) + across(across(position))
    return position + after * speed + 0.5 * after**2 * pull
