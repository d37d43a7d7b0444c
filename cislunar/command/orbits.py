"""``cislunar orbits``: families of periodic orbits and their members."""

import logging
from contextlib import suppress
from typing import Any

import click

from cislunar.command.base import Group, progress
from cislunar.command.orbit_argument import members_of
from cislunar.command.table import OUTPUT, UNITS, Column, show, state_columns
from cislunar.errors import ConfigurationError

logger = logging.getLogger("cislunar")


class Wanted(click.ParamType):
    """A value, or a range LOW:HIGH."""

    name = "VALUE|LOW:HIGH"

    def convert(self, value: Any, param: Any, ctx: Any) -> float | tuple[float, float]:
        """The number, or the two."""
        if not isinstance(value, str):
            return value
        try:
            numbers = tuple(float(part) for part in value.split(":"))
        except ValueError:
            numbers = ()
        if len(numbers) not in (1, 2):
            self.fail(f"{value!r} is no number and no range LOW:HIGH", param, ctx)
        return numbers[0] if len(numbers) == 1 else numbers


@click.group(cls=Group)
def orbits() -> None:
    """Families of periodic orbits, and their members.

    \b
    Examples:
      cislunar orbits list
      cislunar orbits members Halo_L2_S --jacobi 3.05
    """


@orbits.command("list")
@OUTPUT
def list_families(output: str | None) -> None:
    """List the families and where they end.

    Values of x at the crossing, of the period and of the Jacobi constant are nondimensional.

    \b
    Example:
      cislunar orbits list
    """
    from cislunar.orbits.catalogue import CATALOGUE, end_in_words

    meanings = [family.meaning for family in CATALOGUE.values()]
    ends = [end_in_words(family) for family in CATALOGUE.values()]
    show([Column("family", [*CATALOGUE]), Column("orbits", meanings), Column("end", ends)], output)


@orbits.command()
@click.argument("families", nargs=-1, metavar="[FAMILY]...")
@click.option("--jacobi", type=Wanted(), help="Of this Jacobi constant, or within a range.")
@click.option("--period", type=Wanted(), help="Of this period, or within a range, days.")
@click.option("--stability", type=Wanted(), help="Of this stability index, or within a range.")
@click.option("--count", type=click.IntRange(min=1), help="This many, evenly along the family.")
@click.option("--through", is_flag=True, help="Orbits through the Earth or the Moon too.")
@UNITS
@OUTPUT
def members(
    families: tuple[str, ...],
    jacobi: float | tuple[float, float] | None,
    period: float | tuple[float, float] | None,
    stability: float | tuple[float, float] | None,
    count: int | None,
    through: bool,
    units: str,
    output: str | None,
) -> None:
    """Members of families, one row each.

    If no family is named, of the observers' thirteen. One value of --jacobi, --period or
    --stability that members have, or --count of them, evenly along the family; ranges LOW:HIGH
    leave out what lies beyond. Orbits through the Earth or the Moon, where some families end, are
    left out without --through. In km the file can be the table of moving targets of a study of
    one's own.

    \b
    Examples:
      cislunar orbits members Halo_L2_S --jacobi 3.05
      cislunar orbits members Lyap_L1 Halo_L1_N --period 12
      cislunar orbits members Vertical_L2 --count 40 --stability 1:20
      cislunar orbits members Halo_L3_N --count 5 --through
    """
    from cislunar.constants import SECONDS_PER_DAY, TIME_UNIT_S
    from cislunar.orbits.catalogue import family_named
    from cislunar.orbits.families import FAMILIES, concatenate

    asked = {"jacobi": jacobi, "period": period, "stability": stability, "count": count}
    if all(value is None for value in asked.values()):
        raise click.UsageError("give one of --jacobi, --period, --stability and --count")
    for family in families:
        family_named(family)
    chosen = [*dict.fromkeys(families)] or [*FAMILIES]
    found = concatenate(_members(chosen, asked, clear=not through))
    names = found.family.tolist()
    number = [1 + names[:row].count(name) for row, name in enumerate(names)]
    days = found.period * TIME_UNIT_S / SECONDS_PER_DAY
    length = (
        Column("period_days", days, ".5f")
        if units == "km"
        else Column("period_nd", found.period, ".9f")
    )
    show(
        [
            Column("id", [f"{name}_{k}" for name, k in zip(names, number, strict=True)]),
            Column("family", names),
            *state_columns(found.state, units),
            length,
            Column("jacobi_nd", found.jacobi, ".6f"),
            Column("stability_index", found.stability_index, ".3f"),
            Column("perilune_km", found.perilune_km, ".1f"),
            Column("perigee_km", found.perigee_km, ".1f"),
        ],
        output,
    )


def _members(families: list[str], asked: dict[str, Any], *, clear: bool) -> list[Any]:
    """Members of each family that has any; a single family has to."""
    steps = "members followed, iterations"
    if len(families) == 1:
        counted = {"progress": progress("orbits"), "following": progress(steps)}
        found = members_of(families[0], **asked, clear=clear, **counted)
        _say_if_several(found, asked)
        return [found]
    report, found = progress("families"), []
    for done, family in enumerate(families, start=1):
        with suppress(ConfigurationError):
            found.append(members_of(family, **asked, clear=clear, following=progress(steps)))
            _say_if_several(found[-1], asked)
        report(done, len(families))
    if not found:
        wanted = ", ".join(f"{key} = {each}" for key, each in asked.items() if each is not None)
        raise ConfigurationError(f"no member of {', '.join(families)} has {wanted}")
    return found


def _say_if_several(found: Any, asked: dict[str, Any]) -> None:
    """A value may be that of several members, which one easily takes for one."""
    for key, value in asked.items():
        if isinstance(value, float) and found.period.size > 1:
            logger.info(
                "%d members of %s have %s = %g", found.period.size, found.family[0], key, value
            )
