"""The statistics that rows of ``claims.yaml`` on tracking name.

Each takes the swept cells of one scenario and architecture, and the measure; of ANEES the decimal
logarithm. Intervals are over realizations.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from cislunar.campaign.tracking import cells_of, slopes, values_of
from cislunar.campaign.tracking.summary import PARTS
from cislunar.evaluation.intervals import (
    Interval,
    interval_of,
    log_interval,
    prediction_interval,
    share_interval,
    t_interval,
)
from cislunar.runtime.arguments import Array

from .judges import table


class Sweep(NamedTuple):
    """Realizations of some cells in rising order of a label, and perhaps those of another sweep."""

    frame: pd.DataFrame
    along: str = "targets"
    beside: pd.DataFrame | None = None

    @property
    def places(self) -> NDArray[np.int64]:
        """Values of the label that is swept."""
        return cells_of(self.frame)[self.along].to_numpy()


class Part(NamedTuple):
    """In how many cells a property holds."""

    number: int
    cells: int
    by: float = np.nan

    @property
    def share(self) -> float:
        return self.number / self.cells

    @property
    def throughout(self) -> str:
        return "satisfactory" if self.number == self.cells else "not satisfactory"


class Halves(NamedTuple):
    """Whether a trend keeps its sign: no half of the range has an interval of the other sign."""

    none_falls: bool
    none_rises: bool


def _values(frame: pd.DataFrame, quantity: str, *measure: str) -> Array:
    found = values_of(frame, quantity, *measure)
    return np.log10(found) if quantity.startswith("anees") else found


def _change(frame: pd.DataFrame, *measure: str) -> Array:
    found = _values(frame, *measure)
    return found[:, -1] - found[:, 0]


def _growth(sweep: Sweep, *measure: str) -> Interval:
    """Ratio of the last to the first cell."""
    found = _values(sweep.frame, *measure)
    return log_interval(found[:, -1] / found[:, 0])


def _halves(sweep: Sweep, *measure: str) -> Halves:
    """Trends over the lower and over the upper half of the places, the middle in both."""
    found, half = _values(sweep.frame, *measure), len(sweep.places) // 2 + 1
    parts = [
        t_interval(slopes(sweep.places[at], found[:, at]))
        for at in (slice(None, half), slice(-half, None))
    ]
    return Halves(
        not any(each.below_zero for each in parts), not any(each.above_zero for each in parts)
    )


def _dip(sweep: Sweep, quantity: str) -> Interval | None:
    """Rotation at 3 h less the mean of 2 h and 4 h."""
    at = [np.flatnonzero(sweep.places == minutes) for minutes in (120, 180, 240)]
    if not all(place.size for place in at):
        return None
    found = 0.5 * sum(_values(sweep.frame, quantity, part) for part in PARTS[:2])
    two, three, four = (found[:, place[0]] for place in at)
    return t_interval(three - 0.5 * (two + four))


def _behind(sweep: Sweep, quantity: str) -> Part:
    """Cells whose interval has attitude below position, and the mean difference."""
    found = _values(sweep.frame, quantity, "attitude") - _values(sweep.frame, quantity, "position")
    below = [t_interval(column).below_zero for column in found.T]
    return Part(sum(below), len(below), -np.nanmean(found))


def _range(sweep: Sweep, *measure: str) -> Interval:
    """Prediction interval of one more realization of the first cell; not negative."""
    found = prediction_interval(_values(sweep.frame, *measure)[:, 0])
    return found._replace(low=max(0.0, found.low))


def unsatisfactory(frame: pd.DataFrame) -> list[str]:
    """Cells whose translation is not satisfactory (phrase of the table), with the reason."""
    most, shares = table()["limits"].outside, values_of(frame, "translation_outside_share").T
    found = []
    for cell, own in zip(cells_of(frame).itertuples(), shares, strict=True):
        share = interval_of("translation_outside_share", own, cell.targets)
        if not share.ceiling <= most:
            found.append(f"{cell.targets} targets, {cell.interval_minutes} min: {share:.3f}")
    return found


def _satisfactory(sweep: Sweep) -> Part:
    cells = len(cells_of(sweep.frame))
    return Part(cells - len(unsatisfactory(sweep.frame)), cells)


def _shortfall(sweep: Sweep) -> str:
    """Cells that are not satisfactory, and the inconsistent targets on low lunar trajectories."""
    failing = unsatisfactory(sweep.frame)
    if not failing:
        return ""
    lunar, lost = (
        np.nansum(values_of(sweep.frame, name))
        for name in ("inconsistent_translation_lunar", "inconsistent_translation")
    )
    return (
        f" (not: {' | '.join(failing[:3])}); {lunar:.0f} of {lost:.0f} inconsistent targets are on "
        "low lunar trajectories"
    )


STATISTICS: dict[str, Callable[..., Any]] = {
    "mean": lambda sweep, *m: interval_of(
        m[0], values_of(sweep.frame, *m)[:, 0], sweep.frame["targets"].iloc[0]
    ),
    "spread": _range,
    "first": lambda sweep, *m: np.nanmean(_values(sweep.frame, *m)[:, 0]),
    "last": lambda sweep, *m: np.nanmean(_values(sweep.frame, *m)[:, -1]),
    "average": lambda sweep, *m: np.nanmean(_values(sweep.frame, *m)),
    "several": lambda sweep, *m: share_interval(
        (_values(sweep.frame, *m) >= 2).mean(axis=1), targets=1
    ),
    "trend": lambda sweep, *m: t_interval(slopes(sweep.places, _values(sweep.frame, *m))),
    "decades": lambda sweep, *m: t_interval(
        slopes(sweep.places, np.log10(values_of(sweep.frame, *m)))
    ),
    "change": lambda sweep, *m: t_interval(_change(sweep.frame, *m)),
    "excess": lambda sweep, *m: t_interval(_change(sweep.frame, *m) - _change(sweep.beside, *m)),
    "growth": _growth,
    "halves": _halves,
    "dip": _dip,
    "behind": _behind,
    "satisfactory": _satisfactory,
    "shortfall": _shortfall,
}
"""Statistics that a row may name; None where its cells are missing."""
