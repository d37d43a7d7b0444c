"""Schedules of observations and their measurements as records.

Rows are sorted by target, then step, then the order in which they are used. Any number of rows may
have the same target and step. An observation that detects nothing is a record too.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.errors import ConfigurationError
from cislunar.runtime import Array, array_of


class Schedule(NamedTuple):
    """Observations to be made over consecutive steps: the rows of target j at step i are
    ``offset[j, i] : offset[j, i + 1]`` with `offset` (target, step + 1), and `observer` (row,) is
    the index of the observer."""

    offset: NDArray[np.int64]
    observer: NDArray[np.int64]


class Measurements(NamedTuple):
    """Measurements of the observations of a `Schedule`.

    Attributes
    ----------
    offset, observer : ndarray of int
        See `Schedule`.
    value : ndarray, shape (row, 3)
        Magnitude, right ascension and declination (mag, rad, rad); NaN where nothing was detected.
    variance : ndarray, shape (row, 3)
        Variances of the independent errors; mag^2, rad^2.
    """

    offset: NDArray[np.int64]
    observer: NDArray[np.int64]
    value: Array
    variance: Array

    def where(self, chosen: NDArray[np.bool_]) -> "Measurements":
        """The rows for which a boolean, shape (row,), is true; the steps stay as they are."""
        target, step = rows_of(self)
        n_targets, n_offsets = self.offset.shape
        offset = _offsets(target[chosen], step[chosen], n_targets, n_offsets - 1)
        return Measurements(
            offset, self.observer[chosen], self.value[chosen], self.variance[chosen]
        )


def no_measurements(n_targets: int, n_steps: int) -> Measurements:
    """Measurements without rows, of `n_targets` targets at `n_steps` steps."""
    offset = np.zeros((n_targets, n_steps + 1), dtype=np.int64)
    return Measurements(offset, np.empty(0, dtype=np.int64), *np.empty((2, 0, 3)))


def _offsets(
    target: NDArray[np.int64], step: NDArray[np.int64], n_targets: int, n_steps: int
) -> NDArray[np.int64]:
    """Offsets of rows that are sorted by target and step."""
    counts = np.zeros((n_targets, n_steps), dtype=np.int64)
    np.add.at(counts, (target, step), 1)
    ends = np.cumsum(counts).reshape(counts.shape)
    return np.ascontiguousarray(np.column_stack([ends[:, :1] - counts[:, :1], ends]))


def rows_of(records: Schedule | Measurements) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Target and step of every row of the records, ndarrays of int, shape (row,)."""
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
        Value where there is no row; not above any code.

    Returns
    -------
    ndarray, shape (target, step)
    """
    values = np.asarray(codes)
    n_targets, n_offsets = records.offset.shape
    out = np.full((n_targets, n_offsets - 1), none, dtype=values.dtype)
    np.maximum.at(out, rows_of(records), values)
    return out


def _indices(
    target: ArrayLike, step: ArrayLike, observer: ArrayLike, n_targets: int, n_steps: int
) -> list[NDArray[np.int64]]:
    """Indices (row,) of observations; a `ConfigurationError` if they are impossible."""
    rows = []
    for key, given, end in (
        ("target", target, n_targets), ("step", step, n_steps), ("observer", observer, np.inf),
    ):  # fmt: skip
        column = array_of(key, given)
        wrong = (column < 0.0) | (column >= end) | (column != np.floor(column))
        rows.append(column.astype(np.int64))
        if column.shape != rows[0].shape or column.ndim != 1 or np.any(wrong):
            raise ConfigurationError(
                f"schedule: {key} needs one index per observation, at least 0 and below {end}"
            )
    return rows


def schedule(
    target: ArrayLike, step: ArrayLike, observer: ArrayLike, n_targets: int, n_steps: int
) -> Schedule:
    """Lay out observations given one by one as indices (row,) in any order; rows of the same target
    and step keep their order."""
    rows = _indices(target, step, observer, n_targets, n_steps)
    order = np.lexsort((rows[1], rows[0]))
    targets, steps, observers = (column[order] for column in rows)
    return Schedule(_offsets(targets, steps, n_targets, n_steps), observers)


def arranged(
    target: NDArray[np.int64],
    step: NDArray[np.int64],
    observer: NDArray[np.int64],
    value: Array,
    variance: Array,
    n_targets: int,
    n_steps: int,
) -> tuple[Measurements, NDArray[np.int64]]:
    """Lay out measurements given one by one.

    Parameters
    ----------
    target, step, observer : ndarray of int, shape (row,)
    value, variance : ndarray, shape (row, 3)
        See `Measurements`.
    n_targets, n_steps : int

    Returns
    -------
    measurements : Measurements
    order : ndarray of int, shape (row,)
        Given row of each of their rows.

    Raises
    ------
    ConfigurationError
        If an index is impossible, or an array has another shape.
    """
    target, step, observer = _indices(target, step, observer, n_targets, n_steps)
    for name, each in (("value", value), ("variance", variance)):
        array_of(name, each, (target.size, 3), finite=False)
    order = np.lexsort((observer, step, target))
    offset = _offsets(target[order], step[order], n_targets, n_steps)
    return Measurements(offset, observer[order], value[order], variance[order]), order


def pointed_schedule(target: ArrayLike, n_targets: int) -> Schedule:
    """Schedule in which every observer observes a given target at each step.

    Parameters
    ----------
    target : array_like of int, shape (step, observer)
        Target of each observer at each step; negative for an idle one.
    n_targets : int

    Returns
    -------
    Schedule

    Raises
    ------
    ConfigurationError
        If a target is not a whole number below `n_targets`, or the array has another shape.
    """
    targets = array_of("target", target)
    if targets.ndim != 2:
        array_of("target", targets, ("step", "observer"))
    step, observer = np.nonzero(targets >= 0)
    return schedule(targets[step, observer], step, observer, n_targets, targets.shape[0])
