"""Initial orbits of one object from its angles: starts, least squares, and all solutions.

The rows are grouped into tracklets. Starts are the orbits through pairs of tracklets
(`cislunar.orbit_determination.pairs`) and samples of the admissible regions of single tracklets.
If there are several observers, another start is the motion at constant velocity that is nearest to
all lines of sight; in the CR3BP it has the acceleration at its middle. All starts are fitted to all
angles. Solutions that agree with the angles and are admissible are kept, in order of evidence.
Where the angles do not determine a direction of state space, the solutions are samples of a set of
orbits with nearly equal residuals.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.constants import LENGTH_UNIT_KM, TIME_UNIT_S
from cislunar.dynamics import EARTH_MOON, equations_of_motion, propagate_many, require_span
from cislunar.errors import ConfigurationError
from cislunar.orbit_determination.admissible_region import (
    AdmissibleRegion,
    is_admissible,
    is_brightness_admissible,
    sample_region,
)
from cislunar.orbit_determination.angles import Angles, frame_rate
from cislunar.orbit_determination.least_squares import CONVERGED, SINGULAR, OrbitFits, fit_orbits
from cislunar.orbit_determination.pairs import PairSettings, pair_starts
from cislunar.orbit_determination.tracklets import Attributables, attributables
from cislunar.orbit_determination.verdicts import (
    CONTRADICTORY,
    DIRECTION_ONLY,
    NO_ORBIT,
    ORBIT,
    SEVERAL_ORBITS,
    VerdictSettings,
    agrees,
    log_evidence,
    undetermined_directions,
)
from cislunar.runtime import Array, Indices
from cislunar.runtime.settings_fields import Count, Positive, Section, setting

_SAME = 1e-3
"""Largest difference of positions, relative to the range, of two fits of the same minimum."""


class InitialOrbitSettings(Section):
    """Starts of the search for all orbits of one object."""

    # fmt: off

    pass_min: Positive = setting(
        "longest part of a pass of one observer that is one tracklet", "min", default=15)
    n_tracklets: Count = setting(
        "tracklets, spread over the time of all, whose pairs and regions give starts", "1",
        default=5)
    n_ranges: Count = setting("ranges of a sampled region", "1", default=24)
    n_rates: Count = setting("range rates of a sampled region", "1", default=7)
    verdict: VerdictSettings = setting("", default=VerdictSettings())

    # fmt: on


class InitialOrbits(NamedTuple):
    """Orbits of one object, and a verdict on what its angles determine.

    Attributes
    ----------
    verdict : str
        See `cislunar.orbit_determination.verdicts`.
    fits : OrbitFits
        Admissible solutions that agree with the angles, by decreasing evidence, at one epoch.
    log_evidence : ndarray, shape (fit,)
        See `cislunar.orbit_determination.verdicts.log_evidence`.
    undetermined_directions : ndarray of int, shape (fit,)
        See `cislunar.orbit_determination.verdicts.undetermined_directions`.
    """

    verdict: str
    fits: OrbitFits
    log_evidence: Array
    undetermined_directions: Indices


def initial_orbits(
    angles: Angles,
    *,
    forces: tuple = EARTH_MOON,
    region: AdmissibleRegion | None = None,
    settings: InitialOrbitSettings | None = None,
    epoch: float | None = None,
    known: InitialOrbits | None = None,
) -> InitialOrbits:
    """Determine all orbits of one object that its angles permit, without a first guess.

    Parameters
    ----------
    angles : Angles
        Directions of this object only.
    forces : NamedTuple
        CR3BP or ephemeris forces.
    region : AdmissibleRegion, optional
    settings : InitialOrbitSettings, optional
    epoch : float, optional
        Time of the solutions, nondimensional; by default the mean time of the angles.
    known : InitialOrbits, optional
        Solutions for nearly the same angles: the search begins from these alone, if there are any.

    Returns
    -------
    InitialOrbits
        Without fits if the verdict is CONTRADICTORY or NO_ORBIT, and if it is DIRECTION_ONLY
        because there are fewer than three rows or no fit is regular.

    Raises
    ------
    ConfigurationError
        If there is no row, or the force model does not cover the times.
    """
    region = AdmissibleRegion() if region is None else region
    settings = InitialOrbitSettings() if settings is None else settings
    n = angles.time.size
    if n == 0:
        raise ConfigurationError("angles have no row; give the detections of an object")
    epoch = float(np.mean(angles.time)) if epoch is None else float(epoch)
    require_span(forces, min(epoch, angles.time[0]), max(epoch, angles.time[-1]))
    all_rows = np.arange(n)
    nothing = fit_orbits(angles, [], np.empty((0, 6)), 0.0, forces=forces)
    if n < 3:
        return _found(DIRECTION_ONLY, nothing, angles, region, settings)
    if known is not None and known.fits.epoch.size:
        times, states = known.fits.epoch, known.fits.state
    else:
        times, states = _starts(angles, forces, region, settings)
    fits = fit_orbits(angles, [all_rows] * len(states), states, times, forces=forces)
    singular = np.any(fits.status == SINGULAR)
    fits = refit_at(_distinct(fits), angles, epoch, forces=forces)
    good = agrees(fits, settings.verdict.significance)
    allowed = good & is_plausible(fits, forces, region)
    for k in np.flatnonzero(allowed).tolist():
        one = fits.take([k])
        allowed[k] = is_brightness_admissible(one.position, angles.rows(one.row), region)
    if allowed.any():
        kept = _distinct(fits.take(np.flatnonzero(allowed)))
        return _found("", kept, angles, region, settings)
    if good.any():
        verdict = NO_ORBIT
    elif np.any(fits.status == CONVERGED):
        verdict = CONTRADICTORY
    else:
        verdict = DIRECTION_ONLY if singular else NO_ORBIT
    return _found(verdict, nothing, angles, region, settings)


def _found(verdict, fits, angles, region, settings) -> InitialOrbits:
    """Solutions in order of evidence, and the verdict if it is not given."""
    evidence = log_evidence(fits, angles, region)
    order = np.argsort(-evidence, kind="stable")
    fits, evidence = fits.take(order), evidence[order]
    free = undetermined_directions(fits, region, settings.verdict)
    if not verdict:
        rivals = evidence >= evidence[0] - settings.verdict.rival_log_ratio
        verdict = SEVERAL_ORBITS if np.count_nonzero(rivals) > 1 else ORBIT
        verdict = DIRECTION_ONLY if np.any(free[rivals] > 0) else verdict
    return InitialOrbits(verdict, fits, evidence, free)


def _starts(angles, forces, region, settings) -> tuple[Array, Array]:
    """Times and states from which the solutions are sought."""
    rate = frame_rate(forces)
    length = settings.pass_min * 60.0 / TIME_UNIT_S
    tracklets = attributables(angles, _passes(angles, length), rate=rate)
    if tracklets.time.size == 0:
        whole = [np.flatnonzero(angles.observer == each) for each in np.unique(angles.observer)]
        whole = [rows for rows in whole if np.unique(angles.time[rows]).size >= 2]
        parts = [
            attributables(
                angles, [rows], rate=rate, degree=min(2, np.unique(angles.time[rows]).size - 1)
            )
            for rows in whole
        ]
        if parts:
            columns = [np.concatenate(each) for each in zip(*(p[:-1] for p in parts), strict=True)]
            tracklets = Attributables(*columns, tuple(each.detections[0] for each in parts))
    count = tracklets.time.size
    chosen = np.unique(
        np.linspace(0, count - 1, min(settings.n_tracklets, count)).round().astype(int)
    )
    tracklets = tracklets.take(chosen)
    pairs = [
        (i, j)
        for i in range(chosen.size)
        for j in range(i + 1, chosen.size)
        if tracklets.time[j] > tracklets.time[i]
    ]
    loose = PairSettings(angle_tolerance_deg=1.0, rate_tolerance_arcsec_s=0.5)
    joined = pair_starts(tracklets, np.array(pairs), region, loose, forces=forces)
    times, states = [joined.time], [joined.state]
    for k in range(chosen.size):
        bank = sample_region(
            tracklets, k, region, forces=forces, n_ranges=settings.n_ranges,
            n_rates=settings.n_rates,
        )  # fmt: skip
        times.append(np.full(len(bank), tracklets.time[k]))
        states.append(bank)
    if np.unique(angles.observer).size > 1:
        time, state = _ballistic(angles, forces)
        if np.all(np.isfinite(state)):
            times.append(np.array([time]))
            states.append(state[None])
    return np.concatenate(times), np.concatenate(states)


def _passes(angles: Angles, length: float) -> list[Indices]:
    """Rows of each observer within a length of time, at two times at least."""
    found = []
    for observer in np.unique(angles.observer):
        rows = np.flatnonzero(angles.observer == observer)
        while rows.size:
            near = angles.time[rows] <= angles.time[rows[0]] + length
            if np.unique(angles.time[rows[near]]).size >= 2:
                found.append(rows[near])
            rows = rows[~near]
    return found


def _ballistic(angles: Angles, forces: tuple) -> tuple[float, Array]:
    """State of uniform velocity, in the propagation frame, nearest to all lines of sight."""
    middle = float(np.mean(angles.time))
    since = angles.time - middle
    across = angles.basis
    design = np.concatenate([across, across * since[:, None, None]], axis=2).reshape(-1, 6)
    right = np.einsum("nac,nc->na", across, angles.observer_position).ravel()
    state = np.linalg.lstsq(design, right, rcond=None)[0]
    if frame_rate(forces):
        # the acceleration at the first solution, once
        pull = equations_of_motion(state, forces.mu)[3:]
        shift = np.einsum("nac,c->na", across, pull) * (0.5 * since**2)[:, None]
        state = np.linalg.lstsq(design, right - shift.ravel(), rcond=None)[0]
    return middle, state


def is_plausible(fits: OrbitFits, forces: tuple, region: AdmissibleRegion) -> NDArray[np.bool_]:
    """Which fits (fit,) are admissible at their epochs, and too near to the observers at less than
    half of their detections. The solution that moves along with an observer is always near to it,
    whereas an object may pass by."""
    good = is_admissible(fits.state, fits.epoch, forces, region)
    near = np.linalg.norm(fits.position, axis=1) * LENGTH_UNIT_KM < region.least_range_km
    of = np.repeat(np.arange(fits.epoch.size), np.diff(fits.begin))
    return good & (2.0 * np.bincount(of, near, minlength=fits.epoch.size) < np.diff(fits.begin))


def _distinct(fits: OrbitFits) -> OrbitFits:
    """Converged solutions of different minima, by chi squared."""
    kept: list[int] = []
    converged = np.flatnonzero(fits.status == CONVERGED)
    for k in converged[np.argsort(fits.chi_squared[converged], kind="stable")].tolist():
        others = (fits.take([m]).position for m in kept)
        line = fits.take([k]).position
        if not any(
            np.linalg.norm(line - other, axis=1).max()
            <= _SAME * np.linalg.norm(other, axis=1).max()
            for other in others
        ):
            kept.append(k)
    return fits.take(kept)


def refit_at(
    fits: OrbitFits, angles: Angles, epoch: ArrayLike, *, forces: tuple = EARTH_MOON
) -> OrbitFits:
    """Converged solutions at other epochs: propagated to these epochs and fitted again.

    Parameters
    ----------
    fits : OrbitFits
    angles : Angles
    epoch : array_like, shape () or (fit,)
        Nondimensional.
    forces : NamedTuple
        Force model.

    Returns
    -------
    OrbitFits
        Those that have converged and can be propagated; all fits unchanged if none can.

    Raises
    ------
    ConfigurationError
        If the force model does not cover the times of the angles.
    """
    epochs = np.broadcast_to(np.asarray(epoch, dtype=float), fits.epoch.shape)
    found = np.flatnonzero(fits.status == CONVERGED)
    elapsed = (epochs - fits.epoch)[found, None]
    given = {"forces": forces, "start": fits.epoch[found], "on_failure": "nan"}
    states = propagate_many(fits.state[found], elapsed, **given)[:, 0]
    kept = np.isfinite(states).all(axis=1)
    if not kept.any():
        return fits
    found = found[kept]
    rows = [fits.detections(k) for k in found.tolist()]
    return fit_orbits(angles, rows, states[kept], epochs[found], forces=forces)
