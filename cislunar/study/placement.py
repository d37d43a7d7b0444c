"""Observers and targets of a study in the propagation frame of its dynamics."""

from collections.abc import Sequence

import numpy as np

from cislunar.campaign.settings.cell_tree import CellSettings
from cislunar.campaign.tracking.cell import Placement, scene_times
from cislunar.campaign.tracking.ephemeris_inputs import CellEphemeris, observer_tracks
from cislunar.constants import TIME_UNIT_S
from cislunar.dynamics.ephemeris import UNITS
from cislunar.dynamics.frames import BARYCENTER, recenter
from cislunar.dynamics.instantaneous_frame_cr3bp import inertial_states, is_low_lunar
from cislunar.ephemeris.time_scales import tdb_after
from cislunar.exchange.inertial import (
    Epoch,
    inertial_covariances,
    rotating_covariances,
    rotating_states,
)
from cislunar.exchange.key_values import CENTERS
from cislunar.exchange.oem import Segment, state_at
from cislunar.runtime.arguments import Array
from cislunar.study.objects import PATH_POINTS, StudyObject
from cislunar.tasking.initial_conditions import initial_estimate
from cislunar.tasking.settings import LoopSettings
from cislunar.visibility.tracks import satellite_tracks

_PROPAGATOR = "dop853"


def place_objects(
    observers: Sequence[StudyObject],
    targets: Sequence[StudyObject],
    settings: CellSettings,
    loop: LoopSettings,
    epoch: Epoch,
    ephemeris: CellEphemeris | None,
) -> Placement:
    """Positions of observers at all times of the scene, and initial estimates of targets.

    Objects that are given by an ephemeris or a state in the ICRF keep these positions in the ICRF.
    For their positions in the CR3BP, and its limits, see `cislunar.exchange.inertial`.

    Parameters
    ----------
    observers, targets : sequence of StudyObject
    settings : CellSettings
    loop : LoopSettings
    epoch : Epoch
        Epoch and its axes.
    ephemeris : CellEphemeris or None
        Ephemeris of the bodies; None in the CR3BP.

    Returns
    -------
    Placement

    Raises
    ------
    ConfigurationError
        If an observer's orbit cannot be refined and the settings refuse that.
    InputFileError
        If the ephemeris of an observer does not cover the run, or that of a target the epoch.
    """
    tracks = np.array([_track(each, settings, loop, epoch, ephemeris) for each in observers])
    rows = [_initial(each, epoch, ephemeris) for each in targets]
    state, low = np.array([row[0] for row in rows]), np.array([row[1] for row in rows])
    sigma = settings.initial_sigma.components()
    estimate = initial_estimate(state, sigma)
    if any(each.covariance_km is not None for each in targets):
        covariance = np.tile(np.diag(sigma**2), (len(targets), 1, 1))
        for own, each in zip(covariance, targets, strict=True):
            if each.covariance_km is not None:
                own[6:, 6:] = _covariance(each, epoch, ephemeris)
        estimate = estimate._replace(covariance=covariance)
    for j, each in enumerate(targets):
        if each.quaternion is not None:
            estimate.quaternion[j] = each.quaternion
        if each.angular_velocity_deg_h is not None:
            estimate.angular_velocity[j] = np.deg2rad(each.angular_velocity_deg_h) / 3600.0
    return Placement(tracks, state, low, np.arange(len(targets)), estimate)


def _track(
    observer: StudyObject,
    settings: CellSettings,
    loop: LoopSettings,
    epoch: Epoch,
    ephemeris: CellEphemeris | None,
) -> Array:
    """Positions (time, 3) of an observer, propagation frame."""
    if observer.segments:
        times = zip(tdb_after(epoch.tdb_s, loop.elapsed_s), loop.elapsed_s, strict=True)
        found = [_state_at(observer.segments, *each, epoch, ephemeris) for each in times]
        return np.array(found)[:, :3]
    flown = observer.state[None], np.array([observer.period])
    if ephemeris is None:
        times = scene_times(settings, loop)
        return satellite_tracks(*flown, [0.0], times, propagator=_PROPAGATOR)[0, 0]
    given = ephemeris, settings.dynamics, *flown, [np.zeros(1)], loop.elapsed_s
    return observer_tracks(*given)[0]


def flown_path(observer: StudyObject, epoch: Epoch, duration_s: float) -> Array:
    """Positions (time, 3) of an observer, nondimensional, rotating frame: from its ephemeris over a
    duration, or along its orbit (`StudyObject.path`)."""
    if not observer.segments:
        return observer.path(duration_s / TIME_UNIT_S)
    elapsed = np.linspace(0.0, duration_s, PATH_POINTS)
    times = zip(tdb_after(epoch.tdb_s, elapsed), elapsed, strict=True)
    return np.array([_state_at(observer.segments, *each, epoch, None)[:3] for each in times])


def _state_at(
    segments: Sequence[Segment],
    tdb_s: float,
    elapsed_s: float,
    epoch: Epoch,
    ephemeris: CellEphemeris | None,
) -> Array:
    """State (6,) of an object of a message, propagation frame, nondimensional."""
    state, center = state_at(segments, float(tdb_s))
    if ephemeris is None:
        return rotating_states(state[None], [elapsed_s], epoch, center)[0]
    moved = recenter(state, ephemeris.table, tdb_s, old=CENTERS[center], new=BARYCENTER)
    return moved / UNITS


def _initial(
    target: StudyObject, epoch: Epoch, ephemeris: CellEphemeris | None
) -> tuple[Array, bool]:
    """State (6,) at the epoch, propagation frame, and whether the orbit is a low lunar one."""
    if ephemeris is None:
        return target.state, False
    if not target.segments:
        state, low = inertial_states(target.state[None], ephemeris.table, ephemeris.start)
        return state[0], bool(low[0])
    found = _state_at(target.segments, epoch.tdb_s, 0.0, epoch, ephemeris)
    return found, bool(is_low_lunar(target.state[None])[0])


def _covariance(target: StudyObject, epoch: Epoch, ephemeris: CellEphemeris | None) -> Array:
    """Covariance (6, 6) of position and velocity, propagation frame, nondimensional."""
    given = target.covariance_km
    scaled = given / np.outer(UNITS, UNITS)
    if bool(target.segments) == (ephemeris is not None):
        return scaled
    if target.segments:
        return rotating_covariances(given[None], [0.0], epoch)[0]
    return inertial_covariances(scaled[None], [0.0], epoch)[0] / np.outer(UNITS, UNITS)
