"""``cislunar orbits``: families of periodic orbits and their members."""

import logging
from contextlib import suppress
from typing import Any

import click

from cislunar.command.base import Group, progress
from cislunar.command.table import OUTPUT, UNITS, Column, show, state_columns
from cislunar.errors import ConfigurationError
from cislunar.study.orbit_text import members_of

logger = logging.getLogger("cislunar")


class ValueOrRange(click.ParamType):
    """A value, or a range LOW:HIGH."""

    name = "VALUE|LOW:HIGH"

    def convert(self, value: Any, param: Any, ctx: Any) -> float | tuple[float, float]:
        """The number, or both ends of the range."""
        if not isinstance(value, str):
            return value
        try:
            numbers = tuple(float(part) for part in value.split(":"))
        except ValueError:
            numbers = ()
        if len(numbers) not in (1, 2):
            self.fail(f"{value!r} is neither a number nor a range LOW:HIGH", param, ctx)
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
    """List the families and their ends.

    Values of x at the crossing, of the period and of the Jacobi constant are nondimensional.

    \b
    Example:
      cislunar orbits list
    """
    from cislunar.orbits.catalog import CATALOG, end_in_words

    meanings = [family.meaning for family in CATALOG.values()]
    ends = [end_in_words(family) for family in CATALOG.values()]
    show([Column("family", [*CATALOG]), Column("orbits", meanings), Column("end", ends)], output)


@orbits.command()
@click.argument("families", nargs=-1, metavar="[FAMILY]...")
@click.option("--jacobi", type=ValueOrRange(), help="Jacobi constant, or range of it.")
@click.option("--period", type=ValueOrRange(), help="Period, or range of it, days.")
@click.option("--stability", type=ValueOrRange(), help="Stability index, or range of it.")
@click.option(
    "--count", type=click.IntRange(min=1), help="Number of members, evenly along the family."
)
@click.option("--through", is_flag=True, help="Include orbits through the Earth or the Moon.")
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
    """List members of families, one row each.

    Without a FAMILY, the thirteen families of observers are listed. Give one value of --jacobi,
    --period or --stability, or --count for members evenly along the family; ranges LOW:HIGH
    restrict the result. Orbits through the Earth or the Moon, where some families end, are excluded
    unless --through is given. An id has the family, the Jacobi constant and the period in days.

    With units km, the file can serve as table of moving targets of a user-defined study, in which
    each target starts at its state. With the column orbit_period_days renamed to period_days, each
    starts at a random point of its orbit.

    \b
    Examples:
      cislunar orbits members Halo_L2_S --jacobi 3.05
      cislunar orbits members Lyap_L1 Halo_L1_N --period 12
      cislunar orbits members Vertical_L2 --count 40 --stability 1:20
      cislunar orbits members Halo_L3_N --count 5 --through
    """
    from cislunar.constants import SECONDS_PER_DAY, TIME_UNIT_S
    from cislunar.orbits.catalog import family_named
    from cislunar.orbits.families import FAMILIES, concatenate

    filters = {"jacobi": jacobi, "period": period, "stability": stability, "count": count}
    if all(value is None for value in filters.values()):
        raise click.UsageError("give one of --jacobi, --period, --stability and --count")
    for family in families:
        family_named(family)
    chosen = [*dict.fromkeys(families)] or [*FAMILIES]
    found = concatenate(_members(chosen, filters, clear=not through))
    days = found.period * TIME_UNIT_S / SECONDS_PER_DAY
    # a table of targets would take period_days as the request of a random start
    length = (
        Column("orbit_period_days", days, ".5f")
        if units == "km"
        else Column("period_nd", found.period, ".9f")
    )
    show(
        [
            Column("id", _ids(found.family.tolist(), found.jacobi, days)),
            Column("family", found.family),
            *state_columns(found.state, units),
            length,
            Column("jacobi_nd", found.jacobi, ".6f"),
            Column("stability_index", found.stability_index, ".3f"),
            Column("perilune_km", found.perilune_km, ".1f"),
            Column("perigee_km", found.perigee_km, ".1f"),
        ],
        output,
    )


def _ids(families: list[str], jacobi: Any, days: Any) -> list[str]:
    """Ids of members, unique among the tables of several calls too."""
    ids: list[str] = []
    for family, constant, period in zip(families, jacobi, days, strict=True):
        name = f"{family}_{constant:.6f}_{period:.5f}"
        same = sum(each == name or each.startswith(f"{name}_") for each in ids)
        ids.append(f"{name}_{same + 1}" if same else name)
    return ids


def _members(families: list[str], filters: dict[str, Any], *, clear: bool) -> list[Any]:
    """Members of each family that has any; a single family must have one."""
    steps = "members followed, iterations"
    if len(families) == 1:
        counted = {"progress": progress("orbits"), "following": progress(steps)}
        found = members_of(families[0], **filters, clear=clear, **counted)
        _log_if_several(found, filters)
        return [found]
    report, found = progress("families"), []
    for done, family in enumerate(families, start=1):
        with suppress(ConfigurationError):
            found.append(members_of(family, **filters, clear=clear, following=progress(steps)))
            _log_if_several(found[-1], filters)
        report(done, len(families))
    if not found:
        conditions = ", ".join(
            f"{key} = {each}" for key, each in filters.items() if each is not None
        )
        raise ConfigurationError(f"no member of {', '.join(families)} has {conditions}")
    return found


def _log_if_several(found: Any, filters: dict[str, Any]) -> None:
    """Log that several members share a value, because a single one may be expected."""
    for key, value in filters.items():
        if isinstance(value, float) and found.period.size > 1:
            logger.info(
                "%d members of %s have %s = %g", found.period.size, found.family[0], key, value
            )
