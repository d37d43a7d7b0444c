"""Quantities of `astropy.units` as numbers in the units of this library.

Astropy is not needed: an object with the method `to_value` and the attribute `unit` is a quantity,
and one with the attributes `utc` and `isot` an `astropy.time.Time`.
"""

import datetime
from typing import Any, Literal

import numpy as np

from cislunar.constants import LENGTH_UNIT_KM, TIME_UNIT_S
from cislunar.errors import ConfigurationError

_NONDIMENSIONAL = {
    "length": {"km": LENGTH_UNIT_KM},
    "time": {"s": TIME_UNIT_S},
    "state": {"km": LENGTH_UNIT_KM, "km/s": LENGTH_UNIT_KM / TIME_UNIT_S},
}


def is_quantity(given: Any) -> bool:
    """Whether a value is a quantity of `astropy.units`."""
    return hasattr(given, "to_value") and hasattr(given, "unit")


def in_unit(name: str, given: Any, unit: str) -> Any:
    """The number of a quantity in a unit; anything else as it is.

    Parameters
    ----------
    name : str
        Name of the argument, for messages.
    given : Any
        A quantity, or a value without a unit.
    unit : str
        Unit as `astropy.units` writes it; "" or "1" if the value has none.

    Returns
    -------
    float, ndarray or Any
        The value in `unit`, a float for a scalar quantity.

    Raises
    ------
    ConfigurationError
        If the quantity cannot be converted.
    """
    if not is_quantity(given):
        return given
    try:
        value = given.to_value("" if unit == "1" else unit.replace("^", "**"))
    except (ValueError, TypeError):  # of which the errors of astropy.units are
        words = " ".join(str(given).split())
        raise ConfigurationError(
            f"{name} = {words} cannot be converted to {unit or 'a number without a unit'}"
        ) from None
    return value.item() if getattr(value, "ndim", 1) == 0 else value


def nondimensional(name: str, given: Any, kind: Literal["length", "time", "state"]) -> Any:
    """The nondimensional numbers of quantities; anything else as it is.

    Parameters
    ----------
    name : str
        Name of the argument, for messages.
    given : Any
        A quantity, or for a state a sequence of quantities: position and velocity, or components.
    kind : {"length", "time", "state"}
        What the quantity is.

    Returns
    -------
    float, ndarray or Any
        In the units of the CR3BP (`cislunar.constants`).

    Raises
    ------
    ConfigurationError
        If a quantity cannot be converted.
    """
    return _in_units(name, given, _NONDIMENSIONAL[kind])


def in_kilometers(name: str, given: Any) -> Any:
    """A state of quantities in km and km/s, see `nondimensional`; anything else as it is."""
    return _in_units(name, given, {"km": 1.0, "km/s": 1.0})


def _in_units(name: str, given: Any, units: dict[str, float]) -> Any:
    """Quantities in the first of some units that fits, divided by its size."""
    if isinstance(given, tuple | list) and given and all(map(is_quantity, given)):
        # of a state, which has two units, the first half is the position
        one = [{unit: size} for unit, size in units.items()]
        parts = [_in_units(name, x, one[len(one) * k // len(given)]) for k, x in enumerate(given)]
        return np.concatenate([np.ravel(part) for part in parts])
    if not is_quantity(given):
        return given
    if len(units) == 2:
        raise ConfigurationError(f"{name}: give (position, velocity), each with its own unit")
    for unit, size in units.items():
        try:
            return in_unit(name, given, unit) / size
        except ConfigurationError:
            continue
    words = " ".join(str(given).split())
    raise ConfigurationError(f"{name} = {words} cannot be converted to {' or '.join(units)}")


def date_of(given: Any) -> Any:
    """ISO 8601 date, UTC, of an `astropy.time.Time` or a date of `datetime`, NumPy or pandas, which
    are in UTC unless they state a time zone; anything else as it is."""
    if hasattr(given, "utc") and hasattr(given, "isot"):
        if not given.isscalar:
            raise ConfigurationError(f"give one date instead of {given.size}")
        moment = given.utc.copy()
        moment.precision = 6
        return str(moment.isot)
    if isinstance(given, np.datetime64):
        return str(given.astype("datetime64[us]"))
    if isinstance(given, datetime.datetime) and given.tzinfo:
        given = given.astimezone(datetime.UTC).replace(tzinfo=None)
    return given.isoformat() if isinstance(given, datetime.date) else given
