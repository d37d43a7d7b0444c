"""A second association, for tracks whose targets may have maneuvered.

After a maneuver a target leaves the gate of its track, and the first association gives it nothing.
The detections that no track has taken are then compared with the orbits that a maneuver can lead to
(decision-based methods; Li & Jilkov 2002, Proceedings of SPIE 4728, 511). Between the last
detection of the track and the present, at a uniform time, each component of its velocity has
changed by a normal variable. Without the difference in gravity between the orbits with and without
the change, the covariance of the state is larger by

    s^2 [[T^2/3 I, T/2 I], [T/2 I, I]]

after the time T for the standard deviation s. Several values of s are tried, beginning with the
smallest. Such a gate contains false alarms. A track therefore takes detections only if those of
several exposures agree with one orbit (`associate_frames`): if they are confirmed, or if the
likelihood ratio to false alarms is large after the probability of a maneuver has been taken into
account.
"""

from collections.abc import Callable

import numpy as np

from cislunar.association.model import AssociationModel
from cislunar.association.multiple_frames import associate_frames
from cislunar.association.window import Association, Window
from cislunar.dynamics.maneuvers import VELOCITY_UNIT_M_S
from cislunar.estimation.estimator import OrbitEstimates
from cislunar.runtime import Array, Indices

_SCALES_M_S = 5.0, 50.0, 500.0
"""Standard deviations of a component of the change of velocity, m/s."""


def reachable(orbits: OrbitEstimates, waited: Array, sigma_m_s: float) -> OrbitEstimates:
    """Orbits after a maneuver that may have occurred.

    Parameters
    ----------
    orbits : OrbitEstimates
        Orbits without a maneuver.
    waited : ndarray, shape (track,)
        Time during which a track may have maneuvered, nondimensional; NaN for a track that has not.
    sigma_m_s : float
        Standard deviation of each component of the change of velocity, m/s.

    Returns
    -------
    OrbitEstimates
        With larger covariances; NaN for tracks that have not maneuvered.
    """
    variance = (sigma_m_s / VELOCITY_UNIT_M_S) ** 2
    shape = np.array([waited**2 / 3.0, waited / 2.0, waited / 2.0, np.ones(waited.size)])
    blocks = np.moveaxis(shape.reshape(2, 2, -1), -1, 0)
    added = variance * np.einsum("jab,cd->jacbd", blocks, np.eye(3)).reshape(-1, 6, 6)
    gone = np.where(np.isfinite(waited), 1.0, np.nan)
    return OrbitEstimates(
        orbits.index,
        orbits.translation * gone[:, None],
        orbits.covariance + np.nan_to_num(added),
    )


def associate_maneuvered(
    candidates: Callable[[OrbitEstimates, Indices], Window],
    orbits: OrbitEstimates,
    waited: Array,
    window: Window,
    taken: Association,
    count: int,
    model: AssociationModel,
    probability: float,
) -> Association:
    """Associate the detections that no track has taken with tracks that may have maneuvered.

    Parameters
    ----------
    candidates : callable
        Window of orbits and of detections, given by their indices; the detections of the window are
        positions in these.
    orbits : OrbitEstimates
        Orbits without a maneuver.
    waited : ndarray, shape (track,)
        Time since the last detection of each track until the end of the window, nondimensional; NaN
        before its first detection.
    window, taken : Window, Association
        Candidates and result of the first association.
    count : int
        Number of all detections.
    model : AssociationModel
    probability : float
        Prior probability that a track has maneuvered.

    Returns
    -------
    Association
        With `taken`. Tracks that have a detection there have no further ones.
    """
    waited = waited.copy()
    waited[np.setdiff1d(np.arange(waited.size), window.seen[:, 1])] = np.nan
    waited[taken.track] = np.nan
    free = np.setdiff1d(np.arange(count), taken.detection)
    certain = model.confirmation_score - np.log(probability / len(_SCALES_M_S))
    for sigma in _SCALES_M_S:
        if free.size == 0 or np.all(np.isnan(waited)):
            break
        found = associate_frames(
            candidates(reachable(orbits, waited, sigma), free),
            model.gate_probability,
            model.confirmations,
            model.confirmation_exposures,
            model.hypotheses,
            certain,
        )
        more = found._replace(detection=free[found.detection])
        taken = Association(*map(np.concatenate, zip(taken, more, strict=True)))
        free = np.delete(free, found.detection)
        waited[found.track] = np.nan
    return taken
