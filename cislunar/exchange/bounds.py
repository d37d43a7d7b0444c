"""States and periods that cannot be meant: numbers in another unit than their column's.

Places and speeds differ by powers of ten from one unit to another, so that a wide bound finds a
table in the wrong one without refusing any object that is tracked near Earth and Moon.
"""

from collections.abc import Sequence

import numpy as np

from cislunar.constants import LENGTH_UNIT_KM, MU, SECONDS_PER_DAY, TIME_UNIT_S
from cislunar.errors import InputFileError

FURTHEST_KM = 10_000_000.0
"""From the barycenter."""

LARGEST_EXCESS_KM_S = 10.0
"""Speed that an object would have left on escape from Earth and Moon."""

LONGEST_DAYS = 1000.0
"""Period of an orbit."""

_SPEED = LENGTH_UNIT_KM / TIME_UNIT_S


def check_position(
    place: str, names: Sequence[str], position: Sequence[float], unit: str, mend: str = ""
) -> None:
    """Refuse a place beyond `FURTHEST_KM`.

    `place` is where the row stands, `names` its columns, `position` (3,) nondimensional, `unit`
    (``km`` or none) that of the columns, and `mend` what else to do; an `InputFileError` in a line.
    """
    distance = LENGTH_UNIT_KM * float(np.linalg.norm(position))
    if distance > FURTHEST_KM:
        worst = int(np.argmax(np.abs(position)))
        length = 1.0 if unit == "km" else LENGTH_UNIT_KM
        value = position[worst] * LENGTH_UNIT_KM / length
        expected = "km" if unit == "km" else f"units of {LENGTH_UNIT_KM:g} km"
        raise InputFileError(
            f"{place}: {names[worst]} = {value:g} is taken in {expected}, which puts it "
            f"{distance:.3g} km from the barycenter, beyond {FURTHEST_KM:,.0f} km{mend}"
        )


def check_velocity(
    place: str, names: Sequence[str], state: Sequence[float], unit: str, mend: str = ""
) -> None:
    """Refuse a speed with which an object escapes faster than `LARGEST_EXCESS_KM_S`.

    As `check_position`, of the velocity in a nondimensional state (6,) in the rotating frame.
    """
    x, y, z, vx, vy, vz = state
    speed2 = (vx - y) ** 2 + (vy + x) ** 2 + vz**2  # without the turn of the frame
    escape2 = 2.0 * ((1.0 - MU) / np.hypot(np.hypot(x + MU, y), z))
    escape2 += 2.0 * MU / np.hypot(np.hypot(x - 1.0 + MU, y), z)
    excess = _SPEED * np.sqrt(max(speed2 - escape2, 0.0))
    if excess > LARGEST_EXCESS_KM_S:
        worst = int(np.argmax(np.abs(state[3:])))
        value = state[3 + worst] * (_SPEED if unit == "km" else 1.0)
        expected = "km/s" if unit == "km" else f"units of {_SPEED:.5f} km/s"
        raise InputFileError(
            f"{place}: {names[worst]} = {value:g} is taken in {expected}, which is faster than "
            f"escape from there by {excess:.3g} km/s (at most {LARGEST_EXCESS_KM_S:g}){mend}"
        )


def check_period(place: str, name: str, period: float, unit: str) -> None:
    """Refuse a negative period, and one beyond `LONGEST_DAYS`; as `check_position`."""
    days = period * TIME_UNIT_S / SECONDS_PER_DAY
    if not 0.0 <= days <= LONGEST_DAYS:
        value = days if unit == "km" else period
        fault = "must not be negative" if days < 0.0 else f"is longer than {LONGEST_DAYS:g} days"
        expected = "days" if unit == "km" else f"units of {TIME_UNIT_S / SECONDS_PER_DAY:.5f} days"
        raise InputFileError(f"{place}: {name} = {value:g}, taken in {expected}, {fault}")
