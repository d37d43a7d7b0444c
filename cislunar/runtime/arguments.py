"""Arguments of public functions: wrong kinds, shapes and numbers are refused in one line."""

import os
from collections.abc import Iterable, Sequence
from numbers import Integral, Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.errors import ConfigurationError, did_you_mean
from cislunar.quantities import is_quantity
from cislunar.runtime.settings_words import shown

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]

UNIT_NORM = 1e-6
"""Largest deviation from 1 of the norm of a unit vector, such as by rounding to 7 digits."""


def array_of(
    name: str,
    given: ArrayLike,
    axes: Sequence[str | int | None] | None = None,
    *,
    finite: bool = True,
) -> Array:
    """An argument as an array of floats.

    Parameters
    ----------
    name : str
        Name of the argument, for the message.
    given : array_like
        Value of the argument; texts are no numbers.
    axes : sequence of str, int or None, optional
        Required axes: the length, or what an axis counts, of which at least one is required, or
        None for any length. By default every shape is allowed.
    finite : bool
        Refuse values that are not finite.

    Raises
    ------
    ConfigurationError
        If the argument has another shape, or a value is no number or not finite. The message gives
        the indices of the first such value along the axes that are named.
    """
    if is_quantity(given) and str(given.unit):
        raise ConfigurationError(f"{name} has the unit {given.unit}; give numbers without a unit")
    try:
        found = np.asarray(given)
    except ValueError:  # rows of different lengths
        found = np.asarray(None)
    objects = found.dtype.kind == "O" and all(isinstance(each, Real) for each in found.flat)
    if found.dtype.kind not in "biuf" and not objects:
        raise ConfigurationError(f"{name} = {shown(given)} must be numbers{_shape_in_words(axes)}")
    found = np.asarray(found, dtype=float)
    if axes is not None and not (
        found.ndim == len(axes)
        and all(
            axis is None or (length > 0 if isinstance(axis, str) else length == axis)
            for length, axis in zip(found.shape, axes, strict=True)
        )
    ):
        raise ConfigurationError(
            f"{name} has shape {found.shape}; give numbers{_shape_in_words(axes)}"
        )
    if finite and not np.all(np.isfinite(found)):
        index = np.argwhere(~np.isfinite(found))[0].tolist()
        named = zip(found.shape if axes is None else axes, index, strict=True)
        of = [f"{axis} {k}" for axis, k in named if isinstance(axis, str)]
        raise ConfigurationError(
            f"{name}{' of ' * bool(of)}{', '.join(of)} is not finite ({found[tuple(index)]}); "
            "correct or remove it"
        )
    return found


def number_of(name: str, given: Any, *, positive: bool = False) -> float:
    """An argument as a finite, and if requested positive, float; raises a `ConfigurationError`."""
    value = given.item() if isinstance(given, np.ndarray) and given.ndim == 0 else given
    kind = "positive number" if positive else "finite number"
    if (
        isinstance(value, bool)
        or not isinstance(value, Real)
        or not np.isfinite(float(value))
        or (positive and not value > 0.0)
    ):
        raise ConfigurationError(f"{name} = {shown(given)} must be a {kind}")
    return float(value)


def number_or_range(name: str, given: Any) -> float | tuple[float, ...] | None:
    """A number, both ends of a range, or None, as given; else raises a `ConfigurationError`."""
    if given is None:
        return None
    if not isinstance(given, tuple | list | np.ndarray) or np.ndim(given) == 0:
        return number_of(name, given)
    if len(given) != 2:
        raise ConfigurationError(
            f"{name}: a range has two ends, (lowest, highest), not {len(given)}"
        )
    return tuple(number_of(name, each) for each in given)


def require_unit(name: str, vectors: Array, of: str = "") -> None:
    """Raise a `ConfigurationError` if the norm of a vector, shape (..., component), differs from 1
    by more than `UNIT_NORM`; `of` is what the first axis counts. NaN is not refused."""
    norm = np.linalg.norm(vectors, axis=-1)
    for index in np.argwhere(np.abs(norm - 1.0) > UNIT_NORM)[:1]:
        place = f" of {of} {index[0]}" if of else ""
        found = f"has norm {norm[tuple(index)]:.9g}; divide it by its norm"
        raise ConfigurationError(f"{name}{place} {found}")


def count_of(name: str, given: Any, least: int = 1, most: int | None = None) -> int:
    """An argument as a whole number within limits; raises a `ConfigurationError`."""
    whole = isinstance(given, Integral) and not isinstance(given, bool)
    if not whole or given < least or (most is not None and given > most):
        limits = f"of at least {least}{f' and at most {most:,}' if most else ''}"
        raise ConfigurationError(f"{name} = {shown(given)} must be a whole number {limits}")
    return int(given)


def vectors_of(name: str, given: ArrayLike, *components: int) -> Array:
    """An argument as an array of floats, finite or not, whose last axis has one of some numbers of
    components; raises a `ConfigurationError`."""
    found = array_of(name, given, finite=False)
    if found.ndim == 0 or found.shape[-1] not in components:
        last = " or ".join(map(str, components))
        raise ConfigurationError(
            f"{name} has shape {found.shape}; give numbers of shape (..., {last})"
        )
    return found


def indices_of(name: str, given: ArrayLike, count: int) -> Indices:
    """An argument as an array of indices below a count; raises a `ConfigurationError`."""
    found = array_of(name, given)
    wrong = (found < 0.0) | (found >= count) | (found != np.floor(found))
    if np.any(wrong):
        raise ConfigurationError(
            f"{name}: {found[wrong][0]:g} must be a whole number of at least 0 and below {count:,}"
        )
    return found.astype(np.int64)


def require_choice(name: str, given: Any, choices: Iterable[str]) -> None:
    """Raise a `ConfigurationError` if an argument is none of the known names."""
    names = list(choices)
    text = isinstance(given, str)
    if not text or given not in names:
        close = did_you_mean(given, names) if text else ""
        rule = f"must be one of {', '.join(names)}{close and '; '}{close}"
        raise ConfigurationError(f"{name} = {shown(given)} {rule}")


def require_kind(name: str, given: Any, kind: Any, remedy: str) -> None:
    """Raise a `ConfigurationError` with a remedy if an argument is not an instance of `kind`."""
    if not isinstance(given, kind):
        raise ConfigurationError(f"{name} = {shown(given)}: {remedy}")


def require_path(name: str, given: Any) -> None:
    """Raise a `ConfigurationError` if an argument is not the path of a file or a folder."""
    require_kind(name, given, str | os.PathLike, "give the path of a file or a folder")


def _shape_in_words(axes: Sequence[str | int | None] | None) -> str:
    if axes is None:
        return ""
    named = ("any" if axis is None else str(axis) for axis in axes)
    return f" of shape ({', '.join(named)}{',' * (len(axes) == 1)})"
