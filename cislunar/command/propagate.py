"""``cislunar propagate``: a trajectory in the three-body problem."""

import click

from cislunar.command.base import Command
from cislunar.command.table import OUTPUT, UNITS, Column, Number, orbit_of, show, state_columns
from cislunar.study.orbit_text import FORM


@click.command(cls=Command, epilog=FORM)
@click.option("--orbit", metavar="ORBIT", required=True, help="Initial orbit or state.")
@click.option("--days", type=Number(), required=True, help="Duration; negative: backwards.")
@click.option(
    "--steps",
    type=click.IntRange(1, 1_000_000),
    default=20,
    show_default=True,
    help="Number of steps.",
)
@UNITS
@OUTPUT
def propagate(orbit: str, days: float, steps: int, units: str, output: str | None) -> None:
    """Propagate an orbit or a state in the three-body problem.

    The model is the circular restricted problem of Earth and Moon, in its rotating frame.

    \b
    Examples:
      cislunar propagate --orbit Halo_L2_S,period=6.5 --days 6.5
      cislunar propagate --units nd --orbit 1.12,0,0.18,0,-0.22,0 --days 3 --output path.csv
    """
    import numpy as np

    from cislunar.constants import LENGTH_UNIT_KM, SECONDS_PER_DAY, TIME_UNIT_S
    from cislunar.dynamics.cr3bp import primary_distances
    from cislunar.dynamics.propagation import propagate
    from cislunar.errors import placed

    start = orbit_of(orbit, units)
    elapsed = np.linspace(0.0, days, steps + 1)
    with placed(f"--orbit {orbit}, --days {days:g}"):
        states = propagate(start.state, elapsed * SECONDS_PER_DAY / TIME_UNIT_S)
    earth, moon = primary_distances(states[:, :3])
    show(
        [
            Column("elapsed_days", elapsed, ".5f"),
            *state_columns(states, units),
            Column("earth_distance_km", earth * LENGTH_UNIT_KM, ".1f"),
            Column("moon_distance_km", moon * LENGTH_UNIT_KM, ".1f"),
        ],
        output,
    )
