"""Tables that commands print or write to files."""

import csv
import io
from collections.abc import Sequence
from math import isfinite
from typing import Any, NamedTuple

import click

from cislunar.constants import DATE_SYSTEM, LENGTH_UNIT_KM, TIME_UNIT_S


class Column(NamedTuple):
    """Values under a name that includes their unit; `form` is their format on the terminal."""

    name: str
    values: Sequence[Any]
    form: str = ""


OUTPUT = click.option(
    "--output",
    metavar="FILE",
    help="Write the table to this CSV file; '-' for CSV on the terminal.",
)
UNITS = click.option(
    "--units",
    type=click.Choice(["km", "nd"]),
    default="km",
    show_default=True,
    help="Units of states: km and km/s, or nondimensional (lengths in Earth-Moon distances of "
    "384,400 km, times in 375,190 s, a month divided by 2 pi).",
)
TIME_SYSTEM = click.option(
    "--time-system",
    type=click.Choice(["UTC", "TDB"]),
    default=DATE_SYSTEM,
    show_default=True,
    help="Time scale of the dates in the table.",
)

EXPORT_TIME_SYSTEM = click.option(
    "--time-system",
    type=click.Choice(["UTC", "TAI", "TT", "TDB"]),
    default=DATE_SYSTEM,
    show_default=True,
    help="Time scale of the dates; ADES files are always in UTC.",
)


class _Finite(click.ParamType):
    """A number that is neither infinite nor undefined."""

    def convert(self, value: Any, param: Any, ctx: Any) -> float:
        """The number."""
        number = super().convert(value, param, ctx)
        if not isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return number


class Number(_Finite, type(click.FLOAT)):
    """A finite number."""


class NumberRange(_Finite, click.FloatRange):
    """A finite number within bounds."""


POSITIVE = NumberRange(min=0.0, min_open=True)


def orbit_of(text: str, units: str) -> Any:
    """`cislunar.study.orbit_text.Orbit` of a text in the units of the option."""
    from cislunar.study.orbit_text import read_orbit

    return read_orbit(text, units, "; see --units")


def in_csv(columns: Sequence[Column]) -> str:
    """The table as CSV, numbers to full precision."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([column.name for column in columns])
    writer.writerows(zip(*(column.values for column in columns), strict=True))
    return text.getvalue()


def _aligned(columns: Sequence[Column]) -> str:
    shown = [[c.name, *(format(value, c.form) for value in c.values)] for c in columns]
    widths = [max(map(len, cells)) for cells in shown]
    left = [bool(c.values) and isinstance(c.values[0], str) for c in columns]
    rows = [
        "  ".join(
            cell.ljust(width) if first else cell.rjust(width)
            for cell, width, first in zip(row, widths, left, strict=True)
        ).rstrip()
        for row in zip(*shown, strict=True)
    ]
    return "\n".join(rows)


def show(columns: Sequence[Column], output: str | None) -> None:
    """Print a table, or write it to a file, which is either complete or not written."""
    columns = [
        c._replace(values=getattr(c.values, "tolist", lambda v=c.values: [*v])()) for c in columns
    ]
    if output is None:
        click.echo(_aligned(columns))
    elif output == "-":
        click.echo(in_csv(columns), nl=False)
    else:
        from cislunar.runtime.netcdf import write_text
        from cislunar.runtime.progress import logger

        write_text(in_csv(columns), output)
        logger.info("%d rows in %s", len(columns[0].values), output)


def state_columns(states: Any, units: str) -> list[Column]:
    """Columns of states, shape (n, 6), nondimensional, rotating frame; they name unit, frame and
    origin."""
    from cislunar.exchange import EARTH_MOON_CENTER

    if units == "nd":
        lengths, speeds, forms = ("_nd", 1.0), ("_nd", 1.0), (".9f", ".9f")
    else:
        lengths, speeds = ("_km", LENGTH_UNIT_KM), ("_km_s", LENGTH_UNIT_KM / TIME_UNIT_S)
        forms = (".3f", ".6f")
    columns = []
    for index, name in enumerate(("x", "y", "z", "vx", "vy", "vz")):
        unit, factor = speeds if index >= 3 else lengths
        columns.append(Column(name + unit, states[:, index] * factor, forms[index // 3]))
    return [
        *columns,
        Column("frame", ["rotating"] * len(states)),
        Column("center", [EARTH_MOON_CENTER] * len(states)),
    ]
