"""Quality of the characterization of cataloged objects against the truth."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from cislunar.detection import FALSE_ALARM
from cislunar.estimation.light_curves.model_selection import UNKNOWN_BODY, Characterization
from cislunar.evaluation import characterized_targets, within_intervals
from cislunar.observation import TargetSurfaces, surfaces_of
from cislunar.runtime import Array
from cislunar.survey.characterization import CharacterizedOrbit
from cislunar.survey.quality.orbits import mean_of, owner_of


class CharacterizationQuality(NamedTuple):
    """Characterized orbits against the truth. Shares are NaN if there is nothing to divide by.

    Attributes
    ----------
    bright : int
        Characterized orbits, which are of objects that are bright enough.
    determined : int
        Those of them whose spin period is determined.
    period_determined : float
        Their share.
    period_half_width : float
        Median half width of the interval of the logarithm of a determined period.
    period_covered : float
        Share of the determined periods whose interval contains the true one.
    amplitude_covered, area_albedo_covered : float
        Share of the characterized orbits whose interval contains the true amplitude, and the true
        area times albedo.
    """

    bright: int
    determined: int
    period_determined: float
    period_half_width: float
    period_covered: float
    amplitude_covered: float
    area_albedo_covered: float


def characterization_quality(
    found: Sequence[CharacterizedOrbit],
    origin: ArrayLike,
    attitude: Array,
    first_attitude: Array,
    first_rate: Array,
    surfaces: TargetSurfaces,
) -> CharacterizationQuality:
    """Characterized orbits against the truth.

    Parameters
    ----------
    found : sequence of CharacterizedOrbit
    origin : array_like of int, shape (row,)
        Object of each detection, or `FALSE_ALARM`.
    attitude : ndarray, shape (row, 4)
        True attitude at each detection, inertial frame to body frame; NaN for false alarms.
    first_attitude, first_rate : ndarray, shapes (object, 4) and (object, 3)
        True attitudes and angular velocities (rad/s, body frame) at the start.
    surfaces : TargetSurfaces
        True bodies.
    """
    given, real, objects, curves, true, stated = np.asarray(origin), [], [], [], [], []
    for each in found:
        main = owner_of(given[each.row])[0]
        if main == FALSE_ALARM:
            continue
        own = given[each.row] == main
        real.append(each)
        objects.append(main)
        curves.append(each.light_curve[own])
        true.append(attitude[each.row[own]])
        values = each.spin_period_h, np.full(3, np.nan), 180.0, each.amplitude_mag
        stated.append(Characterization(*values, each.area_albedo_m2, UNKNOWN_BODY))
    of = np.array(objects, dtype=np.int64)
    if of.size == 0:
        return CharacterizationQuality(len(found), 0, *(float("nan"),) * 5)
    compared = characterized_targets(
        stated, curves, true, first_attitude[of], first_rate[of], surfaces_of(surfaces, of)
    )
    inside = within_intervals(compared)
    determined = np.array([each.determined for each in real])
    period = compared.spin_period[determined]
    half = 0.5 * np.log(period[:, 2] / period[:, 1])
    return CharacterizationQuality(
        bright=len(found),
        determined=int(determined.sum()),
        period_determined=float(determined.sum() / len(found)),
        period_half_width=float(np.median(half)) if half.size else float("nan"),
        period_covered=mean_of(pd.Series(inside["spin_period"][determined].astype(float))),
        amplitude_covered=float(inside["amplitude"].mean()),
        area_albedo_covered=float(inside["area_albedo"].mean()),
    )
