"""Orbits in one line of text, for studies and commands: a member of a family, or a state."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from cislunar.errors import ConfigurationError

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


def read_orbit(text: str, units: str) -> Orbit:
    """The orbit that a text describes.

    Parameters
    ----------
    text : str
        See `FORM`.
    units : {"km", "nd"}
        Whether a state is in km and km/s, or nondimensional.

    Returns
    -------
    Orbit

    Raises
    ------
    ConfigurationError
        If the text describes no orbit; the message gives the reason.
    """
    first, *rest = (part.strip() for part in text.split(","))
    try:
        float(first)
    except ValueError:
        return _member(text, first, rest)
    return Orbit(_state(text, [first, *rest], units), 0.0)


def _number(text: str, part: str) -> float:
    try:
        return float(part)
    except ValueError:
        raise ConfigurationError(f"orbit {text!r}: {part!r} is not a number") from None


def _state(text: str, parts: list[str], units: str) -> Any:
    import numpy as np

    from cislunar.constants import LENGTH_UNIT_KM, MU, TIME_UNIT_S
    from cislunar.dynamics.bounds import check_position, check_velocity
    from cislunar.dynamics.cr3bp import primary_positions
    from cislunar.observation.sightline import inside_primary

    state = np.array([_number(text, part) for part in parts])
    if state.size != 6 or not np.all(np.isfinite(state)):
        raise ConfigurationError(f"orbit {text!r}: a state is six finite numbers x,y,z,vx,vy,vz")
    if units == "km":
        state[:3] /= LENGTH_UNIT_KM
        state[3:] *= TIME_UNIT_S / LENGTH_UNIT_KM
    if inside_primary(*state[:3], primary_positions(MU)):
        raise ConfigurationError(
            f"orbit {text!r}: in units {units} this is a position inside the Earth or the Moon"
        )
    unit = "km" if units == "km" else ""
    check_position(f"orbit {text!r}", ("x", "y", "z"), state[:3], unit, "; see --units")
    check_velocity(f"orbit {text!r}", ("vx", "vy", "vz"), state, unit, "; see --units")
    return state


def _member(text: str, family: str, options: list[str]) -> Orbit:
    given = {}
    for option in options:
        key, _, value = option.partition("=")
        if key not in ("jacobi", "period", "member", "phase") or key in given:
            raise ConfigurationError(
                f"orbit {text!r}: {option!r} is not one of jacobi=, period=, member= and phase=, "
                "each once"
            )
        given[key] = _number(text, value)
    chosen = [key for key in ("jacobi", "period") if key in given]
    if len(chosen) != 1:
        raise ConfigurationError(f"orbit {text!r}: give either jacobi= or period=, and only one")
    return member_of(f"orbit {text!r}", family, given)


def member_of(place: str, family: str, given: Mapping[str, float]) -> Orbit:
    """A single member of a family, at its phase.

    Parameters
    ----------
    place : str
        What is specified, for messages.
    family : str
        Name of the family.
    given : mapping
        One of `jacobi` and `period` (days), and optionally `member`, counted from 1, and `phase`,
        a fraction of the period.

    Returns
    -------
    Orbit

    Raises
    ------
    ConfigurationError
        If the family has no such member, or several.
    """
    import numpy as np

    from cislunar.constants import SECONDS_PER_DAY, TIME_UNIT_S
    from cislunar.dynamics.propagation import propagate_periodic

    quantity = "jacobi" if "jacobi" in given else "period"
    members = members_of(family, **{quantity: given[quantity]})
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
