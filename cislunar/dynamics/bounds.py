"""Plausibility bounds on states and periods, which detect numbers in a wrong unit.

Positions and speeds differ by powers of ten between units. A wide bound therefore detects a table
or an array in the wrong unit without refusing any object that is tracked near Earth and Moon.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.constants import LENGTH_UNIT_KM, MU, SECONDS_PER_DAY, TIME_UNIT_S
from cislunar.errors import ConfigurationError, InputFileError
from cislunar.quantities import nondimensional
from cislunar.runtime import Array, array_of

_FURTHEST_KM = 10_000_000.0
"""Largest distance from the Earth-Moon barycenter, km."""

_LARGEST_EXCESS_KM_S = 10.0
"""Largest hyperbolic excess speed on escape from Earth and Moon, km/s."""

_FASTEST_KM_S = float(np.hypot(11.2, _LARGEST_EXCESS_KM_S))
"""Largest inertial speed, km/s: that of this excess at the surface of the Earth."""

_LONGEST_DAYS = 1000.0
"""Longest period of an orbit, days."""

_SPEED = LENGTH_UNIT_KM / TIME_UNIT_S

_WITHIN_BOUNDS = 3.0
"""Nondimensional states whose components are at most this large are within all bounds: at most 5.2
units from the barycenter and at an inertial speed of at most 9.5 units, 9.7 km/s."""


def check_position(
    place: str, names: Sequence[str], position: Sequence[float], unit: str, remedy: str = ""
) -> None:
    """Raise an `InputFileError` for a position, nondimensional, beyond 10,000,000 km. `place`
    names the row, `names` its columns, `unit` is that of the columns (``km`` or none), and `remedy`
    is appended to the message."""
    distance = LENGTH_UNIT_KM * float(np.linalg.norm(position))
    if distance > _FURTHEST_KM:
        worst = int(np.argmax(np.abs(position)))
        length = 1.0 if unit == "km" else LENGTH_UNIT_KM
        value = position[worst] * LENGTH_UNIT_KM / length
        expected = "km" if unit == "km" else f"units of {LENGTH_UNIT_KM:g} km"
        raise InputFileError(
            f"{place}: {names[worst]} = {value:g} is taken in {expected}, which puts it "
            f"{distance:.3g} km from the barycenter, beyond {_FURTHEST_KM:,.0f} km{remedy}"
        )


def check_velocity(
    place: str, names: Sequence[str], state: Sequence[float], unit: str, remedy: str = ""
) -> None:
    """Raise an `InputFileError` for a speed more than 10 km/s above escape. `state`
    (6,) is nondimensional, rotating frame; for the other arguments see `check_position`."""
    excess = float(_excess_km_s(np.asarray(state)))
    if excess > _LARGEST_EXCESS_KM_S:
        worst = int(np.argmax(np.abs(state[3:])))
        value = state[3 + worst] * (_SPEED if unit == "km" else 1.0)
        expected = "km/s" if unit == "km" else f"units of {_SPEED:.5f} km/s"
        raise InputFileError(
            f"{place}: {names[worst]} = {value:g} is taken in {expected}, which is faster than "
            f"escape from there by {excess:.3g} km/s (at most {_LARGEST_EXCESS_KM_S:g}){remedy}"
        )


def _excess_km_s(state: NDArray[np.float64]) -> NDArray[np.float64]:
    """Excess speed on escape, km/s, of nondimensional states (..., 6) in the rotating frame."""
    x, y, z, vx, vy, vz = np.moveaxis(state, -1, 0)
    speed2 = (vx - y) ** 2 + (vy + x) ** 2 + vz**2  # inertial velocity
    with np.errstate(divide="ignore"):
        escape2 = 2.0 * ((1.0 - MU) / np.hypot(np.hypot(x + MU, y), z))
        escape2 += 2.0 * MU / np.hypot(np.hypot(x - 1.0 + MU, y), z)
    return _SPEED * np.sqrt(np.maximum(speed2 - escape2, 0.0))


def state_vector(state: ArrayLike) -> Array:
    """A state as an array of 6 finite numbers; raises a `ConfigurationError` otherwise."""
    state = nondimensional("state", state, "state")
    vector = np.array(array_of("state", state, finite=False))
    if vector.shape != (6,) or not np.all(np.isfinite(vector)):
        raise ConfigurationError(f"a state must be 6 finite numbers, got {vector.tolist()}")
    return vector


def require_nondimensional(name: str, given: ArrayLike) -> None:
    """Refuse an argument with a state or position that must be in another unit.

    Parameters
    ----------
    name : str
        Name of the argument, for the message.
    given : array_like, shape (..., 6) or (..., 3)
        States or positions, which should be nondimensional, rotating frame.

    Raises
    ------
    ConfigurationError
        If a row violates the bounds of `check_position` or `check_velocity`.
    """
    values = np.asarray(given, dtype=float)
    if values.ndim == 0 or values.size == 0 or values.shape[-1] not in (3, 6):
        return  # a wrong shape is reported elsewhere
    rows = values.reshape(-1, values.shape[-1])
    if np.abs(rows).max() <= _WITHIN_BOUNDS:
        return
    remedy = (
        "; divide km by LENGTH_UNIT_KM of cislunar.constants, km/s by LENGTH_UNIT_KM / TIME_UNIT_S"
    )
    try:
        furthest = rows[np.argmax(np.sum(rows[:, :3] ** 2, axis=1))]
        check_position(name, ("x", "y", "z"), furthest[:3], "", remedy)
        if rows.shape[1] == 6:
            fastest = rows[np.argmax(_excess_km_s(rows))]
            check_velocity(name, ("vx", "vy", "vz"), fastest, "", remedy)
    except InputFileError as error:
        raise ConfigurationError(str(error)) from None


def require_kilometers(name: str, state: ArrayLike) -> None:
    """Raise a `ConfigurationError` for a state (6,) relative to the Earth-Moon barycenter, inertial
    axes, that must be in another unit than km and km/s: beyond 10,000,000 km, or faster than
    `_FASTEST_KM_S`."""
    values = np.asarray(state, dtype=float)
    for quantity, found, most, unit in (
        ("distance", float(np.linalg.norm(values[:3])), _FURTHEST_KM, "km"),
        ("speed", float(np.linalg.norm(values[3:])), _FASTEST_KM_S, "km/s"),
    ):
        if found > most:
            raise ConfigurationError(
                f"{name}: its {quantity} from the barycenter would be {found:.3g} {unit} (at most "
                f"{most:,.0f}); give km and km/s: divide meters by 1000"
            )


def check_period(place: str, name: str, period: float, unit: str) -> None:
    """Raise an `InputFileError` for a period that is negative or longer than 1000 days."""
    days = period * TIME_UNIT_S / SECONDS_PER_DAY
    if not 0.0 <= days <= _LONGEST_DAYS:
        value = days if unit == "km" else period
        fault = "must not be negative" if days < 0.0 else f"is longer than {_LONGEST_DAYS:g} days"
        expected = "days" if unit == "km" else f"units of {TIME_UNIT_S / SECONDS_PER_DAY:.5f} days"
        raise InputFileError(f"{place}: {name} = {value:g}, taken in {expected}, {fault}")
