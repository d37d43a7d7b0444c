"""``cislunar see``: visibility and brightness of a target for an observer."""

import click

from cislunar.command.base import Command
from cislunar.command.table import (
    OUTPUT,
    POSITIVE,
    TIME_SYSTEM,
    UNITS,
    Column,
    Number,
    NumberRange,
    orbit_of,
    show,
)
from cislunar.study.orbit_text import FORM


@click.command(cls=Command, epilog=FORM)
@click.option("--observer", metavar="ORBIT", required=True, help="Orbit of the observer.")
@click.option("--target", metavar="ORBIT", required=True, help="Orbit of the target.")
@click.option(
    "--epoch", metavar="DATE", default="2024-10-01", show_default=True, help="UTC, ISO 8601."
)
@click.option(
    "--hours", type=NumberRange(min=0.0), default=24.0, show_default=True, help="Duration."
)
@click.option(
    "--step", type=POSITIVE, default=60.0, show_default=True, help="Minutes between rows."
)
@click.option(
    "--radius", type=POSITIVE, default=1.0, show_default=True, help="Radius of the target, m."
)
@click.option(
    "--limit", type=Number(), default=18.0, show_default=True, help="Limiting magnitude, mag."
)
@TIME_SYSTEM
@UNITS
@OUTPUT
def see(
    observer: str,
    target: str,
    epoch: str,
    hours: float,
    step: float,
    radius: float,
    limit: float,
    time_system: str,
    units: str,
    output: str | None,
) -> None:
    """Show when an observer sees a target, and how bright it is.

    The target is a white diffuse sphere. It is seen if it is bright enough, farther from Sun, Moon
    and Earth than the exclusion angles (35, 5, 15 degrees), and not hidden by Moon or Earth. The
    phase angle is that at the target; the other angles are those at the observer.

    \b
    Example:
      cislunar see --observer Halo_L2_S,period=6.5 --target Lyap_L2,period=15 --radius 2
    """
    import numpy as np

    from cislunar.ephemeris.sampling import sample_ephemeris
    from cislunar.ephemeris.time_scales import clock_text, julian_date, tdb_after, tdb_to_clock
    from cislunar.errors import placed
    from cislunar.observation.measurement import DETECTED, EXCLUDED, FAINT, OCCULTED
    from cislunar.observation.sensor import Sensor
    from cislunar.observation.sightings import sightings
    from cislunar.runtime.progress import logger

    with placed(f"--epoch {epoch}"):
        start = julian_date(epoch)
    with placed(f"--epoch {epoch}, --hours {hours:g}"):
        sky = sample_ephemeris(start, hours / 24.0, step)
    positions = [orbit_of(text, units).states(sky.time)[:, :3] for text in (observer, target)]
    sensor = Sensor(limiting_magnitude=limit)
    found = sightings(*positions, sky.sun_position, sensor, radius_m=radius)
    words = {DETECTED: "seen", FAINT: "faint", EXCLUDED: "excluded", OCCULTED: "occulted"}
    clock = tdb_to_clock(tdb_after(sky.et[0], sky.et - sky.et[0]), time_system)
    show(
        [
            Column(f"time_{time_system.lower()}", [clock_text(second) for second in clock]),
            Column("sight", [words[code] for code in found.outcome.tolist()]),
            Column("magnitude_mag", found.magnitude, ".2f"),
            Column("range_km", found.range_km, ".1f"),
            Column("phase_angle_deg", found.phase_angle_deg, ".1f"),
            *(
                Column(f"{body}_angle_deg", angle, ".1f")
                for body, angle in zip(
                    ("sun", "moon", "earth"), found.body_angle_deg.T, strict=True
                )
            ),
        ],
        output,
    )
    logger.info("seen at %d of %d times", np.sum(found.outcome == DETECTED), found.outcome.size)
