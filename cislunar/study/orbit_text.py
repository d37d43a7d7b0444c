"""Orbits in one line of text, for studies and commands: a member of a family, or a state."""

from collections.abc import Mapping
from math import isfinite
from typing import Any, NamedTuple

from cislunar.errors import ConfigurationError, placed

COMPONENTS = ("x", "y", "z", "vx", "vy", "vz")
"""Components of a state."""

FORM = (
    "An ORBIT is FAMILY,jacobi=VALUE or FAMILY,period=DAYS, with ,member=N if several members "
    "have that value, and ,phase=FRACTION of the period to start at a later point; or a state "
    "x,y,z,vx,vy,vz in the rotating frame of Earth and Moon, origin at their barycenter."
)


class Orbit(NamedTuple):
    """State at the epoch, shape (6,), nondimensional, rotating frame; period 0 if not periodic."""

    state: Any
    period: float
    family: str = "own"

    def states(self, times: Any) -> Any:
        """States at nondimensional times since the epoch, shape (time, 6), rotating frame."""
        from cislunar.dynamics.propagation import propagate, propagate_periodic

        if self.period > 0.0:
            return propagate_periodic(self.state, self.period, times)
        return propagate(self.state, times)


def members_of(
    family: str,
    *,
    jacobi: Any = None,
    period: Any = None,
    stability: Any = None,
    count: int | None = None,
    clear: bool = True,
    **progress: Any,
) -> Any:
    """`periodic_orbits` with the period in days, which always returns at least one member.

    Raises
    ------
    ConfigurationError
        If the family is unknown or has no such member; the message gives the range of the family.
    """
    from cislunar.orbits.catalog import periodic_orbits

    given = {"jacobi": jacobi, "period_days": period, "stability": stability}
    members = periodic_orbits(family, **given, count=count, clear=clear, **progress)
    if not members.period.size:
        raise ConfigurationError(f"no member of {family} lies within these ranges; raise --count")
    return members


def read_orbit(text: str, units: str = "km", remedy: str = "") -> Orbit:
    """The orbit that a text describes.

    Parameters
    ----------
    text : str
        See `FORM`.
    units : {"km", "nd"}
        Whether a state is in km and km/s, or nondimensional.
    remedy : str
        Added to the message about a state that must be in other units.

    Returns
    -------
    Orbit

    Raises
    ------
    ConfigurationError, InputFileError
        If the text describes no orbit; the message gives the reason.
    """
    first, *rest = (part.strip() for part in text.split(","))
    place = f"orbit {text!r}"
    try:
        float(first)
    except ValueError:
        return _member(place, first, rest)
    numbers = [_number(place, part) for part in (first, *rest)]
    if len(numbers) != 6:
        raise ConfigurationError(f"{place}: a state is six finite numbers x,y,z,vx,vy,vz")
    return Orbit(state_of(place, numbers, "km" if units == "km" else "", remedy), 0.0)


def _number(place: str, part: str) -> float:
    try:
        if isfinite(number := float(part)):
            return number
    except ValueError:
        pass
    raise ConfigurationError(f"{place}: {part!r} is not a number")


def state_of(place: str, given: Any, unit: str, remedy: str = "") -> Any:
    """A state (6,), nondimensional, rotating frame, of six numbers in km and km/s (`unit` "km"), or
    nondimensional ones (""); refuses impossible ones, with the remedy."""
    import numpy as np

    from cislunar.constants import LENGTH_UNIT_KM, TIME_UNIT_S
    from cislunar.exchange.table_rows import check_state
    from cislunar.runtime.arguments import array_of

    state = array_of(place, given, (6,))
    if unit:
        state = state / np.repeat([LENGTH_UNIT_KM, LENGTH_UNIT_KM / TIME_UNIT_S], 3)
    check_state(place, COMPONENTS, state, unit, remedy)
    return state


def _member(place: str, family: str, options: list[str]) -> Orbit:
    given = {}
    for option in options:
        key, _, value = (part.strip() for part in option.partition("="))
        if key not in ("jacobi", "period", "member", "phase") or key in given:
            raise ConfigurationError(
                f"{place}: {option!r} is not one of jacobi=, period= (days), member= and phase=, "
                "each once"
            )
        given[key] = _number(place, value)
    return member_of(place, family, given)


def member_of(place: str, family: str, given: Mapping[str, float]) -> Orbit:
    """A single member of a family, at its phase, by one of `jacobi` and `period` (days), and
    optionally `member`, counted from 1, and `phase`, a fraction of the period. A
    `ConfigurationError` that begins with `place` if the family has no such member, or several."""
    import numpy as np

    from cislunar.constants import SECONDS_PER_DAY, TIME_UNIT_S
    from cislunar.dynamics.propagation import propagate_periodic

    chosen = {key: given[key] for key in ("jacobi", "period") if key in given}
    if len(chosen) != 1:
        raise ConfigurationError(
            f"{place}: give the Jacobi constant or the period in days of the member of {family}, "
            "and only one of them"
        )
    with placed(place):
        members = members_of(family, **chosen)
    number = given.get("member", 1.0 if members.period.size == 1 else 0.0)
    if number not in range(1, members.period.size + 1):
        raise ConfigurationError(
            f"{place}: {family} has {members.period.size} such members; add member=N, "
            f"counted from 1, of those with Jacobi constants {members.jacobi.round(4).tolist()} "
            "and periods of "
            f"{(members.period * TIME_UNIT_S / SECONDS_PER_DAY).round(3).tolist()} days"
        )
    state, period = members.state[int(number) - 1], float(members.period[int(number) - 1])
    if phase := given.get("phase"):
        (state,) = propagate_periodic(state, period, np.array([phase % 1.0 * period]))
    return Orbit(state, period, family)
