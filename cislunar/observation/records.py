"""Measurements as records: which observer looked at which target at which step, and what it saw.

Rows are sorted by target, then step, then the order in which they are used; any number may share a
target and a step. An attempt that found nothing is a record too.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.errors import ConfigurationError

Array = NDArray[np.float64]


class Schedule(NamedTuple):
    """Looks to be taken over consecutive steps.

    Attributes
    ----------
    offset : ndarray of int, shape (target, step + 1)
        The rows of target j at step i are ``offset[j, i] : offset[j, i + 1]``.
    observer : ndarray of int, shape (row,)
        Who looks.
    """

    offset: NDArray[np.int64]
    observer: NDArray[np.int64]


class Measurements(NamedTuple):
    """What the looks of a `Schedule` brought.

    Attributes
    ----------
    offset, observer : ndarray of int
        As in `Schedule`.
    value : ndarray, shape (row, 3)
        Magnitude, right ascension and declination (mag, rad, rad); NaN where nothing was found.
    variance : ndarray, shape (row, 3)
        Of the errors, which are independent; mag^2, rad^2.
    """

    offset: NDArray[np.int64]
    observer: NDArray[np.int64]
    value: Array
    variance: Array

    def where(self, chosen: NDArray[np.bool_]) -> "Measurements":
        """Those of the rows for which a boolean, shape (row,), is true; steps stay as they are."""
        target, step = rows_of(self)
        n_targets, n_offsets = self.offset.shape
        offset = _offsets(target[chosen], step[chosen], n_targets, n_offsets - 1)
        return Measurements(
            offset, self.observer[chosen], self.value[chosen], self.variance[chosen]
        )


def _offsets(
    target: NDArray[np.int64], step: NDArray[np.int64], n_targets: int, n_steps: int
) -> NDArray[np.int64]:
    """Offsets of rows that are sorted by target and step."""
    counts = np.zeros((n_targets, n_steps), dtype=np.int64)
    np.add.at(counts, (target, step), 1)
    ends = np.cumsum(counts).reshape(counts.shape)
    return np.ascontiguousarray(np.column_stack([ends[:, :1] - counts[:, :1], ends]))


def rows_of(records: Schedule | Measurements) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Target and step of every row.

    Parameters
    ----------
    records : Schedule or Measurements

    Returns
    -------
    target, step : ndarray of int, shape (row,)
    """
    counts = np.diff(records.offset, axis=1)
    target, step = np.indices(counts.shape)
    return np.repeat(target.ravel(), counts.ravel()), np.repeat(step.ravel(), counts.ravel())


def highest(records: Schedule | Measurements, codes: ArrayLike, none: int) -> NDArray:
    """Largest of the rows' codes at every target and step.

    Parameters
    ----------
    records : Schedule or Measurements
    codes : array_like of bool or int, shape (row,)
    none : int
        Where there is no row; not above any code.

    Returns
    -------
    ndarray, shape (target, step)
        Of the type of `codes`.
    """
    values = np.asarray(codes)
    n_targets, n_offsets = records.offset.shape
    out = np.full((n_targets, n_offsets - 1), none, dtype=values.dtype)
    np.maximum.at(out, rows_of(records), values)
    return out


def schedule(
    target: ArrayLike, step: ArrayLike, observer: ArrayLike, n_targets: int, n_steps: int
) -> Schedule:
    """Lay out looks given one by one.

    Parameters
    ----------
    target, step, observer : array_like of int, shape (row,)
        In any order; rows of the same target and step keep theirs.
    n_targets, n_steps : int

    Returns
    -------
    Schedule

    Raises
    ------
    ConfigurationError
        If an index lies outside its range.
    """
    rows = [np.asarray(column, dtype=np.int64) for column in (target, step, observer)]
    for key, column, end in zip(
        ("target", "step", "observer"), rows, (n_targets, n_steps, np.inf), strict=True
    ):
        if column.shape != rows[0].shape or np.any((column < 0) | (column >= end)):
            raise ConfigurationError(
                f"schedule: {key} needs one index for each look, from 0 and below {end}"
            )
    order = np.lexsort((rows[1], rows[0]))
    targets, steps, observers = (column[order] for column in rows)
    return Schedule(_offsets(targets, steps, n_targets, n_steps), observers)


def constant_schedule(target: ArrayLike, n_targets: int, n_steps: int) -> Schedule:
    """Every observer looks at its target at every step.

    Parameters
    ----------
    target : array_like of int, shape (observer,)
        Target of each observer; below 0 for an idle one.
    n_targets, n_steps : int

    Returns
    -------
    Schedule
    """
    return pointed_schedule(np.tile(np.asarray(target, dtype=np.int64), (n_steps, 1)), n_targets)


def pointed_schedule(target: ArrayLike, n_targets: int) -> Schedule:
    """Every observer looks where it is told to, step by step.

    Parameters
    ----------
    target : array_like of int, shape (step, observer)
        Target of each observer at each step; below 0 for an idle one.
    n_targets : int

    Returns
    -------
    Schedule
    """
    targets = np.asarray(target, dtype=np.int64)
    step, observer = np.nonzero(targets >= 0)
    return schedule(targets[step, observer], step, observer, n_targets, targets.shape[0])
