"""``cislunar orbits``: families of periodic orbits and their members."""

from contextlib import suppress
from typing import Any

import click

from cislunar.command.base import Group, progress
from cislunar.command.orbit_argument import members_at
from cislunar.command.table import OUTPUT, UNITS, Column, show, state_columns
from cislunar.errors import ConfigurationError

_KINDS = {
    "Butterfly": "butterfly, from the halos about L2",
    "Dragonfly": "dragonfly",
    "Halo": "halo",
    "Lyap": "planar Lyapunov",
}
_HALVES = {"N": ", northern", "S": ", southern"}


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
    """List the families.

    \b
    Example:
      cislunar orbits list
    """
    from cislunar.orbits.families import FAMILIES

    meanings = []
    for family in FAMILIES:
        kind, *rest = family.split("_")
        about = f" about {rest[0]}" if rest[0].startswith("L") else ""
        meanings.append(f"{_KINDS[kind]}{about}{_HALVES.get(rest[-1], '')}")
    show([Column("family", FAMILIES), Column("orbits", meanings)], output)


@orbits.command()
@click.argument("families", nargs=-1, metavar="[FAMILY]...")
@click.option("--jacobi", type=float, metavar="VALUE", help="All members of this Jacobi constant.")
@click.option("--period", type=float, metavar="DAYS", help="All members of this period.")
@click.option("--count", type=click.IntRange(min=1), help="This many, evenly along the family.")
@UNITS
@OUTPUT
def members(
    families: tuple[str, ...],
    jacobi: float | None,
    period: float | None,
    count: int | None,
    units: str,
    output: str | None,
) -> None:
    """Members of families (of all, if none is named), one row each.

    Exactly one of --jacobi, --period and --count. States are at the crossing of the xz plane that
    counts as epoch. In km the file can be the table of moving targets of a study of one's own.

    \b
    Examples:
      cislunar orbits members Halo_L2_S --jacobi 3.05
      cislunar orbits members Lyap_L1 Halo_L1_N --period 12
      cislunar orbits members --count 5 --output orbits.csv
    """
    from cislunar.constants import SECONDS_PER_DAY, TIME_UNIT_S
    from cislunar.orbits.families import FAMILIES, concatenate, observer_library, root_of

    if sum(value is not None for value in (jacobi, period, count)) != 1:
        raise click.UsageError("give exactly one of --jacobi, --period and --count")
    for family in families:
        root_of(family)
    chosen = [*dict.fromkeys(families)] or [*FAMILIES]
    if count is not None:
        found = observer_library(dict.fromkeys(chosen, count), progress=progress("orbits"))
    else:
        quantity, value = ("jacobi", jacobi) if period is None else ("period", period)
        found = concatenate(_those_with(chosen, quantity, value))
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


def _those_with(families: list[str], quantity: str, value: float) -> list[Any]:
    """Members of each family that has any."""
    if len(families) == 1:
        return [members_at(families[0], quantity, value)]
    report, found = progress("families"), []
    for done, family in enumerate(families, start=1):
        with suppress(ConfigurationError):
            found.append(members_at(family, quantity, value))
        report(done, len(families))
    if not found:
        raise ConfigurationError(f"no member of {', '.join(families)} has {quantity} = {value:g}")
    return found
