"""What a survey returns, and the record of its blocks."""

from typing import NamedTuple

import pandas as pd

from cislunar.detection import Detections, Exposures
from cislunar.orbit_determination import LinkedOrbits, OrbitFits
from cislunar.runtime import Array, Indices
from cislunar.survey.characterization import CharacterizedOrbit
from cislunar.survey.maneuvers import Lineage
from cislunar.targets import Maneuvers


class CatalogRecord(NamedTuple):
    """The catalog after a linking run, with the truth.

    Attributes
    ----------
    orbits : LinkedOrbits
        Their detections are numbered in the order of the blocks.
    owner : ndarray of int, shape (orbit,)
        Object of most detections of each orbit, or `FALSE_ALARM`.
    maneuvers : Lineage or None
        That the catalog has found.
    """

    orbits: LinkedOrbits
    owner: Indices
    maneuvers: Lineage | None


class BlockRecord(NamedTuple):
    """What happens in a block of a survey, with the truth.

    Attributes
    ----------
    first : int
        Index of the first step among the scene's times.
    exposures : Exposures
    detections : Detections
    origin : ndarray of int, shape (row,)
        Object of each detection, or `FALSE_ALARM`.
    state : ndarray, shape (object, step + 1, 6)
        True states from the time before the first step on, nondimensional, propagation frame.
    maneuvers : Maneuvers
        Of all objects in the whole survey.
    velocity_changes_m_s : ndarray, shape (maneuver, 3)
        Changes of velocity so far, propagation frame, m/s.
    catalog : CatalogRecord or None
        After the linking run at the end of the block, if there was one.
    """

    first: int
    exposures: Exposures
    detections: Detections
    origin: Indices
    state: Array
    maneuvers: Maneuvers
    velocity_changes_m_s: Array
    catalog: CatalogRecord | None = None


class SurveyResult(NamedTuple):
    """Result of a survey.

    Attributes
    ----------
    states : DataFrame
        Quality after each linking run; columns are the fields of `CatalogState`, ``undetected``
        (expected number of undetected objects), and the numbers of ``exposures``, ``detections``
        and ``false_alarms`` so far. The last row also has the fields of
        `CharacterizationQuality` if light curves are used.
    orbits : DataFrame
        Orbits after each linking run (`cislunar.survey.quality.ORBIT_COLUMNS`).
    objects : DataFrame
        For each object its row ``object``, its ``tracklets``, whether it is ``outside`` of the
        families, and in days, infinite if never:
        ``detected`` at the first detection, and ``cataloged`` at the linking run from which on a
        confirmed orbit is correct.
    linked : LinkedOrbits
        The catalog itself after the last linking run, which knows nothing of the objects.
    averaged : OrbitFits
        Its orbits with states and covariances that allow for undetected maneuvers.
    characterized : tuple of CharacterizedOrbit or None
        What the light curves of confirmed orbits tell of their objects; None if light curves are
        not used.
    """

    states: pd.DataFrame
    orbits: pd.DataFrame
    objects: pd.DataFrame
    linked: LinkedOrbits
    averaged: OrbitFits
    characterized: tuple[CharacterizedOrbit, ...] | None = None
