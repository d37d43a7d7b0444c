"""A second association, for tracks whose targets may have maneuvered.

After a maneuver a target leaves the gate of its track, and the first association gives it nothing.
The detections that no track has taken are then compared with the orbits that a maneuver can lead to
(Li & Jilkov 2002, Proceedings of SPIE 4728, 511, section 2: detection of a maneuver by a change of
the model). Between the last detection of the track and the present, at a uniform time, each
component of its velocity has changed by a normal variable. The changes are small against the
velocity, and without the difference in gravity between both orbits the covariance of the state is
larger by

    s^2 [[T^2/3 I, T/2 I], [T/2 I, I]]

after the time T for the standard deviation s. Several values of s are tried, beginning with the
smallest. Such a gate contains false alarms. A track therefore takes detections only if those of
several exposures agree with one orbit (`associate_frames`): if they are confirmed, or if the
likelihood ratio to false alarms is large after the probability of a maneuver has been taken into
account.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cislunar.association.model import AssociationModel
from cislunar.association.multiple_frames import associate_frames
from cislunar.association.window import Association, Window
from cislunar.dynamics.maneuvers import VELOCITY_UNIT_M_S
from cislunar.estimation.estimator import OrbitEstimates

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

SCALES_M_S = 5.0, 50.0, 500.0
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
    detections: Indices,
    model: AssociationModel,
    probability: float,
) -> list[Association]:
    """Associate detections that no track has taken with tracks that may have maneuvered.

    Parameters
    ----------
    candidates : callable
        Window of orbits and of detections, given by their indices; the detections of the window are
        positions in these.
    orbits, waited
        See `reachable`.
    detections : ndarray of int
        Indices of the detections.
    model : AssociationModel
    probability : float
        Prior probability that a track has maneuvered.

    Returns
    -------
    list of Association
        By standard deviation; their detections are elements of `detections`.
    """
    found: list[Association] = []
    waited = waited.copy()
    certain = model.confirmation_score - np.log(probability / len(SCALES_M_S))
    for sigma in SCALES_M_S:
        if detections.size == 0 or np.all(np.isnan(waited)):
            break
        taken = associate_frames(
            candidates(reachable(orbits, waited, sigma), detections),
            model.gate_probability,
            model.confirmations,
            model.confirmation_exposures,
            model.hypotheses,
            certain,
        )
        if taken.track.size:
            found.append(taken._replace(detection=detections[taken.detection]))
            detections = np.delete(detections, taken.detection)
            waited[taken.track] = np.nan
    return found
