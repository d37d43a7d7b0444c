"""Tables that commands print or write."""

import csv
import io
from collections.abc import Sequence
from math import isfinite
from typing import Any, NamedTuple

import click


class Column(NamedTuple):
    """Values under a name that tells their unit; `form` is how the terminal shows them."""

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
    help="Of states given and shown: km and km/s, or Earth-Moon distances and 1/n.",
)


class Number(click.FloatRange):
    """A finite number within bounds."""

    def convert(self, value: Any, param: Any, ctx: Any) -> float:
        """The number."""
        number = super().convert(value, param, ctx)
        if not isfinite(number):
            self.fail(f"{value} is no finite number.", param, ctx)
        return number


POSITIVE = Number(min=0.0, min_open=True)


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
    """Print a table, or write it whole or not at all."""
    columns = [
        c._replace(values=getattr(c.values, "tolist", lambda v=c.values: [*v])()) for c in columns
    ]
    if output is None:
        click.echo(_aligned(columns))
    elif output == "-":
        click.echo(in_csv(columns), nl=False)
    else:
        from cislunar.campaign.data.netcdf import write_text
        from cislunar.campaign.data.progress import logger

        write_text(in_csv(columns), output)
        logger.info("%d rows in %s", len(columns[0].values), output)


def state_columns(states: Any, units: str) -> list[Column]:
    """States, shape (n, 6), nondimensional, rotating frame, as columns that name unit and frame."""
    from cislunar.constants import LENGTH_UNIT_KM, TIME_UNIT_S

    if units == "nd":
        lengths, speeds, forms = ("_nd", 1.0), ("_nd", 1.0), (".9f", ".9f")
    else:
        lengths, speeds = ("_km", LENGTH_UNIT_KM), ("_km_s", LENGTH_UNIT_KM / TIME_UNIT_S)
        forms = (".3f", ".6f")
    columns = []
    for place, name in enumerate(("x", "y", "z", "vx", "vy", "vz")):
        unit, factor = speeds if place >= 3 else lengths
        columns.append(Column(name + unit, states[:, place] * factor, forms[place // 3]))
    return [*columns, Column("frame", ["rotating"] * len(states))]
